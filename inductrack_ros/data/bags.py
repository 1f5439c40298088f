"""rosbag2 in and out (MCAP or SQLite) through the pure-Python `rosbags` package: no ROS installation needed.

Header stamps are the time, not the time of recording. Messages are read one by one and turned into channels a block
at a time, so that reading takes the memory of the run that comes out and, but for a few columns, no more.
"""

from __future__ import annotations

import os
import tempfile
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from .. import frames
from ..core.errors import InputError, did_you_mean
from ..core.model import Pulses
from ..core.state import ACCELERATIONS, CHANNELS, COORDINATES, GAPS, RATES
from .measurement import Array, Run
from .open_files import allow_files_of

#: Where the package's own nodes publish. A rig's sensors stand under `measured/`, the simulator's truth beside it.
MEASURED = "/inductrack/measured/"
TRUTH = "/inductrack/"
#: Drive pulses: a PointStamped each; stamp = start of the half sine, x = coil index, y = signed current in A.
PULSE_TOPICS = ("/inductrack/fired_pulses", "/inductrack/drive_pulses")
ODOMETRY = "/inductrack/odometry"

TYPES = {
    "pose": "geometry_msgs/msg/PoseStamped",
    "twist": "geometry_msgs/msg/TwistStamped",
    "imu": "sensor_msgs/msg/Imu",
    **dict.fromkeys(GAPS, "sensor_msgs/msg/Range"),
    "pulses": "geometry_msgs/msg/PointStamped",
}


#: Messages that are checked and turned into channels at a time.
BLOCK = 4096


@dataclass
class _Stream:
    """What one topic gave: stamps (n,) in ns and its columns (n,) of numbers."""

    topic: str
    stamps: NDArray[np.int64]
    columns: list[Array]


def read_bag(
    path: str | Path,
    topics: Mapping[str, str | None] | None = None,
    name: str | None = None,
    gravity: float = frames.GRAVITY,
) -> Run:
    """Read one run from a rosbag2 folder, a bare `.mcap` or a bare `.db3`.

    topics: topic of `pose`, `twist`, `imu`, `gap_top`, `gap_right`, `gap_left`, `pulses`; None leaves one out. Where
        a key is absent the default is `/inductrack/measured/<key>`, or `/inductrack/<key>` in a bag that has nothing
        under `measured/`. A pose is required, the others are read if they are there.
    gravity: m/s², what an Imu at rest shows.

    The samples of all topics are laid on the union of their stamps. A twist is in the track's axes, like the pose.
    Of an Imu only the specific force is read, as three second derivatives, rotated by the roll of the pose at its
    stamp. A gap that is not finite or beyond its sensor's range is "not measured".
    Raises InputError, naming bag and topic, for anything that is not such a bag.
    """
    path = Path(path)
    topics = dict(topics or {})
    for key in topics:
        if key not in TYPES:
            raise InputError(f"{path}: topics: unknown key '{key}'{did_you_mean(key, TYPES)}")
    streams = _read_streams(path, topics)

    pose, imu = streams["pose"], streams.get("imu")
    if imu:
        _rotate_to_track(imu, pose, gravity)
    names = {"pose": COORDINATES, "twist": RATES, "imu": ACCELERATIONS[:3]} | {gap: (gap,) for gap in GAPS}
    given = {key: streams[key] for key in names if key in streams}
    stamps = pose.stamps
    for stream in given.values():
        if stream.stamps[0] > pose.stamps[-1] or stream.stamps[-1] < pose.stamps[0]:
            raise InputError(
                f"{path}: topic {stream.topic} is stamped at other times than {pose.topic}; "
                "stamp both with one clock (use_sim_time?)"
            )
        if not np.array_equal(stamps, stream.stamps):
            stamps = np.union1d(stamps, stream.stamps)
    if len(stamps) < 2:
        raise InputError(f"{path}: only one sample; a run needs at least 2")
    channels = tuple(c for c in CHANNELS if any(c in names[key] for key in given))
    values = np.empty((len(channels), len(stamps))).T  # column by column: each takes its memory as that of its source goes
    for key, stream in given.items():
        rows = slice(None) if np.array_equal(stamps, stream.stamps) else np.searchsorted(stamps, stream.stamps)
        for channel in reversed(names[key]):
            column = values[:, channels.index(channel)]
            column[:] = np.nan
            column[rows] = stream.columns.pop()

    return Run(
        name=name if name is not None else path.stem if path.is_file() else path.name,
        file=path,
        channels=channels,
        times=_seconds(stamps, stamps[0]),
        values=values,
        stamps=stamps,
        pulses=_pulses(path, streams.get("pulses"), stamps[0]),
    )


