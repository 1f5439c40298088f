# SPDX-License-Identifier: Apache-2.0
"""Where the table of a CSV begins, how its cells are separated, and what its columns are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import InputError, did_you_mean
from ..core.state import CHANNELS
from .csv_cells import SEPARATORS, decimal_sign, number, shown, split
from .csv_header import TIME, Header, find_header, known_name, parts, plain, rows_below
from .units import SI, any_factor, factor

#: Before the name of a column that is read for the model's sake, not as a channel.
INPUT = "input:"
#: What stands in a time's header like a unit and says how its dates are written, or where their clock is.
_DATED = re.compile(r"(utc|gmt|local|iso).*|.*(hh?\W?mm|yyyy).*", re.IGNORECASE)
#: Bytes by which the decimal sign is told.
SAMPLE = 20_000
_CALLED = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "blanks"}


@dataclass(frozen=True)
class Column:
    """A column of the file that is read: its place, the name it is read under, its header's text, the factor to SI."""

    place: int
    name: str
    header: str
    factor: float = 1.0
    unit: str = ""


@dataclass(frozen=True)
class Layout:
    """A table: separator, decimal sign, number of cells in a row, the columns that are read, and the row (from 1) where
    data begin."""

    separator: str
    decimal: str
    cells: int
    last: str  # what the header calls the last of them
    columns: tuple[Column, ...]
    first_row: int
    start: int  # byte at which that row begins
    header: re.Pattern[bytes]  # the header's line, should it stand among the data again


def find_layout(file: Path, data: bytes, inputs: dict[str, str], notes: list[str]) -> Layout:
    """Find the header and judge its columns. ``inputs``: other columns to be read, by name → header's text.

    What is left out or converted is added to ``notes``. Raises InputError naming row, column and remedy.
    """
    header = find_header(file, data, inputs, notes)
    row, units, start = rows_below(data, header, notes)
    first = next(
        (line.decode(errors="replace") for line in data[start : start + SAMPLE].split(b"\n") if line.strip()), ""
    )
    separator = _of_the_rows(header, first, notes)
    names = _without_empty_end(header, len(split(first, separator)))
    columns = _judge(f"{file}, row {header.row}", names, units, inputs, notes)
    decimal = _decimal(file, row, data, start, separator)
    again = re.compile(rb"(?mi)^" + re.escape(header.text.strip().encode()) + rb"[ \t\r]*$")
    return Layout(separator, decimal, len(names), names[-1], columns, row, start, again)


def _of_the_rows(header: Header, first: str, notes: list[str]) -> str:
    """The separator of the rows, of which ``first`` is the first: the header's, but where that leaves one cell and
    another as many as there are names."""
    if len(header.names) < 2 or len(split(first, header.separator)) != 1:
        return header.separator
    for separator in SEPARATORS:
        if len(split(first, separator)) == len(header.names):
            notes.append(f"the rows are separated by {_CALLED[separator]}, the header by {_CALLED[header.separator]}")
            return separator
    return header.separator


def _without_empty_end(header: Header, cells: int) -> list[str]:
    """The header's names; nameless ones at its end only where the first row has ``cells`` for them."""
    names = list(header.names)
    while len(names) > max(cells, 1) and not names[-1]:
        names.pop()
    return names


# ---------------------------------------------------------------- the columns


