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
_TIME_NAMES = (
    "t timestamp time_stamp stamp zeit temps datetime date_time elapsed elapsed_time relative_time rel_time seconds"
).split()
#: What stands in a time's header like a unit and says how its dates are written, or where their clock is.
_DATED = re.compile(r"(utc|gmt|local|iso).*|.*(hh?\W?mm|yyyy).*", re.IGNORECASE)
#: Rows in which the header is looked for.
HEAD = 200
#: Rows below the header that may say more about the columns, such as their units.
WORDS = 5
#: Cells that say "not measured", in small letters.
NOTHING = ("", "nan", "na", "n/a", "n.a.", "null", "none", "<na>", "#n/a")
#: Bytes by which the decimal sign is told.
SAMPLE = 20_000
#: Between cells, the likelier first; a blank stands for any number of blanks and tabs.
SEPARATORS = (",", ";", "\t", "|", " ")
#: Numbers with a comma, with a point, and with commas where those of thousands would stand.
_COMMA = re.compile(r"[+-]?[\d.]*,[\d.,]*([eE][+-]?\d+)?", re.ASCII)
_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?", re.ASCII)
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
    body_row, units, body_start = _below(data, row + 1, start, separator, notes)
    columns = _judge(file, row, names, units, inputs, notes)
    decimal = _decimal(file, body_row, data, body_start, separator)
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
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip().strip("\"'_"))
    name = re.sub(r"[\s\-]+", "_", name.lower())
    return TIME if name in _TIME_NAMES else name


def _below(data: bytes, row: int, start: int, separator: str, notes: list[str]) -> tuple[int, list[str], int]:
    """The row where data begin, the units in a row of their own (or none), and the byte of that first row. Rows of
    words, which describe the columns, are left out."""
    units: list[str] = []
    passed = 0
    for _ in range(WORDS):
        end = data.find(b"\n", start)
        cells = split(data[start : max(end, start)].decode(errors="replace"), separator)
        if end < 0 or not _wordy(cells):
            break
        bare = [cell.strip("[](){}<> ") for cell in cells]
        if not units and any(any_factor(unit) is not None for unit in bare if unit not in ("-", "1")):
            units = bare
        else:
            passed += 1
        row, start = row + 1, end + 1
    if passed:
        notes.append(f"{passed} row{'' if passed == 1 else 's'} of words below the header left out")
    return row, units, start


def _wordy(cells: list[str]) -> bool:
    """Whether a row holds words and nothing that could be measured, or stand for what was not."""
    words = [cell for cell in cells if cell]
    return any(re.search(r"[^\W\d]|[°%]", cell) for cell in words) and not any(
        number(cell) is not None or re.match(r"[\d+.]|-\W*\d", cell) or cell.lower() in NOTHING for cell in words
    )


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
        if name == TIME and _DATED.fullmatch(unit):
            unit = ""
        asked = header if header in wanted else parts(header)[0]
        if asked in wanted:
            unit = unit or parts(header)[1]
            scale = any_factor(unit) or 1.0
            name = INPUT + wanted.pop(asked)
            columns[name] = Column(place, name, header, scale, unit)
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
        named = "; ".join(shown(n) for n in names[:6] if n)
        meant = f"name the column that holds it so (there are {named})" if len(names) > 1 and named else "add it"
        raise InputError(f"{where}: column '{TIME}' is missing, the time of each row in seconds; {meant}{blanks}")
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
        if meant and _mistyped(_plain(header), meant[1]):
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


# ---------------------------------------------------------------- cells


def decimal_sign(file: Path, row: int, text: str, separator: str) -> str:
    """The decimal sign in some rows, the first of which is ``row``.

    Raises InputError, naming file and row, where a comma stands between thousands or may do so.
    """
    cells = [cell.strip(' "') for cell in re.split(f"[{re.escape(separator)}\n]", text)]
    quoted = re.findall(r'"([^"\n]*)"', text)
    commas = [cell for cell in (quoted if separator == "," else cells) if _COMMA.fullmatch(cell)]
    if not commas:
        return "."
    thousands = [cell for cell in commas if _THOUSANDS.fullmatch(cell)]
    points = any(_POINT.fullmatch(cell) for cell in cells) or any("." in cell for cell in thousands)
    if not thousands or (len(thousands) < len(commas) and not points):
        return ","
    what = "has a comma between thousands" if points else "has a comma that is a decimal one or between thousands"
    row += text.count("\n", 0, text.index(thousands[0]))
    remedy = "export the numbers without thousands separators and with decimal points"
    raise InputError(f"{file}, row {row}: {thousands[0]!r} {what}; {remedy}")


def _decimal(file: Path, row: int, data: bytes, start: int, separator: str) -> str:
    """The decimal sign of a table: by its first rows, or by the first that hold one."""
    sample = data[start : start + SAMPLE]
    mark = b'"' if separator == "," else b","
    if mark not in sample and b"." not in sample and (at := data.find(mark, start)) >= 0:
        begin = max(data.rfind(b"\n", start, at) + 1, start)
        row += data.count(b"\n", start, begin)
        sample = data[begin : begin + SAMPLE]
    return decimal_sign(file, row, sample.decode(errors="replace"), separator)


def number(cell: str, decimal: str = ".") -> float | None:
    """A cell's number; None where it is none. An underscore and foreign digits make none, as for pandas."""
    if decimal != "." and "." in cell:
        return None
    if re.fullmatch(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", cell.replace(decimal, "."), re.ASCII):
        return float(cell.replace(decimal, "."))
    return {"nan": float("nan"), "inf": float("inf")}.get(cell.strip().lower().lstrip("+-"))


def shown(text: str) -> str:
    """A cell as it stands in one line of a message."""
    return repr(text if len(text) <= 40 else text[:37] + "...")
