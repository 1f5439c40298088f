# SPDX-License-Identifier: Apache-2.0
"""Controllers: in step with simulated time, so that a run can be repeated to the bit; and in real time."""

from __future__ import annotations

import hashlib
import json
import signal
import subprocess
import time
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest
from conftest import counted, newest_in
from geometry_msgs.msg import PointStamped, TwistStamped
from rosbags.rosbag2 import Reader
from std_srvs.srv import SetBool, Trigger

from inductrack_ros import cli, demo
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model, Pulses
from inductrack_ros.core.state import FURTHER_SENSORS, STATES
from inductrack_ros.data.bags import read_bag
from inductrack_ros.nodes import record
from inductrack_ros.nodes.sim import ASK_AGAIN
from inductrack_ros.nodes.topics import nanoseconds_of

EXAMPLE = Path(__file__).parent.parent / "examples" / "my_controller.py"
SIM = ["--ros-args", "-p", "drive:=pulses", "-p", "initial_state:='surge_rate=15.0'"]
LOCKSTEP = ["-p", "lockstep:=true"]
HOLD = ["--ros-args", "-p", "mode:=speed", "-p", "target_speed:=15.0"]

#: Simulated seconds for which the speed is held, and from which on it is near. Left to a constant current the cradle
#: stands after two.
HELD, SETTLED = 4.0, 3.0


def seconds(message) -> float:
    return nanoseconds_of(message.header.stamp) / 1e9


def test_the_unstable_speed_is_held_and_mode_gains_and_lead_change_meanwhile(ros):
    twist = ros.listen(TwistStamped, "/inductrack/twist")
    fired = ros.listen(PointStamped, "/inductrack/fired_pulses")
    # A kilohertz of controller answers is what the machine gives; 250 Hz is enough and takes a quarter of the time.
    sim = ros.start("sim", *SIM, *LOCKSTEP, "-p", "rate:=250.0", "-p", "paused:=true")
    controller = ros.start("track_controller", *HOLD, *LOCKSTEP)
    ros.connect("/inductrack/sim")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    # Of both topics: one may be heard later than the other.
    ros.wait(lambda: twist and seconds(twist[-1]) > HELD, "the speed to be held for a while")
    ros.wait(lambda: fired and seconds(fired[-1]) > HELD, "the pulses that hold it")
    speeds = {seconds(m): m.twist.linear.x for m in twist}
    assert len(speeds) > 250 * HELD and max(abs(v - 15.0) for v in speeds.values()) < 0.6
    assert max(abs(v - 15.0) for t, v in speeds.items() if t > SETTLED) < 0.1
    coils = [int(m.point.x) for m in fired]
    assert coils == list(range(coils[0], coils[0] + len(coils))) and len(coils) > 290 * HELD  # each once, none left out
    assert all((m.point.y > 0) == (m.point.x % 2 == 0) for m in fired)
    name = "/inductrack/track_controller"
    ros.call(SetBool, "/inductrack/sim/pause", data=True)  # in a second it would run away to 50 m/s
    for parameter, value in (("drive_current", 9000.0), ("mode", "current")):
        assert ros.set_parameter(name, parameter, value).successful

    def faster() -> bool:
        ros.step_on("/inductrack/sim")
        return twist[-1].twist.linear.x > 15.4

    ros.wait(faster, "9000 A to speed the cradle up")
    began = seconds(twist[-1])
    for parameter, value in (
        ("target_speed", 15.2),
        ("gain", 6000.0),
        ("lead", 0.01),
        ("max_current", 12000.0),
        ("mode", "speed"),
    ):
        assert ros.set_parameter(name, parameter, value).successful
    controller.wait_for("firing for 15.2 m/s, 10 ms ahead")
    for parameter, value in (("mode", "sideways"), ("lead", 9.0), ("gain", float("nan")), ("lockstep", False)):
        assert not ros.set_parameter(name, parameter, value).successful
    ros.call(SetBool, "/inductrack/sim/pause", data=False)

    def held() -> bool:
        newest = seconds(twist[-1])
        last = (m.twist.linear.x for m in takewhile(lambda m: seconds(m) > newest - 1.0, reversed(twist)))
        return newest > began + 1.0 and all(abs(speed - 15.2) < 0.1 for speed in last)

    ros.wait(held, "the speed it was asked to hold, for a second")
    assert max(abs(m.point.y) for m in fired if seconds(m) > began) <= 12000.0
    assert sim.stop() == 0 and controller.stop() == 0


