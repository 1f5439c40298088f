# SPDX-License-Identifier: Apache-2.0
"""Faults of controllers and simulators, in real processes over real DDS: what is lost, who says so, what goes on.

Idea: a rig's user wants no thrust that nobody commands, a count of what went wrong, and to go on without a restart of
what did not fail.
"""

from __future__ import annotations

import math
import os
import re
import signal
import time
from itertools import pairwise
from pathlib import Path

from conftest import wait_until
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped, WrenchStamped
from rosbags.rosbag2 import Reader
from std_msgs.msg import UInt64MultiArray
from std_srvs.srv import SetBool, Trigger

from inductrack_ros.core.parameters import PARAMETERS
from inductrack_ros.nodes.record import stamp_ns
from inductrack_ros.nodes.topics import nanoseconds_of, pulse_message, stamp_of

SIM = ["--ros-args", "-p", "drive:=pulses", "-p", "initial_state:=surge_rate=15.0"]
HOLD = ["--ros-args", "-p", "mode:=speed", "-p", "target_speed:=15.0", "-p", "lead:=0.05"]
SLOWLY = ["-p", "speed_factor:=0.05"]  # without thrust 15 m/s are gone within a second


def seconds(message) -> float:
    return nanoseconds_of(message.header.stamp) / 1e9


def recorded(bag: Path) -> list[int]:
    """Stamps (ns) of the poses in a bag, in their order."""
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic == "/inductrack/pose"]
        return sorted(stamp_ns(raw) for _, _, raw in reader.messages(connections)) or [0]


def stand_still(ros, poses: list[PoseStamped]) -> None:
    """Pause the simulator, and hear where it stands."""
    ros.call(SetBool, "/inductrack/sim/pause", data=True)
    at = float(re.search(r"[\d.]+", ros.call(Trigger, "/inductrack/sim/step").message)[0])
    ros.wait(lambda: abs(seconds(poses[-1]) - at) < 1e-6, "the pose at which it stands")


