"""CSV in and out: a header with `time` and channels, SI units, empty cells allowed."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError, did_you_mean
from ..core.state import CHANNELS
from .measurement import Array, Run

TIME = "time"


def read_csv(file: str | Path, name: str | None = None) -> Run:
    """Read one run from a CSV.

    Columns may stand in any order and are returned in the canonical one. An empty cell, or `nan`, is "not measured".
    Raises InputError, naming file, row (as an editor counts) and column, for anything that is not such a file.
    """
    file = Path(file)
    text = _read_text(file)
    header, body = _split_header(file, text)
    table = _parse(file, header, body)
    _check(file, header, body, table)
    stamps = table[:, header.index(TIME)]
    channels = tuple(c for c in CHANNELS if c in header)
    return Run(
        name=name if name is not None else file.stem,
        file=file,
        channels=channels,
        times=stamps - stamps[0],
        values=np.ascontiguousarray(table[:, [header.index(c) for c in channels]]),
        stamps=stamps,
    )


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
        _replace(file, "\n".join(lines))
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror}") from None


def write_prediction(folder: str | Path, run: Run, predicted: Array) -> Path:
    """Write `<run>.predicted.csv`: the run's own stamps and channels with predicted values (n, c); return its path.

    An older prediction is replaced. Raises InputError if it cannot be written.
    """
    file = Path(folder) / f"{run.name}.predicted.csv"
    write_csv(file, run.stamps, dict(zip(run.channels, np.asarray(predicted).T, strict=True)), overwrite=True)
    return file


# ---------------------------------------------------------------- reading


def _read_text(file: Path) -> str:
    try:
        if file.is_dir():
            raise InputError(f"{file}: is a folder, not a CSV file (a rosbag2 folder holds metadata.yaml)")
        if not file.exists():
            raise InputError(f"{file}: no such file")
        if not file.is_file():  # reading a pipe or a device could wait for ever
            raise InputError(f"{file}: not a regular file")
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError(f"{file}, row {line}: not UTF-8 text; save it as CSV with UTF-8 encoding") from None
    if not text.strip():
        raise InputError(f"{file}: empty; it needs a header with '{TIME}' and channels, and at least 2 rows")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _split_header(file: Path, text: str) -> tuple[list[str], str]:
    first, _, body = text.partition("\n")
    where = f"{file}, row 1"
    try:
        header = [name.strip() for name in next(csv.reader([first], skipinitialspace=True), [])]
    except csv.Error as error:
        raise InputError(f"{where}: {error}") from None
    if len(header) == 1 and re.search(r"[;\t]", first):
        raise InputError(f"{where}: columns must be separated by commas (and decimals by points)")
    if header and all(_number(name) is not None for name in header):
        raise InputError(f"{where}: no header; the first row must name the columns, e.g. time,surge,heave")
    for i, name in enumerate(header):
        if not name:
            raise InputError(f"{where}, column {i + 1}: has no name; name it or delete the column")
        if name not in (TIME, *CHANNELS):
            raise InputError(f"{where}: unknown column {_shown(name)}{did_you_mean(name, (TIME, *CHANNELS))}")
        if name in header[:i]:
            raise InputError(f"{where}: column '{name}' stands there twice; delete one")
    if TIME not in header:
        raise InputError(f"{where}: column '{TIME}' is missing; add the time of each row in seconds")
    if len(header) == 1:
        raise InputError(f"{where}: only '{TIME}'; add at least one of {', '.join(CHANNELS)}")
    return header, body


def _parse(file: Path, header: list[str], body: str) -> Array:
    """Table (n, len(header)); empty cells are NaN. numpy's fast reader first, ours where it gives up."""
    for fill in (False, True):
        text = _fill(body) if fill else body
        try:
            table = np.loadtxt(io.StringIO(text), delimiter=",", comments=None, ndmin=2) if body.strip() else None
        except ValueError:
            continue
        if table is not None and table.shape[1] == len(header):
            return table
        break
    rows = [row for _, row in _rows(file, header, body)]
    return np.array(rows, float).reshape(len(rows), len(header))


def _fill(body: str) -> str:
    """Write `nan` into empty cells, all but a row's first."""
    return (body + "\n").replace(",,", ",nan,").replace(",,", ",nan,").replace(",\n", ",nan\n")


def _rows(file: Path, header: list[str], body: str) -> Iterator[tuple[int, list[float]]]:
    """Yield (row number as an editor shows it, floats); raise InputError at the first bad cell. Slow and exact."""
    last = body.rstrip("\n").count("\n") + 2
    reader = csv.reader(io.StringIO(body), skipinitialspace=True)
    try:
        for cells in reader:
            line = reader.line_num + 1
            if len(cells) <= 1 and not "".join(cells).strip():
                continue
            if len(cells) != len(header):
                cut = "; the last row is cut off" if line >= last and len(cells) < len(header) else ""
                counts = f"{len(cells)} cells where the header names {len(header)}"
                raise InputError(f"{file}, row {line}: {counts}{cut}; complete the row or delete it")
            values = []
            for column, cell in zip(header, cells, strict=True):
                value = _number(cell) if cell.strip() else math.nan
                if value is None:
                    place = f"{file}, row {line}, column '{column}'"
                    raise InputError(f"{place}: {_shown(cell)} is not a number; correct it or leave it empty")
                values.append(value)
            yield line, values
    except csv.Error as error:
        raise InputError(f"{file}, row {reader.line_num + 1}: {error}") from None


def _check(file: Path, header: list[str], body: str, table: Array) -> None:
    def line(row: int) -> int:
        """The editor's row number of a table row: blank lines shift it."""
        return next(n for i, (n, _) in enumerate(_rows(file, header, body)) if i == row)

    if len(table) < 2:
        raise InputError(f"{file}: {len(table)} row{'' if len(table) == 1 else 's'} of data; a run needs at least 2")
    infinite = np.argwhere(np.isinf(table))
    if len(infinite):
        row, column = infinite[0]
        raise InputError(f"{file}, row {line(row)}, column '{header[column]}': infinite; correct it or leave it empty")
    times = table[:, header.index(TIME)]
    if np.isnan(times).any():
        raise InputError(f"{file}, row {line(int(np.argmax(np.isnan(times))))}: no time; fill it in or delete the row")
    backwards = np.flatnonzero(np.diff(times) <= 0)
    if len(backwards):
        row = int(backwards[0]) + 1
        what = "repeats the row before" if times[row] == times[row - 1] else f"comes after {float(times[row - 1])!r}"
        place = f"{file}, row {line(row)}, column '{TIME}'"
        raise InputError(f"{place}: {float(times[row])!r} {what}; sort the rows by time and delete repeats")
    for column, cells in zip(header, table.T, strict=True):
        if np.isnan(cells).all():
            raise InputError(f"{file}, column '{column}': empty from top to bottom; delete the column")


def _number(cell: str) -> float | None:
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _shown(text: str) -> str:
    """A cell as it stands in one line of a message."""
    return repr(text if len(text) <= 40 else text[:37] + "...")


# ---------------------------------------------------------------- writing


def _nanoseconds(stamp: int) -> str:
    sign, stamp = ("-", -stamp) if stamp < 0 else ("", stamp)
    return f"{sign}{stamp // 1_000_000_000}.{stamp % 1_000_000_000:09d}"


def _replace(file: Path, text: str) -> None:
    """Write to a sibling and rename, so that no half-written file is ever seen under the name."""
    temporary = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(file)
    finally:
        temporary.unlink(missing_ok=True)
