# SPDX-License-Identifier: Apache-2.0
"""What the simulator publishes: one place for topic names, message types and how each is filled (axes: `frames`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import reduce
from importlib import import_module

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PointStamped, PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, Range
from visualization_msgs.msg import Marker, MarkerArray

from .. import frames
from ..core.errors import InputError
from ..core.rig import SENSORS, Sample
from ..core.state import ACCELERATIONS, CHANNEL, COORDINATES, FURTHER, FURTHER_SENSORS, GAPS, INSTRUMENTS, RATES
from .drive import Pulse
from .listeners import Listeners
from .qos import DEPTH, profile
from .qos import publisher as qos_publisher
from .scene import scene
from .transforms import cradle_transform, gap_transforms

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the PyPI wheels
    TFMessage = None

TICK_DEPTH = 10_000  # of what is published at every tick: a recorder that stands still for seconds loses nothing
FIELD_OF_VIEW = 0.05  # rad; a spot on the track
#: Covariance (36,) of the truth: none to speak of, but 0 would mean that it is not known.
EXACT = np.diag(np.full(6, 1e-12)).ravel()
LOSSLESS = (
    "in lockstep time waits for an answer to every pose, so none may be lost; give reliable, or leave lockstep off"
)
NEWTON_METRES = 0.002  # length of a force arrow in m per N
_COLOURS = {"lift": (0.1, 0.5, 1.0), "drag": (1.0, 0.3, 0.1), "thrust": (0.1, 0.8, 0.2), "total": (0.1, 0.1, 0.1)}
_OTHER_COLOUR = (0.6, 0.2, 0.8)


def stamp_of(nanoseconds: int) -> Time:
    """Nanoseconds as a message's stamp."""
    seconds, rest = divmod(nanoseconds, 10**9)
    return Time(sec=seconds, nanosec=rest)


def nanoseconds_of(stamp: Time) -> int:
    """A message's stamp in nanoseconds."""
    return stamp.sec * 10**9 + stamp.nanosec


def fill_vector(into: object, values: Iterable[float]) -> None:
    into.x, into.y, into.z = map(float, values)


def fill_pose(into: object, coordinates: np.ndarray) -> None:
    """Surge, sway, heave, roll (4,) into a Pose."""
    position, orientation = frames.coordinates_to_pose(coordinates)
    fill_vector(into.position, position)
    into.orientation.x, into.orientation.y, into.orientation.z, into.orientation.w = orientation.tolist()


def fill_twist(into: object, linear: np.ndarray, angular: np.ndarray) -> None:
    fill_vector(into.linear, linear)
    fill_vector(into.angular, angular)


def message_type(sensor: str) -> type:
    """The message that a sensor of the rig delivers. Raises `InputError` where its package is not installed, or it has
    no header or none of the fields that its channels declare."""
    package, _, name = INSTRUMENTS[sensor].message.partition("/msg/")
    place = CHANNEL[INSTRUMENTS[sensor].channels[0]].place
    try:
        kind = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise InputError(f"{place}: {INSTRUMENTS[sensor].message} is not installed; choose another message") from None
    if sensor in FURTHER_SENSORS:
        if not hasattr(kind(), "header"):
            raise InputError(f"{place}: {INSTRUMENTS[sensor].message} has no header; choose another message")
        try:
            fill_fields(kind(), dict.fromkeys(INSTRUMENTS[sensor].channels, 0.0))
        except (AttributeError, AssertionError):
            fields = ", ".join(CHANNEL[c].field for c in INSTRUMENTS[sensor].channels)
            raise InputError(f"{place}: {INSTRUMENTS[sensor].message} has no numbers {fields}") from None
    return kind


def fill_fields(into: object, reading: Mapping[str, float]) -> None:
    """The reading of each channel into the field that the channel declares."""
    for channel, value in reading.items():
        *parents, last = CHANNEL[channel].field.split(".")
        setattr(reduce(getattr, parents, into), last, float(value))


def read_fields(message: object, sensor: str) -> np.ndarray:
    """The reading of a sensor that declares itself, out of the fields of its message, in the order of its channels."""
    return np.array(
        [reduce(getattr, CHANNEL[c].field.split("."), message) for c in INSTRUMENTS[sensor].channels], float
    )


def fill_wrench(into: object, force: np.ndarray, torque: np.ndarray) -> None:
    fill_vector(into.force, force)
    fill_vector(into.torque, torque)


