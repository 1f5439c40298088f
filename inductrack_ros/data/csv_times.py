# SPDX-License-Identifier: Apache-2.0
"""Times as loggers and spreadsheets write them: dates, times of day, numbers too long for a float, counters that
wrap."""

from __future__ import annotations

import math
import re
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: ns of a day.
DAY = 86_400_000_000_000
#: From so many s on a float resolves no ns; beyond so many whole ns have no room.
COARSE, NO_ROOM = 2.0**22, 9.2e9
#: Counters that wrap (s) and what they count. One wraps where it then has gone on by no more than so many usual steps.
WRAPS = (
    (2**16 * 1e-3, "16 bits of ms"),
    (2**32 * 1e-9, "32 bits of ns"),
    (2**32 * 1e-6, "32 bits of µs"),
    (2**32 * 1e-3, "32 bits of ms"),
)
WENT_ON = 5.0


def needs_integers(cell: str, decimal: str, factor: float) -> bool:
    """Whether a time, of a unit of ``factor`` s, is too long for a float to hold its ns, as times since 1970 are."""
    try:
        seconds = abs(float(cell.replace(decimal, "."))) * factor
    except ValueError:
        return False
    return COARSE < seconds < NO_ROOM and factor in (1.0, 1e-3, 1e-6, 1e-9)


def nanoseconds(cell: str, decimal: str, factor: float) -> int | None:
    """A time of a unit of ``factor`` s as whole ns, exactly; None where it is no number, or too large."""
    try:
        value = Decimal(cell.replace(decimal, ".")).scaleb(9 + round(math.log10(factor)))
        return round(value) if abs(value) < NO_ROOM * 1e9 else None
    except (InvalidOperation, ValueError, OverflowError):
        return None


def unwrapped(stamps: NDArray[Any]) -> tuple[NDArray[Any], list[str]]:
    """Stamps (n,), s or whole ns, of a counter that went on where it began again; and what is to be said of that."""
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0)
    if not len(back) or len(back) > len(steps) / 4:
        return stamps, []
    second = 1e9 if stamps.dtype.kind == "i" else 1.0
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for period, what in WRAPS:
        onward = steps[back] + period * second
        if ((onward > 0) & (onward <= WENT_ON * usual)).all():
            turns = np.zeros(len(stamps), np.int64)
            turns[back + 1] = 1
            added = np.cumsum(turns) * (round(period * second) if stamps.dtype.kind == "i" else period)
            return stamps + added, [f"the times count {what} and begin again: {period:.10g} s added to the later ones"]
    return stamps, []


def is_of_day(cell: str) -> bool:
    """Whether a time is one of the day (or of a stopwatch), without a date."""
    return re.match(r"\d+:", cell) is not None


def read_times(text: Any) -> Any:
    """A series of texts as one of dates (UTC) or of times of day, in ns, by what the first one is; not a time where
    one cannot be read."""
    import pandas as pd  # slow to import

    text = text.str.replace(r"(?<=\d),(?=\d)", ".", regex=True)
    text = text.str.replace(r"(\d+:\d\d:\d\d):(\d+)$", r"\1.\2", regex=True)  # 10:59:00:500
    first = text.iloc[0]
    if is_of_day(first):
        return _times_of_day(text)
    if re.match(r"\d{4}-\d|\d{8}[T ]", first):
        return pd.to_datetime(text, format="ISO8601", utc=True, errors="coerce").dt.as_unit("ns")
    read = [
        pd.to_datetime(text, format="mixed", dayfirst=first, utc=True, errors="coerce").dt.as_unit("ns")
        for first in (True, False)
    ]
    return min(read, key=lambda t: t.max() - t.min())  # 01/02 and 02/02 are a day apart, not a month


def whole_nanoseconds(times: Any, of_day: bool) -> tuple[NDArray[np.int64], bool]:
    """Times (n,) as whole ns, and whether times of day among them passed midnight, where 24 h are added to the later
    ones."""
    stamps = times.astype("int64").to_numpy()
    if not of_day:
        return stamps, False
    passed = np.concatenate([[0], np.cumsum(np.diff(stamps) < -DAY // 2)])
    return stamps + passed * DAY, bool(passed[-1])


def _times_of_day(text: Any) -> Any:
    """Times since midnight out of `10:59:00.5`, `59:00.5` or `10:59:00.5 PM`; not a time where there is none."""
    import pandas as pd

    half = text.str.extract(r"(?i)\b([ap])\.?m\.?$")[0].str.lower()
    clock = text.str.replace(r"(?i)\s*\b[ap]\.?m\.?$", "", regex=True)
    clock = clock.where(clock.str.count(":") != 1, "00:" + clock)
    times = pd.to_timedelta(clock, errors="coerce").astype("timedelta64[ns]")
    twelve = clock.str.match("12:")
    hours = 12 * ((half == "p") & ~twelve).astype(int) - 12 * ((half == "a") & twelve).astype(int)
    return times + pd.to_timedelta(hours, unit="h")