#: Simulated seconds of a run that is recorded twice.
LASTS = 0.5


def record_lockstep(ros, bag: Path, until: float, stands: float = 0.0) -> dict[str, str]:
    """Record a run of sim and track_controller in lockstep; a digest of every topic up to a simulated time. In the
    middle the controller stands still for ``stands`` (s)."""
    twist = ros.listen(TwistStamped, "/inductrack/twist")
    sim = ros.start("sim", *SIM, *LOCKSTEP, "-p", "paused:=true", "-p", "seed:=5")
    controller = ros.start("track_controller", *HOLD, *LOCKSTEP, "-p", "detectors.false_rate:=20.0")
    publishers, known = ros.node.count_publishers, ros.node.get_topic_names_and_types
    last = ("/inductrack/measured/gap_left", "/inductrack/drive_pulses", "/inductrack/wrench/total")
    ros.wait(lambda: all(map(publishers, last)) and len(known()) > 25, "simulator and controller")
    recorder = ros.start("record", "-o", str(bag), "--stamp", "header")
    every = [name for name, _ in known() if name.startswith("/inductrack/")]
    not_kept = record.NOT_WANTED
    every = [name for name in every if publishers(name) and not name.removeprefix("/inductrack/").startswith(not_kept)]
    listeners = ros.node.get_subscriptions_info_by_topic
    ros.wait(
        lambda: all("record" in {s.node_name for s in listeners(name)} for name in every), "the recorder to hear all"
    )
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    if stands:
        ros.wait(lambda: twist and seconds(twist[-1]) > 0.5 * until, "the middle of the run")
        controller.send(signal.SIGSTOP)
        time.sleep(stands)
        controller.send(signal.SIGCONT)
    ros.wait(lambda: twist and seconds(twist[-1]) > until + 0.1, "the end of the run")
    ros.call(SetBool, "/inductrack/sim/pause", data=True)
    off = {f"/inductrack/measured/{sensor}" for sensor in FURTHER_SENSORS}
    wanted = set(every) - off
    ros.wait(
        lambda: {topic for topic, time_ns in newest_in(bag).items() if time_ns > until * 1e9} >= wanted,
        "every topic in the bag to the end",
    )
    assert recorder.stop() == 0 and controller.stop() == 0 and sim.stop() == 0
    digests: dict[str, hashlib._Hash] = {}
    with Reader(bag) as reader:
        for connection, time_ns, raw in reader.messages():
            if time_ns <= until * 1e9:
                digests.setdefault(connection.topic, hashlib.sha256()).update(time_ns.to_bytes(8, "little") + raw)
    assert wanted == set(digests)
    return {topic: digest.hexdigest() for topic, digest in digests.items()}


def test_two_lockstep_runs_give_the_same_bag(ros, tmp_path):
    """Also where a busy machine leaves the controller out for a while."""
    first = record_lockstep(ros, tmp_path / "first", LASTS)
    second = record_lockstep(ros, tmp_path / "second", LASTS, stands=2.5 * ASK_AGAIN)
    assert first == second
    run = read_bag(tmp_path / "first")  # and it is a run of a campaign: sensors, and the pulses that were fired
    assert {"surge", "heave_rate", "gap_top", "heave_acceleration"} <= set(run.channels) and len(
        run.pulses.times
    ) > 250 * LASTS

    # The pulses that were fired, given to the model, are the run.
    truth = read_bag(tmp_path / "first", {n: f"/inductrack/{n}" for n in ("pose", "twist")} | {"imu": None})
    whole = np.column_stack([truth.values[:, truth.channels.index(name)] for name in STATES])
    fired = Pulses(truth.pulses.times, truth.pulses.coils, truth.pulses.currents)
    again = Model.create(drive="pulses").simulate(truth.times, whole[0], pulses=fired)
    until = truth.times < LASTS
    assert np.abs(again.states - whole)[until].max() < 1e-5

    # What the sensors measured, as a campaign: the model differs from it by the sensors' noise.
    Model.create(drive="pulses").save(tmp_path / "model.yaml")
    (tmp_path / "campaign.yaml").write_text("{name: rig, model: model.yaml, runs: [{file: first, drive_current: 0.0}]}")
    assert cli.main(["compare", str(tmp_path), "--output", str(tmp_path / "out")]) == 0
    comparison = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert 0.9 < comparison["error_over_noise"] < 1.1


