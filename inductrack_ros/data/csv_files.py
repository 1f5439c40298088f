# SPDX-License-Identifier: Apache-2.0
"""One run out of a CSV as loggers and spreadsheets write it, through pandas."""

from __future__ import annotations

import contextlib
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
from .csv_cells import NO_READING, NOTHING, is_grouped, is_time, number, shown, split
from .csv_counted import counted
from .csv_header import TIME, known_name
from .csv_layout import INPUT, Column, Layout, find_layout
from .csv_rows import rows_of_data
from .csv_text import read_text
from .csv_times import NO_ROOM, is_of_day, nanoseconds, needs_integers, read_times, unwrapped, whole_nanoseconds
from .measurement import Array, Run
from .order import Place, in_order

_NUMBERS = b"0123456789+-.,;|\t\n\r eEnNaA"
_NO_READING = re.compile(rb"(?i)\b(?:" + b"|".join(w.encode() for w in NO_READING if w[0] not in "*#") + rb")\b|[*#]")
#: Further cells that say "not measured", as people write it.
EMPTY = ("-", "--", "---", "?")


def _remedy(cell: str, column: Column, decimal: str) -> str:
    """What to do about a cell that is no number."""
    if number(re.sub("[dD]", "e", cell), decimal) is not None:
        return "write its exponent with E"
    below = re.fullmatch(r"\(([^-]+)\)|([^-]+)-", cell)
    if below and number(below[1] or below[2], decimal) is not None:
        return f"write it as -{below[1] or below[2]}"
    with_unit = re.fullmatch(r"([-+0-9.,eE]*\d)\s*([^\W\d_]\S*|[%°])", cell)
    if with_unit and number(with_unit[1], decimal) is not None:
        name = column.name if column.name in CHANNELS or column.name == TIME else column.header
        return f"write the unit into the header, '{name} [{with_unit[2]}]', and only numbers below"
    return "correct it or " + ("delete the row" if column.name == TIME else "leave it empty")


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
    table = _Table(file, layout, data[: layout.start], rows_of_data(file, data, layout, notes))
    del data
    stamps, columns = table.read(notes)
    numbers = table.numbers()
    place = Place(f"{file}", lambda i: f"row {table.row(i)}", "row", "correct the times, or make two files of two runs")
    index, said = in_order(stamps, list(columns.values()), place)
    notes += said
    if index is not None:
        stamps, columns = stamps[index], {n: c[index] for n, c in columns.items()}
        numbers = numbers[index]
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
        numbers=numbers,
        seconds_stated=bool(table.time.unit) or table.dated or table.counted,
        converted={c.name: c.unit for c in layout.columns if c.name in channels and c.factor != 1.0},
        inputs={n.removeprefix(INPUT): (times[~np.isnan(c)], c[~np.isnan(c)]) for n, c in columns.items()},
        notes=tuple(notes),
    )


# ---------------------------------------------------------------- cells


