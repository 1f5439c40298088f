# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag's topics as columns of numbers, in the order of their stamps."""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from .. import frames
from ..core.errors import InputError, did_you_mean
from ..core.state import FURTHER_SENSORS, GAPS, INSTRUMENTS
from .bag_files import Bag, said_of
from .measurement import Array
from .message_fields import fields_of
from .message_fields import read_field as field_of
from .order import OUT_OF_ORDER, Place, in_order

TYPES = {name: sensor.message for name, sensor in INSTRUMENTS.items()} | {"pulses": "geometry_msgs/msg/PointStamped"}
#: Columns that a topic gives; those of pulses are coil, current and how many had fired.
COLUMNS = {name: sensor.channels for name, sensor in INSTRUMENTS.items()} | {"pulses": ("coil", "current", "count")}
#: Messages that are turned into channels at a time.
BLOCK = 4096
#: Length of a quaternion that is taken for a unit one.
UNIT = (0.9, 1.1)
#: Pitch and yaw (rad) that are worth a word.
ASKEW = 0.05


@dataclass
class Stream:
    """What one topic gave: stamps (n,) in ns, names of its columns, and these, (n,) each, NaN where not measured; the
    number of each message on the topic, from 1."""

    topic: str
    stamps: NDArray[np.int64]
    names: tuple[str, ...]
    columns: list[Array]
    numbers: NDArray[np.int32]


def read_streams(bag: Bag, wanted: Mapping[str, str], notes: list[str]) -> dict[str, Stream]:
    """Read topics (by key of `TYPES`) in one pass over the bag. What is left out is added to ``notes``.

    Raises InputError, naming bag and topic, where they are no measurements.
    """
    readings = [_Reading(f"{bag.path}: topic {topic}", key, topic) for key, topic in wanted.items()]
    by_topic = {topic: [r for r in readings if r.topic == topic] for topic in wanted.values()}
    for topic, _, raw in bag.messages(by_topic.keys()):
        mine = by_topic[topic]
        message = _decoded(mine, raw)
        if message is None:
            continue
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        for reading in mine:
            reading.add(stamp, reading.extract(message), message.header.frame_id)
    if bag.damaged:
        for reading in readings:
            reading.leave_out_odd_stamps()
    return {r.key: r.stream(notes) for r in readings if r.count or r.key == "pose"}


def read_field(bag: Bag, topic: str, field: str) -> tuple[NDArray[np.int64], Array]:
    """Stamps (m,) in ns and numbers (m,) of one field, e.g. `point.x` or `data[0]`; a message without header counts
    from its log time.

    Raises InputError where there is no such topic or no such number in it.
    """
    where = f"{bag.path}: inputs: {topic}:{field}"
    if topic not in bag.topics:
        raise InputError(f"{where}: no such topic in the bag{did_you_mean(topic, bag.topics)}")
    store, msgtype = _typestore(Stores.ROS2_JAZZY), bag.topics[topic].msgtype
    if msgtype not in store.fielddefs:
        raise InputError(
            f"{where}: {msgtype} is not known; republish the number as a standard message, say a PointStamped"
        )
    stamps, values = array("q"), array("d")
    for _, time, raw in bag.messages({topic}):
        try:
            message = value = store.deserialize_cdr(raw, msgtype)
            for part in re.findall(r"[^.\[\]]+", field):
                value = value[int(part)] if part.isdecimal() else getattr(value, part)
            number = float(value)
        except Exception as error:
            names = ", ".join(name for name, _ in store.fielddefs[msgtype][1])
            raise InputError(
                f"{where}: no number there ({' '.join(str(error).split())[:100]}); {msgtype} has {names}"
            ) from None
        if math.isfinite(number):
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            stamps.append(time if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec)
            values.append(number)
    order = np.argsort(np.array(stamps, np.int64), kind="stable")
    return np.array(stamps, np.int64)[order], np.array(values)[order]


