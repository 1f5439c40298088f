# SPDX-License-Identifier: Apache-2.0
"""The rows of data of a CSV: each with the same number of cells, unquoted, without what stands between and behind
them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .csv_cells import is_time, number, shown, split
from .csv_header import TIME
from .csv_layout import Layout

#: Rows behind the data that are looked at.
TAIL = 40
#: What a spreadsheet or a logger calls the rows behind its data.
SUMMARIES = (
    "mean average avg mittelwert mittel moyenne media promedio gemiddelde std stdev stddev stdabw standard"
    " standardabweichung ecart sd sigma var variance varianz rms rmse min minimum max maximum median sum summe somme"
    " suma total count anzahl n range peak end ende eof"
).split()


def rows_of_data(file: Path, data: bytes, layout: Layout, notes: list[str]) -> bytes:
    """The rows from the first of data on, each with the same number of cells, unquoted; rows that hold nothing are
    empty."""
    body, separator = data[layout.start :], layout.separator.encode()
    if again := len(re.findall(layout.header, body)):
        body = re.sub(layout.header, b"", body)  # a logger that was started again writes its header again
        notes.append(f"{again} more header{'' if again == 1 else 's'} between the rows left out")
    if re.search(rb"(?m)^[ \t]*(#|%|//)", body):
        said = [line.count(separator) == layout.cells - 1 for line in re.findall(rb"(?m)^[ \t]*(?:#|%|//).*$", body)]
        if separator != b" " and (rows := sum(said)):
            some = "1 row that begins" if rows == 1 else f"{rows} rows that begin"
            notes.append(f"{some} like a comment, with as many cells as the others, left out")
        body = re.sub(rb"(?m)^[ \t]*(#|%|//).*$", b"", body)
    if separator == b" ":
        body = _without_blanks(body.replace(b"\t", b" ")).replace(b" ", b"\t")
        separator = b"\t"
    elif b" " in body:
        body = _without_blanks(body, separator)
    if b'"' in body:
        body = _unquoted(file, body, layout, separator)
    if re.search(rb"(?m)^[\s" + re.escape(separator) + rb"]*$", body):
        body = re.sub(rb"(?m)^[ \t\v\f" + re.escape(separator) + rb"]+$", b"", body)
    body = _without_tail(body, layout, notes)
    return _complete(file, body, layout, separator, notes) if body.strip() else b""


def _without_tail(body: bytes, layout: Layout, notes: list[str]) -> bytes:
    """The body without the rows behind the data: words where a time should stand, and nothing measured, or a
    summary."""
    time = next(c.place for c in layout.columns if c.name == TIME)
    separator = "\t" if layout.separator == " " else layout.separator
    used = {c.place for c in layout.columns}
    left: list[str] = []
    end = len(body)
    for _ in range(TAIL):
        whole = body[:end].rstrip(b"\n")
        start = whole.rfind(b"\n") + 1
        line = whole[start:].decode(errors="replace")
        cells = split(line, separator)
        cell = cells[time] if time < len(cells) else ""
        name = _summary(cells, used) if start else ""
        if name and _no_later(cell, body[:start], time, separator, layout.decimal, used):
            left.append(name)
            end = start
            continue
        if not start or number(cell, layout.decimal) is not None or number(cell) is not None or is_time(cell):
            break
        words = [c for c in cells if re.search(r"[^\W\d]", c)]
        first = re.search(r"[^\W\d_]+", words[0]) if words else None
        summary = first is not None and first[0].lower() in SUMMARIES
        if not words or not summary and (len(cells) == layout.cells or any(number(c) is not None for c in cells)):
            break
        left.append(next(c for c in cells if c))
        end = start
    if not left:
        return body
    said = ", ".join(shown(cell) for cell in left[:-4:-1])
    notes.append(f"{len(left)} row{'' if len(left) == 1 else 's'} behind the data left out: {said}")
    return body[:end]


def _summary(cells: list[str], used: set[int]) -> str:
    """What a row of numbers is called in a column that is not read, where that is a summary's name; else nothing."""
    words = [c for i, c in enumerate(cells) if i not in used and re.search(r"[^\W\d]", c)]
    first = re.match(r"[^\W\d_]+", words[0]) if len(words) == 1 else None
    return words[0] if first and first[0].lower() in SUMMARIES else ""


def _no_later(cell: str, above: bytes, time: int, separator: str, decimal: str, used: set[int]) -> bool:
    """Whether the time in a row is a number no later than that of the nearest row above it that is no summary."""
    here, there = number(cell, decimal), None
    for _ in range(TAIL):
        above, _, line = above.rstrip(b"\n").rpartition(b"\n")
        cells = split(line.decode(errors="replace"), separator)
        if not _summary(cells, used):
            there = number(cells[time], decimal) if time < len(cells) else None
            break
    return here is not None and there is not None and here <= there