class _Table:
    """The cells of a body that are read, and where each row of them stands in the file."""

    def __init__(self, file: Path, layout: Layout, above: bytes, body: bytes) -> None:
        self.file, self.layout, self.above, self.body = file, layout, above, body
        self.known = {c.name for c in layout.columns} | set(CHANNELS)
        self.time = next(c for c in layout.columns if c.name == TIME)
        self.first = self._first_time()
        self.dated = is_time(self.first) and not is_grouped(self.first)
        self.counted = False

    def rows(self) -> Iterator[tuple[int, str]]:
        """Row number as an editor shows it, and text, of every row of data."""
        for i, line in enumerate(self.body.split(b"\n")):
            if line:
                yield self.layout.first_row + i, line.decode(errors="replace")

    def row(self, index: int) -> int:
        """The editor's number of a row of the table."""
        return next(number for i, (number, _) in enumerate(self.rows()) if i == index)

    def numbers(self) -> NDArray[np.int32]:
        """(n,) The editor's number of every row of the table."""
        ends = np.flatnonzero(np.frombuffer(self.body + b"\n", np.uint8) == ord("\n"))
        return (np.flatnonzero(np.diff(ends, prepend=-1) > 1) + self.layout.first_row).astype(np.int32)

    def error(self, index: int, column: Column, message: str) -> InputError:
        return InputError(f"{self.file}, row {self.row(index)}, column '{column.header}': {message}")

    def read(self, notes: list[str]) -> tuple[Array | NDArray[np.int64], dict[str, Array]]:
        """Stamps (n,), s or whole ns, and the columns (n,) by name, SI; NaN where not measured."""
        if not self.body.strip():
            return np.empty(0), {}
        exact = not self.dated and needs_integers(self.first, self.layout.decimal, self.time.factor)
        frame = self._with_integers() if exact else self._parsed({self.time.place: str} if self.dated else {})
        times = frame.pop(self.time.place)
        if self.dated:
            stamps = self._dates(times, notes)
        elif times.isna().all():
            self.counted = True
            stamps = counted(self.file, self.above, self.layout, self.numbers(), notes)
        else:
            stamps, said = unwrapped(self._times(self._whole(times) if exact else times.to_numpy()))
            notes += said
        columns, missing = {}, False
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
            missing |= bool(np.isnan(values).any())
        if missing:
            self._say_no_reading(notes)
        if not set(columns) & set(CHANNELS):
            raise InputError(f"{self.file}: every channel is empty from top to bottom; nothing was measured")
        return stamps, columns

    def _with_integers(self) -> Any:
        """The frame with its times as whole numbers where they are that, else as text."""
        if self.first.isdigit():
            with contextlib.suppress(InputError):  # of a time that is none, or of another cell: said below
                return self._parsed({self.time.place: np.int64})
        return self._parsed({self.time.place: str})

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
                        for cell in (*NOTHING, *EMPTY, *NO_READING)
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

    def _say_no_reading(self, notes: list[str]) -> None:
        """Cells by which an instrument says that there is no reading, for each column."""
        if not self.body.translate(None, _NUMBERS) or not _NO_READING.search(self.body):
            return
        separator = "\t" if self.layout.separator == " " else self.layout.separator
        said: dict[int, list[tuple[int, str]]] = {}
        for row, line in self.rows():
            if _NO_READING.search(line.encode()):
                cells = [cell.strip() for cell in line.split(separator)]
                for place, cell in enumerate(cells):
                    if cell.lower() in NO_READING:
                        said.setdefault(place, []).append((row, cell))
        for column in self.layout.columns:
            if found := said.get(column.place):
                row, cell = found[0]
                cells = "1 cell" if len(found) == 1 else f"{len(found)} cells"
                notes.append(f"{cells} of {shown(column.header)} without a reading, as {shown(cell)} in row {row}")

    def _name_the_cell(self, columns: list[Column], decimal: str) -> None:
        """Raise InputError for the first cell that is no number. Slow and exact."""
        empty = {*NOTHING, *NO_READING, *(cell.lower() for cell in EMPTY)}
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
                    remedy = _remedy(cell, column, decimal)
                    sign = " with a decimal comma, as the others are" if number(cell) is not None else ""
                    raise InputError(f"{place}: {shown(cell)} is not a number{sign}; {remedy}")

    # -- time

    def _first_time(self) -> str:
        """The cell of the first time; nothing where there are no rows."""
        for _, line in self.rows():
            cells = split(line, "\t" if self.layout.separator == " " else self.layout.separator)
            return cells[self.time.place] if self.time.place < len(cells) else ""
        return ""

    def _whole(self, cells: Any) -> Array | NDArray[np.int64]:
        """Times as whole ns; as numbers where a cell is empty or infinite, which is said of these."""
        if cells.dtype.kind == "i":
            unit = round(1e9 * self.time.factor)
            if np.abs(cells).max() < NO_ROOM * 1e9 / unit:
                return cells.to_numpy() * unit
            cells = cells.astype(str)
        separator = "\t" if self.layout.separator == " " else self.layout.separator
        decimal = "." if separator == "," else self.layout.decimal
        text = cells.str.strip().to_list()
        whole = [nanoseconds(c, decimal, self.time.factor) if isinstance(c, str) else None for c in text]
        if None in whole:
            numbers = [number(c, decimal) if isinstance(c, str) else float("nan") for c in text]
            if None in numbers:
                self._name_the_cell([self.time], decimal)
            return np.array(numbers, np.float64)
        return np.array(whole, np.int64)

    def _times(self, times: NDArray[Any]) -> NDArray[Any]:
        """Times (n,) in s; whole ns as they are. Raises InputError where one is missing or infinite."""
        if times.dtype.kind == "i":
            return times
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
