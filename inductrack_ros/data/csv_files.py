# SPDX-License-Identifier: Apache-2.0
"""One run out of a CSV as loggers and spreadsheets write it, through pandas."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.state import CHANNELS
from .csv_cells import NOTHING, is_grouped, is_time, number, shown, split
from .csv_header import TIME, known_name
from .csv_layout import INPUT, Column, Layout, find_layout
from .csv_text import read_text
from .csv_times import is_of_day, read_times, whole_nanoseconds
from .measurement import Array, Run
from .order import Place, in_order

#: Further cells that say "not measured", as spreadsheets and people write it.
EMPTY = ("-", "--", "---", "?", "#DIV/0!", "#VALUE!", "#REF!", "#NUM!", "#NAME?")


def read_csv(file: str | Path, name: str | None = None, inputs: Mapping[str, str] | None = None) -> Run:
    """Read one run from a CSV.

    inputs: further columns to be read into `Run.inputs`, by the name they get → the header's text.

    Separators, decimal commas, comments, units in the header, and times as dates are found out; see docs/campaigns.md.
    Columns may stand in any order and are returned in the canonical one. An empty cell, or `nan`, is "not measured".
    What was converted or left out stands in `Run.notes`. Raises InputError, naming file, row (as an editor counts)
    and column, for anything that is not such a file.
    """
    file, notes = Path(file), []
    data = read_text(file, notes)
    layout = find_layout(file, data, dict(inputs or {}), notes)
    table = _Table(file, layout, _body(file, data, layout, notes))
    del data
    stamps, columns = table.read(notes)
    place = Place(f"{file}", lambda i: f"row {table.row(i)}", "row", "correct the times, or make two files of two runs")
    index, said = in_order(stamps, list(columns.values()), place)
    notes += said
    if index is not None:
        stamps, columns = stamps[index], {n: c[index] for n, c in columns.items()}
    if len(stamps) < 2:
        raise InputError(f"{file}: {len(stamps)} row{'' if len(stamps) == 1 else 's'} of data; a run needs at least 2")
    channels = tuple(c for c in CHANNELS if c in columns)
    times = (stamps - stamps[0]) / (1e9 if stamps.dtype.kind == "i" else 1.0)
    return Run(
        name=name if name is not None else file.stem,
        file=file,
        channels=channels,
        times=times,
        values=np.column_stack([columns.pop(c) for c in channels]),
        stamps=stamps,
        seconds_stated=bool(table.time.unit) or stamps.dtype.kind == "i",
        inputs={n.removeprefix(INPUT): (times[~np.isnan(c)], c[~np.isnan(c)]) for n, c in columns.items()},
        notes=tuple(notes),
    )


# ---------------------------------------------------------------- rows


def _body(file: Path, data: bytes, layout: Layout, notes: list[str]) -> bytes:
    """The rows from the first of data on, each with the same number of cells, unquoted; rows that hold nothing are
    empty."""
    body, separator = data[layout.start :], layout.separator.encode()
    if again := len(re.findall(layout.header, body)):
        body = re.sub(layout.header, b"", body)  # a logger that was started again writes its header again
        notes.append(f"{again} more header{'' if again == 1 else 's'} between the rows left out")
    if re.search(rb"(?m)^[ \t]*(#|%|//)", body):
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
    return _complete(file, body, layout, separator, notes) if body.strip() else b""


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
    """Judge the number of cells in each row: all may end with a separator more, the last one may be cut off."""
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
    remedy = "complete the row or delete it"
    if len(wrong) == used.sum() > 1 and (cells[wrong] == cells[first]).all():
        remedy = "as in all rows; name each column in the header"
        if cells[first] >= 2 * layout.cells - 1 and separator == b",":
            remedy = "as in all rows; decimal commas need semicolons between the cells"
    counts = f"{cells[first]} cell{'' if cells[first] == 1 else 's'} where the header names {layout.cells}"
    raise InputError(f"{file}, row {layout.first_row + first}: {counts}; {remedy}")


def _trimmed(body: bytes, rows: NDArray[np.intp], starts: NDArray[np.intp], ends: NDArray[np.intp]) -> bytes:
    """The body with the last byte of some rows taken off."""
    kept = np.ones(len(body), bool)
    kept[ends[rows] - 1] = False
    return np.frombuffer(body, np.uint8)[kept].tobytes()


# ---------------------------------------------------------------- cells


class _Table:
    """The cells of a body that are read, and where each row of them stands in the file."""

    def __init__(self, file: Path, layout: Layout, body: bytes) -> None:
        self.file, self.layout, self.body = file, layout, body
        self.known = {c.name for c in layout.columns} | set(CHANNELS)
        self.time = next(c for c in layout.columns if c.name == TIME)

    def rows(self) -> Iterator[tuple[int, str]]:
        """Row number as an editor shows it, and text, of every row of data."""
        for i, line in enumerate(self.body.split(b"\n")):
            if line:
                yield self.layout.first_row + i, line.decode(errors="replace")

    def row(self, index: int) -> int:
        """The editor's number of a row of the table."""
        return next(number for i, (number, _) in enumerate(self.rows()) if i == index)

    def error(self, index: int, column: Column, message: str) -> InputError:
        return InputError(f"{self.file}, row {self.row(index)}, column '{column.header}': {message}")

    def read(self, notes: list[str]) -> tuple[Array | NDArray[np.int64], dict[str, Array]]:
        """Stamps (n,), s or whole ns, and the columns (n,) by name, SI; NaN where not measured."""
        if not self.body.strip():
            return np.empty(0), {}
        dated = self._first_time()
        frame = self._parsed({self.time.place: str} if dated else {})
        stamps = self._dates(frame[self.time.place], notes) if dated else self._times(frame[self.time.place].to_numpy())
        columns = {}
        for column in self.layout.columns:
            if column.name == TIME:
                continue
            values = frame.pop(column.place).to_numpy(dtype=float)
            if np.isinf(values).any():
                raise self.error(int(np.argmax(np.isinf(values))), column, "infinite; correct it or leave it empty")
            if np.isnan(values).all():
                notes.append(f"column {shown(column.header)} is empty from top to bottom and left out")
            else:
                columns[column.name] = values * column.factor if column.factor != 1.0 else values
        if not set(columns) & set(CHANNELS):
            raise InputError(f"{self.file}: every channel is empty from top to bottom; nothing was measured")
        return stamps, columns

    def _parsed(self, kinds: dict[int, Any]) -> Any:
        """A frame of the wanted columns by their places; exactly says which cell is no number."""
        import pandas as pd  # slow to import: a bag needs none

        separator = "\t" if self.layout.separator == " " else self.layout.separator
        wanted = sorted(c.place for c in self.layout.columns)
        kinds = {place: kinds.get(place, float) for place in wanted}
        exact: dict[str, Any] = {} if int(pd.__version__.partition(".")[0]) >= 3 else {"float_precision": "round_trip"}
        decimal = "." if separator == "," else self.layout.decimal
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return pd.read_csv(
                    io.BytesIO(self.body),
                    sep=separator,
                    decimal=decimal,
                    header=None,
                    names=range(self.layout.cells),
                    usecols=wanted,
                    dtype=kinds,
                    na_values=[
                        write(cell)
                        for cell in (*NOTHING, *EMPTY)
                        for write in (str.lower, str.upper, str.title, _as_computed)
                    ],
                    skip_blank_lines=True,
                    quoting=csv.QUOTE_NONE,
                    engine="c",
                    index_col=False,
                    skipinitialspace=True,
                    encoding_errors="replace",
                    **exact,
                )
        except (ValueError, pd.errors.ParserError, OverflowError) as error:
            self._name_the_cell([c for c in self.layout.columns if kinds[c.place] is float], decimal)
            raise InputError(f"{self.file}: cannot be read as a table ({' '.join(str(error).split())[:160]})") from None

    def _name_the_cell(self, columns: list[Column], decimal: str) -> None:
        """Raise InputError for the first cell that is no number. Slow and exact."""
        empty = {*NOTHING, *(cell.lower() for cell in EMPTY)}
        separator = "\t" if self.layout.separator == " " else self.layout.separator
        for row, line in self.rows():
            cells = line.split(separator)
            for column in columns:
                cell = cells[column.place].strip() if column.place < len(cells) else ""
                if cell.lower() not in empty and number(cell, decimal) is None:
                    place = f"{self.file}, row {row}, column '{column.header}'"
                    if column.name == TIME and sum(known_name(c)[0] in self.known for c in cells) > 1:
                        raise InputError(f"{self.file}, row {row}: another table begins; make a file of each")
                    if is_grouped(cell):
                        remedy = "export the numbers without thousands separators"
                        raise InputError(f"{place}: {shown(cell)} has thousands separators; {remedy}")
                    remedy = "correct it or " + ("delete the row" if column.name == TIME else "leave it empty")
                    sign = " with a decimal comma, as the others are" if number(cell) is not None else ""
                    raise InputError(f"{place}: {shown(cell)} is not a number{sign}; {remedy}")

    # -- time

    def _first_time(self) -> str:
        """The first time where it is a date or a time of day, else nothing."""
        for _, line in self.rows():
            cells = split(line, "\t" if self.layout.separator == " " else self.layout.separator)
            cell = cells[self.time.place] if self.time.place < len(cells) else ""
            return cell if is_time(cell) and not is_grouped(cell) else ""
        return ""

    def _times(self, times: Array) -> Array:
        if np.isnan(times).any():
            raise InputError(
                f"{self.file}, row {self.row(int(np.argmax(np.isnan(times))))}: no time; fill it in or delete the row"
            )
        if np.isinf(times).any():
            raise self.error(int(np.argmax(np.isinf(times))), self.time, "infinite; correct it or leave it empty")
        return times * self.time.factor if self.time.factor != 1.0 else times

    def _dates(self, cells: Any, notes: list[str]) -> NDArray[np.int64]:
        """Whole ns of dates (since 1970) or times of day."""
        text = cells.fillna("").str.strip()
        first = text.iloc[0]
        times = read_times(text)
        if times.isna().any():
            i = int(times.isna().to_numpy().argmax())
            if not text.iloc[i]:
                raise InputError(f"{self.file}, row {self.row(i)}: no time; fill it in or delete the row")
            if i == 0:
                remedy = "write it as 2026-01-31T10:00:00.5, or in seconds"
                raise self.error(i, self.time, f"{shown(first)} is no time that is read; {remedy}")
            remedy = "correct it or delete the row"
            raise self.error(i, self.time, f"{shown(text.iloc[i])} is no time like {shown(first)}; {remedy}")
        stamps, passed_midnight = whole_nanoseconds(times, of_day=is_of_day(first))
        if passed_midnight:
            notes.append("the times of day pass midnight: 24 h added to the later ones")
        return stamps


def _as_computed(cell: str) -> str:
    """No number, no time, as programs write them."""
    return cell.replace("nan", "NaN").replace("nat", "NaT")