def write_bag(
    path: str | Path,
    times: ArrayLike,
    columns: Mapping[str, ArrayLike],
    *,
    start: float = 0.0,
    pulses: Pulses | None = None,
    frame_id: str = "track",
    child_frame_id: str = "cradle",
) -> None:
    """Write a run as a rosbag2 folder (MCAP) with the topics that the simulator's node publishes under `/inductrack/`.

    times: (n,) s; columns: (n,) each: all eight states, and gaps if there are any; start: s added to every stamp.
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
            unfinished.rename(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


# ---------------------------------------------------------------- reading

#: The numbers of a message that are looked at.
_EXTRACT: dict[str, Callable[[Any], tuple[float, ...]]] = {
    TYPES["pose"]: lambda m: (
        *_xyz(m.pose.position),
        m.pose.orientation.x,
        m.pose.orientation.y,
        m.pose.orientation.z,
        m.pose.orientation.w,
    ),
    TYPES["twist"]: lambda m: (*_xyz(m.twist.linear), *_xyz(m.twist.angular)),
    TYPES["imu"]: lambda m: (*_xyz(m.linear_acceleration), float(m.linear_acceleration_covariance[0] == -1)),
    TYPES["gap_top"]: lambda m: (m.range, m.min_range, m.max_range),
    TYPES["pulses"]: lambda m: _xyz(m.point),
}


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


@lru_cache(maxsize=1)
def _typestore() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def _read_streams(path: Path, topics: Mapping[str, str | None]) -> dict[str, _Stream]:
    """Read the wanted topics of a bag; keys of TYPES."""
    source = _storage(path)
    allow_files_of(source)
    try:
        for file in source.glob("*.db3") if source.is_dir() else [source]:
            _check_length(file)
        with Reader(source) as reader:
            # A sensor that is switched off may still have its topic in the bag, without messages.
            measured = any(c.topic.startswith(MEASURED) and c.msgcount for c in reader.connections)
            present = {c.topic: c.msgtype for c in reader.connections}
            wanted = _choose(path, topics, present, MEASURED if measured else TRUTH)
            return _read_messages(path, reader, wanted)
    except InputError:
        raise
    except Exception as error:
        # A damaged file can fail anywhere in the reader, its decompressors or SQLite, with any exception of theirs.
        raise InputError(
            f"{path}: cannot be read as a rosbag2, damaged or cut off ({_one_line(error)}); "
            "record it again, or try `ros2 bag reindex`"
        ) from None


def _storage(path: Path) -> Path:
    """The folder, or the file to open where a folder was left without its metadata."""
    try:
        if path.is_file():
            if path.suffix not in (".mcap", ".db3"):
                raise InputError(f"{path}: not a bag; give a rosbag2 folder, a .mcap or a .db3")
            return path
        if not path.is_dir():
            raise InputError(f"{path}: no such bag")
        if (path / "metadata.yaml").is_file():
            return path
        inside = sorted(p for p in path.iterdir() if p.suffix in (".mcap", ".db3") and p.is_file())
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(inside) == 1:
        return inside[0]
    if inside:
        raise InputError(f"{path}: metadata.yaml is missing; rebuild it with `ros2 bag reindex {path}`")
    raise InputError(f"{path}: not a rosbag2 folder: neither metadata.yaml nor a .mcap or .db3 in it")


def _check_length(file: Path) -> None:
    """SQLite reads the missing end of a file as zeros; its header says how many pages there should be."""
    with file.open("rb") as stream:
        head = stream.read(32)
    if len(head) == 32 and head.startswith(b"SQLite format 3\0"):
        page_size, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
        if file.stat().st_size < pages * (page_size if page_size > 1 else 65536):
            raise EOFError("its end is missing")


def _choose(path: Path, topics: Mapping[str, str | None], present: Mapping[str, str], prefix: str) -> dict[str, str]:
    """Topic to read for each key, those that are in the bag; `present` is the type of every topic."""
    wanted: dict[str, str] = {}
    for key, msgtype in TYPES.items():
        asked = topics.get(key)
        if asked is not None:
            candidates = [asked if asked.startswith("/") else f"/{asked}"]
        elif key in topics:  # null: leave it out
            continue
        else:
            candidates = list(PULSE_TOPICS) if key == "pulses" else [prefix + key]
        found = next((c for c in candidates if c in present), None)
        if found is None:
            if asked is not None or key == "pose":
                held = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(present.items())) or "no topics at all"
                raise InputError(f"{path}: no topic {candidates[0]} for {key}; {_set(key)}; the bag has {held}")
            continue
        if present[found] != msgtype:
            raise InputError(f"{path}: topic {found} is {present[found]}, but {key} must be {msgtype}; {_set(key)}")
        wanted[key] = found
    if "pose" not in wanted:
        raise InputError(f"{path}: a run needs its pose; {_set('pose')}")
    return wanted


def _read_messages(path: Path, reader: Reader, wanted: Mapping[str, str]) -> dict[str, _Stream]:
    """Read the topics (by key) in one pass over the bag; those without messages are left out."""
    connections = [c for c in reader.connections if c.topic in wanted.values()]
    deserialize = _typestore().deserialize_cdr
    readings = [_Reading(path, key, topic) for key, topic in wanted.items()]
    by_topic = {topic: [r for r in readings if r.topic == topic] for topic in wanted.values()}
    for connection, _, raw in reader.messages(connections):
        message = deserialize(raw, connection.msgtype)
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        numbers = _EXTRACT[connection.msgtype](message)
        for reading in by_topic[connection.topic]:
            reading.add(stamp, numbers)
    for reading in readings:
        promised = sum(c.msgcount for c in connections if c.topic == reading.topic)
        if reading.count < promised:
            counts = f"{reading.count} messages where {promised} were recorded"
            raise InputError(f"{path}: topic {reading.topic}: {counts}; the bag is cut off: record it again")
    return {r.key: r.stream() for r in readings if r.count or r.key == "pose"}


class _Reading:
    """One topic's messages on their way into columns, checked a block at a time. Nothing else of them is kept."""

    def __init__(self, path: Path, key: str, topic: str) -> None:
        self.key, self.topic, self.where = key, topic, f"{path}: topic {topic}"
        self.count = 0  # messages so far
        self._stamps, self._columns = array("q"), [array("d") for _ in range(_WIDTHS[key])]
        self._pending_stamps, self._pending = array("q"), array("d")  # what is not in the columns yet
        self._seen = 0  # how many of those are: the last message stays, to compare the next one with

    def add(self, stamp: int, numbers: tuple[float, ...]) -> None:
        """Take a message's stamp (ns) and the numbers that `_EXTRACT` gives."""
        self.count += 1
        self._pending_stamps.append(stamp)
        self._pending.extend(numbers)
        if len(self._pending_stamps) > BLOCK:
            self._settle()

    def stream(self) -> _Stream:
        """The measurements in the order of their stamps."""
        if not self.count:
            raise InputError(f"{self.where}: no messages; record it again or {_set(self.key)}")
        self._settle()
        if self.key != "pulses" and self.count > 1 and not self._pending_stamps[-1]:
            raise self._unstamped()
        if not self._stamps:
            raise InputError(
                f"{self.where}: every message says that it is no measurement (out of the sensor's range, or a covariance "
                f"of -1); leave the topic out with topics: {{{self.key}: null}}"
            )
        return _Stream(self.topic, np.frombuffer(self._stamps, np.int64), [np.frombuffer(c) for c in self._columns])

    def _unstamped(self) -> InputError:
        return InputError(f"{self.where}: header stamps are 0; fill header.stamp before publishing")

    def _settle(self) -> None:
        """Check what is pending and put it into the columns."""
        stamps = np.array(self._pending_stamps)
        numbers = np.array(self._pending).reshape(len(stamps), -1)
        new = np.arange(len(stamps)) >= self._seen
        if self.key != "pulses":  # two may share a stamp, and a command may be sent before an earlier one
            # A simulator that stands still says the same again and again.
            new[1:] = (np.diff(stamps) != 0) | (numbers[1:] != numbers[:-1]).any(axis=1)
            self._check_order(stamps, new)
        if self.key in GAPS:
            new &= _within_range(numbers)
        elif self.key == "imu":
            new &= numbers[:, 3] == 0
        self._append(stamps[new], numbers[new])
        del self._pending_stamps[:-1], self._pending[: -numbers.shape[1]]
        self._seen = 1

    def _check_order(self, stamps: NDArray[np.int64], new: NDArray[np.bool_]) -> None:
        backwards = np.flatnonzero((np.diff(stamps) <= 0) & new[1:])
        if not len(backwards):
            return
        i = int(backwards[0]) + 1
        if not stamps[: i + 1].any():
            raise self._unstamped()
        what = "repeats the stamp of" if stamps[i] == stamps[i - 1] else "is stamped earlier than"
        number = self.count - len(stamps) + i
        raise InputError(
            f"{self.where}: message {number + 1} {what} message {number}; stamps must increase: one publisher, one run to a bag"
        )

    def _append(self, stamps: NDArray[np.int64], numbers: Array) -> None:
        broken = ~np.isfinite(numbers[:, :1] if self.key in GAPS else numbers).all(axis=1)
        if broken.any():
            after = stamps[int(np.argmax(broken))] - (self._stamps or stamps)[0]
            raise InputError(f"{self.where}: NaN or infinity {after / 1e9} s after the first message")
        if self.key == "pose":
            largest = np.abs(numbers[:, 3:]).max(axis=1)
            if ((largest < 0.45) | (largest > 1.1)).any():  # a unit quaternion's largest component is between 0.5 and 1
                raise InputError(f"{self.where}: an orientation that is no unit quaternion; publish w = 1 for none")
            numbers = frames.pose_to_coordinates(numbers[:, :3], numbers[:, 3:])
            # An angle recorded as a quaternion comes back within ±π; the model's does not jump.
            numbers[:, 3] = np.unwrap(np.append(self._columns[3][-1:], numbers[:, 3]))[-len(numbers) or None :]
        elif self.key == "twist":
            numbers = frames.twist_to_rates(numbers[:, :3], numbers[:, 3:])
        self._stamps.frombytes(stamps.tobytes())
        for column, values in zip(self._columns, numbers.T, strict=False):
            column.frombytes(values.tobytes())


