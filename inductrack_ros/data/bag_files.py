# SPDX-License-Identifier: Apache-2.0
"""Opens what people have of a rosbag2: a folder with or without its metadata, a bare file, compressed, cut off, of any
distribution.

The storage files tell what is in them; `metadata.yaml` only says which they are and in what order. They are read one
after the other by `rosbags`, so that a recording of a thousand files needs no thousand open ones."""

from __future__ import annotations

import contextlib
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePath

from rosbags.interfaces import Connection, QosReliability
from rosbags.rosbag2 import Reader

from ..core.errors import InputError
from ..core.yaml_files import read_yaml
from .mcap_salvage import MAGIC, salvage, zstd

METADATA = "metadata.yaml"
SQLITE, ZSTD, ROS1 = b"SQLite format 3\0", b"\x28\xb5\x2f\xfd", b"#ROSBAG V"
_PACKED = (".zstd", ".zst")


@dataclass(frozen=True)
class Topic:
    """A topic in a bag: message type, number of messages, whether all its publishers offered best effort only."""

    name: str
    msgtype: str
    count: int
    lossy: bool

    def joined(self, other: Topic | None) -> Topic:
        """This and another part of the same topic."""
        return (
            self
            if other is None
            else Topic(self.name, other.msgtype, self.count + other.count, self.lossy and other.lossy)
        )


@dataclass(frozen=True)
class _File:
    """A storage file that can be read: ``path`` may be a copy of ``given``, which messages to people name."""

    path: Path
    given: Path
    cut: bool = False


@dataclass(frozen=True)
class Bag:
    """An open bag: its topics by name, and what was to be said while it was opened."""

    path: Path
    topics: dict[str, Topic]
    notes: tuple[str, ...]
    _files: tuple[_File, ...] = field(repr=False, default=())

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Topic, log time (ns) and bytes of every message on these topics, file by file. Raises InputError for a
        damaged one."""
        for file in self._files:
            with _saying_what_is_damaged(file):
                yield from _messages(file, names)


def is_bag(path: Path) -> bool:
    """Whether a path is read as a bag rather than as text: a folder, or a file that begins or ends as a bag does."""
    if path.is_dir():
        return True
    try:
        head = _head(path) if path.is_file() else b""  # opening a pipe could wait for ever
    except (OSError, ValueError):
        head = b""
    return _inner(path).suffix in (".mcap", ".db3", ".bag") or head.startswith((MAGIC, SQLITE, ROS1))


def unpacked_name(path: Path) -> str:
    """A file's name without the suffix of a compression."""
    return path.stem if path.suffix in _PACKED else path.name


@contextlib.contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a rosbag2 folder or one of its files; copies that are needed are gone at the end.

    Raises InputError, naming bag and remedy, for what is no bag or is damaged beyond reading.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="inductrack-") as folder:
            notes: list[str] = []
            given, promised = _storage_files(path, notes)
            files = tuple(_readable(file, Path(folder, str(i)), notes) for i, file in enumerate(given))
            topics: dict[str, Topic] = {}
            for file in files:
                with _saying_what_is_damaged(file):
                    for topic in _topics(file):
                        topics[topic.name] = topic.joined(topics.get(topic.name))
            found = sum(t.count for t in topics.values())
            cut = [f.given.name for f in files if f.cut]
            if cut and not found:
                raise InputError(
                    f"{path}: {cut[0]} is cut off and holds no whole message; copy it again or try `mcap recover"
                    f" {cut[0]}`"
                )
            if cut or found < promised:
                what = f"{cut[0]} is cut off" if cut else f"{METADATA} promises more"
                mend = f"; `mcap recover {cut[0]}` mends the file" if cut else ""
                notes.append(
                    f"{what}: {found}{f' of {promised}' if promised else ''} messages are whole and read{mend}"
                )
            yield Bag(path, topics, tuple(notes), files)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


# ---------------------------------------------------------------- which files


