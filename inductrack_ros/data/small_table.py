# SPDX-License-Identifier: Apache-2.0
"""A short table of numbers, not a run: the same dialects and units as a run's CSV, row by row."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..core.errors import InputError, did_you_mean
from .csv_cells import COMMENT, SEPARATORS, decimal_sign, number, shown, split
from .csv_header import parts
from .csv_text import read_text
from .units import factor


def read_small_table(
    file: str | Path, units: Mapping[str, str]
) -> tuple[tuple[str, ...], list[tuple[int, list[float]]], tuple[str, ...]]:
    """Names of the columns, rows (number as an editor shows it, values in ``units``), and notes of what was converted.

    ``units``: SI unit of each column that may stand there. Raises InputError naming file, row and column.
    """
    file, notes = Path(file), []
    lines = [
        (i, line) for i, line in enumerate(read_text(file, notes).decode().splitlines(), 1) if line.strip(" \t,;|")
    ]
    lines = [
        (i, line) for i, line in lines if not COMMENT.match(line) and not line.lower().lstrip('"').startswith("sep=")
    ]
    if not lines:
        raise InputError(f"{file}: no table; it needs a header with {', '.join(units)}")
    row, head = lines[0]
    separator = max(SEPARATORS, key=lambda s: sum(parts(name)[0].lower() in units for name in split(head, s)))
    decimal = decimal_sign(file, row + 1, "\n".join(line for _, line in lines[1:20]), separator)
    names, factors = [], []
    headers = split(head, separator)
    for header in headers[:-1] if not headers[-1] else headers:
        name, unit = parts(header)[0].lower(), parts(header)[1]
        if name not in units:
            raise InputError(f"{file}, row {row}: unknown column {shown(header)}{did_you_mean(name, units)}")
        scale = factor(unit, units[name]) if unit else 1.0
        if scale is None:
            raise InputError(
                f"{file}, row {row}: column '{name}' is in {shown(unit)}, which is no unit known for it; convert it to"
                f" {units[name]}"
            )
        names.append(name)
        factors.append(scale)
        if scale != 1.0:
            notes.append(f"converted to SI: {name} from {unit}")
    rows = []
    for i, line in lines[1:]:
        cells = split(line, separator)
        cells = cells[:-1] if len(cells) == len(names) + 1 and not cells[-1] else cells
        if len(cells) != len(names):
            raise InputError(
                f"{file}, row {i}: {len(cells)} cells where the header names {len(names)}; complete the row or"
                " delete it"
            )
        values = [number(cell, decimal) for cell in cells]
        for name, cell, value in zip(names, cells, values, strict=True):
            if value is None:
                raise InputError(f"{file}, row {i}, column '{name}': {shown(cell)} is not a number")
        rows.append((i, [value * scale for value, scale in zip(values, factors, strict=True)]))
    return tuple(names), rows, tuple(notes)
