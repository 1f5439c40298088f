# SPDX-License-Identifier: Apache-2.0
"""A run as rosbag2 (MCAP) with the topics of the simulator's node, through the pure-Python `rosbags` package."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from .. import frames
from ..core.errors import InputError
from ..core.model import Pulses
from ..core.rig import Record
from ..core.state import COORDINATES, FURTHER_SENSORS, GAPS, RATES
from .bags import MEASURED, ODOMETRY, PULSE_TOPICS, TRUTH, TYPES
from .measurement import Array
from .message_fields import blank_message, fields_of, write_field


def write_bag(
    path: str | Path,
    times: ArrayLike,
    columns: Mapping[str, ArrayLike],
    *,
    start: float = 0.0,
    pulses: Pulses | None = None,
    measured: Mapping[str, Record] | None = None,
    gravity: float = frames.GRAVITY,
    frame_id: str = "track",
    child_frame_id: str = "cradle",
) -> None:
    """Write a run as a rosbag2 folder (MCAP) with the topics that the simulator's node publishes under `/inductrack/`.

    times: (n,) s; columns: (n,) each: all eight states, and gaps if there are any; start: s added to every stamp.
    measured: what each sensor delivered, for the topics under `measured/`; gravity: m/s², what an Imu at rest shows.
    pose and twist are in the track's axes, the twist of the odometry in the cradle's, as ROS has it.
    The bag appears complete or not at all. Raises InputError if the path exists or cannot be written, or a state is
    missing.
    """
    path = Path(path)
    if missing := [c for c in (*COORDINATES, *RATES) if c not in columns]:
        raise InputError(f"{path}: a bag needs all states; missing: {', '.join(missing)}")
    table = {name: np.asarray(values, float) for name, values in columns.items()}
    stamps = _nanoseconds(times) + _nanoseconds(start)
    if len(stamps) and stamps.min() < 0:
        raise InputError(f"{path}: times before 0 cannot be ROS stamps; give a later start")
    if os.path.lexists(path):
        raise InputError(f"{path}: exists already; choose another name or delete it first")
    if not path.parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.parent}; create it first")
    try:
        # The file inside bears the folder's name, so the sibling is a folder that holds the bag under its final name.
        with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as temporary:
            unfinished = Path(temporary, path.name)
            with Writer(unfinished, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP) as writer:
                _write_messages(writer, stamps, table, pulses, start, frame_id, child_frame_id)
                _write_measured(_Bag(writer, frame_id), measured or {}, start, gravity, child_frame_id)
            unfinished.rename(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


class _Bag:
    """A bag that is written: makes headers and, for each topic, a function that writes its messages."""

    def __init__(self, writer: Writer, frame_id: str) -> None:
        self._writer, self._frame, self._store = writer, frame_id, get_typestore(Stores.ROS2_JAZZY)
        kinds = self._store.types.items()
        self.geometry = {name.rpartition("/")[2]: kind for name, kind in kinds if name.startswith("geometry_msgs/")}

    def header(self, stamp: int, frame: str | None = None) -> Any:
        """A header of a stamp in ns."""
        time = self._store.types["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
        return self._store.types["std_msgs/msg/Header"](time, self._frame if frame is None else frame)

    def add(self, topic: str, msgtype: str) -> Callable[..., None]:
        """Function that writes a message of this type, given its stamp and its fields."""
        connection = self._writer.add_connection(topic, msgtype, typestore=self._store)
        kind = self._store.types[msgtype]
        return lambda stamp, *fields: self._writer.write(
            connection, stamp, self._store.serialize_cdr(kind(*fields), msgtype)
        )

    def add_readings(self, sensor: str, stamps: list[int], readings: Array) -> None:
        """Write what a sensor that declares itself delivered: its readings (m, c) go into the fields of its message."""
        connection = self._writer.add_connection(MEASURED + sensor, TYPES[sensor], typestore=self._store)
        message, fields = blank_message(TYPES[sensor]), fields_of(sensor)
        for stamp, row in zip(stamps, readings.tolist(), strict=True):
            message.header = self.header(stamp)
            for field, value in zip(fields, row, strict=True):
                write_field(message, field, value)
            self._writer.write(connection, stamp, self._store.serialize_cdr(message, TYPES[sensor]))


def _write_measured(
    bag: _Bag, measured: Mapping[str, Record], start: float, gravity: float, child_frame_id: str
) -> None:
    """What the sensors delivered, as the `sim` node publishes it."""
    point, vector, quaternion = (bag.geometry[n] for n in ("Point", "Vector3", "Quaternion"))
    no_covariance = np.zeros(9)
    not_measured = np.array([-1.0, *no_covariance[1:]])
    for sensor, record in measured.items():
        stamps = (_nanoseconds(record.times) + _nanoseconds(start)).tolist()
        if sensor in FURTHER_SENSORS:
            bag.add_readings(sensor, stamps, record.readings)
            continue
        write = bag.add(MEASURED + sensor, TYPES[sensor])
        if sensor == "pose":
            position, orientation = frames.coordinates_to_pose(record.readings)
            for stamp, p, q in zip(stamps, position.tolist(), orientation.tolist(), strict=True):
                write(stamp, bag.header(stamp), bag.geometry["Pose"](point(*p), quaternion(*q)))
        elif sensor == "twist":
            linear, angular = frames.rates_to_twist(record.readings)
            for stamp, v, w in zip(stamps, linear.tolist(), angular.tolist(), strict=True):
                write(stamp, bag.header(stamp), bag.geometry["Twist"](vector(*v), vector(*w)))
        elif sensor == "imu":
            felt = frames.accelerations_to_specific_force(record.readings, record.roll, gravity)
            still = quaternion(0.0, 0.0, 0.0, 1.0), not_measured, vector(0.0, 0.0, 0.0), not_measured
            for stamp, f in zip(stamps, felt.tolist(), strict=True):
                write(stamp, bag.header(stamp, child_frame_id), *still, vector(*f), no_covariance)
        else:
            for stamp, (gap,) in zip(stamps, record.readings.tolist(), strict=True):
                write(stamp, bag.header(stamp, sensor), 1, 0.0, 0.0, 0.0, gap, 0.0)


def _write_messages(
    writer: Writer,
    stamps: NDArray[np.int64],
    table: Mapping[str, Array],
    pulses: Pulses | None,
    start: float,
    frame_id: str,
    child_frame_id: str,
) -> None:
    bag = _Bag(writer, frame_id)
    geometry, header, add = bag.geometry, bag.header, bag.add
    point, vector, quaternion = geometry["Point"], geometry["Vector3"], geometry["Quaternion"]
    no_covariance = np.zeros(36)

    write_pose, write_twist = add(TRUTH + "pose", TYPES["pose"]), add(TRUTH + "twist", TYPES["twist"])
    write_odometry = add(ODOMETRY, "nav_msgs/msg/Odometry")
    gaps = {gap: add(TRUTH + gap, TYPES[gap]) for gap in GAPS if gap in table}

    coordinates = np.column_stack([table[c] for c in COORDINATES])
    rates = np.column_stack([table[c] for c in RATES])
    rows = zip(
        stamps.tolist(),
        *(a.tolist() for a in frames.coordinates_to_pose(coordinates)),
        *(a.tolist() for a in frames.rates_to_twist(rates)),
        *(a.tolist() for a in frames.rates_to_body_twist(rates, coordinates[:, 3])),
        strict=True,
    )
    for i, (stamp, position, orientation, linear, angular, body_linear, body_angular) in enumerate(rows):
        head = header(stamp)
        pose = geometry["Pose"](point(*position), quaternion(*orientation))
        twist = geometry["Twist"](vector(*linear), vector(*angular))
        body_twist = geometry["Twist"](vector(*body_linear), vector(*body_angular))
        write_pose(stamp, head, pose)
        write_twist(stamp, head, twist)
        write_odometry(
            stamp,
            head,
            child_frame_id,
            geometry["PoseWithCovariance"](pose, no_covariance),
            geometry["TwistWithCovariance"](body_twist, no_covariance),
        )
        for gap, write in gaps.items():
            # Infrared is the nearest kind that the message knows. No limits declared, for a gap in contact is negative.
            write(stamp, header(stamp, gap), 1, 0.0, 0.0, 0.0, float(table[gap][i]), 0.0)
    if pulses is not None:
        write_pulse = add(PULSE_TOPICS[0], TYPES["pulses"])
        pulse_stamps = (_nanoseconds(pulses.times) + _nanoseconds(start)).clip(0).tolist()
        fired = zip(pulse_stamps, pulses.coils, pulses.currents, strict=True)
        for count, (stamp, coil, current) in enumerate(fired, 1):
            write_pulse(stamp, header(stamp), point(float(coil), float(current), float(count)))


def _nanoseconds(seconds: ArrayLike) -> NDArray[np.int64]:
    return np.rint(np.asarray(seconds, float) * 1e9).astype(np.int64)
