# SPDX-License-Identifier: Apache-2.0
"""One run out of a rosbag2 (MCAP or SQLite) through the pure-Python `rosbags` package: no ROS installation needed.

Header stamps are the time, not the time of recording. Messages are read one by one and turned into channels a block
at a time, so that reading takes the memory of the run that comes out and, but for a few columns, no more.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import frames
from ..core.errors import InputError, did_you_mean
from ..core.model import Pulses
from ..core.state import CHANNELS, FURTHER_SENSORS, GAPS
from .bag_files import Bag, Topic, open_bag
from .bag_messages import BLOCK, TYPES, Stream, read_field, read_streams
from .bag_storage import unpacked_name
from .measurement import Array, Run

#: Where the package's own nodes publish. A rig's sensors stand under `measured/`, the simulator's truth beside it.
TRUTH = "/inductrack/"
MEASURED = TRUTH + "measured/"
#: Drive pulses: a PointStamped each; stamp = start of the half sine, x = coil index, y = signed current in A, z = how
#: many have fired with this one, or anything else where nobody counts.
PULSE_TOPICS = (TRUTH + "fired_pulses", TRUTH + "drive_pulses")
ODOMETRY = TRUTH + "odometry"
#: Packages whose messages are about the recording, not about the rig.
_ABOUT_ROS = (
    "rosgraph_msgs rcl_interfaces rosbag2_interfaces statistics_msgs lifecycle_msgs diagnostic_msgs visualization_msgs"
    " tf2_msgs bond"
).split()
#: What the package's nodes publish beside a rig's sensors: known, so not named where it is not read.
_OURS = (
    *("pose", "twist", "odometry", "imu", *GAPS, "fired_pulses", "drive_pulses", "residual/pose", "residual/twist"),
    *("missing_force", "missing_force_sigma"),
    *(f"residual/{sensor}" for sensor in FURTHER_SENSORS),
)
_OUR_FOLDERS = ("wrench/", "lockstep/")


def read_bag(
    path: str | Path,
    topics: Mapping[str, str | None] | None = None,
    name: str | None = None,
    gravity: float = frames.GRAVITY,
    inputs: Mapping[str, str] | None = None,
) -> Run:
    """Read one run from a rosbag2 folder or one of its files, as `bag_files.open_bag` takes them.

    topics: topic of each of `core.state.INSTRUMENTS` and of `pulses`; None leaves one out. Where
        a key is absent, the topic of that name beside the given pose; without one `/inductrack/measured/<key>`, or
        `/inductrack/<key>` in a bag that has nothing under `measured/`. A pose is required, the others are read if
        they are there.

    gravity: m/s², what an Imu at rest shows.
    inputs: what else is read into `Run.inputs`: name → `/topic:field`, e.g. `/bus:point.x`.

    The samples of all topics are laid on the union of their stamps. A twist is in the track's axes, like the pose.
    Of an Imu only the specific force is read, as three second derivatives, rotated by the roll of the pose at its
    stamp. A gap that is not finite or beyond its sensor's range is "not measured"; so is a pose without numbers.
    Raises InputError, naming bag and topic, for anything that is not such a bag.
    """
    path = Path(path)
    topics = dict(topics or {})
    for key in topics:
        if key not in TYPES:
            raise InputError(f"{path}: topics: unknown key '{key}'{did_you_mean(key, TYPES)}")
    with open_bag(path, TYPES.values()) as bag:
        wanted = _choose(path, topics, bag.topics)
        notes = [*bag.notes, *_left_out(topics, wanted, bag.topics, inputs or {})]
        notes += [
            f"{bag.topics[topic].publishers} publishers wrote on {topic}: a run is of one"
            for topic in wanted.values()
            if bag.topics[topic].publishers > 1
        ]
        streams = _read_streams(bag, wanted, notes)
        fields = {n: read_field(bag, *where.rsplit(":", 1)) for n, where in (inputs or {}).items()}
    run = _laid_out(path, name, streams, gravity, notes)
    return replace(
        run, inputs={n: (_seconds(stamps, int(run.stamps[0])), values) for n, (stamps, values) in fields.items()}
    )


def _laid_out(path: Path, name: str | None, streams: dict[str, Stream], gravity: float, notes: list[str]) -> Run:
    """The streams on the union of their stamps."""
    pose, imu = streams["pose"], streams.get("imu")
    if imu and "roll" not in pose.names:
        del streams["imu"]
        notes.append(f"{imu.topic} is left out: without the roll its axes are not known")
    elif imu:
        _rotate_to_track(imu, pose, gravity)
    given = {key: stream for key, stream in streams.items() if key != "pulses"}
    stamps = pose.stamps
    for key, stream in given.items():
        if stream.stamps[0] > pose.stamps[-1] or stream.stamps[-1] < pose.stamps[0]:
            raise InputError(
                f"{path}: topic {stream.topic} is stamped at other times than {pose.topic}; "
                f"stamp both with one clock (use_sim_time?), or leave it out with topics: {{{key}: null}}"
            )
        if not np.array_equal(stamps, stream.stamps):
            stamps = np.union1d(stamps, stream.stamps)
    if len(stamps) < 2:
        raise InputError(f"{path}: only one sample; a run needs at least 2")
    held = {channel for stream in given.values() for channel in stream.names}
    channels = tuple(c for c in CHANNELS if c in held)
    # Column by column: each takes its memory as that of its source goes.
    values = np.empty((len(channels), len(stamps))).T
    for stream in given.values():
        rows = slice(None) if np.array_equal(stamps, stream.stamps) else np.searchsorted(stamps, stream.stamps)
        for channel in reversed(stream.names):
            column = values[:, channels.index(channel)]
            column[:] = np.nan
            column[rows] = stream.columns.pop()

    pulses, counts = _pulses(path, streams.get("pulses"), stamps[0])
    return Run(
        name=name if name is not None else Path(unpacked_name(path)).stem if path.is_file() else path.name,
        file=path,
        channels=channels,
        times=_seconds(stamps, stamps[0]),
        values=values,
        stamps=stamps,
        numbers=pose.numbers if len(stamps) == len(pose.stamps) else None,
        seconds_stated=True,
        pulses=pulses,
        pulse_counts=counts,
        notes=tuple(notes),
    )


# ---------------------------------------------------------------- which topics


def _choose(path: Path, topics: Mapping[str, str | None], present: Mapping[str, Topic]) -> dict[str, str]:
    """Topic to read for each key, those that are in the bag."""
    if not present:
        raise InputError(f"{path}: an empty bag, it has no topics; record it again")
    if "pose" in topics and topics["pose"] is None:
        raise InputError(f"{path}: a run needs its pose; {_set('pose')}")
    prefix, pulses = _beside_the_pose(topics, present)
    wanted: dict[str, str] = {}
    for key, msgtype in TYPES.items():
        asked = topics.get(key)
        if asked is None and key in topics:  # null: leave it out
            continue
        candidates = [_absolute(asked)] if asked is not None else list(pulses) if key == "pulses" else [prefix + key]
        found = next((c for c in candidates if c in present), None)
        if found is None:
            if asked is not None or key == "pose":
                raise InputError(
                    f"{path}: no topic {candidates[0]} for {key}; {_set(key, present)}; the bag has {_held(present)}"
                )
            continue
        if present[found].msgtype != msgtype:
            if asked is None and prefix not in (MEASURED, TRUTH):
                continue  # beside a pose of somebody else's: named among what is left out
            raise InputError(
                f"{path}: topic {found} is {present[found].msgtype}, but {key} must be {msgtype}; {_set(key, present)}"
                + ("" if key == "pose" else f", or leave it out with topics: {{{key}: null}}")
            )
        wanted[key] = found
    return wanted


def _beside_the_pose(topics: Mapping[str, str | None], present: Mapping[str, Topic]) -> tuple[str, tuple[str, ...]]:
    """Where the other sensors stand, and the pulses: beside the pose that was asked for, else under the package's own
    names."""
    pose = topics.get("pose")
    if pose is not None:
        prefix, slash, last = _absolute(pose).rpartition("/")
        if last == "pose":
            root = prefix.removesuffix("/measured") + slash
            return prefix + slash, tuple(root + t.removeprefix(TRUTH) for t in PULSE_TOPICS)
    # A sensor that is switched off may still have its topic in the bag, without messages.
    measured = any(t.count for t in present.values() if t.name.startswith(MEASURED))
    if measured or TRUTH + "pose" not in present and MEASURED + "pose" in present:
        return MEASURED, PULSE_TOPICS
    return TRUTH, PULSE_TOPICS


def _left_out(
    topics: Mapping[str, str | None], wanted: Mapping[str, str], present: Mapping[str, Topic], inputs: Mapping[str, str]
) -> list[str]:
    """A word about topics that are in the bag, may say something of the rig, and are not read."""
    beside, _, own = wanted["pose"].rpartition("/")
    root = beside.removesuffix("/measured") if own == "pose" else TRUTH.rstrip("/")
    asked_off = {f"{beside}/{key}" for key, topic in topics.items() if topic is None}
    read = {*wanted.values(), *asked_off, *(where.rsplit(":", 1)[0] for where in inputs.values())}

    def is_known(topic: Topic) -> bool:
        name = topic.name.removeprefix(f"{root}/")
        ours = name in _OURS or name.startswith(_OUR_FOLDERS)
        return ours and (root != beside or name not in TYPES) or topic.msgtype.partition("/")[0] in _ABOUT_ROS

    left = sorted(t.name for t in present.values() if t.count and t.name not in read and not is_known(t))
    if not left:
        return []
    more = f" and {len(left) - 6} more" if len(left) > 6 else ""
    return [f"topics left out: {', '.join(left[:6])}{more}; topics: in campaign.yaml says which are read"]


def _absolute(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"


def _held(present: Mapping[str, Topic]) -> str:
    named = [f"{name} ({topic.msgtype})" for name, topic in sorted(present.items())]
    return ", ".join(named[:12]) + (f" and {len(named) - 12} more" if len(named) > 12 else "")


def _set(key: str, present: Mapping[str, Topic] | None = None) -> str:
    """What to do for a topic: the line that names it, with the only one that it can be where there is one."""
    fit = [t.name for t in (present or {}).values() if t.msgtype == TYPES[key] and t.count]
    if present is not None and not fit:
        return f"none is a {TYPES[key]} with messages: republish what you have as one"
    better = [name for name in fit if "/measured/" in name] or fit
    return f"set topics: {{{key}: {better[0] if len(better) == 1 else '...'}}} in campaign.yaml"


# ---------------------------------------------------------------- what they hold


def _read_streams(bag: Bag, wanted: Mapping[str, str], notes: list[str]) -> dict[str, Stream]:
    """The topics (by key) in one pass over the bag; those without messages are left out."""
    for key in wanted.keys() & {"pose"}:
        if not bag.topics[wanted[key]].count:
            raise InputError(f"{bag.path}: topic {wanted[key]}: no messages; record it again, or {_set(key)}")
    return read_streams(bag, {key: topic for key, topic in wanted.items() if bag.topics[topic].count}, notes)


def _rotate_to_track(imu: Stream, pose: Stream, gravity: float) -> None:
    """Turn the specific force in an Imu's columns into second derivatives, by the roll of the pose at its stamps."""
    start, roll = pose.stamps[0], pose.columns[pose.names.index("roll")]
    known = ~np.isnan(roll)
    times, roll = _seconds(pose.stamps[known], start), roll[known]
    for first in range(0, len(imu.stamps), BLOCK):
        rows = slice(first, first + BLOCK)
        angle = np.interp(_seconds(imu.stamps[rows], start), times, roll)
        force = np.column_stack([column[rows] for column in imu.columns])
        for column, values in zip(
            imu.columns, frames.specific_force_to_accelerations(force, angle, gravity).T, strict=True
        ):
            column[rows] = values


def _pulses(path: Path, stream: Stream | None, start: int) -> tuple[Pulses | None, Array | None]:
    """The drive, and how many pulses had fired with each as the messages say; None where they do not count."""
    if stream is None:
        return None, None
    order = np.lexsort((stream.columns[2], stream.stamps))
    places, currents, counts = (column[order] for column in stream.columns)
    coils = np.rint(places)
    if (np.abs(places - coils) > 1e-6).any() or (np.abs(coils) > 2**53).any():
        raise InputError(f"{path}: topic {stream.topic}: point.x must be a whole coil index")
    counted = 2 * np.count_nonzero(np.diff(counts) == 1) > len(counts)
    pulses = Pulses(_seconds(stream.stamps[order], start), coils.astype(np.int64), currents)
    return pulses, counts if counted else None


def _seconds(stamps: NDArray[np.int64], start: int) -> Array:
    """Seconds after `start`. The difference is taken in ns: a float of today's date resolves only 0.2 µs."""
    return (stamps - start) / 1e9