class SimulatorTopics:
    """Publishers of the `sim` node, all below its namespace but /clock, /tf."""

    def __init__(self, node: Node, effects: Iterable[str], options: Mapping[str, object]) -> None:
        """``options`` are the node's own parameters, `core.options.SIM`. Raises `InputError` for an override that
        cannot be."""
        reliability = options["reliability"]
        publishers: list[Publisher] = []

        def publisher(
            kind: type, name: str, depth: int = DEPTH, qos: QoSProfile | None = None, must: str = ""
        ) -> Publisher:
            lossy = reliability == "best_effort" or (reliability == "sensor_data" and name.startswith("measured/"))
            made = qos_publisher(node, kind, name, qos or profile(not lossy, depth), must)
            publishers.append(made)
            return made

        self._messages: dict[tuple[type, str], object] = {}
        self._prefix = options["frame_prefix"]
        self._frames = self._prefix + options["track_frame"], self._prefix + options["cradle_frame"]
        # What others look up must not be lost, whatever is asked of the rest: tf2 and clocks of its listeners ask for
        # this.
        self._clock = publisher(Clock, "/clock", qos=profile()) if options["publish_clock"] else None
        self._tf = publisher(TFMessage, "/tf", qos=profile()) if TFMessage else None
        self._tf_static = publisher(TFMessage, "/tf_static", qos=profile(depth=1, latched=True)) if TFMessage else None
        self._pose = publisher(PoseStamped, "pose", TICK_DEPTH, must=LOSSLESS if options["lockstep"] else "")
        self._twist = publisher(TwistStamped, "twist", TICK_DEPTH)
        self._odometry = publisher(Odometry, "odometry")
        self._gaps = {gap: publisher(Range, gap) for gap in GAPS}
        parts = ("lift", "slip", "drag", "thrust", "contact", "weight", *effects, "total")
        self._wrenches = {part: publisher(WrenchStamped, f"wrench/{part}") for part in parts}
        self._forces = publisher(MarkerArray, "forces")
        self._scene = publisher(MarkerArray, "scene")
        self._fired = publisher(PointStamped, "fired_pulses")
        kinds = {name: message_type(name) for name in INSTRUMENTS}
        self._measured = {name: publisher(kind, f"measured/{name}", TICK_DEPTH) for name, kind in kinds.items()}
        self._of_further = {name: kinds[name]() for name in FURTHER_SENSORS}
        self.listeners = Listeners(node, publishers, leading=self._pose)

    def _blank(self, kind: type, stamp: Time, frame: str | None = None):
        """The one message of this type and frame, to be filled and published: making one takes longer than filling
        it."""
        frame = frame or self._frames[0]
        message = self._messages.get((kind, frame))
        if message is None:
            message = self._messages[kind, frame] = kind()
            message.header.frame_id = frame
        message.header.stamp = stamp
        return message

    def clock(self, stamp: Time) -> None:
        if self._clock:
            self._clock.publish(Clock(clock=stamp))

    def state(self, stamp: Time, x: np.ndarray) -> None:
        """Pose and twist, both in the track's axes."""
        self._pose.publish(self._pose_message(stamp, x[:4]))
        self._twist.publish(self._twist_message(stamp, x[4:8]))

    def details(
        self,
        stamp: Time,
        x: np.ndarray,
        truth: Mapping[str, float],
        wrenches: Mapping[str, np.ndarray],
        parameters: Mapping[str, float],
    ) -> None:
        """What is wanted less often: odometry, gaps, forces apart, markers, transform; ``parameters`` are the
        model's."""
        odometry = self._blank(Odometry, stamp)
        odometry.child_frame_id = self._frames[1]
        odometry.pose.covariance = odometry.twist.covariance = EXACT
        fill_pose(odometry.pose.pose, x[:4])
        fill_twist(odometry.twist.twist, *frames.rates_to_body_twist(x[4:8], x[3]))
        self._odometry.publish(odometry)
        for gap, to in self._gaps.items():
            to.publish(self._gap_message(stamp, gap, truth[gap], parameters["nominal_gap"]))
        parts = _lift_and_slip(wrenches)
        for name, publisher in self._wrenches.items():
            if name in parts:
                message = self._blank(WrenchStamped, stamp)
                fill_wrench(message.wrench, *frames.force_to_wrench(parts[name]))
                publisher.publish(message)
        if self._forces.get_subscription_count():
            self._forces.publish(self._arrows(stamp, x, parts))
        if self._scene.get_subscription_count():
            gaps = [truth[gap] for gap in GAPS]
            self._scene.publish(MarkerArray(markers=scene(parameters, x[:4], gaps, stamp, self._frames[0])))
        if self._tf:
            self._tf.publish(TFMessage(transforms=[cradle_transform(stamp, *self._frames, x[:4])]))

    def places(self, stamp: Time, parameters: Mapping[str, float]) -> None:
        """Where the gap sensors sit in the cradle; to be said once, and again where the model's geometry changes."""
        if self._tf_static:
            self._tf_static.publish(
                TFMessage(transforms=gap_transforms(stamp, self._frames[1], self._prefix, parameters))
            )

    def measured(
        self, stamp: Time, sample: Sample, parameters: Mapping[str, float], noise: Mapping[str, float]
    ) -> None:
        """One sensor's sample. ``parameters`` are the model's, ``noise`` the standard deviation of each channel."""
        sensor, reading = sample.sensor, sample.reading
        values = np.array([reading[c] for c in SENSORS[sensor]])
        if sensor in FURTHER_SENSORS:
            message = self._of_further[sensor]
            message.header.stamp, message.header.frame_id = stamp, self._frames[1]
            fill_fields(message, reading)
        elif sensor == "pose":
            message = self._pose_message(stamp, values)
        elif sensor == "twist":
            message = self._twist_message(stamp, values)
        elif sensor == "imu":
            message = self._blank(Imu, stamp, self._frames[1])
            message.orientation_covariance[0] = message.angular_velocity_covariance[0] = -1.0  # not measured
            specific_force = frames.accelerations_to_specific_force(values, sample.roll, parameters["gravity"])
            fill_vector(message.linear_acceleration, specific_force)
            spread = frames.accelerations_to_specific_force(
                np.diag([noise[c] for c in SENSORS[sensor]]), sample.roll, 0.0
            )
            message.linear_acceleration_covariance = (spread.T @ spread).ravel()
        else:
            message = self._gap_message(stamp, sensor, reading[sensor], parameters["nominal_gap"], noise[sensor])
        self._measured[sensor].publish(message)

    def fired(self, stamp: Time, pulse: Pulse, count: int) -> None:
        self._fired.publish(pulse_message(stamp, pulse.coil, pulse.current, self._frames[0], count))

    def _pose_message(self, stamp: Time, coordinates: np.ndarray) -> PoseStamped:
        message = self._blank(PoseStamped, stamp)
        fill_pose(message.pose, coordinates)
        return message

    def _twist_message(self, stamp: Time, rates: np.ndarray) -> TwistStamped:
        message = self._blank(TwistStamped, stamp)
        fill_twist(message.twist, *frames.rates_to_twist(rates))
        return message

    def _gap_message(self, stamp: Time, gap: str, value: float, nominal: float, noise: float = 0.0) -> Range:
        message = self._blank(Range, stamp, self._prefix + gap)
        message.radiation_type = Range.INFRARED  # the nearest kind the message knows
        message.field_of_view = FIELD_OF_VIEW
        message.min_range, message.max_range = -0.5 * nominal, 10.0 * nominal  # in contact a gap is slightly negative
        message.range = float(value)
        if hasattr(message, "variance"):  # since Jazzy
            message.variance = noise**2
        return message

    def _arrows(self, stamp: Time, x: np.ndarray, parts: Mapping[str, np.ndarray]) -> MarkerArray:
        position, _ = frames.coordinates_to_pose(x[:4])
        array = MarkerArray()
        for number, (name, part) in enumerate(parts.items()):
            force, _ = frames.force_to_wrench(part)
            arrow = Marker()
            arrow.header.stamp, arrow.header.frame_id = stamp, self._frames[0]
            arrow.ns, arrow.id, arrow.type = name, number, Marker.ARROW
            tip = position + NEWTON_METRES * force
            arrow.points = [Point(x=float(a), y=float(b), z=float(c)) for a, b, c in (position, tip)]
            arrow.scale.x, arrow.scale.y, arrow.scale.z = 0.01, 0.02, 0.03
            arrow.color.r, arrow.color.g, arrow.color.b = _COLOURS.get(name, _OTHER_COLOUR)
            arrow.color.a = 1.0
            array.markers.append(arrow)
        return array


def pulse_message(stamp: Time, coil: int, current: float, frame: str = "track", count: int = 0) -> PointStamped:
    """A drive pulse: stamp = start of the half sine, x = coil, y = signed current (A); of a fired one, z = how many
    have fired with it."""
    message = PointStamped()
    message.header.stamp = stamp
    message.header.frame_id = frame
    message.point.x, message.point.y, message.point.z = float(coil), float(current), float(count)
    return message


def channels(x: np.ndarray, quantities: Mapping[str, float]) -> dict[str, float]:
    """Every channel a sensor may read, from the state and the model's named quantities."""
    truth = dict(zip((*COORDINATES, *RATES), x[:8].tolist(), strict=True))
    return truth | {name: quantities[name] for name in (*GAPS, *ACCELERATIONS, *FURTHER)}


def _lift_and_slip(wrenches: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The magnets' lift and slip apart; the roll moment stays with the lift."""
    both = wrenches["lift"]
    slip = np.array([0.0, both[1], 0.0, 0.0])
    return {"lift": both - slip, "slip": slip, **{n: w for n, w in wrenches.items() if n != "lift"}}