def test_lockstep_waits_and_says_for_whom(ros):
    sim = ros.start("sim", *SIM, *LOCKSTEP, "-p", "lockstep_timeout:=0.3")
    twist = ros.listen(TwistStamped, "/inductrack/twist")
    sim.wait_for("no answer on lockstep/done to the pose at 0.000 s")
    assert not twist
    controller = ros.start("track_controller", *HOLD, *LOCKSTEP)
    ros.wait(lambda: twist and seconds(twist[-1]) > 0.2, "motion once there is a controller")
    controller.kill()
    question = "is the controller running, with lockstep: true?"
    asked = sim.output.count(question)
    ros.wait(lambda: sim.output.count(question) > asked, "the simulator to miss the controller")
    stood = len(twist)
    again = ros.start("track_controller", *HOLD, *LOCKSTEP)
    ros.call(Trigger, "/inductrack/sim/reset")
    ros.wait(lambda: len(twist) > stood + 50, "motion after a reset")
    assert sim.stop() == 0 and again.stop() == 0


def test_the_example_controller_of_the_documentation_holds_the_speed(ros):
    twist = ros.listen(TwistStamped, "/inductrack/twist")
    sim = ros.start("sim", *SIM, *LOCKSTEP)
    example = ros.start(str(EXAMPLE))
    ros.wait(lambda: twist and seconds(twist[-1]) > 2.0, "two simulated seconds")
    assert np.abs([m.twist.linear.x - 15.0 for m in twist if seconds(m) > 1.0]).max() < 0.5
    assert sim.stop() == 0 and example.stop() == 0


def test_the_demo_records_a_run(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "SECONDS", 1.0)
    monkeypatch.setenv("ROS_DOMAIN_ID", "")  # it claims one of its own
    said = demo.record(tmp_path / "run")
    # Simulated seconds: on a busy machine they take longer than a clock's.
    assert said.startswith("1.0 simulated seconds") and "drive pulses fired" in said
    first: dict[str, int] = {}
    with Reader(tmp_path / "run" / "bag") as reader:
        for connection, _, raw in reader.messages():
            first.setdefault(connection.topic, record.stamp_ns(raw))
    late = {topic for topic, stamp in first.items() if stamp and not topic.endswith("_pulses")}
    assert len(first) > 15 and not late  # `listeners`: the recorder misses nothing


def test_a_demo_whose_node_fails_does_not_wait_for_the_recording():
    failed, recorder = subprocess.Popen(["false"]), subprocess.Popen(["sleep", "600"])
    try:
        failed.wait()
        with pytest.raises(InputError, match="a node ended before the recording; see nodes.log"):
            demo.recorded(recorder, failed, log=Path("nodes.log"))
    finally:
        recorder.kill()
        recorder.wait()


def test_out_of_step_the_pulses_come_in_time(ros):
    """The simulator does not wait: pulses sent ahead arrive before they are to fire. Slowly, for a busy machine's
    sake."""
    twist = ros.listen(TwistStamped, "/inductrack/twist")
    fired = ros.listen(PointStamped, "/inductrack/fired_pulses")
    controller = ros.start("track_controller", *HOLD, "-p", "lead:=0.05")
    controller.wait_for("firing for 15 m/s")
    commanded = ros.listen(PointStamped, "/inductrack/drive_pulses")
    sim = ros.start("sim", *SIM, "-p", "speed_factor:=0.05", "-p", "paused:=true", "-p", "again:=false")
    ros.wait(lambda: ros.node.count_subscribers("/inductrack/drive_pulses") > 1, "the simulator")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    ros.wait(lambda: fired, "the controller to find the simulator, which takes a while now and then")
    new_runs = counted(twist, lambda m: m.twist.linear.x == 15.0)
    ros.call(Trigger, "/inductrack/sim/reset")
    ros.wait(new_runs, "the initial state again")
    begin = max(seconds(m) for m in twist if m.twist.linear.x == 15.0)
    in_this_run = counted(fired, lambda m: seconds(m) > begin)
    ros.wait(lambda: in_this_run() > 100, "a hundred pulses fired")
    newest = seconds(fired[-1])
    due = [m for m in commanded if begin < seconds(m) <= newest]
    assert in_this_run() > 0.6 * len(due)  # a busy machine may be late with some
    assert abs(twist[-1].twist.linear.x - 15.0) < 4.0
    assert sim.stop() == 0 and controller.stop() == 0
