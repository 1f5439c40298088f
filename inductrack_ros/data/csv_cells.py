# SPDX-License-Identifier: Apache-2.0
"""The cells of one row of a table, and what stands in a cell."""

from __future__ import annotations

import csv
import re

from ..core.errors import InputError

#: Cells that say "not measured", in small letters.
NOTHING = ("", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "nat")
NOTHING += ("na", "n/a", "n.a.", "null", "none", "<na>", "#n/a")
NOTHING += ("1.#qnan", "-1.#qnan", "1.#qnan0", "1.#ind", "-1.#ind", "1.#ind00", "-1.#ind00")
#: Words by which instruments say that there is no reading, and what stands in a cell that was too narrow for it.
NO_READING = (
    "over overflow overrange overload ovld ol ofl under underflow invalid error err bad fault open nodata".split()
)
NO_READING += ["no data", "over range", "out of range", "bad input", *("*" * n for n in range(1, 25))]
#: What spreadsheets write in the place of a number, in their languages.
NO_READING += (
    "#div/0! #value! #ref! #num! #name? #null! #spill! #calc! #getting_data #nv #wert! #bezug! #zahl! #leer! #überlauf!"
    " #valeur! #nombre! #nom? #nul! #valor! #¡valor! #¡div/0! #¡ref! #¡num! #¿nombre? #n/d #nome? #valore! #rif!"
    " #waarde! #verw! #getal! #naam? #n/b #arg! #adr! #liczba!"
).split() + ["#" * n for n in range(2, 25)]
#: Between cells, the likelier first; a blank stands for any number of blanks and tabs.
SEPARATORS = (",", ";", "\t", "|", " ")
COMMENT = re.compile(r"\s*(#|%|//)")
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
#: A number of which the thousands are separated.
_GROUPED = re.compile(r"[+-]?\d{1,3}([.,' ’_]\d{3})+([.,]\d*)?")
_MONTHS = "jan|feb|mar|apr|may|mai|jun|jul|aug|sep|oct|okt|nov|dec|dez"
#: The beginning of a date or a time of day.
_DATE = re.compile(
    rf"\d{{1,4}}[-./]\d{{1,3}}[-./T ]\d|\d+:\d\d|\d{{8}}[T ]\d|\d{{1,4}}[-./ ]({_MONTHS})|({_MONTHS})[a-z]*[-. ]+\d"
    r"|(mon|tue|wed|thu|fri|sat|sun)[a-z]*[,. ]+(\d|[a-z])",
    re.IGNORECASE | re.ASCII,
)
#: Numbers with a comma, with a point, and with commas where those of thousands would stand.
_COMMA = re.compile(r"[+-]?[\d.]*,[\d.,]*([eE][+-]?\d+)?", re.ASCII)
_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{2,3})*,\d{3}(\.\d*)?", re.ASCII)
#: A line between header and rows.
_RULE = re.compile(r"[-=+:_|,;\s]*[-=_]{3}[-=+:_|,;\s]*")


def split(line: str, separator: str) -> list[str]:
    """Cells of one row, without blanks and quotes around them."""
    if separator == " ":
        line, separator = re.sub(r"[ \t]+", "\t", line.strip()), "\t"
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


def number(cell: str, decimal: str = ".") -> float | None:
    """A cell's number; None where it is none. An underscore and foreign digits make none, as for pandas."""
    if decimal != "." and "." in cell:
        return None
    if _NUMBER.fullmatch(cell.replace(decimal, ".")):
        return float(cell.replace(decimal, "."))
    return {"nan": float("nan"), "inf": float("inf")}.get(cell.strip().lower().lstrip("+-"))


def is_time(cell: str) -> bool:
    """Whether a cell is a date or a time of day, not a number."""
    return _DATE.match(cell) is not None and number(cell) is None


def is_grouped(cell: str) -> bool:
    """Whether a cell is a number with separators between its thousands."""
    return _GROUPED.fullmatch(cell) is not None


def is_words(cells: list[str]) -> bool:
    """Whether a row holds words and nothing that could be measured, or stand for what was not."""
    words = [cell for cell in cells if cell]
    return any(re.search(r"[^\W\d]|[°%]", cell) for cell in words) and not any(
        number(cell) is not None or re.match(r"[\d+.]|-\W*\d", cell) or cell.lower() in NOTHING for cell in words
    )


def is_rule(line: str) -> bool:
    """Whether a row is only a line drawn below a header."""
    return _RULE.fullmatch(line) is not None


def is_data(cells: list[str]) -> bool:
    """Whether a row holds numbers, dates and what was not measured, and nothing else."""
    measured = [number(cell) is not None or is_time(cell) for cell in cells if cell.lower() not in NOTHING]
    return bool(measured) and all(measured)


def decimal_sign(file: object, row: int, text: str, separator: str) -> str:
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


def shown(text: str) -> str:
    """A cell as it stands in one line of a message; of a long one its beginning and its end, where names differ."""
    return repr(text if len(text) <= 40 else f"{text[:8]}...{text[-29:]}")
