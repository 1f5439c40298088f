# SPDX-License-Identifier: Apache-2.0
"""What a file is that is neither the table nor the bag that was asked for, by its first bytes."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

#: Bytes by which a file is told.
HEAD = 4096

_KINDS = (
    (b"\xd0\xcf\x11\xe0", "an Excel workbook; save the sheet as CSV"),
    (b"\x1f\x8b", "compressed; unpack it with `gunzip`"),
    (b"BZh", "compressed; unpack it with `bunzip2`"),
    (b"\xfd7zXZ", "compressed; unpack it with `unxz`"),
    (b"\x28\xb5\x2f\xfd", "compressed; unpack it with `zstd -d`"),
    (b"\x04\x22\x4d\x18", "compressed; unpack it with `lz4 -d`"),
    (b"7z\xbc\xaf\x27\x1c", "an archive; unpack it with `7z x`"),
    (b"\x89HDF", "an HDF5 or MATLAB file; export it as CSV"),
    (b"MATLAB", "a MATLAB file; export it as CSV, e.g. with writetable"),
    (b"PAR1", "a Parquet file; export it as CSV"),
    (b"TDSm", "a LabVIEW TDMS file; export it as CSV"),
    (b"MDF ", "an MDF file; export it as CSV"),
    (b"version https://git-lfs", "a pointer of Git LFS; fetch the file itself with `git lfs pull`"),
    (b"ULog", "a PX4 log; export it with `ulog2csv`"),
    (b"\x93NUMPY", "an array of numpy; write it with numpy.savetxt and name the columns in its header"),
    (b"ARROW1", "an Arrow file; export it as CSV"),
    (b"%PDF-", "a PDF; export the table as CSV"),
    (b"{\\rtf", "rich text; save it as plain text"),
    (b"<", "a page of HTML or XML; export the table as CSV"),
    (b"{", "JSON; export it as CSV"),
    (b"[{", "JSON; export it as CSV"),
)


_ZIP = b"PK\x03\x04"
#: How packed files begin, what opens them, and what unpacks a folder that was packed so.
_PACKED = ((b"\x1f\x8b", gzip.open, "tar xzf"), (b"BZh", bz2.open, "tar xjf"), (b"\xfd7zXZ", lzma.open, "tar xJf"))
#: What a folder packed with tar has at byte 257.
_TAR = b"ustar"


def kind_of(file: Path) -> str:
    """What a file is, and what to do with it; empty where that is not known. Raises OSError where it cannot be read."""
    head = _head(file)
    text = head.lstrip()
    if head.startswith(_ZIP):
        return _of_zip(file)
    if head[257:].startswith(_TAR):
        return f"a packed folder; unpack it with `tar xf {file.name}`, and name what is in it"
    for magic, opened, unpacking in _PACKED:
        if head.startswith(magic) and _unpacked(file, opened)[257:].startswith(_TAR):
            return f"a packed folder; unpack it with `{unpacking} {file.name}`, and name what is in it"
    return next((what for magic, what in _KINDS if head.startswith(magic) or text.startswith(magic)), "")


def is_text(file: Path) -> bool:
    """Whether a file begins as text in UTF-8."""
    try:
        head = _head(file).decode("utf-8")
    except UnicodeDecodeError as error:
        head = _head(file)[: error.start].decode("utf-8") if error.start > HEAD - 4 else ""
    return bool(head) and all(c.isprintable() or c.isspace() for c in head)


def _head(file: Path) -> bytes:
    with file.open("rb") as stream:
        return stream.read(HEAD)


def _unpacked(file: Path, opened: Callable[..., Any]) -> bytes:
    """The first bytes of what is packed in a file; none where it is damaged."""
    try:
        with opened(file, "rb") as stream:
            return stream.read(HEAD)
    except (EOFError, ValueError, OSError, zlib.error, lzma.LZMAError):
        return b""


def _of_zip(file: Path) -> str:
    """A workbook is a ZIP file too."""
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, ValueError, OSError):
        names = []
    if any(name.startswith(("xl/", "content.xml", "Index/")) for name in names):
        return "a workbook; save the sheet as CSV"
    if not names:
        return "a workbook or an archive; save the sheet as CSV, or unpack it with `unzip`"
    return f"a packed folder; unpack it with `unzip {file.name}`, and name what is in it ({', '.join(names[:3])})"
