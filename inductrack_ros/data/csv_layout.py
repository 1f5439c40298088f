# SPDX-License-Identifier: Apache-2.0
"""Where the table of a CSV begins, how its cells are separated, and what its columns are."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..core.errors import InputError, did_you_mean
from ..core.state import CHANNELS
from .units import SI, any_factor, factor

TIME = "time"
#: Before the name of a column that is read for the model's sake, not as a channel.
INPUT = "input:"
#: Other names of the time.
_TIME_NAMES = ("t", "timestamp", "time_stamp", "stamp", "zeit", "temps")
#: Rows in which the header is looked for.
HEAD = 200
#: Between cells, the likelier first; a blank stands for any number of blanks and tabs.
SEPARATORS = (",", ";", "\t", "|", " ")
COMMENT = re.compile(r"\s*(#|%|//)")


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
    columns: tuple[Column, ...]
    first_row: int
    start: int  # byte at which that row begins
    header: re.Pattern[bytes]  # the header's line, should it stand among the data again


def find_layout(file: Path, data: bytes, inputs: dict[str, str], notes: list[str]) -> Layout:
    """Find the header and judge its columns. ``inputs``: other columns to be read, by name → header's text.

    What is left out or converted is added to ``notes``. Raises InputError naming row, column and remedy.
    """
    row, text, separator, start = _header(file, data, inputs, notes)
    names = split(text, separator)
    body_row, units, body_start = _units_row(data, row + 1, start, separator)
    columns = _judge(file, row, names, units, inputs, notes)
    decimal = decimal_sign(data[body_start : body_start + 20_000].decode(errors="replace"), separator)
    again = re.compile(rb"(?m)^" + re.escape(text.strip().encode()) + rb"[ \t\r]*$")
    return Layout(separator, decimal, len(names), columns, body_row, body_start, again)


def split(line: str, separator: str) -> list[str]:
    """Cells of one row, without blanks and quotes around them."""
    if separator == " ":
        line, separator = re.sub(r"[ \t]+", "\t", line.strip()), "\t"
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


# ---------------------------------------------------------------- the header


def _lines(data: bytes) -> Iterator[tuple[int, str, int]]:
    """Row number, text and the byte behind it, of the first rows."""
    at = 0
    for row in range(1, HEAD + 1):
        end = data.find(b"\n", at)
        if end < 0:
            return
        yield row, data[at:end].decode(errors="replace"), end + 1
        at = end + 1


def _header(file: Path, data: bytes, inputs: dict[str, str], notes: list[str]) -> tuple[int, str, str, int]:
    """Row, text and separator of the header, and the byte behind it."""
    stated, skipped, comment, first = "", 0, None, None
    for row, text, end in _lines(data):
        if not text.strip():
            continue
        if match := re.fullmatch(r'"?sep=(.)"?', text.strip(), re.IGNORECASE) or re.fullmatch(
            r'"?sep=(\t)"?', text, re.IGNORECASE
        ):
            stated = match[1]
            continue
        if COMMENT.match(text):
            comment = row, COMMENT.sub("", text, count=1), end
            continue
        separator = stated or _separator(text, inputs)
        names = split(text, separator)
        if _says(names, inputs) >= 2 or (first is None and TIME in [_base(n)[0] for n in names]):
            if skipped:
                notes.append(f"{skipped} row{'' if skipped == 1 else 's'} before the header left out")
            return row, text, separator, end
        if first is None:
            first = row, text, separator, end
            if all(number(cell) is not None for cell in names if cell):
                if comment is not None and _says(split(comment[1], _separator(comment[1], inputs)), inputs) >= 2:
                    return comment[0], comment[1], stated or _separator(comment[1], inputs), comment[2]
                raise InputError(
                    f"{file}, row {row}: no header; the first row must name the columns, e.g. time,surge,heave"
                )
        skipped += 1
    if first is None:
        raise InputError(f"{file}: no table; it needs a header with 'time' and channels, and at least 2 rows")
    return first


def _separator(text: str, inputs: dict[str, str]) -> str:
    """What separates the cells of a header: that by which it says most."""
    return max(SEPARATORS, key=lambda s: (_says(split(text, s), inputs), len(split(text, s)) > 1, -SEPARATORS.index(s)))


def _says(names: list[str], inputs: dict[str, str]) -> int:
    """How many names of a row are known."""
    return sum(_base(name)[0] in SI or {name, parts(name)[0]} & set(inputs.values()) != set() for name in names)


def _base(header: str) -> tuple[str, str]:
    """Known name of a column and its unit, out of `heave [mm]`, `Time (ms)`, `roll/deg`, `surge_mm`; the text itself
    where not known."""
    text = header.strip()
    name, unit = parts(text)
    if _plain(name) in SI:
        return _plain(name), unit
    name = _plain(text)
    if name in SI:
        return name, ""
    for known in sorted(SI, key=len, reverse=True):
        unit = name.removeprefix(f"{known}_")
        if unit != name and factor(unit, SI[known]) is not None:
            return known, unit
    for known in _TIME_NAMES:
        unit = name.removeprefix(f"{known}_")
        if unit != name and factor(unit, "s") is not None:
            return TIME, unit
    return text, ""


def parts(header: str) -> tuple[str, str]:
    """Name and unit of `heave [mm]`, `Time (ms)`, `roll/deg`, `heave in mm`."""
    match = re.fullmatch(r"(.*?)\s*(?:\[(.*)\]|\((.*)\)|\{(.*)\}|<(.*)>|/\s*([^/\s].*)|,\s*(.+)|\s+in\s+(\S+))", header)
    if match is None:
        return header, ""
    return match[1], next((g for g in match.groups()[1:] if g is not None), "").strip("()[] ")


def _plain(name: str) -> str:
    """A name in our spelling: `Surge Rate` → `surge_rate`."""
    name = re.sub(r"[\s\-]+", "_", name.strip().strip("\"'").lower())
    return TIME if name in _TIME_NAMES else name


def _units_row(data: bytes, row: int, start: int, separator: str) -> tuple[int, list[str], int]:
    """The row where data begin, the units in a row of their own (or none), and the byte of that first row."""
    end = data.find(b"\n", start)
    text = data[start : max(end, start)].decode(errors="replace")
    cells = split(text, separator) if text.strip() else []
    bare = [cell.strip("[](){}<> ") for cell in cells]
    known = [any_factor(unit) is not None for unit in bare if unit not in ("", "-", "1")]
    if known and any(known) and all(number(cell) is None for cell in cells if cell):
        return row + 1, bare, end + 1
    return row, [], start


# ---------------------------------------------------------------- the columns


def _judge(
    file: Path, row: int, names: list[str], units: list[str], inputs: dict[str, str], notes: list[str]
) -> tuple[Column, ...]:
    """The columns that are read."""
    where, columns, left = f"{file}, row {row}", {}, []
    wanted = {text: name for name, text in inputs.items()}
    exact = {name for name in names if name in SI}
    for place, header in enumerate(names):
        name, unit = _base(header)
        unit = unit or (units[place] if place < len(units) else "")
        asked = header if header in wanted else parts(header)[0]
        if asked in wanted:
            unit = unit or parts(header)[1]
            scale = any_factor(unit) or 1.0
            name = INPUT + wanted.pop(asked)
            columns[name] = Column(place, name, header, scale, unit)
        elif name not in (TIME, *CHANNELS) or header != name and name in exact:
            left.append((place, header))
        elif name in columns:
            raise InputError(f"{where}: column '{name}' stands there twice; delete one")
        else:
            columns[name] = Column(place, name, header, _factor(where, name, unit), unit)
    for text in wanted:
        raise InputError(
            f"{where}: no column {shown(text)}, which inputs: in campaign.yaml asks for{did_you_mean(text, names)}"
        )
    _typing_errors(where, [h for _, h in left], columns)
    if TIME not in columns:
        blanks = "; columns must be separated by commas, semicolons, tabs or blanks" if len(names) == 1 else ""
        raise InputError(f"{where}: column '{TIME}' is missing; add the time of each row in seconds{blanks}")
    if len(columns) == 1:
        raise InputError(f"{where}: no channel beside '{TIME}'; add at least one of {', '.join(CHANNELS)}")
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
        near = did_you_mean(_plain(header), [c for c in (TIME, *CHANNELS) if c not in columns])
        meant = re.fullmatch(r"; did you mean '(.*)'\?", near)
        if meant and _distance(_plain(header), meant[1]) <= (1 if len(meant[1]) < 8 else 2):
            raise InputError(f"{where}: unknown column {shown(header)}{near}")


def _distance(a: str, b: str) -> int:
    """Letters to be put in, taken out or exchanged to make one word the other."""
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        above, row[0] = row[0], i
        for j, y in enumerate(b, 1):
            above, row[j] = row[j], min(row[j] + 1, row[j - 1] + 1, above + (x != y))
    return row[-1]


# ---------------------------------------------------------------- cells


def decimal_sign(sample: str, separator: str) -> str:
    """The decimal sign in the first rows."""
    if separator == ",":
        return "," if re.search(r'"[+-]?\d*,\d+([eE][+-]?\d+)?"', sample) else "."
    return "," if re.search(r"(^|[^\d.])[+-]?\d*,\d", sample) else "."


def number(cell: str, decimal: str = ".") -> float | None:
    """A cell's number; None where it is none. An underscore and foreign digits make none, as for pandas."""
    if re.fullmatch(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", cell.replace(decimal, "."), re.ASCII):
        return float(cell.replace(decimal, "."))
    return {"nan": float("nan"), "inf": float("inf")}.get(cell.strip().lower().lstrip("+-"))


def shown(text: str) -> str:
    """A cell as it stands in one line of a message."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
