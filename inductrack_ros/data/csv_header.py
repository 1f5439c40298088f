# SPDX-License-Identifier: Apache-2.0
"""Where the header of a CSV is, how its cells are separated, and which of its names are known."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.errors import InputError
from ..core.state import CHANNEL, CHANNELS
from .csv_cells import COMMENT, SEPARATORS, is_data, is_rule, is_time, is_words, number, split
from .units import SI, any_factor, factor

TIME = "time"
#: Other names of the time.
_TIME_NAMES = (
    "t timestamp time_stamp stamp zeit temps datetime date_time date/time elapsed elapsed_time relative_time rel_time"
    " seconds x_value"
).split()
#: Further names of channels, as they declare them.
_ALIASES = {alias: name for name in CHANNELS for alias in CHANNEL[name].columns}
#: Rows in which the header is looked for.
HEAD = 1000
#: Rows below the header that may say more about the columns, such as their units.
WORDS = 5


@dataclass(frozen=True)
class Header:
    """A row that may be the header: its number, its text, its separator, its cells, the byte behind it, and the units
    in a row of their own above it (or none)."""

    row: int
    text: str
    separator: str
    names: list[str]
    end: int
    known: int = 0  # of its names, each once
    units: int = 0  # of its names that carry one
    time: int | None = None  # place of the time among them
    above: tuple[str, ...] = ()

    def says_more_than(self, other: Header | None) -> bool:
        """Whether this row is the likelier header, or as likely and nearer to the data."""
        if other is None:
            return self.known >= 2 or self.time is not None
        return self.known > 0 and (self.known, self.units) >= (other.known, other.units)


def find_header(file: Path, data: bytes, inputs: dict[str, str], notes: list[str]) -> Header:
    """The row that names the most columns, above the first row that has a time where it says so.

    ``inputs``: names of further columns that count as known, as values. Raises InputError for a table without header.
    """
    stated, comment, first, best = "", None, None, None
    passed: list[Header] = []
    for row, text, end in _lines(data):
        if not text.strip():
            continue
        if match := re.fullmatch(r'"?sep=(.)"?', text.strip(), re.IGNORECASE) or re.fullmatch(
            r'"?sep=(\t)"?', text, re.IGNORECASE
        ):
            stated = match[1]
            continue
        if match := COMMENT.match(text):
            comment = _header(row, text[match.end() :], end, stated, inputs) if first is None else comment
            continue
        found = _header(row, text, end, stated, inputs)
        if best is not None and _is_below(found.names, best):
            break
        if first is None and is_data(found.names):
            if comment is not None and comment.says_more_than(None):  # as numpy.savetxt writes it
                return comment
            raise InputError(f"{file}, row {row}: no header; a row above must name the columns, e.g. time,surge,heave")
        if first is None and comment is not None and _names_it(comment, found):
            return comment
        first = first or found
        if found.says_more_than(best):
            best = found
        passed.append(found)
    header = best or first
    if header is None:
        raise InputError(f"{file}: no table; it needs a header with 'time' and channels, and at least 2 rows")
    above = [row for row in passed if row.row < header.row] if best else []
    units = _units(split(above[-1].text, header.separator)) if above else []
    if units and len(units) == len(header.names):
        header, above = replace(header, above=tuple(units)), above[:-1]
    if above:
        notes.append(f"{len(above)} row{'' if len(above) == 1 else 's'} before the header left out")
    return header


def rows_below(data: bytes, header: Header, notes: list[str]) -> tuple[int, list[str], int]:
    """The row where data begin, the units in a row of their own below the header or above it (or none), and the byte of
    that first row. Rows of words, which describe the columns, are left out."""
    row, start = header.row + 1, header.end
    units: list[str] = []
    passed = 0
    for _ in range(WORDS):
        end = data.find(b"\n", start)
        line = data[start : max(end, start)].decode(errors="replace")
        cells = split(line, header.separator)
        if end < 0 or not (is_words(cells) or is_rule(line)):
            break
        bare = [cell.strip("[](){}<> ") for cell in cells]
        if not units and any(any_factor(unit) is not None for unit in bare if unit not in ("-", "1")):
            units = bare
        elif not is_rule(line):
            passed += 1
        row, start = row + 1, end + 1
    if passed:
        notes.append(f"{passed} row{'' if passed == 1 else 's'} of words below the header left out")
    return row, units or list(header.above), start


def _units(cells: list[str]) -> list[str]:
    """The units in a row that holds nothing else; none where it does."""
    bare = [cell.strip("[](){}<> ") for cell in cells]
    said = [unit for unit in bare if unit not in ("", "-", "1")]
    return bare if said and all(any_factor(unit) is not None for unit in said) else []


# ---------------------------------------------------------------- rows


def _lines(data: bytes) -> Iterator[tuple[int, str, int]]:
    """Row number, text and the byte behind it, of the first rows."""
    at = 0
    for row in range(1, HEAD + 1):
        end = data.find(b"\n", at)
        if end < 0:
            return
        yield row, data[at:end].decode(errors="replace"), end + 1
        at = end + 1


def _header(row: int, text: str, end: int, stated: str, inputs: dict[str, str]) -> Header:
    """A row as it would be as the header, with the separator by which it says most."""
    wanted = set(inputs.values())
    rows = []
    for separator in [stated] if stated else SEPARATORS:
        names = split(text, separator)
        if separator == " " and any(name in SEPARATORS for name in names):  # blanks stand around what separates
            continue
        known: dict[str, tuple[int, str]] = {}
        for place, name in enumerate(names):
            base, unit = known_name(name)
            if base in SI or {name, parts(name)[0]} & wanted:
                known.setdefault(base, (place, unit))
        units = sum(unit != "" for _, unit in known.values())
        time = known[TIME][0] if TIME in known else None
        rows.append(Header(row, text, separator, names, end, len(known), units, time))
    return max(rows, key=lambda h: (h.known, len(h.names) > 1))  # the first of equals


def _names_it(comment: Header, row: Header) -> bool:
    """Whether a comment is the header of the row below it, which is not all numbers: a cell for each name, a number
    where the time should be."""
    time = comment.time
    return time is not None and len(row.names) == len(comment.names) > 1 and _is_below(row.names, comment)


def _is_below(cells: list[str], header: Header) -> bool:
    """Whether a row belongs to the data below a header."""
    if header.time is None or header.known < 2 and (header.time > 0 or len(cells) != len(header.names)):
        return is_data(cells)
    cell = cells[header.time] if header.time < len(cells) else ""
    return number(cell) is not None or is_time(cell)


# ---------------------------------------------------------------- names


def known_name(header: str) -> tuple[str, str]:
    """Known name of a column and its unit, out of `heave [mm]`, `Time (ms)`, `roll/deg`, `surge_mm`; the text itself
    where not known."""
    text = header.strip()
    name, unit = parts(text)
    if plain(name) in SI:
        return plain(name), unit
    name = plain(text)
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
    """Name and unit of `heave [mm]`, `Time (ms)`, `roll/deg`, `heave: mm`, `heave in mm`."""
    match = re.fullmatch(
        r"(.*?)\s*(?:\[(.*)\]|\((.*)\)|\{(.*)\}|<(.*)>|/\s*([^/\s].*)|[,:]\s*(.+)|\s+in\s+(\S+))", header
    )
    if match is None:
        return header, ""
    return match[1], next((g for g in match.groups()[1:] if g is not None), "").strip("()[] ").rstrip(".")


def plain(name: str) -> str:
    """A name in our spelling: `Surge Rate` → `surge_rate`; the channel's own where it declares this name."""
    if name.strip() in _ALIASES:
        return _ALIASES[name.strip()]
    name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip().strip("\"'_"))
    name = re.sub(r"[\s\-]+", "_", name.lower())
    return TIME if name in _TIME_NAMES else _ALIASES.get(name, name)