def _judge(
    where: str, names: list[str], units: list[str], inputs: dict[str, str], notes: list[str]
) -> tuple[Column, ...]:
    """The columns that are read, of a header that stands at ``where``."""
    columns: dict[str, Column] = {}
    left: list[tuple[int, str]] = []
    wanted = {text: name for name, text in inputs.items()}
    exact = {name for name in names if name in SI}
    for place, header in enumerate(names):
        name, unit = known_name(header)
        unit = unit or (units[place] if place < len(units) else "")
        if name == TIME and _DATED.fullmatch(unit):
            unit = ""
        asked = header if header in wanted else parts(header)[0]
        if asked in wanted:
            unit = unit or parts(header)[1]
            scale = any_factor(unit) or 1.0
            name = INPUT + wanted.pop(asked)
            columns[name] = Column(place, name, header, scale, unit)
            if (channel := known_name(header)[0]) in CHANNELS:
                as_input = f"is read as the input {name.removeprefix(INPUT)}"
                notes.append(f"column {shown(header)} {as_input}, not as the channel {channel}")
        elif name not in (TIME, *CHANNELS) or header != name and name in exact:
            left.append((place, header))
        elif name in columns:
            raise InputError(
                f"{where}: two columns hold {name}, {shown(columns[name].header)} and {shown(header)}; keep one"
            )
        else:
            columns[name] = Column(place, name, header, _factor(where, name, unit), unit)
    for text in wanted:
        raise InputError(
            f"{where}: no column {shown(text)}, which inputs: in campaign.yaml asks for{did_you_mean(text, names)}"
        )
    _typing_errors(where, [h for _, h in left], columns)
    if TIME not in columns:
        blanks = "; columns must be separated by commas, semicolons, tabs or blanks" if len(names) == 1 else ""
        meant = f"name the column that holds it so ({_there_are(names)})" if len(names) > 1 else "add it"
        if whole := next((n for n in names if re.search(r"(?i)(^|[._ /])secs?(onds)?$", n)), ""):
            if part := next((n for n in names if re.search(r"(?i)n(ano)?secs?(onds)?$", n)), ""):
                meant = f"it stands in two columns: write {shown(whole)} + 1e-9 × {shown(part)} as one"
        if names and 2 * sum(number(n) is not None for n in names) > len(names):
            raise InputError(f"{where}: holds numbers and no names; put a row above it that names the columns: time, …")
        raise InputError(f"{where}: column '{TIME}' is missing, the time of each row in seconds; {meant}{blanks}")
    if len(columns) == 1:
        raise InputError(
            f"{where}: no channel beside '{TIME}' ({_there_are(names)}); name those that are channels so:"
            f" {', '.join(CHANNELS)}"
        )
    said = [
        shown(header) if header else f"the nameless one ({place + 1})"
        for place, header in left
        if header or place < len(names) - 1
    ]
    if said:
        more = f" and {len(said) - 6} more" if len(said) > 6 else ""
        notes.append(f"column{'' if len(said) == 1 else 's'} left out: {', '.join(said[:6])}{more}")
    if converted := [f"{c.name.removeprefix(INPUT)} from {c.unit}" for c in columns.values() if c.factor != 1.0]:
        notes.append(f"converted to SI: {', '.join(converted)}")
    return tuple(columns.values())


def _there_are(names: list[str]) -> str:
    """What a header names, for a message."""
    named = [shown(name) for name in names if name]
    return f"there are {'; '.join(named[:6])}{f' and {len(named) - 6} more' if len(named) > 6 else ''}"


def _factor(where: str, name: str, unit: str) -> float:
    if not unit or unit in ("-", "1"):
        return 1.0
    value = factor(unit, SI[name])
    if value is None:
        raise InputError(
            f"{where}: column '{name}' is in {shown(unit)}, which is no unit known for it; convert it to {SI[name]}"
        )
    return value


def _typing_errors(where: str, left: list[str], columns: dict[str, Column]) -> None:
    """A column that is left out for one wrong letter would be missed."""
    for header in left:
        near = did_you_mean(plain(header), [c for c in (TIME, *CHANNELS) if c not in columns])
        meant = re.fullmatch(r"; did you mean '(.*)'\?", near)
        if meant and _mistyped(plain(header), meant[1]):
            raise InputError(f"{where}: unknown column {shown(header)}{near}")


def _mistyped(a: str, b: str) -> bool:
    """Whether one letter too many, too few or wrong, or two neighbours exchanged, make one word the other."""
    if len(a) == len(b):
        off = [i for i, (x, y) in enumerate(zip(a, b, strict=True)) if x != y]
        return len(off) == 1 or (
            len(off) == 2 and off[1] == off[0] + 1 and a[off[0]] + a[off[1]] == b[off[1]] + b[off[0]]
        )
    short, long = sorted((a, b), key=len)
    return any(long[:i] + long[i + 1 :] == short for i in range(len(long)))


def _decimal(file: Path, row: int, data: bytes, start: int, separator: str) -> str:
    """The decimal sign of a table: by its first rows, or by the first that hold one."""
    sample = data[start : start + SAMPLE]
    mark = b'"' if separator == "," else b","
    if mark not in sample and b"." not in sample and (at := data.find(mark, start)) >= 0:
        begin = max(data.rfind(b"\n", start, at) + 1, start)
        row += data.count(b"\n", start, begin)
        sample = data[begin : begin + SAMPLE]
    return decimal_sign(file, row, sample.decode(errors="replace"), separator)
