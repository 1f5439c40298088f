# SPDX-License-Identifier: Apache-2.0
"""`track_controller`: watches the photodiodes and fires the drive coils, each with the time at which to fire."""

from __future__ import annotations

import sys
import time

from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.node import Node
from std_msgs.msg import UInt64MultiArray

from ..core.parameters import PARAMETERS, Parameter
from .detectors import Photodiodes
from .diagnostics import PERIOD, Diagnostics
from .firing import FiringPlan, Motion, SpeedHold
from .overrides import Overrides
from .parameters import MODEL_OPTIONS, Option, declare, given, when_set, without_unknown
from .qos import profile, publisher, subscribe
from .runtime import NAMESPACE, every, run
from .topics import LOSSLESS, nanoseconds_of, pulse_message, stamp_of

DECLARED = {
    "mode": Option("current", "fire at a given current, or hold a speed", ("current", "speed")),
    "drive_current": PARAMETERS["drive_current"],
    "target_speed": Parameter(15.0, "m/s", 0.1, 500.0, "speed to hold in mode speed"),
    "gain": Parameter(3000.0, "A·s/m", 0.0, 1e6, "current for each m/s that is missing"),
    "integral_gain": Parameter(3000.0, "A/m", 0.0, 1e6, "growth of the current for each m/s that is missing"),
    "max_current": Parameter(14000.0, "A", 0.0, 1e6, "the controller asks for no more"),
    "min_speed": Parameter(1.0, "m/s", 0.01, 100.0, "no coil is fired below this speed"),
    "lead": Parameter(0.02, "s", 1e-3, 0.5, "how long before its firing a pulse is commanded; cover the round trip"),
    "lockstep": Option(False, "answer every pose on lockstep/done, for a simulator in lockstep"),
    "wavelength": PARAMETERS["wavelength"],
    "pulse_length": PARAMETERS["pulse_length"],
    "detectors.spacing": Parameter(0.05, "m", 1e-3, 10.0, "distance of the photodiodes along the track"),
    "detectors.width": Parameter(0.02, "m", 0.0, 1.0, "length of the flag that darkens them"),
    "detectors.latency": Parameter(0.0, "s", 0.0, 0.1, "how late a photodiode reports"),
    "detectors.assumed_latency": Parameter(0.0, "s", 0.0, 0.1, "what the controller takes that latency for"),
    "detectors.failed": Option([-1], "numbers of photodiodes that never report; [-1] is none"),
    "detectors.false_rate": Parameter(0.0, "1/s", 0.0, 1e4, "reports that come from nothing"),
    "detectors.seed": Option(0, "seed of the false reports"),
}
LIVE = {"mode", "drive_current", "target_speed", "gain", "integral_gain", "max_current", "min_speed", "lead"}
BACK = 0.1  # m; a pose so far behind the last one means that the simulator was reset
AHEAD = 1.0, 10.0  # s, m; one so far ahead of it, that the clock jumped or another simulator speaks
LAST_STAMP = (2**31 - 2) * 10**9  # ns; a message cannot hold a later time
FARTHEST = 1e6  # m; the simulator's longest track
PATIENCE = 1.0  # s of real time without a pose after which the controller says so


