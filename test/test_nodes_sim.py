# SPDX-License-Identifier: Apache-2.0
"""The `sim` node over real DDS: topics, parameters, services, drive pulses, shutdown."""

from __future__ import annotations

import math
import re
import signal
import time
from fnmatch import fnmatch
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import rclpy
from conftest import counted, wait_until
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import DescribeParameters
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, Range
from std_srvs.srv import SetBool, Trigger

from inductrack_ros import frames
from inductrack_ros.core.model import Model
from inductrack_ros.nodes.drive import PulseQueue
from inductrack_ros.nodes.listeners import recorders
from inductrack_ros.nodes.rest import Rest
from inductrack_ros.nodes.sim import SimNode
from inductrack_ros.nodes.simulation import Simulation
from inductrack_ros.nodes.topics import nanoseconds_of, pulse_message, stamp_of

OWN = Path(__file__).with_name("own_effects.py")


def seconds(message) -> float:
    return nanoseconds_of(message.header.stamp) / 1e9


def time_of(step: Trigger.Response) -> float:
    """The stamp (s) of the moment after a step."""
    return float(re.search(r"[\d.]+", step.message)[0])


def options(**values: object) -> list[str]:
    """`name__part=value` as --ros-args."""
    pairs = [("-p", f"{name.replace('__', '.')}:={value}") for name, value in values.items()]
    return ["--ros-args", *(word for pair in pairs for word in pair)]


def test_what_is_published_is_the_model_in_ros_axes(ros):
    topics = {
        "pose": PoseStamped, "twist": TwistStamped, "odometry": Odometry, "gap_top": Range, "gap_left": Range,
        "wrench/lift": WrenchStamped, "wrench/slip": WrenchStamped, "wrench/drag": WrenchStamped,
        "wrench/thrust": WrenchStamped, "wrench/contact": WrenchStamped, "wrench/aerodynamic_drag": WrenchStamped,
        "wrench/total": WrenchStamped, "measured/pose": PoseStamped, "measured/twist": TwistStamped,
        "measured/imu": Imu, "measured/gap_top": Range,
    }  # fmt: skip
    heard = {topic: ros.listen(kind, f"/inductrack/{topic}") for topic, kind in topics.items()}
    clock = ros.listen(Clock, "/clock")
    start = "surge_rate=15.5,sway=0.002,roll=0.01"
    given = options(
        publish_clock="true", initial_state=f"'{start}'", effects="[aerodynamic_drag]", paused="true",
        aerodynamic_drag__drag_area=0.03, measured__pose__rate=100.0, details_rate=100.0,
        speed_factor=0.2, again="false",  # three thousand messages a second are more than a busy machine hears
    )  # fmt: skip
    sim = ros.start("sim", *given)
    ros.connect("/inductrack/sim")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    ros.wait(
        lambda: len(heard["wrench/total"]) > 50 and len(heard["measured/imu"]) > 10 and len(clock) > 50, "messages"
    )
    ros.call(SetBool, "/inductrack/sim/pause", data=True)
    wrenches = [messages for topic, messages in heard.items() if topic.startswith("wrench/")]
    ros.wait(lambda: len({seconds(messages[-1]) for messages in wrenches}) == 1, "all of one moment")
    ros.wait(lambda: seconds(heard["pose"][-1]) >= seconds(wrenches[0][-1]), "the pose of that moment")

    documented = re.findall(
        r"^\| `([^`]+)` \|", (Path(__file__).parent.parent / "docs" / "interfaces.md").read_text(), re.MULTILINE
    )
    for name, _ in ros.node.get_topic_names_and_types():
        if name.startswith("/inductrack/"):
            assert any(fnmatch(name.removeprefix("/inductrack/"), pattern) for pattern in documented), name

    model = Model.create(effects={"aerodynamic_drag": {"drag_area": 0.03}})
    x0 = model.initial_state(surge_rate=15.5, sway=0.002, roll=0.01)
    times = np.array([seconds(m) for m in heard["pose"]])
    assert np.allclose(np.diff(times), 1 / 500, atol=2e-9)
    flying = times[times < 1.0]  # then it lands
    assert len(flying) > 200
    run = model.simulate(np.concatenate([[0.0], flying]), x0)
    for got, want in zip(heard["pose"], run.states[1:], strict=False):
        position, orientation = frames.coordinates_to_pose(want[:4])
        p, q = got.pose.position, got.pose.orientation
        assert np.allclose([p.x, p.y, p.z], position, atol=1e-6)
        assert np.allclose([q.x, q.y, q.z, q.w], orientation, atol=1e-6)
    assert {m.header.frame_id for m in heard["pose"]} == {"track"} and heard["odometry"][0].child_frame_id == "cradle"

    # Forces: parts add up to the total, and the total is mass times acceleration.
    by_time = {seconds(m): m.wrench for m in heard["wrench/total"]}
    drag = {seconds(m): m.wrench.force.x for m in heard["wrench/drag"]}
    moment = next(t for t in by_time if t in drag and t > 0.05)
    parts = ("lift", "slip", "drag", "thrust", "contact", "aerodynamic_drag")
    surge = sum(m.wrench.force.x for part in parts for m in heard[f"wrench/{part}"] if seconds(m) == moment)
    assert surge == pytest.approx(by_time[moment].force.x, rel=1e-9)
    assert drag[moment] < 0 < [m.wrench.force.z for m in heard["wrench/lift"] if seconds(m) == moment][0]
    assert heard["gap_top"][0].header.frame_id == "gap_top" and 0.003 < heard["gap_top"][0].range < 0.012
    times = sorted({round(c.clock.sec + 1e-9 * c.clock.nanosec, 6) for c in clock})
    # A hundredth of a second, whatever the rate of ticks.
    assert len(times) > 50 and np.diff(times).max() == pytest.approx(0.01)

    # What is known of the noise stands in the messages; the truth has none, and 0 would mean that it is not known.
    imu, gap, odometry = heard["measured/imu"][-1], heard["measured/gap_top"][-1], heard["odometry"][-1]
    assert np.reshape(imu.linear_acceleration_covariance, (3, 3)) == pytest.approx(np.eye(3) * 0.05**2)
    assert (gap.min_range, gap.max_range, gap.field_of_view) == pytest.approx(
        (-0.005, 0.1, 0.05)
    ) and gap.variance == pytest.approx(9e-10)
    assert heard["gap_top"][-1].variance == 0.0
    assert all(
        0 < v < 1e-9
        for c in (odometry.pose.covariance, odometry.twist.covariance)
        for v in np.reshape(c, (6, 6)).diagonal()
    )

    # The sensors: another rate, noise about the truth; an Imu at rest would show +g upwards.
    truth = {seconds(m): m.pose.position.z for m in heard["pose"]}
    errors = [m.pose.position.z - truth[seconds(m)] for m in heard["measured/pose"] if seconds(m) in truth]
    assert len(errors) < len(truth) / 3 and 1e-5 < np.std(errors) < 1e-4
    assert np.mean([m.linear_acceleration.z for m in heard["measured/imu"]]) == pytest.approx(9.81, abs=2.0)
    assert sim.stop() == 0


