# SPDX-License-Identifier: Apache-2.0
"""Which files make up a bag: a folder with or without its metadata, or a bare file."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path, PurePath
from typing import Any

from ..core.errors import InputError
from ..core.paths import missing
from ..core.yaml_files import read_yaml
from .file_kinds import kind_of
from .mcap_salvage import MAGIC

METADATA = "metadata.yaml"
SQLITE, ROS1 = b"SQLite format 3\0", b"#ROSBAG V"
_PACKED = (".zstd", ".zst")
#: What every recorder writes into the metadata.
_PROMISED = ("duration", "starting_time", "message_count", "topics_with_message_count")


def is_bag(path: Path) -> bool:
    """Whether a path is read as a bag rather than as text: a folder, or a file that begins or ends as a bag does."""
    if path.is_dir():
        return True
    try:
        head = head_of(path) if path.is_file() else b""  # opening a pipe could wait for ever
    except (OSError, ValueError):
        head = b""
    return (
        path.name == METADATA
        or _inner(path).suffix in (".mcap", ".db3", ".bag")
        or head.startswith((MAGIC, SQLITE, ROS1))
    )


def storage_inside(folder: Path) -> bool:
    """Whether a folder holds storage files of a bag."""
    try:
        return folder.is_dir() and any(map(_is_storage, folder.iterdir()))
    except OSError:
        return False


def head_of(file: Path) -> bytes:
    """The first bytes of a file."""
    with file.open("rb") as stream:
        return stream.read(32)


def unpacked_name(path: PurePath) -> str:
    """A file's name without the suffix of a compression."""
    return path.stem if path.suffix in _PACKED else path.name


def storage_files(path: Path, notes: list[str]) -> tuple[list[Path], int]:
    """The storage files of a bag in their order, and how many messages its metadata promise (0: they do not say).

    What is left out or missing is added to ``notes``. Raises InputError for what is no bag, or has lost a part.
    """
    try:
        if path.is_file():
            if path.name == METADATA:
                raise InputError(f"{path}: says what is in a bag; name its folder, {path.parent}")
            if not is_bag(path):
                raise InputError(f"{path}: not a bag; give a rosbag2 folder, a .mcap or a .db3")
            return [path], 0
        if not path.is_dir():
            raise InputError(f"{path}: {missing(path).replace('no such file', 'no such bag', 1)}")
        inside = sorted((p for p in path.iterdir() if _is_storage(p)), key=_natural)
        has_metadata = (path / METADATA).is_file()
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if inside and (inner := [p for p in sorted(path.iterdir()) if storage_inside(p)]):
        notes.append(
            f"{_names(inner)} in it holds a bag of its own, which is not used; list it as a run where it is one"
        )
    named, promised = _metadata(path / METADATA, notes) if has_metadata else ([], 0)
    files = _named(path, named, inside, notes) or _found(path, inside, notes)
    if len(files) > 1 and (empty := [p.name for p in files if not p.stat().st_size]) and len(empty) < len(files):
        notes.append(f"{', '.join(empty)} is empty and left out: the recorder ended before it was written")
        files = [p for p in files if p.name not in empty]
    return files, promised


def _named(path: Path, names: list[str], inside: list[Path], notes: list[str]) -> list[Path]:
    """The files that the metadata name, packed or unpacked; none where none of these is there but others are."""
    unpacked = {unpacked_name(p): p for p in inside}
    files = [
        path / name if (path / name).is_file() else unpacked.get(unpacked_name(PurePath(name)), path / name)
        for name in names
    ]
    missing = [p.name for p in files if not p.is_file()]
    for name in missing:
        _refuse_packed(path, name)
    if missing and len(missing) == len(files) and inside:
        notes.append(f"{METADATA} is not used: it names {missing[0]}, which is not there")
        return []
    if missing:
        raise InputError(
            f"{path}: {missing[0]} is missing, which {METADATA} names; copy it here, or `ros2 bag reindex {path}`"
        )
    left = [p for p in inside if p not in files]
    if files and left:
        notes.append(f"{_names(left)} is left out: {METADATA} does not name it")
    return files


def _found(path: Path, inside: list[Path], notes: list[str]) -> list[Path]:
    """The storage files of a folder, which must belong to one bag."""
    if not inside:
        ros1 = next(iter(sorted(path.glob("*.bag*"))), None)
        if ros1 is not None:
            return [ros1]
        _refuse_packed(path)
        held = _names(sorted(path.iterdir())[:3])
        bags = [p for p in sorted(path.iterdir()) if storage_inside(p)]
        if bags:
            raise InputError(
                f"{path}: a folder of {len(bags)} bag{'s' * (len(bags) > 1)}; name one: {_names(bags[:4])}"
            )
        raise InputError(
            f"{path}: not a rosbag2 folder: neither {METADATA} nor a .mcap or .db3 in it"
            + (f"; it holds {held}" if held else "")
        )
    plain = {p.name for p in inside}
    twice = [p for p in inside if p.name != unpacked_name(p) and unpacked_name(p) in plain]
    if twice:
        notes.append(f"{_names(twice)} is left out: it is there unpacked, too")
    files = [p for p in inside if p not in twice]
    if len({re.sub(r"_\d+$", "", _inner(p).stem) + _inner(p).suffix for p in files}) > 1:
        raise InputError(
            f"{path}: {METADATA} is missing, and the files belong to several bags; name one of them as the run's file"
        )
    numbers = [int(match[1]) for p in files if (match := re.search(r"_(\d+)$", _inner(p).stem))]
    for before, after in zip(numbers, numbers[1:], strict=False):
        if after > before + 1:
            notes.append(f"files {before} and {after} follow each other: what was recorded between them is missing")
    return files


def _refuse_packed(folder: Path, name: str = "") -> None:
    """Raise InputError where a storage file, of this name or any, is in the folder, but packed in a way that is not
    read."""
    for file in sorted(folder.iterdir()):
        stem = Path(file.stem)
        storage = stem.name == name if name else stem.suffix in (".mcap", ".db3")
        if storage and file.is_file() and (what := kind_of(file)) and "unpack" in what:
            raise InputError(f"{file}: is {what}")


def _metadata(file: Path, notes: list[str]) -> tuple[list[str], int]:
    """Names of the storage files and number of messages; none and 0 where the metadata cannot be read."""
    try:
        written: Any = read_yaml(file, aliases=True)
        information = written["rosbag2_bagfile_information"]
        names = [PurePath(name).name for name in information["relative_file_paths"]]
        count = information.get("message_count", 0)
        if lacks := [key for key in _PROMISED if key not in information]:
            notes.append(f"{METADATA} is cut off or not whole, it lacks {', '.join(lacks)}: the files themselves count")
        return names, count if isinstance(count, int) and not isinstance(count, bool) else 0
    except (InputError, KeyError, TypeError, AttributeError):
        notes.append(f"{METADATA} cannot be read and is not used")
        return [], 0


def _is_storage(path: Path) -> bool:
    return not path.name.startswith(".") and _inner(path).suffix in (".mcap", ".db3") and path.is_file()


def _inner(path: Path) -> Path:
    return Path(unpacked_name(path))


def _names(paths: Iterable[Path]) -> str:
    return ", ".join(p.name for p in paths)


def _natural(path: Path) -> list[tuple[int, str]]:
    """run_2 before run_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", path.name)]
