# SPDX-License-Identifier: Apache-2.0
"""Dates and times of day as loggers and spreadsheets write them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: ns of a day.
DAY = 86_400_000_000_000


def is_of_day(cell: str) -> bool:
    """Whether a time is one of the day (or of a stopwatch), without a date."""
    return re.match(r"\d+:", cell) is not None


def read_times(text: Any) -> Any:
    """A series of texts as one of dates (UTC) or of times of day, in ns, by what the first one is; not a time where
    one cannot be read."""
    import pandas as pd  # slow to import

    text = text.str.replace(r"(?<=\d),(?=\d)", ".", regex=True)
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
