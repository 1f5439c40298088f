# SPDX-License-Identifier: Apache-2.0
"""`monitor`: runs the model beside what is measured and says, live, what force it lacks and where it fails."""

from __future__ import annotations

import sys
import time

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from threadpoolctl import threadpool_limits

from .. import frames
from ..core import rig
from ..core.model import Model
from ..core.options import MODEL_OPTIONS, is_of_the_node
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import COORDINATES, FURTHER_SENSORS, INDEX, INSTRUMENTS, OUTPUTS
from ..monitoring.monitor import SEEN, Monitor, Window
from ..reports.words import sized
from .diagnostics import PERIOD, Diagnostics
from .domain import reach
from .overrides import Overrides
from .parameters import (
    Option,
    declare,
    effect_parameters,
    given,
    in_words,
    model_options,
    when_set,
    with_values,
    without_unknown,
)
from .qos import profile, publisher, subscribe
from .runtime import NAMESPACE, every, run
from .topics import fill_fields, fill_pose, fill_twist, fill_wrench, message_type, nanoseconds_of, read_fields, stamp_of

_NOISE = {f"measured.{s}.noise": rig.declared()[f"measured.{s}.noise"] for s in SEEN}
OWN = {
    "window": Parameter(0.1, "s", 0.01, 2.0, "length of the windows; a longer one shows smaller forces, later"),
    "memory": Parameter(60.0, "s", 1.0, 3600.0, "how far back the verdict looks"),
    "false_alarms": Parameter(0.1, "1/h", 1e-4, 100.0, "false alarms while the model is complete, at most, on average"),
    "reliability": Option("best_effort", "quality of service asked of what is measured", ("reliable", "best_effort")),
    **_NOISE,
}
_SENSOR_OF = {channel: sensor for sensor, instrument in INSTRUMENTS.items() for channel in instrument.channels}
SILENT = 1.0  # s without a pose, and nobody who publishes it, after which a run or a bag is over
LOOK = 0.02  # s between looks for windows that are complete


