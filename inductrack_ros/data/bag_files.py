# SPDX-License-Identifier: Apache-2.0
"""Opens what people have of a rosbag2: a folder with or without its metadata, a bare file, compressed, cut off, of any
distribution.

The storage files tell what is in them; `metadata.yaml` only says which they are and in what order. They are read one
after the other by `rosbags`, so that a recording of a thousand files needs no thousand open ones."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2, QosDurability, QosReliability
from rosbags.rosbag2 import Reader

from ..core.errors import InputError, one_line
from . import mcap_salvage, sqlite_salvage
from .bag_storage import METADATA, ROS1, SQLITE, head_of, storage_files
from .file_kinds import is_text, kind_of
from .mcap_salvage import MAGIC, zstd
from .salvage import Channel, Found, Loss, in_words
from .sqlite_files import lacks_its_end, tables_of, whole_database, with_an_end

ZSTD = b"\x28\xb5\x2f\xfd"


@dataclass(frozen=True)
class Topic:
    """A topic in a bag: message type, number of messages, whether all its publishers offered best effort only,
    whether they kept their last message for who comes later (transient local), and how many they were, if that was
    recorded."""

    name: str
    msgtype: str
    count: int
    lossy: bool
    latched: bool = False
    publishers: int = 1

    def joined(self, other: Topic | None) -> Topic:
        """This and another part of the same topic."""
        if other is None:
            return self
        count, lossy = self.count + other.count, self.lossy and other.lossy
        publishers = max(self.publishers, other.publishers)
        return Topic(self.name, other.msgtype, count, lossy, self.latched and other.latched, publishers)


@dataclass(frozen=True)
class _File:
    """A storage file that can be read: ``path`` may be a copy of ``given``, which messages to people name. One that is
    ``cut`` off or damaged, or that holds more than ROS 2 writes, is to be read record after record."""

    path: Path
    given: Path
    cut: bool = False
    damaged: bool = False
    by_record: bool = False

    @property
    def is_mcap(self) -> bool:
        """Whether it is an MCAP, else a database."""
        return self.path.suffix == ".mcap"

    @property
    def mends(self) -> str:
        """What mends it."""
        name = self.given.name
        return f"mcap recover {name}" if self.is_mcap else f"sqlite3 {name} .recover"

    def found(self) -> Iterator[Found]:
        """Each whole message and each stretch in which some are lost."""
        return (mcap_salvage if self.is_mcap else sqlite_salvage).salvage(self.path)

    def records(self) -> Iterator[tuple[Channel, int, bytes]]:
        """Channel, log time (ns) and bytes of each whole message."""
        return (one for one in self.found() if not isinstance(one, Loss))

    @property
    def promised(self) -> tuple[int, int | None]:
        """How many messages it had as it says itself, 0 where that is lost, and the log time (ns) of the first."""
        return (mcap_salvage if self.is_mcap else sqlite_salvage).promised(self.path)


@dataclass(frozen=True)
class Bag:
    """An open bag: its topics by name, and what was to be said while it was opened."""

    path: Path
    topics: dict[str, Topic]
    notes: tuple[str, ...]
    _files: tuple[_File, ...] = field(repr=False, default=())

    @property
    def damaged(self) -> bool:
        """Whether bytes of its messages may be others than were written."""
        return any(file.damaged for file in self._files)

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Topic, log time (ns) and bytes of every message on these topics, file by file. Raises InputError for a
        damaged one."""
        types = {name: self.topics[name].msgtype for name in names if name in self.topics}
        for file in self._files:
            with _saying_what_is_damaged(file):
                yield from _messages(file, types)