#: Columns that a topic gives: coordinates, rates, specific force, gap, coil and current.
_WIDTHS = {"pose": 4, "twist": 4, "imu": 3, **dict.fromkeys(GAPS, 1), "pulses": 2}


def _rotate_to_track(imu: _Stream, pose: _Stream, gravity: float) -> None:
    """Turn the specific force in an Imu's columns into second derivatives, by the roll of the pose at its stamps."""
    times, start = _seconds(pose.stamps, pose.stamps[0]), pose.stamps[0]
    for first in range(0, len(imu.stamps), BLOCK):
        rows = slice(first, first + BLOCK)
        roll = np.interp(_seconds(imu.stamps[rows], start), times, pose.columns[3])
        force = np.column_stack([column[rows] for column in imu.columns])
        for column, values in zip(imu.columns, frames.specific_force_to_accelerations(force, roll, gravity).T, strict=True):
            column[rows] = values


def _within_range(numbers: Array) -> NDArray[np.bool_]:
    """(n,) from (range, min_range, max_range) (n, 3): False where a Range says itself that it is no measurement.

    REP-117: not finite is nothing seen. In contact a gap is slightly negative, so a lower limit of 0 is no limit.
    Both limits at 0: no range was declared.
    """
    value, low, high = numbers.T
    declared = high > low
    return np.isfinite(value) & ~(declared & (value > high)) & ~(declared & (low > 0) & (value < low))