@pytest.mark.parametrize(
    "given, says",
    [
        (("eta:=20.0",), "eta = 20 is out of range; it must lie in [0.01, 10]"),
        (("etta:=1.0",), "unknown parameter 'etta'; did you mean 'eta'?"),
        (("speed_factor:=0.0",), "speed_factor = 0 is out of range"),
        (("rate:=fast",), "rate = 'fast' is not a number"),
        (("drive:=steam",), "drive = 'steam'; it must be 'averaged' or 'pulses'"),
        (("initial_state:=speed=3",), "unknown name 'speed'"),
        (("effects:=[aerodynamic_drg]",), "unknown effect 'aerodynamic_drg'; did you mean 'aerodynamic_drag'?"),
        (("measured.heave.nois:=1.0",), "did you mean 'measured.heave.noise'?"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name_at_the_start(ros, given, says):
    sim = ros.start("sim", "--ros-args", *(word for g in given for word in ("-p", g)))
    assert sim.wait() == 2
    assert says in sim.output and len(sim.output.strip().splitlines()) == 1, sim.output


def test_a_diagnosed_model_runs_as_it_is_and_changes_live(ros, tmp_path):
    effects = {"viscous_drag": {"coefficient": 0.5}, "sensor_delay:heave": {"delay": 0.002},
               "stand_in_heave": {"values": [0.0, 0.1, 0.2]}, "patch": {"size": 2.0},
               "track_temperature": {"coefficient": 0.004}}  # fmt: skip
    model = Model.create({"eta": 0.74}, effects, effect_files=[OWN])
    model.save(tmp_path / "model.yaml")
    sim = ros.start("sim", "--ros-args", "--params-file", str(tmp_path / "model.yaml"))
    sim.wait_for("effects: viscous_drag, sensor_delay:heave, stand_in_heave, patch, track_temperature")
    viscous = ros.listen(WrenchStamped, "/inductrack/wrench/viscous_drag")
    twist = ros.listen(TwistStamped, "/inductrack/twist")

    def coefficient() -> float | None:
        """By the newest moment of which both the force and the speed are there."""
        speeds = {seconds(message): message.twist.linear.x for message in twist}
        forces = {seconds(message): message.wrench.force.x for message in viscous}
        both = [t for t in forces.keys() & speeds.keys() if speeds[t] > 0.1]
        return -forces[max(both)] / speeds[max(both)] if both else None

    assert ros.wait(coefficient, "the effect's wrench and the speed at the same moment") == pytest.approx(0.5, rel=1e-9)
    assert ros.set_parameter("/inductrack/sim", "viscous_drag.coefficient", 2.0).successful
    for heard in (viscous, twist):
        heard.clear()
    ros.wait(lambda: coefficient() == pytest.approx(2.0, rel=1e-9), "the new coefficient to count")
    warm = ros.listen(WrenchStamped, "/inductrack/wrench/track_temperature")
    assert ros.set_parameter("/inductrack/sim", "conditions.track_temperature", 60.0).successful
    # What is resistive brakes more.
    ros.wait(lambda: warm and warm[-1].wrench.force.x < -1.0, "the temperature to count")
    live = {"eta": 0.75, "drive_current": 6000.0, "speed_factor": 0.5, "stand_in_heave.values": [0.5, 0.0]}
    for name, value in (live | {"measured.heave.noise": 0.0}).items():
        assert ros.set_parameter("/inductrack/sim", name, value).successful
    for name, value, says in (("eta", 20.0, "10.0"), ("speed_factor", -1.0, "0.001"), ("rate", 100.0, "rate")):
        result = ros.set_parameter("/inductrack/sim", name, value)
        assert not result.successful and name in result.reason and says in result.reason
    described = ros.call(DescribeParameters, "/inductrack/sim/describe_parameters", names=["mass"]).descriptors[0]
    assert "kg" in described.description and described.floating_point_range[0].to_value == 1e5
    assert sim.stop() == 0


def test_pause_step_reset_and_speed_factor(ros):
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    sim = ros.start("sim", *options(publish_clock="true", speed_factor=0.5))
    ros.wait(lambda: len(poses) > 20, "poses")
    begin = time.monotonic()
    starts = counted(poses, lambda m: seconds(m) == 0.0)
    ros.call(Trigger, "/inductrack/sim/reset")
    ros.wait(starts, "the initial state")  # the newest is soon another
    ros.wait(lambda: seconds(poses[-1]) > 0.5, "half a simulated second")
    assert time.monotonic() - begin > 0.99  # half a simulated second at half speed; a busy machine takes longer

    refused = ros.call(Trigger, "/inductrack/sim/step")
    assert not refused.success and "pause" in refused.message
    assert ros.call(SetBool, "/inductrack/sim/pause", data=True).success
    steps = [ros.call(Trigger, "/inductrack/sim/step") for _ in range(3)]
    assert all(step.success for step in steps)
    ros.wait(lambda: seconds(poses[-1]) >= time_of(steps[-1]) - 1e-6, "the pose after the last step")
    ticks = [round(500 * time_of(step)) for step in steps]
    # Time stood between.
    assert ticks == [ticks[0], ticks[0] + 1, ticks[0] + 2] == [round(500 * seconds(p)) for p in poses[-3:]]

    assert ros.call(Trigger, "/inductrack/sim/reset").success
    ros.wait(lambda: seconds(poses[-1]) == 0.0, "the initial state again")
    assert poses[-1].pose.position.x == 0.0
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    ros.wait(lambda: poses[-1].pose.position.x > 0.1, "motion again")
    assert sim.stop() == 0


def test_drive_pulses_fired_late_refused_and_two_simulators(ros):
    given = options(drive="pulses", publish_clock="true", again="false", initial_state="'surge_rate=15.0'")
    sim = ros.start("sim", *given)
    sim.wait_for("drive: pulses")
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    thrusts = ros.listen(WrenchStamped, "/inductrack/wrench/thrust")
    fired = ros.listen(PointStamped, "/inductrack/fired_pulses")
    diagnostics = ros.listen(DiagnosticArray, "/diagnostics")
    pulses = ros.publisher(PointStamped, "/inductrack/drive_pulses")
    ros.wait(lambda: poses and thrusts, "poses")
    assert all(m.wrench.force.x == 0.0 for m in thrusts)  # no controller, no thrust

    def stand_still() -> float:
        """Simulated time, which does not go on from here: a busy machine would turn early into late."""
        ros.call(SetBool, "/inductrack/sim/pause", data=True)
        return time_of(ros.call(Trigger, "/inductrack/sim/step"))

    def send(at: float, coil: float, current: float) -> None:
        pulses.publish(pulse_message(stamp_of(round(at * 1e9)), coil, current))

    now = stand_still()
    send(now - 0.1, 41, 7000.0)
    for coil, current in ((1e9, 7000.0), (3, math.nan), (3, 1e9)):
        send(now + 0.2, coil, current)

    def count(name: str) -> str:
        values = [{v.key: v.value for v in s.values} for d in diagnostics for s in d.status]
        return values[-1].get(name, "") if values else ""

    ros.wait(lambda: (count("late pulses"), count("refused pulses")) == ("1", "3"), "the counts in the diagnostics")
    assert count("fired pulses") == "0" and not fired
    assert "late by" in sim.output and "send it further ahead" in sim.output

    at = now + 0.2
    for _ in range(2):  # the second is refused, which shows that the first was taken before time goes on
        send(at, 40, 7000.0)
    ros.wait(lambda: count("refused pulses") == "4", "the pulse to be there")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    ros.wait(lambda: fired and count("fired pulses") == "1", "the echo of the pulse")
    assert seconds(fired[0]) == pytest.approx(at, abs=1e-6) and [m.point.z for m in fired] == [1.0]
    assert (fired[0].point.x, fired[0].point.y) == (40.0, 7000.0)

    second = ros.start("sim")
    sim.wait_for("two simulators on one domain?")
    assert second.stop() == 0 and sim.stop() == 0


def test_commands_that_have_come_are_taken_before_time_goes_on(ros):
    """By the simulator itself. The executor handed over one between two turns of several ticks each, while a busy
    machine's simulator caught up, and those behind it were late."""
    rclpy.init(args=["test", "--ros-args", "-p", "drive:=pulses", "-p", "publish_clock:=true"])
    sim = SimNode()
    try:
        pulses = ros.publisher(PointStamped, "/inductrack/drive_pulses")
        for coil in range(10):
            pulses.publish(pulse_message(stamp_of(9 * 10**8), coil, 7000.0))
        wait_until(lambda: sim.queue.fired + sim.queue.late == 10, "all that was commanded", sim._wake)
        assert sim.queue.late == 0
    finally:
        sim.destroy_node()
        rclpy.shutdown()


@pytest.mark.parametrize("node", ["sim", "track_controller", "record"])
def test_ctrl_c_twice_and_sigterm_end_a_node_quietly(ros, node):
    for first, second in ((signal.SIGINT, signal.SIGINT), (signal.SIGTERM, None)):
        process = ros.start(node)
        process.wait_for("[INFO]")
        process.send(first)
        if second:
            process.send(second)
        assert process.wait() == 0
        assert "Traceback" not in process.output and "Error" not in process.output, process.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_a_node_still_starts_is_quiet_too(ros, number):
    for delay in (0.0, 0.5, 1.0):  # somewhere in the imports, or as the node comes up
        process = ros.start("sim")
        ros.wait(process.minds_signals, "the start of Python")
        time.sleep(delay)
        process.send(number)
        assert process.wait() == 0
        assert "Traceback" not in process.output, process.output


def test_alone_it_flies_for_as_long_as_one_watches(ros):
    """`ros2 run inductrack_ros sim` and nothing else: it comes to rest, says so once with the remedy, and begins
    anew."""
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    sim = ros.start("sim", *options(speed_factor=10.0, rate=100.0, publish_clock="true"))

    starts = counted(poses, lambda m: m.pose.position.x == 0.0)
    ros.wait(lambda: starts() > 2 and poses[-1].pose.position.x > 5.0, "the third run")
    assert sim.output.count("has come to rest after") == 1 and "start it faster" in sim.output
    stamps = [nanoseconds_of(m.header.stamp) for m in poses]
    assert {b - a for a, b in pairwise(stamps)} == {10_000_000}  # no way back, no hole
    ros.call(SetBool, "/inductrack/sim/pause", data=True)
    after = time_of(ros.call(Trigger, "/inductrack/sim/step"))
    ros.wait(lambda: seconds(poses[-1]) == pytest.approx(after, abs=1e-6), "the pose that the step tells of")
    assert sim.stop() == 0


def test_a_run_that_somebody_records_or_waits_for_stays_one(ros):
    simulation = Simulation(Model.default(), {"surge_rate": 15.5}, 500.0, PulseQueue(10, 1e4, 6e-4))
    given = {"again": True, "lockstep": False, "listeners": 0, "track_length": 1000.0}
    assert not any(Rest(ros.node, given, controllers=0).look(simulation) for _ in range(3))  # it flies
    simulation.x[4] = 0.0
    for why in ({}, {"again": False}, {"lockstep": True}, {"listeners": 1}):
        rest = Rest(ros.node, given | why, controllers=0)
        assert [rest.look(simulation) for _ in range(4)] == ([False, True, False, True] if not why else [False] * 4)
    driven = Rest(ros.node, given | {"listeners": 1}, controllers=1)  # the listener is the controller
    assert [driven.look(simulation) for _ in range(2)] == [False, True]
    stood = Simulation(Model.default(), {"surge_rate": 0.0}, 500.0, PulseQueue(10, 1e4, 6e-4))
    assert not any(Rest(ros.node, given, controllers=0).look(stood) for _ in range(3))  # as asked
    away = Simulation(Model.default(), {"surge_rate": 17.0}, 500.0, PulseQueue(10, 1e4, 6e-4))
    away.x[0] = 999.0
    rest = Rest(ros.node, given, controllers=0)
    assert not any(rest.look(away) for _ in range(3))
    away.x[0] = 1001.0  # above its balance speed it runs away
    assert [rest.look(away) for _ in range(4)] == [False, True, False, True]
    for waits in (True, False):  # in lockstep the controller says when a run is over
        assert Rest(ros.node, given | {"lockstep": waits}, controllers=0).is_past_track(away) is not waits
    recorder = ros.start("record", "-o", "bag", "/pose")
    ros.node.create_publisher(PoseStamped, "/pose", 1)
    ros.wait(lambda: recorders(ros.node, "/pose"), "the recorder")  # its name comes after the count
    rest = Rest(ros.node, given, controllers=0)
    assert not any(rest.look(simulation) for _ in range(4))
    assert recorder.stop() == 0


def test_a_run_that_stays_one_ends_with_its_track(ros):
    """It once went on to 1e9 m, and a reset then left it paused."""
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    given = options(listeners=1, track_length=20.0, publish_clock="true", initial_state="surge_rate=17.0")
    sim = ros.start("sim", *given)
    ros.wait(lambda: "past the 20 m of its track (track_length)" in sim.output, "the end of the track")
    assert "Reset begins anew" in sim.output
    assert ros.call(SetBool, "/inductrack/sim/pause", data=False).message == "past its track; reset begins anew"
    last = seconds(poses[-1])
    assert 20.0 < poses[-1].pose.position.x < 20.1

    starts = counted(poses, lambda m: seconds(m) == 0.0)
    ros.call(Trigger, "/inductrack/sim/reset")
    ros.wait(lambda: starts() and seconds(poses[-1]) == last, "the same run once more")
    assert ros.call(SetBool, "/inductrack/sim/pause", data=True).message == "paused"
    step = ros.call(Trigger, "/inductrack/sim/step")
    assert not step.success and step.message == "past its track; reset begins anew"
    assert sim.stop() == 0


def test_another_namespace(ros):
    """And use_sim_time, which launch files set for all nodes alike: the simulator itself needs no /clock to run."""
    sim = ros.start("sim", "--ros-args", "-r", "__ns:=/rig2", "-p", "use_sim_time:=true")
    poses = ros.listen(PoseStamped, "/rig2/pose")
    ros.wait(lambda: poses, "a pose under /rig2")
    assert sim.stop() == 0


def test_help_does_not_start_a_node(ros):
    sim = ros.start("sim", "-h")
    assert sim.wait() == 0 and "the cradle in real time" in sim.output and "[INFO]" not in sim.output
