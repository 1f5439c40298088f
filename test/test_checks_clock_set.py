# SPDX-License-Identifier: Apache-2.0
"""The look at the data: clocks that are set while a run is recorded, and what else happens at one row of a file."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import changed, kinds, measured

from inductrack_ros.checks import IMPOSSIBLE, impossible, look


def stamped(campaign, change, name="b"):
    """The campaign with the times of one run changed."""

    def one(run):
        times = change(run.times.copy())
        return replace(run, times=times, stamps=times) if run.name == name else run

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


# ---------------------------------------------------------------- clocks


@pytest.mark.parametrize(("steps", "how"), [(3.0, "ahead by 6 ms"), (1.5, "ahead by 3 ms"), (-0.8, "back by 1.6 ms")])
def test_a_clock_that_is_set_by_less_than_a_hole_is_named(steps, how, pose, model):
    def set_at_140(times):
        times[140:] += steps * 2e-3
        return times

    (found,) = impossible(look(stamped(pose, set_at_140), model))
    assert (found.kind, found.run, found.size["sample"]) == ("clock_jump", "b", 140)
    assert found.text.startswith(f"the clock of b.csv jumps {how} at ")


@pytest.mark.parametrize("seed", range(4))
def test_late_stamps_and_lost_rows_set_no_clock(seed, pose, model):
    rng = np.random.default_rng(seed)
    late = stamped(pose, lambda t: t + 1.6e-3 * (rng.random(len(t)) < 0.04))
    lost = rng.random(len(pose.runs[0].times)) > 0.04
    lost[[0, -1]] = True
    thinned = [replace(r, times=r.times[lost], stamps=r.stamps[lost], values=r.values[lost]) for r in pose.runs]
    for campaign in (late, replace(pose, runs=tuple(thinned))):
        assert "clock_jump" not in {f.kind for f in look(campaign, model)}


def test_stamps_of_one_sensor_whose_fractions_are_in_another_unit_are_named(model):
    """The nanoseconds of a twist hold milliseconds: it stands still for a second, and the pose beside it goes on."""
    rig = measured(("surge", "sway", "heave", "roll", "surge_rate", "heave_rate"), count=1101)

    def of_two_sensors(run):
        wrong = np.floor(run.times) + np.floor(1e3 * (run.times % 1.0)) * 1e-9
        times = np.union1d(run.times, wrong)
        values = np.full((len(times), len(run.channels)), np.nan)
        values[np.searchsorted(times, run.times), :4] = run.values[:, :4]
        values[np.searchsorted(times, wrong), 4:] = run.values[:, 4:]
        return replace(run, times=times, stamps=times, values=values)

    (found,) = impossible(look(replace(rig, runs=tuple(map(of_two_sensors, rig.runs))), model))
    assert found.kind == "time_unit" and found.size["channels"] == ["surge_rate", "heave_rate"]
    assert "does nanosec hold microseconds or milliseconds?" in found.remedy


def test_a_travel_that_begins_again_comes_to_no_rest(pose, model):
    """The speed over its whole length would be hardly any."""
    found = look(changed(pose, "surge", lambda y: y % 4.0, "b"), model)
    assert kinds(found) == {("value_jump", "surge")}


# ---------------------------------------------------------------- at one row


def from_row(row, change):
    def one(column):
        column[row:] = change(column[row:])
        return column

    return one


WRITTEN = {
    "its sign were changed": ("roll", lambda y: -y),
    "it were in mm": ("heave", lambda y: 1e3 * y),
    "it were in degrees": ("roll", lambda y: y * 180.0 / np.pi),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_a_sign_or_a_unit_that_changes_at_a_row_is_named(how, pose, model):
    channel, change = WRITTEN[how]
    row = 100 + int(np.argmax(np.abs(pose.runs[1][channel][100:200])))  # where it is far from 0
    found = [f for f in impossible(look(changed(pose, channel, from_row(row, change), "b"), model))]
    assert found[0].kind == "value_jump" and f"from there on it reads as if {how}" in found[0].remedy


def test_another_zero_from_a_row_on_is_no_unit(pose, model):
    moved = changed(pose, "heave", from_row(150, lambda y: y + 2.3e-3), "b")
    (found,) = impossible(look(moved, model))
    assert found.remedy.startswith("its zero was moved or counts were lost")


def test_cells_that_moved_to_other_columns_are_named(pose, model):
    """From a row on each cell stands one column further to the left, as where a cell was left out."""

    def moved(run):
        values = run.values.copy()
        values[150:, :-1], values[150:, -1] = run.values[150:, 1:], np.nan
        return replace(run, values=values) if run.name == "b" else run

    found = impossible(look(replace(pose, runs=tuple(map(moved, pose.runs))), model))
    surge = next(f for f in found if f.channel == "surge")
    assert (surge.kind, surge.severity) == ("value_jump", IMPOSSIBLE)
    assert "sway" in surge.remedy and "moved to other columns" in surge.remedy