def _storage_files(path: Path, notes: list[str]) -> tuple[list[Path], int]:
    """The storage files of a bag in their order, and how many messages its metadata promise (0: they do not say)."""
    try:
        if path.is_file():
            if not is_bag(path):
                raise InputError(f"{path}: not a bag; give a rosbag2 folder, a .mcap or a .db3")
            return [path], 0
        if not path.is_dir():
            raise InputError(f"{path}: no such bag")
        inside = sorted((p for p in path.iterdir() if _is_storage(p)), key=_natural)
        has_metadata = (path / METADATA).is_file()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    named, promised = _metadata(path / METADATA, notes) if has_metadata else ([], 0)
    if named:
        missing = [name for name in named if not (path / name).is_file()]
        if missing:
            raise InputError(
                f"{path}: {missing[0]} is missing, which {METADATA} names; copy it here, or `ros2 bag reindex {path}`"
            )
        if left := [p.name for p in inside if p.name not in named]:
            notes.append(f"{', '.join(left)} is left out: {METADATA} does not name it")
        return [path / name for name in named], promised
    if not inside:
        ros1 = next(iter(sorted(path.glob("*.bag"))), None)
        if ros1 is not None:
            return [ros1], 0
        raise InputError(f"{path}: not a rosbag2 folder: neither {METADATA} nor a .mcap or .db3 in it")
    if len({re.sub(r"_\d+$", "", _inner(p).stem) + _inner(p).suffix for p in inside}) > 1:
        raise InputError(
            f"{path}: {METADATA} is missing, and the files belong to several bags; name one of them as the run's file"
        )
    return inside, promised


def _metadata(file: Path, notes: list[str]) -> tuple[list[str], int]:
    """Names of the storage files and number of messages; none and 0 where the metadata cannot be read."""
    try:
        information = read_yaml(file, aliases=True)["rosbag2_bagfile_information"]
        names = [PurePath(name).name for name in information["relative_file_paths"]]
        count = information.get("message_count", 0)
        return names, count if isinstance(count, int) and not isinstance(count, bool) else 0
    except (InputError, KeyError, TypeError, AttributeError):
        notes.append(f"{METADATA} cannot be read and is not used")
        return [], 0


def _is_storage(path: Path) -> bool:
    return not path.name.startswith(".") and _inner(path).suffix in (".mcap", ".db3") and path.is_file()


def _inner(path: Path) -> Path:
    return Path(unpacked_name(path))