#: The numbers of a message that are looked at; of a sensor that declares itself, its fields.
_EXTRACT: dict[str, Callable[[Any], tuple[float, ...]]] = {
    "pose": lambda m: (
        *_xyz(m.pose.position),
        m.pose.orientation.x,
        m.pose.orientation.y,
        m.pose.orientation.z,
        m.pose.orientation.w,
    ),
    "twist": lambda m: (*_xyz(m.twist.linear), *_xyz(m.twist.angular)),
    "imu": lambda m: (*_xyz(m.linear_acceleration), float(m.linear_acceleration_covariance[0] == -1)),
    **{gap: lambda m: (m.range, m.min_range, m.max_range) for gap in GAPS},
    "pulses": lambda m: _xyz(m.point),
}


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


@lru_cache(maxsize=2)
def _typestore(distribution: Stores) -> Any:
    return get_typestore(distribution)


def _decoded(readings: list[_Reading], raw: bytes) -> Any:
    """A message; None, and counted, where it is none. A Range has one number fewer before Jazzy; the other types are
    alike in all distributions."""
    first, said = readings[0], ""
    for distribution in (first.distribution,) if first.count else (Stores.ROS2_JAZZY, Stores.ROS2_HUMBLE):
        try:
            message = _typestore(distribution).deserialize_cdr(raw, first.msgtype)
        except Exception as error:
            said = said or said_of(error)
            continue
        for reading in readings:
            reading.distribution = distribution
        return message
    for reading in readings:
        reading.damaged += 1
        reading.damage = reading.damage or said
    return None


