# SPDX-License-Identifier: Apache-2.0
"""A file of a logger or a spreadsheet as UTF-8 lines that end with a newline, row for row as an editor shows them."""

from __future__ import annotations

import codecs
from pathlib import Path

from ..core.errors import InputError

#: What a file is that begins so, and what to do with it.
OTHERS = (
    (b"PK\x03\x04", "a workbook or an archive; save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook; save the sheet as CSV"),
    (b"\x1f\x8b", "compressed; unpack it with `gunzip`"),
    (b"BZh", "compressed; unpack it with `bunzip2`"),
    (b"\xfd7zXZ", "compressed; unpack it with `unxz`"),
    (b"\x28\xb5\x2f\xfd", "compressed; unpack it with `zstd -d`"),
    (b"\x89HDF", "an HDF5 or MATLAB file; export it as CSV"),
    (b"MATLAB", "a MATLAB file; export it as CSV, e.g. with writetable"),
    (b"PAR1", "a Parquet file; export it as CSV"),
    (b"TDSm", "a LabVIEW TDMS file; export it as CSV"),
    (b"MDF ", "an MDF file; export it as CSV"),
    (b"ULog", "a PX4 log; export it with `ulog2csv`"),
)
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
        if not file.exists():
            raise InputError(f"{file}: no such file")
        if not file.is_file():  # reading a pipe or a device could wait for ever
            raise InputError(f"{file}: not a regular file")
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    for head, what in OTHERS:
        if data.startswith(head):
            raise InputError(f"{file}: is no CSV but {what}")
    data = _utf8(file, data, notes)
    if not data.strip():
        raise InputError(f"{file}: empty; it needs a header that names the columns, and rows of numbers")
    if b"\0" in data:
        raise InputError(
            f"{file}, row {_row(data, data.index(0))}: a NUL character, which no text holds; copy or export the file"
            " again"
        )
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data if data.endswith(b"\n") else data + b"\n"


def _utf8(file: Path, data: bytes, notes: list[str]) -> bytes:
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return _recoded(file, data[len(mark) :], encoding)
    if len(data) >= 4 and data[1] == 0 and data[3] == 0 and data[0] and data[2]:
        return _recoded(file, data, "utf-16-le")
    if len(data) >= 4 and data[0] == 0 and data[2] == 0 and data[1] and data[3]:
        return _recoded(file, data, "utf-16-be")
    try:
        data.decode("utf-8")
        return data
    except UnicodeDecodeError:
        notes.append("not UTF-8: read as Windows-1252")
        return data.decode("cp1252", errors="replace").encode()


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