def _pulses(path: Path, stream: _Stream | None, start: int) -> Pulses | None:
    if stream is None:
        return None
    order = np.argsort(stream.stamps, kind="stable")
    places, currents = (column[order] for column in stream.columns)
    coils = np.rint(places)
    if (np.abs(places - coils) > 1e-6).any() or (np.abs(coils) > 2**53).any():
        raise InputError(f"{path}: topic {stream.topic}: point.x must be a whole coil index")
    return Pulses(_seconds(stream.stamps[order], start), coils.astype(np.int64), currents)


def _seconds(stamps: NDArray[np.int64], start: int) -> Array:
    """Seconds after `start`. The difference is taken in ns: a float of today's date resolves only 0.2 µs."""
    return (stamps - start) / 1e9


def _nanoseconds(seconds: ArrayLike) -> NDArray[np.int64]:
    return np.rint(np.asarray(seconds, float) * 1e9).astype(np.int64)


def _set(key: str) -> str:
    return f"set topics: {{{key}: ...}} in campaign.yaml"


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


# ---------------------------------------------------------------- writing


def _write_messages(
    writer: Writer,
    stamps: NDArray[np.int64],
    table: Mapping[str, Array],
    pulses: Pulses | None,
    start: float,
    frame_id: str,
    child_frame_id: str,
) -> None:
    store = _typestore()
    geometry = {
        name.rpartition("/")[2]: kind for name, kind in store.types.items() if name.startswith("geometry_msgs/")
    }
    point, vector, quaternion = geometry["Point"], geometry["Vector3"], geometry["Quaternion"]
    no_covariance = np.zeros(36)

    def header(stamp: int, frame: str = frame_id) -> Any:
        time = store.types["builtin_interfaces/msg/Time"](*divmod(stamp, 1_000_000_000))
        return store.types["std_msgs/msg/Header"](time, frame)

    def add(topic: str, msgtype: str) -> Callable[..., None]:
        """Function that writes a message of this type, given its stamp and its fields."""
        connection = writer.add_connection(topic, msgtype, typestore=store)
        kind = store.types[msgtype]
        return lambda stamp, *fields: writer.write(connection, stamp, store.serialize_cdr(kind(*fields), msgtype))

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
        for stamp, coil, current in zip(pulse_stamps, pulses.coils, pulses.currents, strict=True):
            write_pulse(stamp, header(stamp), point(float(coil), float(current), 0.0))
