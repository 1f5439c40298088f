# SPDX-License-Identifier: Apache-2.0
"""Times that a table leaves out, where the rows above it say when they begin and by how much they go on: a measurement
file of LabVIEW without X columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .csv_cells import number, split
from .csv_layout import Layout
from .measurement import Array

_BEGIN, _STEP, _OF = "X0", "Delta_X", "X_Dimension"
_REMEDY = "save the file with one X column (in LabVIEW: X_Columns One)"


def counted(file: Path, data: bytes, layout: Layout, rows: NDArray[np.int32], notes: list[str]) -> Array:
    """Times (n,) in s of the table's ``rows`` (n,), which are numbered as an editor does and have none of their own.

    Raises InputError where the rows above the table do not tell them.
    """
    above = [split(line, layout.separator) for line in data[: layout.start].decode(errors="replace").split("\n")]
    said = {cells[0]: cells for cells in above if cells and cells[0] in (_BEGIN, _STEP, _OF)}
    if what := {c for c in said.get(_OF, ())[1:] if c} - {"Time"}:
        raise InputError(f"{file}: its rows go on in {what.pop()}, not in time; a run is samples by their time")
    begin, step = (_only(file, name, said.get(name, []), layout) for name in (_BEGIN, _STEP))
    if step is None or not step > 0.0:
        where = f"no {_STEP} above the table says how they go on" if step is None else f"{_STEP} above it is {step:g}"
        raise InputError(
            f"{file}, row {layout.first_row}: the rows have no times, and {where}; fill them in, or {_REMEDY}"
        )
    begin = begin or 0.0
    notes.append(f"the rows have no times: counted from {_BEGIN}, {begin:g} s, in steps of {_STEP}, {step:g} s")
    return begin + step * (rows - rows[0])


def _only(file: Path, name: str, cells: list[str], layout: Layout) -> float | None:
    """The number that a row above the table gives all columns that are read; None where there is none. Raises
    InputError where they differ."""
    places = [column.place for column in layout.columns]
    mine = [cells[place] for place in places if 0 < place < len(cells)]
    values = [value for cell in mine if (value := number(cell, layout.decimal)) is not None]
    if len(set(values)) > 1:
        differing = " and ".join(f"{value:g}" for value in sorted(set(values))[:2])
        raise InputError(
            f"{file}: {name} differs between the channels, {differing}; {_REMEDY}, or a file for each rate"
        )
    return values[0] if values else None
