# SPDX-License-Identifier: Apache-2.0
"""A file of a logger or a spreadsheet as UTF-8 lines that end with a newline, row for row as an editor shows them."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.paths import missing
from .file_kinds import kind_of

#: Characters that text does not hold, but for NUL, which a recording that was cut off may end in.
_BINARY = re.compile(rb"[\x01-\x08\x0e-\x19\x1c-\x1f\x7f]")
#: What is no part of a table (a byte-order mark, also where files were joined), and blanks and a minus as typesetters
#: write them, each with what stands for it.
TYPESET = (
    (codecs.BOM_UTF8, b""),
    ("\u200b".encode(), b""),
    ("\u00a0".encode(), b" "),
    ("\u202f".encode(), b" "),
    ("\u2212".encode(), b"-"),
)
#: Bytes by which an encoding without a mark is told.
HEAD = 4096
#: A quoted cell that goes over several lines, and no further than that.
_QUOTED = re.compile(rb'((?<![^,;|\t\n])"(?:[^"\n]|"")*(?:\n(?:[^"\n]|"")*){1,20}"(?![^,;|\t\n]))')
#: A table of which each row is in quotes, as a spreadsheet saves one that it took for one column.
_QUOTED_ROWS = re.compile(rb'(?:"[^"\n]*[,;|\t][^"\n]*"[ \t]*\n|[ \t]*\n)+')
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def read_text(file: Path, notes: list[str]) -> bytes:
    """The file in UTF-8 without byte-order mark. Raises InputError for what is no text, and says what it is instead."""
    try:
        if file.is_dir():
            raise InputError(f"{file}: is a folder, not a CSV file (a rosbag2 folder holds metadata.yaml)")
        if why := missing(file):
            raise InputError(f"{file}: {why}")
        if not file.is_file():  # reading a pipe or a device could wait for ever
            raise InputError(f"{file}: not a regular file")
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if what := kind_of(file):
        raise InputError(f"{file}: is no CSV but {what}")
    data = _utf8(file, data, notes)
    if len(_BINARY.findall(data[:HEAD])) > 2 or b"\0" in data and b"\n" not in data.rstrip(b"\0"):
        raise InputError(f"{file}: is no CSV but a binary file; export the table as CSV with the program that wrote it")
    for typed, meant in TYPESET:
        data = data.replace(typed, meant)
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    data = _without_tail(data, notes)
    if not data.strip():
        raise InputError(f"{file}: empty; it needs a header that names the columns, and rows of numbers")
    if b"\0" in data:
        raise InputError(
            f"{file}, row {_row(data, data.index(0))}: a NUL character, which no text holds; copy or export the file"
            " again"
        )
    data = data if data.endswith(b"\n") else data + b"\n"
    data = data.replace(b'="', b'"')  # a number as a spreadsheet is made to keep it: ="1.20"
    if data.startswith(b'"') and _QUOTED_ROWS.fullmatch(data):
        data = data.replace(b'"', b"")
    return _joined(data) if b'"' in data else data


def _joined(data: bytes) -> bytes:
    """The text with every quoted cell on one line; the line ends that stood in it follow its row, so that rows keep
    their numbers."""
    text = np.frombuffer(data, np.uint8)
    ends = np.searchsorted(np.flatnonzero(text == ord('"')), np.flatnonzero(text == ord("\n")))
    if not (ends % 2).any():
        return data
    moved = 0
    lines: list[bytes] = []
    for part in _QUOTED.split(data):  # what stands between quoted cells of several lines, and these
        if _QUOTED.fullmatch(part):
            lines.append(part.replace(b"\n", b" "))
            moved += part.count(b"\n")
        elif moved and b"\n" in part:
            head, _, rest = part.partition(b"\n")
            lines.append(head + b"\n" * (moved + 1) + rest)
            moved = 0
        else:
            lines.append(part)
    return b"".join(lines)


def _without_tail(data: bytes, notes: list[str]) -> bytes:
    """The text without what a recorder leaves behind it: blocks of NUL that it reserved and did not fill, with the row
    that it did not finish; and the Ctrl-Z of DOS."""
    whole = data.rstrip(b"\0")
    if whole == data:
        return data.removesuffix(b"\x1a")
    notes.append(f"{len(data) - len(whole)} NUL characters at the end left out: the recording was cut off")
    return whole[: whole.rfind(b"\n") + 1]


def _utf8(file: Path, data: bytes, notes: list[str]) -> bytes:
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return _recoded(file, data[len(mark) :], encoding)
    if encoding := _unmarked(data[:HEAD]):
        return _recoded(file, data, encoding)
    try:
        data.decode("utf-8")
        return data
    except UnicodeDecodeError:
        notes.append("not UTF-8: read as Windows-1252")
        return data.decode("cp1252", errors="replace").encode()


def _unmarked(head: bytes) -> str:
    """UTF-16 without its mark, by the bytes of 0 that most letters have and no other text; empty for none."""
    for zeros, others, encoding in ((1, 0, "utf-16-le"), (0, 1, "utf-16-be")):
        if head[zeros::2].count(0) > len(head) / 4 and not head[others::2].count(0):
            return encoding
    return ""


def _recoded(file: Path, data: bytes, encoding: str) -> bytes:
    try:
        return data.decode(encoding).encode()
    except UnicodeError as error:
        start = getattr(error, "start", len(data))
        row = data[:start].decode(encoding, errors="ignore").count("\n") + 1
        raise InputError(
            f"{file}, row {row}: not {encoding.upper()} text, as its first bytes say; save it with UTF-8 encoding"
        ) from None


def _row(data: bytes, at: int) -> int:
    return max(data.count(b"\n", 0, at), data.count(b"\r", 0, at)) + 1
