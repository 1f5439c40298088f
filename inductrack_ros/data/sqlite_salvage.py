# SPDX-License-Identifier: Apache-2.0
"""The whole rows of an SQLite bag of which pages are damaged or missing.

Rows stand in pages in the order of their id, and each page is found by the ids in it. So the rows of a damaged page are
stepped over: the next id that can be read is looked for. An index is not used, for it may be what is damaged."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from .salvage import Channel, Found, Loss
from .sqlite_files import read_only

#: No bag has so many messages.
_MOST = 1 << 40
_ROWS = "SELECT id, topic_id, timestamp, data FROM messages"
_Row = tuple[int, int, int, bytes | None]


def is_whole(path: Path) -> bool:
    """Whether every page of a database is as SQLite would have it. What stands in a row has no check sum."""
    try:
        with contextlib.closing(read_only(path)) as database:
            return database.execute("PRAGMA quick_check(1)").fetchone() == ("ok",)
    except (sqlite3.Error, UnicodeError):
        return False


def salvage(path: Path) -> Iterator[Found]:
    """Each whole message and each stretch that is lost, in the order of their ids. Raises sqlite3.Error where the
    topics cannot be read."""
    with contextlib.closing(read_only(path)) as database:
        channels = _channels(database)
        last, row = None, 0
        while True:
            with contextlib.suppress(sqlite3.DatabaseError):  # which takes the row before the damage with it
                for number, topic, time, data in database.execute(f"{_ROWS} WHERE id > ? ORDER BY id", (row,)):
                    row, last = number, time
                    if topic in channels:
                        yield channels[topic], time, data or b""
                return
            found = _first(database, row + 1)
            if found is None:
                found = _behind(database, row + 1)
                yield Loss(last, found and found[2])
            if found is None:
                return
            row, topic, last, data = found
            if topic in channels:
                yield channels[topic], last, data or b""


def promised(path: Path) -> tuple[int, int | None]:
    """How many messages there were, by the largest id, and the log time (ns) of the first; 0 and None where that cannot
    be read."""
    try:
        with contextlib.closing(read_only(path)) as database:
            (most,) = database.execute("SELECT max(id) FROM messages").fetchone()
            (first,) = database.execute("SELECT timestamp FROM messages ORDER BY id LIMIT 1").fetchone()
            return most, first
    except (sqlite3.Error, UnicodeError, TypeError):
        return 0, None


def _channels(database: sqlite3.Connection) -> dict[int, Channel]:
    """The topics by their number; older distributions do not say what publishers offered."""
    names = [str(column[1]) for column in database.execute("PRAGMA table_info(topics)")]
    offered = "offered_qos_profiles" if "offered_qos_profiles" in names else "''"
    rows = database.execute(f"SELECT id, name, type, {offered} FROM topics").fetchall()
    return {int(number): Channel(str(name), str(msgtype), str(qos)) for number, name, msgtype, qos in rows}


def _first(database: sqlite3.Connection, row: int) -> _Row | None:
    """The first row from an id on; None where it cannot be read, or there is none."""
    try:
        return database.execute(f"{_ROWS} WHERE id >= ? ORDER BY id LIMIT 1", (row,)).fetchone()
    except sqlite3.DatabaseError:
        return None


def _behind(database: sqlite3.Connection, low: int) -> _Row | None:
    """The first row behind damage, which is at the id ``low``; None where there is none."""
    step = 1
    while (found := _first(database, low + step)) is None:
        step *= 2
        if step > _MOST:
            return None
    low, high = low + step // 2, low + step  # from the one on nothing is read, from the other on something is
    while high - low > 1:
        middle = (low + high) // 2
        nearer = _first(database, middle)
        low, high, found = (middle, high, found) if nearer is None else (low, middle, nearer)
    return found
