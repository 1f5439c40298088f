# SPDX-License-Identifier: Apache-2.0
"""The look at the data: exchanges, zeros and clocks that only the model's motion gives away."""

from dataclasses import replace

import pytest
from test_checks import POSE, changed, flown, measured

from inductrack_ros.checks import impossible, look
from inductrack_ros.core.model import Model


@pytest.fixture(scope="module")
def model():
    return Model.default()


@pytest.fixture(scope="module")
def pose():
    return measured()


def only(campaign, name="a"):
    """The campaign with one run only, and no noise stated."""
    return replace(campaign, runs=tuple(r for r in campaign.runs if r.name == name), noise_std={})


def exchanged(campaign, pair, runs="abc"):
    """The campaign with two columns of some runs exchanged."""

    def one(run):
        columns = list(run.channels)
        a, b = (columns.index(c) for c in pair)
        columns[a], columns[b] = columns[b], columns[a]
        return replace(run, values=run.values[:, [run.channels.index(c) for c in columns]])

    return replace(campaign, runs=tuple(one(r) if r.name in runs else r for r in campaign.runs))


# ---------------------------------------------------------------- channels that changed places


@pytest.mark.parametrize("pair", [("heave", "roll"), ("sway", "roll"), ("sway", "heave")])
@pytest.mark.parametrize("runs", ["abc", "a", "b", "c"])
def test_channels_that_changed_places_are_named_once(pair, runs, pose, model):
    """Also where the cradle would stand in the track as they are written, and the forces say nothing."""
    (found,) = impossible(look(exchanged(replace(pose, noise_std={}), pair, runs), model))
    assert found.kind == "axis_flipped" and f"{' and '.join(pair)} are swapped" in found.text
    assert ("alone of 3 runs" in found.text) == (runs != "abc")


@pytest.mark.parametrize("pair", [("heave", "roll"), ("sway", "roll")])
@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_channels_of_a_single_run_that_changed_places_are_named(pair, name, pose, model):
    """Sway written in another unit would look much the same; an exchange needs no number to be right."""
    (found,) = impossible(look(exchanged(only(pose, name), pair), model))
    assert found.size["candidates"] == list(pair)


def test_a_cradle_that_lies_on_the_track_has_its_channels_in_place(model):
    """Nothing is said of forces where it touches all along."""
    lies = flown([(0.0, {"surge_rate": v, "heave": -0.0102}) for v in (4.0, 5.0)], POSE, 200, 2e-3)
    assert not impossible(look(lies, model))


# ---------------------------------------------------------------- the gap above


@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_a_heave_that_is_the_gap_above_in_millimetres_is_both(name, pose, model):
    gap = model.parameters["nominal_gap"]
    found = impossible(look(changed(only(pose, name), "heave", lambda y: 1e3 * (y + gap)), model))
    assert [(f.kind, f.channel) for f in found] == [("unit", "heave"), ("zero", "heave")]
    assert "in mm" in found[0].remedy and "subtract the nominal gap, 0.01 m" in found[1].remedy


# ---------------------------------------------------------------- the drive currents of two runs


@pytest.mark.parametrize("currents", [(3600.0, 5000.0, 7000.0), (5000.0, 7000.0, 3600.0)])
def test_two_currents_that_are_exchanged_are_named(currents, pose, model):
    runs = tuple(replace(r, drive_current=c) for r, c in zip(pose.runs, currents, strict=True))
    (found,) = impossible(look(replace(pose, runs=runs), model))
    others = [r.name for r, c in zip(pose.runs, currents, strict=True) if c != r.drive_current]
    assert found.channel == "drive_current" and found.size["runs"] == others
    assert "exchange drive_current of the two" in found.remedy


def test_a_drive_that_weakens_with_the_speed_is_no_exchange(model):
    """A slow run needs more than its current, a fast one less; the one between what it says."""
    rig = Model.create(
        parameters={"gamma": 2.1 * model.parameters["gamma"]}, effects={"drive_back_emf": {"cutoff_speed": 42.0}}
    )
    starts = [{"surge_rate": v, "sway": 2e-3, "heave": rig.equilibrium_heave(v)} for v in (17.0, 22.0, 27.0)]
    found = look(flown(list(zip((3600.0, 5000.0, 7000.0), starts, strict=True)), POSE, 301, 2e-3, model=rig), model)
    assert not [f for f in impossible(found) if "would move it" in f.text]
