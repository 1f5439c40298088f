# SPDX-License-Identifier: Apache-2.0
"""A run as CSV: `time` and columns, SI units, empty cells where nothing was measured."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.output_folder import write_whole
from .csv_header import TIME
from .measurement import Array, Run


def write_csv(file: str | Path, times: ArrayLike, columns: Mapping[str, ArrayLike], *, overwrite: bool = False) -> None:
    """Write `time` and the columns, each (n,), in the order given; NaN becomes an empty cell.

    Floats are written so that they read back to the last bit; integer times are nanoseconds, written as seconds.
    The file appears complete or not at all. Raises InputError if it exists (unless `overwrite`) or cannot be written.
    """
    file = Path(file)
    times = np.asarray(times)
    stamp = _nanoseconds if times.dtype.kind == "i" else repr
    cells = [list(map(stamp, times.tolist()))]
    for values in columns.values():
        cells.append(["" if math.isnan(v) else repr(v) for v in np.asarray(values, float).tolist()])
    lines = [",".join((TIME, *columns)), *map(",".join, zip(*cells, strict=True)), ""]
    if os.path.lexists(file) and not overwrite:
        raise InputError(f"{file}: exists already; choose another name or delete it first")
    if not file.parent.is_dir():
        raise InputError(f"{file}: there is no folder {file.parent}; create it first")
    try:
        write_whole(file, "\n".join(lines))
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror}") from None


def write_prediction(folder: str | Path, run: Run, predicted: Array) -> Path:
    """Write `<run>.predicted.csv`: the run's own stamps and channels with predicted values (n, c); return its path.

    An older prediction is replaced. Raises InputError if it cannot be written.
    """
    file = Path(folder) / f"{run.name}.predicted.csv"
    write_csv(file, run.stamps, dict(zip(run.channels, np.asarray(predicted).T, strict=True)), overwrite=True)
    return file


def _nanoseconds(stamp: int) -> str:
    sign, stamp = ("-", -stamp) if stamp < 0 else ("", stamp)
    return f"{sign}{stamp // 1_000_000_000}.{stamp % 1_000_000_000:09d}"