class TrackController(Node):
    """Pose → photodiode edges → drive pulses."""

    def __init__(self, overrides: Overrides = Overrides()) -> None:  # noqa: B008  it never changes
        super().__init__("track_controller", namespace=NAMESPACE, automatically_declare_parameters_from_overrides=True)
        start = given(self)
        ours = {n: v for n, v in start.items() if not _of_the_model(n)}
        without_unknown(ours, DECLARED, self, overrides.shared(self.get_fully_qualified_name()))
        self._options = declare(self, DECLARED, LIVE)
        self._begin()
        self._sent = self._jumps = self._broken = 0
        self._last_pose: float | None = None  # real time
        options = self._options
        must = LOSSLESS if options["lockstep"] else ""
        self._pulses = publisher(self, PointStamped, "drive_pulses", profile(), must)
        self._done = None
        if options["lockstep"]:
            self._done = publisher(self, UInt64MultiArray, "lockstep/done", profile(), must)
        # In lockstep every pose counts; else the newest does, and edges are interpolated between those that came.
        qos = profile() if options["lockstep"] else profile(reliable=False, depth=1)
        subscribe(self, PoseStamped, "pose", self._take_pose, qos, must)
        when_set(self, self._check_parameters, self._take_parameters)
        self._diagnostics = Diagnostics(self, "firing")
        every(self, PERIOD, self._diagnose)
        self.get_logger().info(self._what_it_does())

    def _begin(self) -> None:
        """A new run: nothing is known of the motion."""
        options = self._options
        self._photodiodes = Photodiodes(
            options["detectors.spacing"], options["detectors.width"], options["detectors.latency"],
            options["detectors.failed"], options["detectors.false_rate"], options["detectors.seed"],
        )  # fmt: skip
        self._motion = Motion(
            options["detectors.width"], options["detectors.assumed_latency"], tolerance=0.25 * options["wavelength"]
        )
        self._plan = FiringPlan(
            self._motion, 0.5 * options["wavelength"], options["pulse_length"], options["lead"], options["min_speed"],
            waits=options["lockstep"],
        )  # fmt: skip
        self._hold = self._new_hold()
        self._zero: int | None = None  # ns of the first pose; the times of this run are seconds since
        self._newest = 0
        self._surge = 0.0

    def _new_hold(self) -> SpeedHold:
        options = self._options
        return SpeedHold(
            options["target_speed"],
            options["drive_current"],
            options["gain"],
            options["integral_gain"],
            options["max_current"],
        )

    def _what_it_does(self) -> str:
        options = self._options
        asked = (
            f"{options['drive_current']:g} A" if options["mode"] == "current" else f"{options['target_speed']:g} m/s"
        )
        return f"firing for {asked}, {1e3 * options['lead']:g} ms ahead"

    def _take_pose(self, message: PoseStamped) -> None:
        stamp = nanoseconds_of(message.header.stamp)
        surge = message.pose.position.x
        self._last_pose = time.monotonic()
        if not (abs(surge) <= FARTHEST and 0 <= stamp <= LAST_STAMP):
            self._broken += 1
            return
        if self._zero is not None and not self._follows(stamp, surge):
            self._jumps += 1
            self._begin()
        if self._zero is None:
            self._zero = stamp
        self._newest, self._surge = stamp, surge
        now = (stamp - self._zero) / 1e9
        for edge in self._photodiodes.see(now, surge):
            self._motion.add(edge)
        amplitude = self._options["drive_current"] if self._options["mode"] == "current" else self._hold
        pulses = self._plan.pulses(now, amplitude)
        for pulse in pulses:
            at = stamp_of(self._zero + round(pulse.time * 1e9))
            self._pulses.publish(pulse_message(at, pulse.coil, pulse.current))
        self._sent += len(pulses)
        if self._done:
            self._done.publish(UInt64MultiArray(data=[stamp, len(pulses)]))

    def _follows(self, stamp: int, surge: float) -> bool:
        """Whether a pose can be the next of this run; after a reset or a jump of the clock the motion is learnt
        anew."""
        passed, moved = (stamp - self._newest) / 1e9, surge - self._surge
        return 0.0 <= passed <= AHEAD[0] and -BACK <= moved <= AHEAD[1]

    def _check_parameters(self, values: dict[str, object]) -> None:
        for name in values.keys() & DECLARED.keys():  # rclpy's own check of a range lets NaN pass
            DECLARED[name].check(name, values[name])

    def _take_parameters(self, values: dict[str, object]) -> None:
        before = self._options["mode"]
        self._options.update(values)
        options = self._options
        self._plan.lead, self._plan.minimum_speed = options["lead"], options["min_speed"]
        if options["mode"] != before:
            self._hold = self._new_hold()  # it begins at the current that was fired so far
        hold = self._hold
        hold.speed, hold.limit = options["target_speed"], options["max_current"]
        hold.gain, hold.integral_gain = options["gain"], options["integral_gain"]
        self.get_logger().info(self._what_it_does())

    def _diagnose(self) -> None:
        silent = None if self._last_pose is None else time.monotonic() - self._last_pose
        lost = silent is None or silent > PATIENCE
        self._diagnostics.publish(
            {
                "photodiode reports that do not fit": self._motion.rejected,
                "poses that jumped": self._jumps,
                "poses that cannot be": self._broken,
            },
            {"pulses sent": self._sent, "speed (m/s)": f"{self._motion.speed:.3f}"},
            (not lost, "waiting for a pose" if silent is None else f"no pose for {silent:.0f} s" if lost else ""),
        )


def _of_the_model(name: str) -> bool:
    """Whether a parameter is the model's: a parameter file for all nodes holds those too."""
    return name in PARAMETERS or name in MODEL_OPTIONS or ("." in name and not name.startswith("detectors."))


def main(args: list[str] | None = None) -> int:
    return run(TrackController, args)


if __name__ == "__main__":
    sys.exit(main())
