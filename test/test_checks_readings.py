# SPDX-License-Identifier: Apache-2.0
"""The look at the data: exchanges, zeros and clocks that only the model's motion gives away."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import POSE, changed, flown, measured, times_of

from inductrack_ros.checks import IMPOSSIBLE, WARNING, impossible, look
from inductrack_ros.checks.apart import of_some
from inductrack_ros.checks.finding import Finding
from inductrack_ros.checks.readings import explains
from inductrack_ros.core.model import Model


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


# ---------------------------------------------------------------- what explains anything


def test_a_channel_whose_unit_explains_another_has_to_belong_itself():
    """A hidden spring in roll: with sway a thousand times smaller roll would fit, and sway would not move as it should
    at all."""
    off, then = {"surge": 0.03, "roll": 0.78}, {"surge": 0.03, "roll": 0.14}
    assert explains(off, then | {"sway": 0.05}, ["sway"])
    assert not explains(off, then | {"sway": 1.0}, ["sway"])
    assert explains(off, then | {"sway": 1.0}, ["time"])  # sway may have a fault of its own


@pytest.mark.parametrize(("unlike", "told"), [("bc", False), ("b", True)])
def test_a_unit_is_no_one_runs_where_most_others_move_as_none_explains(unlike, told, pose):
    """A strong asymmetry of the arrays: each run alone moves by other forces, and one of them might be in inches."""

    def alone(campaign):
        names = [run.name for run in campaign.runs]
        if names == ["a"]:
            return [Finding("unit", IMPOSSIBLE, "sway seems to be in inches", "", "sway", size={"factor": 0.0254})]
        if len(names) > 1 or names[0] not in unlike:
            return []
        return [Finding("unlike", WARNING, "roll and sway move", "", "roll", size={"channels": ["roll", "sway"]})]

    assert bool(impossible(of_some(pose, [], alone, lambda finding: True))) == told


@pytest.mark.parametrize(("unit", "size"), [("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254)])
def test_lengths_that_are_all_in_one_unit_are_read_together(unit, size, pose, model):
    """Each alone would be in mm, while the others are still wrong."""
    written = replace(pose, noise_std={})
    for channel in ("surge", "sway", "heave"):
        written = changed(written, channel, lambda y: y / size)
    found = impossible(look(written, model))
    assert {f.channel for f in found} == {"surge", "sway", "heave"}
    assert all(f.remedy.endswith(f"'{f.channel} [{unit}]' in the header") for f in found)


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


# ---------------------------------------------------------------- clocks


@pytest.mark.parametrize("factor", [0.1, 0.5, 2.0, 2.5, 3.7])
@pytest.mark.parametrize("runs", ["a", "b", "c", "abc"])
def test_a_clock_of_another_rate_is_named_before_any_force(factor, runs, pose, model):
    (found,) = impossible(look(times_of(pose if len(runs) > 1 else only(pose, runs), factor), model))
    assert found.kind == "time_unit" and "sampling rate" in found.remedy
    assert found.size["factor"] == pytest.approx(factor, rel=0.03)
    assert ("too slowly" if factor > 1.0 else "too fast") in found.text


def test_a_clock_of_one_run_alone_is_named(pose, model):
    slow = tuple(replace(r, times=2 * r.times, stamps=2 * r.stamps) if r.name == "b" else r for r in pose.runs)
    (found,) = look(replace(pose, runs=slow), model)
    assert (found.kind, found.run) == ("time_unit", "b") and found.text.startswith("in b alone of 3 runs everything")


def honest(parameters=None, effects=(), speeds=(17.0, 22.0, 26.0)):
    """Runs of a rig whose clock, units and zeros are right, and which is another than the model."""
    rig = Model.create(parameters=parameters, effects=effects)
    starts = [{"surge_rate": v, "sway": 2e-3, "heave": rig.equilibrium_heave(v) + 5e-4} for v in speeds]
    return flown(list(zip((7000.0, 5000.0, 3600.0), starts, strict=True)), POSE, 301, 2e-3, model=rig)


@pytest.mark.parametrize("name", ["eta", "gamma"])
@pytest.mark.parametrize("factor", [0.5, 0.7, 1.5, 2.0])
def test_a_lift_or_a_drive_of_another_size_is_no_other_clock(name, factor, model):
    """A lift of half the size swings as slowly as a clock that is too fast, but does not carry the weight."""
    found = look(honest({name: factor * model.parameters[name]}), model)
    assert not {"time_unit", "zero"} & {f.kind for f in found}


@pytest.mark.parametrize("rate", [-0.1, 0.1])
def test_a_clock_that_an_effect_may_explain_is_no_other_unit(rate, pose, model):
    assert not impossible(look(times_of(pose, 1.0 / (1.0 + rate)), model))


# ---------------------------------------------------------------- zeros


def test_the_gap_above_with_a_minus_is_named(pose, model):
    """It rests near where heave rests, and swings alike."""
    for scale, kinds in ((1.0, ["zero"]), (1e3, ["unit", "zero"])):
        wrong = changed(replace(pose, noise_std={}), "heave", lambda y, scale=scale: -scale * (y + 0.01))
        found = impossible(look(wrong, model))
        assert [f.kind for f in found] == kinds and {f.channel for f in found} == {"heave"}
        assert "minus the gap of the top array" in found[-1].text
        assert "change its sign, then subtract the nominal gap" in found[-1].remedy


def test_a_rate_beside_minus_the_gap_is_no_cause_of_its_own(model):
    rig = measured((*POSE, "heave_rate"))
    (found,) = impossible(look(changed(rig, "heave", lambda y: -(y + 0.01)), model))
    assert (found.kind, found.channel) == ("zero", "heave")


@pytest.mark.parametrize("area", [-0.13, -0.115, -0.1, -0.05, 0.1])
def test_a_lift_that_falls_with_the_speed_is_no_negative_gap(area, model):
    """The cradle sinks as it gets faster, as it seems to where its heave is the gap above with a minus."""
    rig = honest(effects={"aerodynamic_lift": {"lift_area": area}})
    assert not impossible(look(rig, model))
    if area == -0.05:  # so much is named beside a hidden lift
        (found,) = impossible(look(changed(rig, "heave", lambda y: -(y + 0.01)), model))
        assert found.kind == "zero" and "minus the gap" in found.text


def alike():
    """Three runs of about one speed."""
    start = {"sway": 3e-3, "heave": -4.8e-3}
    return flown([(7000.0, {**start, "surge_rate": v}) for v in (19.0, 20.0, 21.0)], POSE, 301, 2e-3)


@pytest.mark.parametrize("zero", [3e-3, -3e-3, -2e-3])
@pytest.mark.parametrize("run", ["a", "b", "c"])
def test_a_zero_that_one_run_has_alone_is_named(zero, run, model):
    (found,) = look(changed(alike(), "heave", lambda y: y + zero, run), model)
    assert (found.kind, found.channel, found.run, found.severity) == ("zero", "heave", run, IMPOSSIBLE)
    assert found.size["zero"] == pytest.approx(zero, abs=5e-5) and "alone of 3 runs" in found.text


@pytest.mark.parametrize("run", ["a", "c"])
def test_a_zero_of_the_slowest_or_fastest_run_may_mislead(run, pose, model):
    """There the lift might be another."""
    (found,) = look(changed(pose, "heave", lambda y: y + 3e-3, run), model)
    assert (found.kind, found.run, found.severity) == ("zero", run, WARNING) and "with the speed?" in found.remedy


def test_a_rig_without_weight_is_looked_at(pose):
    assert not impossible(look(pose, Model.create(parameters={"gravity": 0.0})))


def test_a_zero_of_all_runs_stays_an_effect(pose, model):
    for zero in (-2e-3, 2e-3, 3e-3):
        assert not impossible(look(changed(pose, "heave", lambda y, zero=zero: y + zero), model))


@pytest.mark.parametrize("part", [0.6, 1.5])
@pytest.mark.parametrize("name", ["mass", "eta"])
def test_another_load_or_weaker_magnets_of_one_run_are_no_zero(name, part, model):
    """They change the swing in sway and roll as well; where a condition says so nothing is odd."""
    size = part * model.parameters[name]
    rig = Model.create(parameters={name: size})
    run = flown(
        [(7000.0, {"surge_rate": 20.0, "sway": 3e-3, "heave": rig.equilibrium_heave(20.0)})], POSE, 301, 2e-3, 5, rig
    )
    loaded = replace(alike(), runs=tuple(replace(run.runs[0], name="b") if r.name == "b" else r for r in alike().runs))
    assert not [f for f in impossible(look(loaded, model)) if f.kind == "zero"]
    said = tuple(replace(r, conditions={name: size}) if r.name == "b" else r for r in loaded.runs)
    assert not [f for f in look(replace(loaded, runs=said), model) if f.kind == "zero"]


@pytest.mark.parametrize(("amplitude", "wavelength"), [(3e-4, 2.0), (1e-3, 10.0), (2e-3, 40.0)])
def test_a_track_that_is_not_even_is_no_zero(amplitude, wavelength, model):
    waves = {"guideway_waviness": {"amplitude": amplitude, "wavelength": wavelength, "phase": 0.0}}
    assert not impossible(look(honest(effects=waves, speeds=(20.0, 20.5, 21.0)), model))


# ---------------------------------------------------------------- effects of sensors, however strong


@pytest.mark.parametrize("bias", [-3e-3, -2e-3, 2e-3, 3e-3])
def test_a_zero_of_sway_in_all_runs_is_no_unit_of_one(bias, pose, model):
    """In one run another unit would take it up; the others move as no reading explains."""
    assert not impossible(look(changed(pose, "sway", lambda y: y + bias), model))


@pytest.mark.parametrize("angle", [-0.3, 0.05, 0.2, 0.5])
def test_sensors_that_are_turned_in_all_runs_are_no_unit_of_one(angle, pose, model):
    def turned(run):
        values, c, s = run.values.copy(), np.cos(angle), np.sin(angle)
        values[:, 1] = c * run["sway"] + s * run["heave"]
        values[:, 2] = c * run["heave"] - s * run["sway"]
        return replace(run, values=values)

    assert not impossible(look(replace(pose, runs=tuple(map(turned, pose.runs))), model))


def test_an_exchange_explains_only_what_belongs_then():
    """In a run with little in sway the exchange may bring one channel near by chance; the other stays where it was."""
    before, after = {"sway": 0.93, "roll": 0.98, "heave": 0.01}, {"sway": 0.29, "roll": 0.99, "heave": 0.02}
    assert not explains(before, after, ("sway", "roll"))
    assert explains(before, {**after, "roll": 0.1}, ("sway", "roll"))
