# SPDX-License-Identifier: Apache-2.0
"""The look at the data: frames that are turned, gravity on the wrong axis, sensors that are late as a whole."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import POSE, changed, flown, measured, put
from test_data_bags import EPOCH, GOOD, TWIST, header, imu, make, record, vector
from test_data_bags import POSE as POSE_STAMPED

from inductrack_ros import frames
from inductrack_ros.checks import IMPOSSIBLE, impossible, look
from inductrack_ros.core.state import COORDINATES, RATES
from inductrack_ros.data import read_bag

STEP = 2_000_000
ACCELERATIONS = ("surge_acceleration", "sway_acceleration", "heave_acceleration")


@pytest.fixture(scope="module")
def rig():
    """Runs with all that a pose, a twist and an Imu carry."""
    return measured((*COORDINATES, *RATES, *ACCELERATIONS), count=400)


def in_bags(folder, rig, pose=lambda p, q: (p, q), twist=lambda v, w: (v, w), force=lambda f: f, late=None):
    """The rig's runs as they come out of bags whose publishers do something to poses, twists and specific forces."""
    late = late or {}

    def messages(run):
        poses, twists, forces = [], [], []
        for k in range(len(run.times)):
            at = {key: header(EPOCH + k * STEP + late.get(key, 0)) for key in ("pose", "twist")}
            p, q = pose(*frames.coordinates_to_pose([run[c][k] for c in COORDINATES]))
            v, w = twist(*frames.rates_to_twist([run[c][k] for c in RATES]))
            place = make("geometry_msgs/msg/Pose", vector(p, "Point"), vector(q, "Quaternion"))
            poses.append((POSE_STAMPED, make(POSE_STAMPED, at["pose"], place)))
            twists.append((TWIST, make(TWIST, at["twist"], make("geometry_msgs/msg/Twist", vector(v), vector(w)))))
            a = np.array([run[c][k] for c in ACCELERATIONS]) + [0.0, 0.0, 9.81]
            c, s = np.cos(run["roll"][k]), np.sin(run["roll"][k])
            sensed = np.array([a[0], c * a[1] + s * a[2], c * a[2] - s * a[1]])
            forces.append(imu(EPOCH + k * STEP + late.get("imu", 0), force(sensed)))
        return {GOOD: poses, "/inductrack/twist": twists, "/inductrack/imu": forces}

    runs = tuple(
        replace(read_bag(record(folder / run.name, messages(run))), name=run.name, drive_current=run.drive_current)
        for run in rig.runs
    )
    return replace(rig, runs=runs, noise_std={})


def turned_about_z(angle):
    c, s = np.cos(angle), np.sin(angle)

    def turn(v):
        return [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]

    return turn


@pytest.mark.parametrize(
    ("publisher", "kind", "words"),
    [
        ({"pose": lambda p, q: (p, [q[3], q[0], q[1], q[2]])}, "constant", "written w first"),
        ({"pose": lambda p, q: (turned_about_z(0.02)(p), q)}, "turned", "turned by 1.1"),
        ({"pose": lambda p, q: (turned_about_z(np.pi)(p), q)}, "turned", "half a turn about z"),
        ({"pose": lambda p, q: ([p[0], -p[1], -p[2]], [q[0], -q[1], -q[2], q[3]])}, "turned", "as in NED"),
        (
            {
                "pose": lambda p, q: ([p[0], -p[1], -p[2]], [q[3], q[2], -q[1], -q[0]]),
                "twist": lambda v, w: ([v[0], -v[1], -v[2]], w),
            },
            "zero",
            "z point down (NED)",
        ),
        ({"force": lambda f: f / 9.81}, "unit", "surge_acceleration in g instead of"),
        ({"force": lambda f: f * [1, -1, -1]}, "turned", "accelerometer is turned by half a turn about x"),
        ({"force": lambda f: f * [-1, -1, 1]}, "turned", "accelerometer is turned by half a turn about z"),
        ({"force": lambda f: f - [0, 0, 9.81]}, "zero", "publish it with gravity"),
        ({"force": lambda f: f - [0, 0, 2 * 9.81]}, "zero", "which way is up?"),
        ({"force": lambda f: f[[1, 2, 0]]}, "zero", "lies on its side"),
        ({"late": {"twist": 300_000_000}}, "offset", "roll_rate are all 300 ms later"),
        ({"late": {"twist": -300_000_000}}, "offset", "roll_rate are all 300 ms earlier"),
        ({"late": {"imu": 300_000_000}}, "offset", "heave_acceleration are all 300 ms later"),
    ],
)
def test_what_a_publisher_does_is_said_before_any_other_cause(tmp_path, publisher, kind, words, rig, model):
    found = impossible(look(in_bags(tmp_path, rig, **publisher), model))
    assert found[0].kind == kind and words in found[0].line
    assert {f.kind for f in found} == {kind}


def test_nothing_of_this_in_good_bags(tmp_path, rig, model):
    assert look(in_bags(tmp_path, rig), model) == ()


def test_an_accelerometer_that_is_late_without_rates(model):
    def late(run):
        values = run.values.copy()
        for c in ACCELERATIONS:
            k = run.channels.index(c)
            values[:, k] = np.concatenate([np.full(150, np.nan), values[:-150, k]])
        return replace(run, values=values)

    slow = measured((*POSE, *ACCELERATIONS), count=400)
    (found,) = impossible(look(replace(slow, runs=tuple(map(late, slow.runs))), model))
    assert (found.kind, round(found.size["offset"], 2)) == ("offset", 0.3)


def test_a_track_that_the_cradle_follows_aside_is_no_turned_frame(model):
    """Within its room sway may follow surge."""
    start = {"surge_rate": 17.0, "sway": 3e-3, "heave": -5e-3}
    one = flown([(7000.0, start)], POSE, 301, 2e-3)
    aside = changed(one, "sway", lambda y: y + 1e-3 * one.runs[0]["surge"], "a")
    assert not [f for f in look(aside, model) if f.kind == "turned"]


def test_bad_samples_at_an_end_and_between(model):
    """Those at an end are found after the others."""
    spoiled = changed(measured(), "heave", put((0, 0.02), (150, 0.02)), "a")
    assert not [f for f in look(spoiled, model) if f.severity == IMPOSSIBLE]
