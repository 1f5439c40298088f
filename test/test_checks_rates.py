# SPDX-License-Identifier: Apache-2.0
"""The look at the data: sensors that are read at rates of their own, and channels that were brought to another rate."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from test_checks import POSE, changed, flown, kinds, measured

from inductrack_ros.checks import SET_ASIDE, impossible, look, set_aside
from inductrack_ros.checks.steps import step_of
from inductrack_ros.core.state import GAPS

ALL = (*POSE, "surge_rate", "sway_rate", "heave_rate", "roll_rate", *GAPS, "surge_acceleration", "heave_acceleration")


def at_their_rates(campaign, every):
    """The campaign with some channels measured at every so many samples only, by channel, as a bag holds them."""
    for channel, n in every.items():
        campaign = changed(campaign, channel, lambda y, n=n: np.where(np.arange(len(y)) % n == 0, y, np.nan))
    return campaign


@pytest.fixture(scope="module")
def mixed():
    """A pose at 500 Hz, gaps at 100 Hz, accelerations at 167 Hz: hardly a sample has all."""
    slow = {**dict.fromkeys(GAPS, 5), "surge_acceleration": 3, "heave_acceleration": 3}
    return at_their_rates(measured(ALL), slow)


# ---------------------------------------------------------------- rates of their own


def test_sensors_of_different_rates_are_no_fault(mixed, model):
    assert impossible(look(mixed, model)) == ()


@pytest.mark.parametrize("channel", ["sway", "surge"])
def test_an_axis_is_held_against_the_forces_whatever_the_other_sensors_rates(channel, mixed, model):
    flipped = mixed
    for name in (channel, f"{channel}_rate"):
        flipped = changed(flipped, name, lambda y: -y)
    if channel == "surge":
        flipped = changed(flipped, "surge_acceleration", lambda y: -y)
    assert ("axis_flipped", channel) in kinds(impossible(look(flipped, model)))


def test_a_slow_coordinate_is_held_against_the_forces(model):
    """A camera sees sway and roll at 125 Hz, an encoder surge at 500 Hz."""
    rig = at_their_rates(measured(), {"sway": 4, "roll": 4})
    assert impossible(look(rig, model)) == ()
    (found,) = impossible(look(changed(rig, "roll", lambda y: y * 180.0 / np.pi), model))
    assert (found.kind, found.channel) == ("unit", "roll") and "degrees" in found.remedy


def test_side_gaps_of_one_run_that_are_exchanged_are_named(mixed, model):
    def exchanged(run):
        names = list(run.channels)
        a, b = names.index("gap_left"), names.index("gap_right")
        names[a], names[b] = names[b], names[a]
        return replace(run, values=run.values[:, [names.index(c) for c in run.channels]])

    runs = tuple(exchanged(run) if run.name == "b" else run for run in mixed.runs)
    (found,) = impossible(look(replace(mixed, runs=runs), model))
    assert found.size["candidates"] == ["gap_left", "gap_right"] and found.size["runs"] == ["b"]


@pytest.mark.parametrize(("factor", "unit"), [(1e2, "cm"), (1e3, "mm")])
def test_the_unit_of_a_slow_gap_is_named_rightly(factor, unit, mixed, model):
    (found,) = impossible(look(changed(mixed, "gap_right", lambda y: y * factor), model))
    assert found.channel == "gap_right" and f"it seems to be in {unit}" in found.remedy


# ---------------------------------------------------------------- brought to another rate


def brought_to(campaign, between, every=8, runs="abc"):
    """The campaign with all channels of some runs interpolated between every so many samples."""

    def one(run):
        times = run.times[::every]
        values = np.column_stack([between(times, y[::every])(run.times) for y in run.values.T])
        return replace(run, values=values) if run.name in runs else run

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


def lines(times, values):
    return lambda t: np.interp(t, times, values)


def rounded_lines(times, values):
    return lambda t: np.round(np.interp(t, times, values), 7)


@pytest.mark.parametrize(("between", "by"), [(lines, "lines"), (rounded_lines, "lines"), (CubicSpline, "cubics")])
def test_what_lies_between_readings_is_no_measurement(between, by, model):
    rig = replace(measured(count=801, step=1e-3), noise_std={})
    found = look(brought_to(rig, between), model)
    assert kinds(found) >= {("resampled", c) for c in POSE} and not impossible(found)
    (heave,) = (f for f in found if f.channel == "heave" and f.kind == "resampled")
    assert heave.severity == SET_ASIDE and f"by {by} between readings that are 8 samples apart" in heave.text
    left = set_aside(brought_to(rig, between), found)
    assert 90 <= len(left.runs[0].samples("heave")[0]) <= 103  # a reading in line with those beside it is not told


def test_one_run_that_was_resampled_is_named(model):
    rig = replace(measured(count=801, step=1e-3), noise_std={})
    found = [f for f in look(brought_to(rig, lines, 5, "b"), model) if f.kind == "resampled"]
    assert {f.channel for f in found} == set(POSE) and all(set(f.samples) == {"b"} for f in found)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 1.0])
def test_smooth_measured_or_simulated_motion_was_not_resampled(noise, model):
    """Also where the cradle hits the track or lies on it, and without any noise."""
    starts = [(0.0, {"surge_rate": 8.0, "heave": 4e-3, "sway": 2e-3}), (7000.0, {"surge_rate": 22.0, "sway": 3e-3})]
    rig = flown(starts, POSE, 900, 1e-3)
    quiet = []
    for run in rig.runs:
        flight = model.simulate(
            run.times, model.initial_state(**dict(starts["ab".index(run.name)][1])), run.drive_current
        )
        truth = np.column_stack([flight[c] for c in POSE])
        quiet.append(replace(run, values=truth + noise * (run.values - truth)))
    assert "resampled" not in {f.kind for f in look(replace(rig, runs=tuple(quiet), noise_std={}), model)}


def test_an_even_motion_on_coarse_steps_was_not_resampled(model):
    """An encoder at nearly one speed counts ten steps, and now and then eleven: lines between readings look so too."""
    rig = replace(measured(count=601, step=2e-3), noise_std={})
    coarse = lambda run: np.round(4.69e-3 * np.rint(23.9 * run.times / 4.69e-3), 5)  # noqa: E731
    surge = rig.channels.index("surge")
    runs = tuple(
        replace(run, values=np.column_stack([coarse(run) if k == surge else y for k, y in enumerate(run.values.T)]))
        for run in rig.runs
    )
    assert "resampled" not in {f.kind for f in look(replace(rig, runs=runs), model)}


# ---------------------------------------------------------------- digits


@pytest.mark.parametrize("digits", [3, 4, 5])
def test_a_number_of_digits_is_a_step_of_the_largest(digits):
    rng = np.random.default_rng(2)
    travel = np.linspace(0.2, 80.0, 3000) + 1e-3 * rng.standard_normal(3000)
    written = np.array([float(f"{x:.{digits}g}") for x in travel])
    assert step_of(written) == pytest.approx(10.0 ** (2 - digits))
    assert step_of(travel) == 0.0


def test_four_digits_far_along_the_track_are_no_fault_of_the_sensor(model):
    """They repeat and run straight; all that is so is the step."""
    rig = replace(measured(count=601), noise_std={})
    written = changed(rig, "surge", lambda y: np.array([float(f"{x:.4g}") for x in y]))
    (found,) = look(written, model)
    assert (found.kind, found.channel) == ("quantised", "surge") and found.size["step"] == pytest.approx(0.01)


def test_the_last_bits_of_a_number_are_no_step():
    """What a spline leaves between its readings."""
    times = np.linspace(0.0, 1.0, 1001)
    smooth = CubicSpline(times[::20], 80.0 * np.sin(times[::20]))(times)
    assert step_of(smooth, 1e-14) == 0.0