class MonitorNode(Node):
    """Message → samples; windows → residuals, wrenches, a verdict."""

    def __init__(self, overrides: Overrides = Overrides()) -> None:  # noqa: B008  it never changes
        super().__init__("monitor", namespace=NAMESPACE, automatically_declare_parameters_from_overrides=True)
        start = given(self)
        # A parameter file made for all nodes holds the simulator's own too; those are passed over.
        ours = {n: v for n, v in start.items() if n not in OWN and not is_of_the_node(n)}
        shared = overrides.shared(self.get_fully_qualified_name())
        known = without_unknown(
            {n: v for n, v in ours.items() if "." not in n}, {**PARAMETERS, **MODEL_OPTIONS}, self, shared
        )
        model = Model.from_mapping(known | {n: v for n, v in ours.items() if "." in n}, where="monitor", shared=shared)
        of_effects = effect_parameters(model)
        self._live = {*PARAMETERS, *of_effects}
        self._options = declare(self, {**PARAMETERS, **model_options(model), **of_effects, **OWN}, self._live)
        options = self._options
        self.monitor = Monitor(
            model, np.array([max(options[name], 1e-12) for name in _NOISE]),
            options["window"], options["memory"], options["false_alarms"],
        )  # fmt: skip
        model.kernel  # noqa: B018  compiled now, not in the first window

        reliable = options["reliability"] == "reliable"
        self._pose = publisher(self, PoseStamped, "residual/pose", profile())
        self._twist = publisher(self, TwistStamped, "residual/twist", profile())
        self._kinds = {sensor: message_type(sensor) for sensor in FURTHER_SENSORS}
        self._further = {s: publisher(self, kind, f"residual/{s}", profile()) for s, kind in self._kinds.items()}
        self._force = publisher(self, WrenchStamped, "missing_force", profile())
        self._sigma = publisher(self, WrenchStamped, "missing_force_sigma", profile())
        subscribe(self, PoseStamped, "measured/pose", self._take_pose, profile(reliable))
        subscribe(self, TwistStamped, "measured/twist", self._take_twist, profile(reliable))
        for sensor, kind in self._kinds.items():
            take = lambda m, sensor=sensor: self._take_further(sensor, m)  # noqa: E731
            subscribe(self, kind, f"measured/{sensor}", take, profile(reliable))
        for topic, fired in (("fired_pulses", True), ("drive_pulses", False)):
            subscribe(self, PointStamped, topic, lambda m, fired=fired: self._take_pulse(m, fired), profile(reliable))
        when_set(self, self._changed, self._take_parameters)
        self._frame = ""
        self._diagnostics = Diagnostics(self, "model", "rig")
        self._said = ""
        self._heard_at = 0.0  # s, monotonic, of the last pose
        self._concluded = 0  # windows that the last conclusion spoke of
        self._last: Window | None = None
        every(self, LOOK, self._look)
        every(self, PERIOD, self._diagnose)
        self.get_logger().info(f"{in_words(model)}; windows of {options['window']:g} s")

    # -- what comes in --------------------------------------------------------------------------------------------

    def _take_pose(self, message: PoseStamped) -> None:
        p, q = message.pose.position, message.pose.orientation
        self._frame = message.header.frame_id
        self._heard_at = time.monotonic()
        coordinates = frames.pose_to_coordinates((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        self.monitor.pose(nanoseconds_of(message.header.stamp), coordinates)

    def _take_twist(self, message: TwistStamped) -> None:
        linear, angular = message.twist.linear, message.twist.angular
        rates = np.array([linear.x, linear.y, linear.z, angular.x])
        self.monitor.twist(nanoseconds_of(message.header.stamp), rates)

    def _take_further(self, sensor: str, message: object) -> None:
        self.monitor.further(sensor, nanoseconds_of(message.header.stamp), read_fields(message, sensor))

    def _take_pulse(self, message: PointStamped, fired: bool) -> None:
        if self.monitor.model.drive != "pulses":
            self.get_logger().warning(
                "drive pulses come, but the model has drive: averaged; start monitor with -p drive:=pulses", once=True
            )
        self.monitor.pulse(nanoseconds_of(message.header.stamp), message.point.x, message.point.y, fired)

    def _changed(self, values: dict[str, object]) -> Model:
        return with_values(self.monitor.model, {n: v for n, v in values.items() if n in self._live})

    def _take_parameters(self, values: dict[str, object]) -> None:
        if values.keys() & self._live:
            self.monitor.change(self._changed(values))

    # -- what goes out --------------------------------------------------------------------------------------------

    def _look(self) -> None:
        for window in self.monitor.windows():
            self._last = window
            if window.fit is not None and not window.fit.contact:
                self._publish(window)

    def _publish(self, window: Window) -> None:
        fit = window.fit
        # The samples came message by message; what is held (fewer degrees of freedom) has no residual.
        residual, at = np.nan_to_num(fit.residual), 0
        while at < len(residual):
            sensor, stamp = _SENSOR_OF[OUTPUTS[window.samples.column[at]]], int(window.stamps[at])
            row = residual[at : at + len(INSTRUMENTS[sensor].channels)]
            at += len(row)
            self._send_residual(sensor, row, stamp)
        for topic, values in ((self._force, fit.force), (self._sigma, fit.sigma)):
            message = WrenchStamped()
            fill_wrench(message.wrench, *frames.force_to_wrench(np.nan_to_num(values)))
            self._send(topic, message, (window.begin + window.end) // 2)

    def _send_residual(self, sensor: str, row: np.ndarray, stamp: int) -> None:
        if sensor == "pose":
            message, topic = PoseStamped(), self._pose
            fill_pose(message.pose, row)
        elif sensor == "twist":
            message, topic = TwistStamped(), self._twist
            fill_twist(message.twist, *frames.rates_to_twist(row))
        else:
            message, topic = self._kinds[sensor](), self._further[sensor]
            fill_fields(message, dict(zip(INSTRUMENTS[sensor].channels, row.tolist(), strict=True)))
        self._send(topic, message, stamp)

    def _send(self, topic: Publisher, message: object, stamp: int) -> None:
        message.header.stamp, message.header.frame_id = stamp_of(stamp), self._frame
        topic.publish(message)

    def _say(self, holds: bool, sentence: str) -> None:
        if holds:
            self.get_logger().info(sentence)
        else:  # a line of its own: rclpy wants one severity to a line
            self.get_logger().warning(sentence)

    def _in_newtons(self, sentence: str) -> str:
        """The verdict with the largest force that is missing."""
        forces = [f"{c} {sized(*force, 'N·m' if c == 'roll' else 'N')}" for c, force in self.monitor.largest.items()]
        return f"{sentence}; largest missing force: {', '.join(forces)}" if forces else sentence

    def _conclude(self, why: str) -> None:
        """The verdict on all windows so far, once."""
        count = self.monitor.counts.windows
        if count > self._concluded:
            self._concluded = count
            holds, sentence = self.monitor.status()
            self._say(holds, f"{why}; verdict after {count} windows: {self._in_newtons(sentence)}")

    def close(self) -> None:
        """Say the verdict when the node ends, for what was measured since it was said last."""
        self._look()
        self._conclude("the monitor ends")

    def _diagnose(self) -> None:
        monitor, counts = self.monitor, self.monitor.counts
        holds, sentence = monitor.status()
        if sentence != self._said:
            self._said = sentence
            waits = not monitor.started
            self._say(holds, f"{sentence}; {reach()}" if waits else self._in_newtons(sentence))
        silent = time.monotonic() - self._heard_at > SILENT
        if silent and not self.count_publishers("measured/pose"):
            self._conclude("the measurements have ended")
        facts: dict[str, object] = {
            "windows": counts.windows,
            "runs begun anew": counts.restarts,
            "windows in contact, not judged": counts.contact,
        }
        facts |= {
            f"fails in {c}": "; or ".join(where) or "everywhere it was tried" for c, where in monitor.failing.items()
        }
        if self._last is not None and self._last.fit is not None:
            for i, c in enumerate(COORDINATES):
                unit = "N·m" if c == "roll" else "N"
                facts[f"missing in {c} ({unit})"] = f"{self._last.fit.force[i]:.3g} ± {self._last.fit.sigma[i]:.2g}"
        for name in SEEN:
            ratio = monitor.noise_found[INDEX[name]]
            if np.isfinite(ratio):
                facts[f"noise of {name}, times measured.{name}.noise"] = f"{ratio:.2f}"
        self._diagnostics.publish(
            {
                "messages with NaN or absurd numbers": counts.not_numbers,
                "messages out of order": counts.out_of_order,
                "windows that could not be judged": counts.unfit,
            },
            facts,
            (holds, sentence),
        )


def main(args: list[str] | None = None) -> int:
    with threadpool_limits(1):  # the matrices are small; threads would only spin
        return run(MonitorNode, args)


if __name__ == "__main__":
    sys.exit(main())