def _without_blanks(body: bytes, separator: bytes = b"") -> bytes:
    """One blank for many, and none at the ends of rows and beside separators. Replacing is fast and takes little
    memory."""
    while b"  " in body:
        body = body.replace(b"  ", b" ")
    for end in (b"\n", separator):
        if end:
            body = body.replace(end + b" ", end).replace(b" " + end, end)
    return body.removeprefix(b" ")


def _unquoted(file: Path, body: bytes, layout: Layout, separator: bytes) -> bytes:
    """Cells without their quotes; a separator inside quotes is a decimal comma or part of a text, which is not read."""
    text = np.frombuffer(body, np.uint8)
    quotes = np.flatnonzero(text == ord('"'))
    inside = np.searchsorted(quotes, np.flatnonzero((text == separator[0]) | (text == ord("\n")))) % 2
    if not inside.any():
        return body.replace(b'"', b"")
    rows = []
    for i, line in enumerate(body.split(b"\n")):
        if line.count(b'"') % 2:
            raise InputError(f"{file}, row {layout.first_row + i}: a quote that is not closed; close it or delete it")
        if b'"' in line:
            cells = re.split(rb'("[^"]*")', line)
            inner = b"." if layout.decimal == "," and separator == b"," else b" "
            line = b"".join(c.strip(b'"').replace(separator, inner) if c.startswith(b'"') else c for c in cells)
        rows.append(line)
    return b"\n".join(rows)


def _complete(file: Path, body: bytes, layout: Layout, separator: bytes, notes: list[str]) -> bytes:
    """Judge the number of cells in each row: all may end with a separator more, the last one may be cut off, the last
    cell may be missing where nothing is read from it."""
    text = np.frombuffer(body, np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    starts = np.concatenate([[0], ends[:-1] + 1])
    before = np.searchsorted(np.flatnonzero(text == separator[0]), [starts, ends])
    cells, used = before[1] - before[0] + 1, ends > starts
    wrong = np.flatnonzero(used & (cells != layout.cells))
    if len(wrong) and (cells[wrong] == layout.cells + 1).all() and (text[ends[wrong] - 1] == separator[0]).all():
        return (
            re.sub(rb"(?m)" + re.escape(separator) + rb"$", b"", body)
            if len(wrong) == used.sum()
            else _trimmed(body, wrong, starts, ends)
        )
    if not len(wrong):
        return body
    first, last = int(wrong[0]), int(np.flatnonzero(used)[-1])
    if first == last and cells[first] < layout.cells and used.sum() > 2:
        notes.append(f"the last row ({layout.first_row + first}) is cut off and left out")
        return body[: starts[first]]
    if _lacks_the_last(body, layout, separator):
        rows = "any row holds" if len(wrong) == used.sum() else "most rows hold"
        notes.append(f"the header names one column more than {rows}: the last one, {shown(layout.last)}, is left out")
        short = layout.cells - 2
        return b"\n".join(
            row + separator if row and row.count(separator) == short else row for row in body.split(b"\n")
        )
    remedy = "complete the row or delete it"
    if len(wrong) == used.sum() > 1 and (cells[wrong] == cells[first]).all():
        few = cells[first] < layout.cells
        remedy = "as in all rows; " + ("delete names that no column has" if few else "name each column in the header")
        if cells[first] >= 2 * layout.cells - 1 and separator == b",":
            remedy = "as in all rows; decimal commas need semicolons between the cells"
    counts = f"{cells[first]} cell{'' if cells[first] == 1 else 's'} where the header names {layout.cells}"
    raise InputError(f"{file}, row {layout.first_row + first}: {counts}; {remedy}")


def _lacks_the_last(body: bytes, layout: Layout, separator: bytes) -> bool:
    """Whether rows are a cell short because the last one, which is not read, is not written where it is empty: the
    `Comment` of LabVIEW. Where other rows have a number there, a short one may have lost any of its cells."""
    if any(column.place == layout.cells - 1 for column in layout.columns):
        return False
    rows = [row for row in body.split(b"\n") if row]
    missing = {layout.cells - 1 - row.count(separator) for row in rows}
    ends = (row.rpartition(separator)[2] for row in rows if row.count(separator) == layout.cells - 1)
    return missing <= {0, 1} and all(number(end.decode(errors="replace")) is None for end in ends)


def _trimmed(body: bytes, rows: NDArray[np.intp], starts: NDArray[np.intp], ends: NDArray[np.intp]) -> bytes:
    """The body with the last byte of some rows taken off."""
    kept = np.ones(len(body), bool)
    kept[ends[rows] - 1] = False
    return np.frombuffer(body, np.uint8)[kept].tobytes()