@contextlib.contextmanager
def open_bag(path: Path, types: Collection[str] = ()) -> Iterator[Bag]:
    """Open a rosbag2 folder or one of its files; copies that are needed are gone at the end. Where messages of several
    types stand under one name, those of one of the ``types`` are meant, else the most.

    Raises InputError, naming bag and remedy, for what is no bag or is damaged beyond reading.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="inductrack-") as folder:
            notes: list[str] = []
            given, promised = storage_files(path, notes)
            files = tuple(_readable(file, Path(folder, str(i)), notes) for i, file in enumerate(given))
            parts: dict[tuple[str, str], Topic] = {}
            hurt: dict[_File, str] = {}
            for file in files:
                with _saying_what_is_damaged(file):
                    found_topics, losses = _topics(file)
                    for topic in found_topics:
                        key = topic.name, topic.msgtype
                        parts[key] = topic.joined(parts.get(key))
                if file.cut or file.damaged:
                    hurt[file] = _hurt(file, losses)
            topics = _of_one_type(parts.values(), types, notes)
            found = sum(t.count for t in parts.values())
            _say_what_is_lost(path, hurt, found, promised or _promised(files, hurt), notes)
            yield Bag(path, topics, tuple(notes), files)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EROFS):  # reading fills nothing but the copies
            raise InputError(
                f"{path}: a copy of it is needed and cannot be written into {tempfile.gettempdir()}: {error.strerror};"
                " set TMPDIR to a folder with room"
            ) from None
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _hurt(file: _File, losses: Iterable[Loss]) -> str:
    """What is wrong with a file that is cut off or damaged, and where."""
    inside = [loss for loss in losses if not (file.cut and loss.before is None)]
    begin = file.promised[1]
    if begin is None:
        begin = next((time for _, time, _ in file.records()), 0)
    said = ["is cut off"] if file.cut else []
    return " and ".join([*said, in_words(inside, begin)] if inside or not file.cut else said)


def _promised(files: Iterable[_File], hurt: Collection[_File]) -> int:
    """How many messages the only file of a bag had as it says itself, where it is hurt; 0 where that is not known."""
    one, *others = files
    return 0 if others or one not in hurt else one.promised[0]


def _say_what_is_lost(path: Path, hurt: Mapping[_File, str], found: int, promised: int, notes: list[str]) -> None:
    """Add to ``notes`` what of a bag is read, where some is lost or may be. Raises InputError where nothing is left."""
    if hurt and not found:
        file, how = next(iter(hurt.items()))
        raise InputError(
            f"{path}: {file.given.name} {how.partition(' from ')[0]} and holds no whole message; copy it again or try"
            f" `{file.mends}`"
        )
    if not hurt and found >= promised:
        return
    what = ", ".join(f"{file.given.name} {how}" for file, how in hurt.items()) or f"{METADATA} promises more"
    mend = f"; `{next(iter(hurt)).mends}` mends the file" if hurt else ""
    notes.append(f"{what}: {found}{f' of {promised}' if promised else ''} messages are whole and read{mend}")


# ---------------------------------------------------------------- one file


def _readable(file: Path, folder: Path, notes: list[str]) -> _File:
    """The file as `rosbags` can read it: unpacked, under a name that SQLite takes, with what its journal holds."""
    path, head = file, head_of(file)
    if head.startswith(ZSTD):
        path = _unpacked(file, folder, notes)
        head = head_of(path)
    if head.startswith(ROS1):
        raise InputError(
            f"{file}: a ROS 1 bag; convert it: `rosbags-convert --src {file} --dst {file.with_suffix('')}`, and name"
            " that folder"
        )
    if head.startswith(SQLITE):
        database = whole_database(path, file, folder, notes)
        if (tables := tables_of(database)) is not None and not {"topics", "messages"} <= set(tables):
            held = f"it holds {', '.join(tables[:4])}" if tables else "it is empty"
            raise InputError(f"{file}: is an SQLite database, but no rosbag2: no tables topics and messages ({held})")
        if cut := lacks_its_end(database):
            database = with_an_end(database, folder)
        damaged = not cut and not sqlite_salvage.is_whole(database)
        return _File(_under(database, folder, ".db3"), file, cut, damaged, cut or damaged)
    if not head:
        raise InputError(f"{file}: empty, the recording was cut off; record it again")
    if not head.startswith(MAGIC):
        if what := kind_of(file):
            raise InputError(f"{file}: is no bag but {what}")
        if is_text(file):
            raise InputError(f"{file}: is no bag but text, whatever its name says; a table is read as {file.stem}.csv")
        raise InputError(
            f"{file}: cannot be read as a rosbag2: it begins neither as MCAP nor as SQLite, damaged or cut off"
        )
    with path.open("rb") as stream:
        stream.seek(0, 2)
        stream.seek(max(stream.tell() - len(MAGIC), len(MAGIC)))
        cut = stream.read() != MAGIC
    path = _under(path, folder, ".mcap")
    damaged = not cut and not mcap_salvage.is_whole(path)
    return _File(path, file, cut, damaged, cut or damaged or _is_not_only_of_ros2(path))


def _is_not_only_of_ros2(path: Path) -> bool:
    """Whether a whole MCAP has another profile than ROS 2's, or schemas that are not ROS 2's."""
    try:
        with Reader(path):
            return False
    except KeyError:  # what `rosbags` says of a schema
        return True
    except Exception as error:  # damaged, which is said where it is read
        return str(error) == "Profile is not ros2."


def _unpacked(file: Path, folder: Path, notes: list[str]) -> Path:
    """An unpacked copy of a file that is compressed with zstd."""
    copy = folder / "unpacked"
    try:
        folder.mkdir(exist_ok=True)
        with zstd.open(file, "rb") as packed, copy.open("wb") as unpacked:
            shutil.copyfileobj(packed, unpacked)
    except (zstd.ZstdError, EOFError) as error:
        raise InputError(
            f"{file}: the zstd compression is damaged or cut off ({one_line(error)}); copy the file again"
        ) from None
    except OSError as error:
        raise InputError(
            f"{file}: is compressed and cannot be unpacked into {tempfile.gettempdir()}: {error.strerror}; unpack it"
            " with `zstd -d`, or set TMPDIR to a folder with room"
        ) from None
    notes.append(f"{file.name} is compressed with zstd and read from an unpacked copy")
    return copy


def _under(path: Path, folder: Path, suffix: str) -> Path:
    """The path, or a link to it where its suffix hides what it is or SQLite would take its name for an address (`run
    #3`)."""
    if path.suffix == suffix and not re.search(r"[?#%]", str(path)):
        return path
    folder.mkdir(exist_ok=True)
    link = folder / f"bag{suffix}"
    link.symlink_to(os.path.realpath(path))
    return link


def _topics(file: _File) -> tuple[list[Topic], list[Loss]]:
    """The topics of a file, and what is lost of one that is read record after record."""
    if not file.by_record:
        with Reader(file.path) as reader:
            found = [Topic(c.topic, _as_of_ros2(c.msgtype), c.msgcount, *_offered(c)) for c in reader.connections]
        return found, []
    counts, losses = Counter[Channel](), list[Loss]()
    for one in file.found():
        if isinstance(one, Loss):
            losses.append(one)
        else:
            counts[one[0]] += 1
    return [_topic(channel, count) for channel, count in counts.items()], losses


def _topic(channel: Channel, count: int) -> Topic:
    lossy = re.search(r"reliability: *['\"]?(2|best_effort)\b", channel.offered_qos) is not None
    latched = re.search(r"durability: *['\"]?(1|transient_local)\b", channel.offered_qos) is not None
    return Topic(channel.topic, _as_of_ros2(channel.msgtype), count, lossy, latched)


def _of_one_type(parts: Iterable[Topic], types: Collection[str], notes: list[str]) -> dict[str, Topic]:
    """The topics by name, each of one type; what stands under its name besides is added to ``notes``."""
    topics: dict[str, Topic] = {}
    for topic in sorted(parts, key=lambda t: (t.msgtype in types and t.count > 0, t.count), reverse=True):
        kept = topics.setdefault(topic.name, topic)
        if kept is not topic and topic.count:
            notes.append(
                f"{topic.count} messages on {topic.name} are {topic.msgtype}, not {kept.msgtype} as the other"
                f" {kept.count}: left out; give each type a topic of its own"
            )
    return topics


def _as_of_ros2(msgtype: str) -> str:
    """`geometry_msgs/PoseStamped`, as converters write it, in the spelling of ROS 2."""
    package, slash, name = msgtype.partition("/")
    return f"{package}/msg/{name}" if slash and "/" not in name else msgtype


def _offered(connection: Connection) -> tuple[bool, bool, int]:
    """Whether all publishers offered best effort only, whether all kept their last message, and how many they are."""
    if not isinstance(connection.ext, ConnectionExtRosbag2):  # ROS 1 offers one kind of service
        return False, False, 1
    profiles = connection.ext.offered_qos_profiles
    lossy = bool(profiles) and all(qos.reliability == QosReliability.BEST_EFFORT for qos in profiles)
    latched = bool(profiles) and all(qos.durability == QosDurability.TRANSIENT_LOCAL for qos in profiles)
    return lossy, latched, max(len(profiles), 1)


def _messages(file: _File, types: Mapping[str, str]) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time (ns) and bytes of the messages on the topics, each of the type that is given for it."""
    if file.by_record:
        for channel, time, data in file.records():
            if types.get(channel.topic) == _as_of_ros2(channel.msgtype):
                yield channel.topic, time, _unpacked_message(data)
        return
    with Reader(file.path) as reader:
        connections = [c for c in reader.connections if types.get(c.topic) == _as_of_ros2(c.msgtype) and c.msgcount]
        if not connections:
            return
        for connection, time, data in reader.messages(connections):
            yield connection.topic, time, _unpacked_message(data or b"")  # a database may hold none


def _unpacked_message(data: bytes) -> bytes:
    """A message, which begins with 0; a compressed one does not."""
    return zstd.decompress(data) if data[:4] == ZSTD else data


@contextlib.contextmanager
def _saying_what_is_damaged(file: _File) -> Iterator[None]:
    """A damaged file can fail anywhere in the reader, its decompressors or SQLite, with any exception of theirs."""
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except Exception as error:
        how = "cut off" if file.cut else "damaged"
        raise InputError(f"{file.given}: {how}{said_of(error)}; copy it again or try `{file.mends}`") from None


def said_of(error: Exception) -> str:
    """What a reader says of a file, in brackets; nothing where damage only made its Python stumble."""
    return "" if type(error).__module__ in ("builtins", "struct") else f" ({one_line(error)})"
