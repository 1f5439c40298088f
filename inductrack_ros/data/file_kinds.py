# SPDX-License-Identifier: Apache-2.0
"""What a file is that is neither the table nor the bag that was asked for, by its first bytes."""

from __future__ import annotations

_KINDS = (
    (b"PK\x03\x04", "a workbook or an archive; save the sheet as CSV"),
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


def kind_of(head: bytes) -> str:
    """What a file is that begins so, and what to do with it; empty where that is not known."""
    text = head.lstrip()
    return next((what for magic, what in _KINDS if head.startswith(magic) or text.startswith(magic)), "")