class _Reading:
    """One topic's messages on their way into columns, converted a block at a time. Nothing else of them is kept."""

    def __init__(self, where: str, key: str, topic: str) -> None:
        self.where, self.key, self.topic = where, key, topic
        self.msgtype, self.distribution = TYPES[key], Stores.ROS2_JAZZY
        fields = fields_of(key) if key in FURTHER_SENSORS else ()
        self.extract = (lambda m: tuple(float(field_of(m, f)) for f in fields)) if fields else _EXTRACT[key]
        self.count = 0  # messages so far
        self.damaged, self.damage = 0, ""  # messages that cannot be decoded, and what is said of the first
        self._stamps, self._columns = array("q"), [array("d") for _ in COLUMNS[key]]
        self._pending = array("d")  # numbers that are not in the columns yet
        self._frame = self._frame_changed = ""  # the frame_id of the first, and what is said where it changes
        self._lost = 0  # messages whose numbers are NaN or infinite
        self._blank = array("b")  # of poses: 1 where the orientation is 0
        self._wrong, self._off = 0, (0, 0.0)  # poses without a unit quaternion; number and length of the first
        self._askew = 0.0  # rad, the most that a pose is turned otherwise than by its roll

    def add(self, stamp: int, numbers: tuple[float, ...], frame: str) -> None:
        """Take a message's stamp (ns), the numbers that `extract` gives, and its frame_id."""
        if not self.count:
            self._frame = frame
        self.count += 1
        if frame != self._frame and not self._frame_changed:
            self._frame_changed = f"from '{self._frame}' to '{frame}' at message {self.count}"
        self._stamps.append(stamp)
        self._pending.extend(numbers)
        if len(self._pending) >= BLOCK * len(numbers):
            self._settle()

    def leave_out_odd_stamps(self) -> None:
        """Leave out messages, of a damaged bag, whose stamp is none of theirs: it leaves those of two filed before and
        two behind it by more than any is filed late."""
        self._settle()
        stamps = np.array(self._stamps, np.int64)
        if len(stamps) < 5:
            return
        middle = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(stamps, 2, mode="reflect"), 5), axis=1)
        good = np.abs(stamps - middle) <= OUT_OF_ORDER * 1e9
        if good.all():
            return
        self.damaged += int((~good).sum())
        self.count = int(good.sum())
        self._stamps = array("q", stamps[good].tobytes())
        self._columns = [array("d", np.array(c)[good].tobytes()) for c in self._columns]
        self._blank = array("b", np.array(self._blank, np.int8)[good].tobytes()) if self._blank else self._blank

    def stream(self, notes: list[str]) -> Stream:
        """The measurements in the order of their stamps."""
        self._settle()
        self._judge_damage(notes)
        stamps, columns = np.array(self._stamps, np.int64), [np.array(c) for c in self._columns]
        numbers = np.arange(1, len(stamps) + 1, dtype=np.int32)
        if self.key == "pulses":  # two may share a stamp, and a command may be sent before an earlier one
            return Stream(self.topic, stamps, COLUMNS[self.key], columns, numbers)
        if len(stamps) > 1 and not stamps.any():
            raise InputError(
                f"{self.where}: header stamps are 0; fill header.stamp before publishing{self._or_leave_out()}"
            )
        self._judge_orientations(columns, notes)
        if self._askew > ASKEW:
            notes.append(
                f"pitch and yaw on {self.topic}, up to {math.degrees(self._askew):.2g}°, are not used: the model has"
                " none; x is along the travel, y left, z up"
            )
        if self._frame_changed:
            notes.append(f"frame_id on {self.topic} changes {self._frame_changed}: one run is of one frame")
        if len(stamps) and stamps.min() < 0:
            notes.append(
                f"{np.count_nonzero(stamps < 0)} of {self.count} messages on {self.topic} are stamped before 1970: a"
                " clock that was not set, or a time that is none"
            )
        if self._lost:
            why = "NaN, infinite or out of the sensor's range" if self.key in GAPS else "NaN or infinite"
            notes.append(f"{self._lost} of {self.count} messages on {self.topic} are {why}: not measured")
        place = Place(
            self.where, lambda i: f"message {i + 1}", "message", "one publisher, one run to a bag", f" on {self.topic}"
        )
        index, said = in_order(stamps, columns, place)
        notes += said
        if index is not None:
            stamps, columns, numbers = stamps[index], [c[index] for c in columns], numbers[index]
        return self._measured(stamps, columns, numbers, notes)

    def _or_leave_out(self) -> str:
        return "" if self.key == "pose" else f", or leave the topic out with topics: {{{self.key}: null}}"

    def _judge_damage(self, notes: list[str]) -> None:
        """A few messages that cannot be decoded are left out; where most cannot, the topic is something else."""
        if not self.damaged:
            return
        of_all = f"{self.damaged} of {self.count + self.damaged} messages"
        if self.damaged > self.count:
            raise InputError(
                f"{self.where}: {of_all} are no {self.msgtype}{self.damage[:160]}; is it serialized as CDR?"
                f"{self._or_leave_out()}"
            )
        notes.append(f"{of_all} on {self.topic} are damaged and left out{self.damage[:100]}")

    def _measured(
        self, stamps: NDArray[np.int64], columns: list[Array], numbers: NDArray[np.int32], notes: list[str]
    ) -> Stream:
        """The stream without the messages and the columns that hold nothing."""
        there = np.zeros(len(stamps), bool)
        for column in columns:
            there |= ~np.isnan(column)
        if not there.any():
            raise InputError(
                f"{self.where}: every message says that it is no measurement (NaN, out of the sensor's range, or a "
                f"covariance of -1); leave the topic out with topics: {{{self.key}: null}}"
            )
        if not there.all():
            stamps, columns, numbers = stamps[there], [c[there] for c in columns], numbers[there]
        held = {n: c for n, c in zip(COLUMNS[self.key], columns, strict=True) if not np.isnan(c).all()}
        if len(held) < len(columns):
            notes.append(
                f"{', '.join(n for n in COLUMNS[self.key] if n not in held)} on {self.topic} is never measured and"
                " left out"
            )
        if "roll" in held:  # an angle recorded as a quaternion comes back within ±π; the model's does not jump
            known = ~np.isnan(held["roll"])
            held["roll"][known] = np.unwrap(held["roll"][known])
        return Stream(self.topic, stamps, tuple(held), list(held.values()), numbers)

    def _settle(self) -> None:
        """Convert what is pending and put it into the columns."""
        if not self._pending:
            return
        numbers = np.array(self._pending).reshape(-1, _EXTRACTED[self.key])
        del self._pending[:]
        for column, values in zip(self._columns, self._converted(numbers).T, strict=False):
            column.frombytes(np.ascontiguousarray(values).tobytes())

    def _converted(self, numbers: Array) -> Array:
        """Columns (m, c) of raw numbers (m, r); NaN where a message is no measurement."""
        if self.key in GAPS:
            seen = _within_range(numbers)
            self._lost += int((~seen).sum())
            return np.where(seen, numbers[:, 0], np.nan)[:, None]
        broken = ~np.isfinite(numbers)
        if self.key == "pulses":
            if broken.any():
                raise InputError(f"{self.where}: NaN or infinity in a pulse{self._or_leave_out()}")
            return numbers
        numbers = np.where(broken, np.nan, numbers)
        self._lost += int(broken.any(axis=1).sum())
        if self.key in FURTHER_SENSORS:
            return numbers
        if self.key == "imu":
            return np.where((numbers[:, 3:] == 0) & ~broken.any(axis=1, keepdims=True), numbers[:, :3], np.nan)
        if self.key == "twist":
            return frames.twist_to_rates(numbers[:, :3], numbers[:, 3:])
        numbers[broken.any(axis=1)] = np.nan
        with np.errstate(over="ignore"):
            length = np.linalg.norm(numbers[:, 3:], axis=1)
        self._blank.frombytes((length == 0).astype(np.int8).tobytes())
        wrong = (length != 0) & ((length < UNIT[0]) | (length > UNIT[1]))
        if wrong.any():
            i = int(np.argmax(wrong))
            self._off = self._off if self._wrong else (len(self._blank) - len(length) + i + 1, float(length[i]))
            self._wrong += int(wrong.sum())
            numbers[wrong] = np.nan
        upright = np.where((length == 0)[:, None], [0.0, 0.0, 0.0, 1.0], numbers[:, 3:])
        turned = 2.0 * np.arcsin(
            np.minimum(np.hypot(upright[:, 1], upright[:, 2]) / np.where(length, length, 1.0), 1.0)
        )
        self._askew = max(self._askew, float(np.nanmax(turned, initial=0.0)))
        return frames.pose_to_coordinates(numbers[:, :3], upright)

    def _judge_orientations(self, columns: list[Array], notes: list[str]) -> None:
        """An orientation of 0 in all poses: a tracker of places only. In some: it had lost what it tracks, and its
        place too."""
        if self._wrong:
            first, length = self._off
            text = f"message {first} has an orientation of length {length:.3g}, no unit quaternion"
            if 2 * self._wrong >= self.count:
                raise InputError(f"{self.where}: {text}; normalise it, or publish w = 1 for none")
            notes.append(f"{self._wrong} of {self.count} poses on {self.topic} are not measured: {text}")
        if self.key != "pose" or not any(self._blank):
            return
        blank = np.array(self._blank, bool)
        known = ~np.isnan(columns[0])
        if blank[known].all():
            columns[3][:] = np.nan
            return
        for column in columns:
            column[blank] = np.nan
        notes.append(f"{int(blank.sum())} of {self.count} poses on {self.topic} have an orientation of 0: not measured")


#: Numbers that `_EXTRACT` gives for each key.
_EXTRACTED = {"pose": 7, "twist": 6, "imu": 4, **dict.fromkeys(GAPS, 3), "pulses": 3}
_EXTRACTED |= {sensor: len(COLUMNS[sensor]) for sensor in FURTHER_SENSORS}


def _within_range(numbers: Array) -> NDArray[np.bool_]:
    """(n,) from (range, min_range, max_range) (n, 3): False where a Range says itself that it is no measurement.

    REP-117: not finite is nothing seen. In contact a gap is slightly negative, so a lower limit of 0 is no limit.
    Both limits at 0: no range was declared.
    """
    value, low, high = numbers.T
    declared = high > low
    return np.isfinite(value) & ~(declared & (value > high)) & ~(declared & (low > 0) & (value < low))
