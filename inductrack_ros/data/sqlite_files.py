# SPDX-License-Identifier: Apache-2.0
"""An SQLite file made whole, with what its journal holds where a recorder was killed.

The format: https://sqlite.org/fileformat.html
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import sqlite3
from pathlib import Path

from ..core.errors import InputError, one_line
from .bag_storage import head_of

_WAL = (0x377F0682, 0x377F0683)
_ROLLBACK = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"


def whole_database(path: Path, given: Path, folder: Path, notes: list[str]) -> Path:
    """The database at ``path`` (a copy of ``given``, or that itself), or a copy in ``folder`` with what SQLite keeps
    beside ``given``.

    What was taken in and what could not be is added to ``notes``.
    """
    wal, journal = Path(f"{given}-wal"), Path(f"{given}-journal")
    pages = _pages_written(wal)
    if wal.is_file() and wal.stat().st_size and pages is None:
        notes.append(f"{wal.name} is damaged and not read: messages may be missing")
    undoing = journal.is_file() and head_of(journal).startswith(_ROLLBACK)
    if not pages and not undoing:
        return path
    folder.mkdir(exist_ok=True)
    copy = folder / "copy.db3"
    shutil.copyfile(path, copy)
    for file in (wal, journal):
        if file.is_file():
            shutil.copyfile(file, f"{copy}{file.name.removeprefix(given.name)}")
    try:
        with contextlib.closing(sqlite3.connect(copy)) as database:
            taken = database.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()[1]
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            database.execute("PRAGMA journal_mode=DELETE").fetchall()
    except sqlite3.Error as error:
        if "disk is full" in str(error):  # 3.10 has no code for it
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from None
        beside = journal if undoing else wal
        raise InputError(
            f"{beside}: cannot be taken into {given.name} ({one_line(error)}); try `sqlite3 {given.name} .recover`"
        ) from None
    if undoing:
        notes.append(f"{journal.name} undoes what the recorder had not finished writing into {given.name}")
    if pages and taken < pages:
        notes.append(
            f"{wal.name} is whole for {max(taken, 0)} of {pages} pages, which are read: messages may be missing"
        )
    elif pages:
        notes.append(f"{wal.name} is read too: the recorder ended before it was taken into {given.name}")
    return copy


def read_only(path: Path) -> sqlite3.Connection:
    """A database of which nothing is changed, nor made beside it."""
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)


def tables_of(path: Path) -> list[str] | None:
    """Names of the tables in a database; None where it cannot be read, which is said where its rows are."""
    try:
        with contextlib.closing(read_only(path)) as database:
            rows = database.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
            return [str(name) for (name,) in rows]
    except (sqlite3.Error, UnicodeError):  # of a damaged one a name may be no text
        return None


def _pages_written(wal: Path) -> int | None:
    """How many pages were written into a -wal since it was last taken in, whole or not; 0 without one, None where it
    is none."""
    if not wal.is_file() or not wal.stat().st_size:
        return 0
    with wal.open("rb") as stream:
        head = stream.read(32)
        size = int.from_bytes(head[8:12], "big")
        if int.from_bytes(head[:4], "big") not in _WAL or len(head) < 32 or not 512 <= size <= 65536:
            return None
        pages = 0
        while (frame := stream.read(24)) and frame[8:16] == head[16:24]:  # else a page of an earlier turn
            pages += 1
            stream.seek(size, 1)
        return pages


def lacks_its_end(file: Path) -> bool:
    """Whether a database is shorter than its header says."""
    return file.stat().st_size < _length(file)


def with_an_end(path: Path, folder: Path) -> Path:
    """A copy in ``folder`` of a database that is cut off, with zeros for its end: without it SQLite opens none."""
    folder.mkdir(exist_ok=True)
    copy = folder / "lengthened.db3"
    shutil.copyfile(path, copy)
    os.truncate(copy, _length(path))
    return copy


def _length(file: Path) -> int:
    """Bytes that a database should have: its header says how many pages."""
    head = head_of(file)
    page_size, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    return pages * (page_size if page_size > 1 else 65536)
