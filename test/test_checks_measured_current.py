# SPDX-License-Identifier: Apache-2.0
"""The look at the data: a drive current that was measured in time, its unit, and limits that hold nothing."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import kinds
from test_checks_one_run import FLIGHTS, rig, weak_drive

from inductrack_ros.checks import IMPOSSIBLE, WARNING, impossible, look
from inductrack_ros.data.limits import Limits

COASTING = [*FLIGHTS[:3], (0.0, 24.0)]


def with_readings(campaign, read):
    """The campaign with its currents measured as ``read`` makes them of times and the current."""

    def one(run):
        times, readings = read(run.times, run.drive_current)
        return replace(run, drive_current=float(np.mean(readings)), inputs={"drive_current": (times, readings)})

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


def steady(times, current):
    return times, np.full(len(times), current)


def test_a_current_as_it_was_measured_is_no_fault(model):
    assert look(with_readings(rig(flights=COASTING), steady), model) == ()


def test_one_filler_among_the_readings_of_a_current_is_named(model):
    def spoiled(times, current):
        return times, np.where(np.arange(len(times)) == 70, -9999.0, current)

    (found,) = impossible(look(with_readings(rig(flights=COASTING), spoiled), model))
    assert (found.kind, found.channel, found.size["count"]) == ("fillers", "drive_current", 1)
    assert "is -9999 A at 0.14 s (1 such)" in found.text


@pytest.mark.parametrize(
    ("kept", "says"),
    [
        (lambda t: t > 0.3, "from 0 to 0.302 s: the first reading is taken"),
        (lambda t: t < 0.2, "to 0.6 s: the last reading is taken"),
        (lambda t: abs(t - 0.3) > 0.1, "a straight line between two is taken"),
    ],
)
def test_a_part_of_a_run_without_its_current_is_said(kept, says, model):
    found = look(with_readings(rig(), lambda t, c: (t[kept(t)], np.full(kept(t).sum(), c))), model)
    assert kinds(found, WARNING) == {("hole", "drive_current")} and says in found[0].text


@pytest.mark.parametrize("weak", [False, True])
def test_currents_in_kiloamperes_are_named_whatever_else_is_not_known(weak, model):
    """Also of a drive that pushes as a steep track would, and where a sensor does not read 0 at rest."""
    model = weak_drive() if weak else model
    measured = with_readings(rig(model, COASTING), lambda t, c: (t, 1e-3 * c + 3e-3 * np.sin(40.0 * t)))
    (found,) = impossible(look(measured, model))
    assert found.channel == "drive_current" and found.text.endswith("it seems to be in kA")
    assert "alone" not in found.text and found.remedy.endswith("multiply it by 1000 where it is measured")
    stated = rig(model, FLIGHTS, {k: 1e-3 * current for k, (current, _) in enumerate(FLIGHTS)})
    (found,) = impossible(look(stated, model))
    assert found.text.endswith("it seems to be in kA") and found.remedy.endswith("by 1000 in campaign.yaml")


def test_a_duty_in_the_place_of_a_current_is_refused():
    """It is proportional to the drive, which no force is."""
    weak = weak_drive()
    (found,) = impossible(look(rig(weak, FLIGHTS, {k: c / 9e3 for k, (c, _) in enumerate(FLIGHTS)}), weak))
    assert (found.channel, found.severity) == ("drive_current", IMPOSSIBLE)
    assert found.size["factor"] == pytest.approx(9e3, rel=0.1)


# ---------------------------------------------------------------- limits


@pytest.mark.parametrize(
    ("state", "limit", "says"),
    [
        ("heave", (-6.0, 1.0), "is it in mm?"),
        ("roll", (-5.0, 5.0), "is it in degrees or mrad?"),
        ("heave", (0.001, 0.002), "is its unit another?"),
    ],
)
def test_limits_that_hold_nothing_are_said(state, limit, says, pose, model):
    (found,) = look(replace(pose, limits=Limits({state: limit})), model)
    assert (found.kind, found.channel, found.severity) == ("limits", state, WARNING) and says in found.remedy


def test_limits_within_the_track_are_good(pose, model):
    limits = Limits({"heave": (-8e-3, 1e-3), "surge_rate": (9.0, 40.0), "roll": (-0.05, 0.05), "surge": (0.0, 200.0)})
    assert look(replace(pose, limits=limits), model) == ()