def _natural(path: Path) -> list[tuple[int, str]]:
    """run_2 before run_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]


# ---------------------------------------------------------------- one file


def _readable(file: Path, folder: Path, notes: list[str]) -> _File:
    """The file as `rosbags` can read it: unpacked, under a name that SQLite takes, with what its journal holds."""
    path, head = file, _head(file)
    if head.startswith(ZSTD):
        folder.mkdir(exist_ok=True)
        path = folder / "unpacked"
        try:
            with zstd.open(file, "rb") as packed, path.open("wb") as unpacked:
                shutil.copyfileobj(packed, unpacked)
        except (zstd.ZstdError, EOFError) as error:
            raise InputError(
                f"{file}: the zstd compression is damaged or cut off ({_one_line(error)}); copy the file again"
            ) from None
        head = _head(path)
    if head.startswith(ROS1):
        raise InputError(
            f"{file}: a ROS 1 bag; convert it: `rosbags-convert --src {file} --dst {file.with_suffix('')}`, and name"
            " that folder"
        )
    if head.startswith(SQLITE):
        return _File(_database(path, file, folder, notes), file)
    if not head:
        raise InputError(f"{file}: empty, the recording was cut off; record it again")
    if not head.startswith(MAGIC):
        raise InputError(
            f"{file}: cannot be read as a rosbag2: it begins neither as MCAP nor as SQLite, damaged or cut off"
        )
    with path.open("rb") as stream:
        stream.seek(0, 2)
        stream.seek(max(stream.tell() - len(MAGIC), len(MAGIC)))
        cut = stream.read() != MAGIC
    return _File(_under(path, folder, ".mcap"), file, cut)


def _database(path: Path, given: Path, folder: Path, notes: list[str]) -> Path:
    """A database that is whole in one file. Changes that SQLite keeps beside it (a recorder that was killed) are taken
    in, in a copy."""
    beside = [Path(f"{given}{suffix}") for suffix in ("-wal", "-journal")]
    beside = [p for p in beside if p.is_file() and p.stat().st_size]
    if not beside:
        _check_length(path)
        return _under(path, folder, ".db3")
    folder.mkdir(exist_ok=True)
    copy = folder / "copy.db3"
    shutil.copyfile(path, copy)
    for file in beside:
        shutil.copyfile(file, f"{copy}{file.name.removeprefix(given.name)}")
    try:
        with contextlib.closing(sqlite3.connect(copy)) as database:
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            database.execute("PRAGMA journal_mode=DELETE").fetchall()
    except sqlite3.Error as error:
        raise InputError(
            f"{beside[0]}: cannot be taken into {given.name} ({_one_line(error)}); try `sqlite3 {given.name} .recover`"
        ) from None
    notes.append(f"{beside[0].name} is read too: the recorder ended before it was taken into {given.name}")
    return copy


def _under(path: Path, folder: Path, suffix: str) -> Path:
    """The path, or a link to it where its suffix hides what it is or SQLite would take its name for an address (`run
    #3`)."""
    if path.suffix == suffix and not re.search(r"[?#%]", str(path)):
        return path
    folder.mkdir(exist_ok=True)
    link = folder / f"bag{suffix}"
    link.symlink_to(path.resolve())
    return link


def _check_length(file: Path) -> None:
    """SQLite reads the missing end of a file as zeros; its header says how many pages there should be."""
    head = _head(file)
    page_size, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    if file.stat().st_size < pages * (page_size if page_size > 1 else 65536):
        raise InputError(f"{file}: cut off, its end is missing; copy it again or try `sqlite3 {file.name} .recover`")


def _head(file: Path) -> bytes:
    with file.open("rb") as stream:
        return stream.read(32)


def _topics(file: _File) -> Iterator[Topic]:
    if file.cut:
        counts: dict[tuple[str, str, bool], int] = {}
        for channel, _, _ in salvage(file.path):
            key = (
                channel.topic,
                channel.msgtype,
                bool(re.search(r"reliability: *['\"]?(2|best_effort)\b", channel.offered_qos)),
            )
            counts[key] = counts.get(key, 0) + 1
        yield from (Topic(*key[:2], count, key[2]) for key, count in counts.items())
        return
    with Reader(file.path) as reader:
        yield from (Topic(c.topic, c.msgtype, c.msgcount, _lossy(c)) for c in reader.connections)


def _lossy(connection: Connection) -> bool:
    offered = [qos.reliability for qos in connection.ext.offered_qos_profiles]
    return bool(offered) and all(reliability == QosReliability.BEST_EFFORT for reliability in offered)


def _messages(file: _File, names: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
    if file.cut:
        yield from ((channel.topic, time, data) for channel, time, data in salvage(file.path) if channel.topic in names)
        return
    with Reader(file.path) as reader:
        connections = [c for c in reader.connections if c.topic in names and c.msgcount]
        if not connections:
            return
        # A message begins with 0, a compressed one does not.
        for connection, time, data in reader.messages(connections):
            yield connection.topic, time, zstd.decompress(data) if data[:4] == ZSTD else data


@contextlib.contextmanager
def _saying_what_is_damaged(file: _File) -> Iterator[None]:
    """A damaged file can fail anywhere in the reader, its decompressors or SQLite, with any exception of theirs."""
    try:
        yield
    except (InputError, GeneratorExit):
        raise
    except Exception as error:
        tool = "mcap recover" if _head(file.path).startswith(MAGIC) else "sqlite3 .recover"
        raise InputError(f"{file.given}: damaged ({_one_line(error)}); copy it again or try `{tool}`") from None


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