def processor_time(pid: int) -> float:
    """Seconds of processor that a process has had (Linux tells in /proc)."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


class Status:
    """The newest diagnostics of each node."""

    def __init__(self, ros) -> None:
        self._heard = ros.listen(DiagnosticArray, "/diagnostics")

    def of(self, node: str) -> DiagnosticStatus:
        found = [s for m in self._heard for s in m.status if s.name.startswith(f"/inductrack/{node}:")]
        return found[-1] if found else DiagnosticStatus()

    def count(self, node: str, name: str) -> int:
        return int({v.key: v.value for v in self.of(node).values}.get(name, -1))


def test_controllers_and_simulators_come_and_go(ros, figure):
    status = Status(ros)
    twist = ros.listen(TwistStamped, "/inductrack/twist")
    thrust = ros.listen(WrenchStamped, "/inductrack/wrench/thrust")
    fired = ros.listen(PointStamped, "/inductrack/fired_pulses")
    sim = ros.start(
        "sim", *SIM, *SLOWLY, "-p", "command_timeout:=0.05", "-p", "publish_clock:=true", "-p", "paused:=true"
    )
    ros.wait(lambda: "no controller" in status.of("sim").message, "the simulator to miss a controller")
    assert all(m.wrench.force.x == 0.0 for m in thrust) and not fired

    controller = ros.start("track_controller", *HOLD)
    controller.wait_for("firing for 15 m/s")
    ros.wait(lambda: "no controller" not in status.of("sim").message, "the simulator to see it")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    ros.wait(lambda: len(fired) > 15, "pulses")
    controller.kill()
    killed = seconds(twist[-1])
    sim.wait_for("no drive pulse for 0.05 s (command_timeout): no thrust; is the controller running?")
    ros.wait(lambda: status.count("sim", "lost controllers") == 1, "the count")
    assert status.of("sim").level == DiagnosticStatus.WARN
    ros.wait(lambda: len(fired) == status.count("sim", "fired pulses"), "all that was fired")

    def after() -> list[float]:
        return [
            m.wrench.force.x for m in thrust if seconds(m) > seconds(fired[-1]) + PARAMETERS["pulse_length"].default
        ]

    ros.wait(after, "what the simulator says of the thrust")
    assert not any(after())
    figure("thrust after the controller was killed", f"{1e3 * max(0.0, seconds(fired[-1]) - killed):.0f} ms simulated")

    ros.call(SetBool, "/inductrack/sim/pause", data=True)  # or a busy machine lets it slow down and land meanwhile
    count = len(fired)
    again = ros.start("track_controller", *HOLD)
    again.wait_for("firing for 15 m/s")
    ros.wait(lambda: "no controller" not in status.of("sim").message, "the simulator to see it")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    ros.wait(lambda: len(fired) > count + 15, "pulses of the controller that was started again")
    assert status.count("sim", "lost controllers") == 1

    # Another controller and another simulator, as anybody's publishers, are said to be there.
    begun = time.monotonic()
    others = (
        ros.publisher(PointStamped, "/inductrack/drive_pulses"),
        ros.node.create_publisher(PoseStamped, "/inductrack/pose", 1),
    )
    sim.wait_for("two simulators on one domain?")
    figure("two simulators on one domain: said after", f"{time.monotonic() - begun:.1f} s")
    sim.wait_for("nodes publish drive_pulses")
    ros.wait(lambda: "another simulator, another controller" in status.of("sim").message, "the diagnostics to say so")
    for other in others:
        ros.node.destroy_publisher(other)

    sim.kill()
    ros.wait(lambda: "no pose for" in status.of("track_controller").message, "the controller to miss its poses")
    count, sent = len(fired), status.count("track_controller", "pulses sent")
    new = ros.start("sim", *SIM, *SLOWLY, "-p", "publish_clock:=true", "-p", "listeners:=1")
    ros.wait(lambda: len(fired) > count + 15, "pulses in the simulator that was started again")
    ros.wait(lambda: status.count("track_controller", "pulses sent") > sent, "the controller to count them")
    assert again.running

    assert new.stop() == 0 and again.stop() == 0


#: Seconds from now, coil, current: nothing of this may be fired.
WILD_PULSES = [
    (0.2, math.nan, 7e3), (0.2, 3.0, math.nan), (0.2, math.inf, 7e3), (0.2, 3.0, -math.inf), (0.2, -1.0, 7e3),
    (0.2, 2.5, 7e3), (0.2, 1e300, 7e3), (0.2, 3.0, 1e300), (0.2, 3.0, -2.1e4), (1e9, 3.0, 7e3), (-1e9, 3.0, 7e3),
    (2.0, 3.0, 7e3), (-0.01, 3.0, 7e3), (-3e9, 3.0, 7e3),
]  # fmt: skip


def test_wild_pulses_a_flood_and_wild_parameters_do_no_harm(ros, figure):
    status = Status(ros)
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    thrust = ros.listen(WrenchStamped, "/inductrack/wrench/thrust")
    fired = ros.listen(PointStamped, "/inductrack/fired_pulses")
    sim = ros.start("sim", *SIM, "-p", "publish_clock:=true", "-p", "again:=false")
    pulses = ros.publisher(PointStamped, "/inductrack/drive_pulses")
    ros.connect("/inductrack/sim")
    ros.wait(lambda: poses and seconds(poses[-1]) > 0.1, "poses")
    stand_still(ros, poses)  # when these are taken, which a busy machine may put off

    def send(after: float, coil: float, current: float) -> None:
        stamp = nanoseconds_of(poses[-1].header.stamp) + round(after * 1e9)
        pulses.publish(pulse_message(stamp_of(max(-(2**31) * 10**9, stamp)), coil, current))

    for wild in WILD_PULSES:
        send(*wild)
    taken = ("late pulses", "refused pulses")
    ros.wait(lambda: sum(status.count("sim", n) for n in taken) == len(WILD_PULSES), "all to be refused or late")
    assert not fired and not any(m.wrench.force.x for m in thrust)

    # A flood: simulated time keeps its pace, and nobody's thrust is the sum of thousands.
    def pace(while_waiting=ros.spin, enough=lambda: True) -> float:
        """Simulated time for each second of processor that the simulator gets, however much others take."""
        begin, first = processor_time(sim.pid), seconds(poses[-1])
        end = first + 1.0
        wait_until(lambda: seconds(poses[-1]) > end and enough(), "simulated time to go on", while_waiting)
        return (seconds(poses[-1]) - first) / (processor_time(sim.pid) - begin)

    sent = 0

    def flood() -> None:
        nonlocal sent
        for _ in range(50):
            send(0.5, 40.0, 7e3)
            sent += 1
        for _ in range(50):
            ros.spin(0.0)

    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    before = pace()
    stand_still(ros, poses)
    refused = status.count("sim", "refused pulses")
    flood()  # of which one is fired: time stands until all are taken
    ros.wait(lambda: status.count("sim", "refused pulses") == refused + sent - 1, "the flood's beginning")
    ros.call(SetBool, "/inductrack/sim/pause", data=False)
    begin = time.monotonic()
    during = pace(flood, lambda: sent > 1000)
    rate = sent / (time.monotonic() - begin)
    figure("flood of drive pulses", f"{rate:.0f}/s; simulated time at {100 * during / before:.0f} % of its pace")
    assert during > 0.2 * before
    ros.wait(lambda: fired and seconds(poses[-1]) > seconds(fired[-1]) + 0.6, "the last pulse to have burnt")
    begins = sorted(seconds(m) for m in fired)
    assert all(b - a >= PARAMETERS["pulse_length"].default for a, b in zip(begins[:-1], begins[1:], strict=True))

    # Parameters: whatever is asked, the answer is yes or a reason, and what is published stays finite.
    asked, before_parameters = 0, len(poses)
    for name, declared in PARAMETERS.items():
        for value in (math.nan, -math.inf, declared.low, declared.high):
            asked += 1
            result = ros.set_parameter("/inductrack/sim", name, value)
            assert (
                result.successful
                or name in result.reason
                or "out of bounds" in result.reason
                or "bounds" in result.reason
            )
            assert result.successful is False or declared.low <= value <= declared.high
    for name, value in (
        ("speed_factor", math.nan),
        ("measured.heave.noise", math.nan),
        ("mass", "heavy"),
        ("mass", [1.0]),
    ):
        assert not ros.set_parameter("/inductrack/sim", name, value).successful
    figure("parameters set at run time to NaN, infinity and the ends of their ranges", asked)
    answer = ros.call(Trigger, "/inductrack/sim/reset")
    assert sim.running and (answer.success or "nothing carries the cradle" in answer.message), answer.message
    numbers = [(m.pose.position.x, m.pose.position.y, m.pose.position.z, m.pose.orientation.w) for m in poses]
    assert len(numbers) > before_parameters
    assert all(map(math.isfinite, sum(numbers, ())))
    assert sim.stop() == 0


def test_a_clock_that_jumps_changes_nothing(ros, tmp_path, figure):
    """The wall clock jumps an hour back and forth all the time; ticks, stamps and the bag go on as if it did not."""
    jumping = tmp_path / "jumping.py"
    jumping.write_text(
        "import itertools, sys, time\n"
        "real, calls = time.time_ns, itertools.count()\n"
        "time.time_ns = lambda: real() + 3600 * 10**9 * (-1) ** (next(calls) // 7)\n"
        "time.time = lambda: time.time_ns() / 1e9\n"
        "name = sys.argv.pop(1)\n"
        "from inductrack_ros.nodes import start\n"
        "sys.exit(getattr(start, name)())\n"
    )
    bag = tmp_path / "bag"
    recorder = ros.start(str(jumping), "record", "-o", str(bag), "/inductrack/pose")
    recorder.wait_for("[INFO]")
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    sim = ros.start(str(jumping), "sim", "--ros-args", "-p", "listeners:=2")
    ros.wait(lambda: len(poses) > 250, "half a second of poses")
    newest = nanoseconds_of(poses[-1].header.stamp)
    ros.wait(lambda: recorded(bag)[-1] >= newest, "all of it in the bag")
    assert recorder.stop() == 0 and sim.stop() == 0
    assert {nanoseconds_of(b.header.stamp) - nanoseconds_of(a.header.stamp) for a, b in pairwise(poses)} == {2_000_000}
    assert {t for m in poses if (t := nanoseconds_of(m.header.stamp)) <= newest} <= set(recorded(bag))
    figure("poses lost while the wall clock jumped by an hour", 0)


def test_a_jumping_pose_does_not_mislead_the_controller(ros):
    """Its clock jumps, its place jumps, its number is missing: nothing is fired until the motion is known again."""
    status = Status(ros)
    sent = ros.listen(PointStamped, "/inductrack/drive_pulses")
    controller = ros.start("track_controller", *HOLD, "-p", "lockstep:=true")
    answers = ros.listen(UInt64MultiArray, "/inductrack/lockstep/done")
    poses = ros.publisher(PoseStamped, "/inductrack/pose")
    ros.connect("/inductrack/track_controller")

    def pose(at: float, surge: float) -> None:
        message = PoseStamped()
        message.header.stamp = stamp_of(round(at * 1e9))
        message.pose.position.x = surge
        poses.publish(message)

    def run(begin: float, place: float, count: int = 150) -> None:
        """Poses at 15 m/s, each answered."""
        for i in range(count):
            answered = len(answers)
            pose(begin + i / 500, place + 15.0 * i / 500)
            ros.wait(lambda n=answered: len(answers) > n, "an answer")

    run(100.0, 0.0)
    ros.wait(lambda: sent, "pulses")
    for wild in (math.nan, math.inf, -math.inf):
        pose(100.6, wild)
    for begin, place in ((2e9, 9.0), (-1e9, 9.0), (100.0, 1e300), (100.0, -1e18), (100.0, 50.0)):
        pose(begin, place)
    ros.wait(lambda: status.count("track_controller", "poses that cannot be") == 6, "the count of broken poses")
    ros.wait(lambda: answers[-1].data[0] == round(100.0 * 1e9), "the answer to the last of them")
    ros.wait(lambda: len(sent) == sum(m.data[1] for m in answers), "all pulses that the answers tell of")
    sent.clear()
    run(200.0, 1000.0)
    ros.wait(lambda: status.count("track_controller", "poses that jumped") >= 2, "the count of jumps")
    ros.wait(lambda: sent, "pulses")
    assert all(200.0 < seconds(m) < 200.4 and 2 * 10000 < m.point.x < 2 * 10200 for m in sent)
    assert controller.stop() == 0


def test_a_recorder_that_stalls_holds_nobody_up_and_loses_nothing(ros, tmp_path, figure):
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    stalled = ros.start("record", "-o", str(tmp_path / "bag"))
    sim = ros.start("sim", "--ros-args", "-p", "publish_clock:=true")
    ros.wait(lambda: ros.node.count_subscribers("/inductrack/pose") > 1 and len(poses) > 200, "poses")

    def lasts(simulated: float) -> float:
        """Seconds of real time that so much simulated time takes: minutes, which nobody waits for here, where each
        message waits 0.1 s for the recorder."""
        begin, end = time.monotonic(), seconds(poses[-1]) + simulated
        ros.wait(lambda: seconds(poses[-1]) > end, "simulated time to go on")
        return time.monotonic() - begin

    before = lasts(3.0)
    stalled.send(signal.SIGSTOP)
    during = lasts(3.0)
    stalled.send(signal.SIGCONT)
    figure("pace of simulated time while a recorder stands still for 3 s", f"{100 * before / during:.0f} %")
    assert {nanoseconds_of(b.header.stamp) - nanoseconds_of(a.header.stamp) for a, b in pairwise(poses)} == {2_000_000}
    newest = nanoseconds_of(poses[-1].header.stamp)
    ros.wait(lambda: recorded(tmp_path / "bag")[-1] >= newest, "the recorder to catch up")
    assert stalled.stop() == 0 and sim.stop() == 0
    stamps = recorded(tmp_path / "bag")
    assert {b - a for a, b in pairwise(stamps)} == {2_000_000}
    figure("poses lost by a recorder that stood still for 3 s", 0)
