# SPDX-License-Identifier: Apache-2.0
"""The look at the data: one run that is written otherwise than the rest, and what all runs share and no one run has."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import POSE, changed, flown, measured

from inductrack_ros.checks import WARNING, impossible, look
from inductrack_ros.core.model import Model

#: Speeds at which the drive carries the cradle on without touching the track, each with the current of its run.
FLIGHTS = [(7000.0, 17.0), (5000.0, 22.0), (3600.0, 26.0), (7000.0, 24.0)]


def rig(model=None, flights=FLIGHTS, current_said=None, count=301, **start):
    """Runs of a model; ``current_said`` is what campaign.yaml says of some, by number."""
    model = model or Model.default()
    starts = []
    for k, (current, speed) in enumerate(flights):
        heave = model.equilibrium_heave(speed) + 5e-4
        starts.append((current, {"surge_rate": speed, "heave": heave, "sway": (-1) ** k * 2e-3, "roll": 3e-3, **start}))
    campaign = flown(starts, POSE, count, 2e-3, model=model)
    said = current_said or {}
    runs = tuple(replace(r, drive_current=said.get(k, r.drive_current)) for k, r in enumerate(campaign.runs))
    return replace(campaign, runs=runs)


def weak_drive():
    """A rig whose drive is weak beside the drag, so that surge hardly shows it."""
    return Model.default().with_changes({"gamma": 1.2})


# ---------------------------------------------------------------- units of one run


@pytest.mark.parametrize("name", ["a", "b"])
def test_degrees_in_one_run_are_no_outliers(name, pose, model):
    """Its noise is 57 times that of the others; the run itself tells that it has no bad samples."""
    odd = replace(changed(pose, "roll", lambda y: y * 180.0 / np.pi, name), noise_std={})
    found = look(odd, model)
    assert [(f.kind, f.channel, f.size["runs"]) for f in impossible(found)] == [("unit", "roll", [name])]
    assert "outliers" not in {f.kind for f in found}


def test_lengths_of_one_run_in_inches_are_named_and_nothing_else(model):
    odd = replace(measured(count=401), noise_std={})
    for channel in ("surge", "sway", "heave"):
        odd = changed(odd, channel, lambda y: y / 0.0254, "c")
    found = impossible(look(odd, model))
    assert {f.channel for f in found} == {"surge", "sway", "heave"}
    assert all("in c" in f.text and f"'{f.channel} [in]'" in f.remedy for f in found)


def test_a_header_whose_unit_is_not_that_of_its_run_is_named(pose, model):
    """Metres below 'heave [mm]': hardly any motion is left, and the noise with it. It is no other zero."""
    odd = changed(replace(pose, noise_std={}), "heave", lambda y: 1e-3 * y, "b")
    odd = replace(odd, runs=tuple(replace(r, converted={"heave": "mm"}) if r.name == "b" else r for r in odd.runs))
    (found,) = impossible(look(odd, model))
    assert (found.kind, found.channel) == ("unit", "heave") and "the header says 'mm'" in found.remedy
    assert "0.001 times as large as they should be" in found.remedy


def test_a_fast_and_a_slow_channel_that_changed_places_are_named():
    """Windows as long as the slow one needs are too long for the other."""
    heavy = Model.default().with_changes({"gamma": 0.97, "eta": 0.745, "mass": 11.2})
    starts = [
        (7000.0, {"surge_rate": 30.0, "sway": 2e-3, "roll": 4e-3}),  # comes down on the track at its end
        (7000.0, {"surge_rate": 33.0, "roll": 0.01, "heave": -2e-3}),
        (7000.0, {"surge_rate": 40.0, "sway": 1e-3, "heave": -4e-3}),
    ]
    campaign = replace(flown(starts, POSE, 501, 4e-3, model=heavy), noise_std={})

    def exchanged(run):
        names = [{"sway": "heave", "heave": "sway"}.get(c, c) for c in run.channels]
        return replace(run, values=run.values[:, [names.index(c) for c in run.channels]]) if run.name == "a" else run

    found = impossible(look(replace(campaign, runs=tuple(map(exchanged, campaign.runs))), heavy))
    assert [f.size.get("candidates") for f in found] == [["sway", "heave"]] and found[0].size["runs"] == ["a"]


# ---------------------------------------------------------------- currents


@pytest.mark.parametrize("coasts", [1, 2])
def test_a_run_that_coasts_and_is_said_to_be_driven_is_named(coasts):
    weak = weak_drive()
    flown_so = [(0.0 if k == coasts else current, speed) for k, (current, speed) in enumerate(FLIGHTS)]
    campaign = rig(weak, flown_so, {coasts: FLIGHTS[coasts][0]})
    (found,) = impossible(look(campaign, weak))
    assert found.channel == "drive_current" and found.size["runs"] == ["abcd"[coasts]]
    assert "does nothing: the cradle coasts as measured" in found.text
    assert impossible(look(rig(weak, flown_so), weak)) == ()


def test_a_drag_that_all_runs_lack_is_no_one_runs_current():
    """It is largest in the fastest run, whose current alone would seem wrong."""
    weak = weak_drive()
    drags = weak.with_changes(effects={"aerodynamic_drag": {"drag_area": 0.2}})
    found = look(rig(drags, [(7000.0, 17.0), (7000.0, 20.0), (7000.0, 30.0)]), weak)
    assert impossible(found) == () and "drive_current" not in {f.channel for f in found}
    (unlike,) = (f for f in found if f.kind == "unlike")
    assert unlike.severity == WARNING and "alone" not in unlike.text and "a drag or a slope" in unlike.remedy


# ---------------------------------------------------------------- conditions


def test_a_run_is_held_against_the_model_under_its_own_conditions(model):
    """One run carries less, and says so."""
    light = model.with_changes({"mass": 0.3 * model.parameters["mass"]})
    mixed = rig(flights=FLIGHTS[:2])
    empty = rig(light, [(7000.0, 20.0)]).runs[0]
    given = replace(empty, name="c", conditions={"mass": light.parameters["mass"]})
    assert look(replace(mixed, runs=(*mixed.runs, given)), model) == ()
    assert look(replace(mixed, runs=(*mixed.runs, replace(given, conditions={}))), model) != ()
