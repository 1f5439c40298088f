# SPDX-License-Identifier: Apache-2.0
"""What is read off a run: each quantity declared once, all of them computed in one pass over the run's samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..core.cache import compiled_once

#: Swings may grow so much from the first third of a run to the last before the run is called not stable.
GROWTH = 4.0
#: Swings (m, m, rad of top gap, sway and roll) that are none: the mean's own curvature, and rounding.
STILL = (2e-5, 2e-5, 2e-4)


@dataclass(frozen=True)
class Quantity:
    """One number of a run: its ``unit`` (SI), what it means, how a map calls it, and factor and unit in which it is
    shown."""

    name: str
    unit: str
    meaning: str
    title: str
    shown: tuple[float, str]


QUANTITIES: tuple[Quantity, ...] = (
    Quantity(
        "first_contact",
        "s",
        "time of the first sample in contact with the track; not a number where none is",
        "First contact",
        (1.0, "s"),
    ),
    Quantity(
        "smallest_gap", "m", "the least of the three gaps over the run; below 0 in contact", "Smallest gap", (1e3, "mm")
    ),
    Quantity(
        "hover_gap",
        "m",
        "mean top gap over the second half of the run; not a number where the cradle touches in it",
        "Hover gap (top)",
        (1e3, "mm"),
    ),
    Quantity("travel", "m", "surge at the end less that at the start", "Travel", (1.0, "m")),
    Quantity("final_speed", "m/s", "surge rate at the end", "Final speed", (1.0, "m/s")),
    Quantity("peak_speed", "m/s", "the largest surge rate", "Peak speed", (1.0, "m/s")),
    Quantity("peak_roll", "rad", "the largest roll to either side", "Peak roll", (1e3, "mrad")),
    Quantity("peak_sway", "m", "the largest sway to either side", "Peak sway", (1e3, "mm")),
    Quantity(
        "swing_growth",
        "",
        "by how much the swings of top gap, sway or roll grow from the first third of the run to the last",
        "Growth of swings",
        (1.0, ""),
    ),
    Quantity(
        "stable",
        "",
        f"1 where the run never touches the track and no swing grows more than {GROWTH:g} times, else 0",
        "Stable",
        (1.0, ""),
    ),
)
NAMES = tuple(q.name for q in QUANTITIES)
QUANTITY = {q.name: q for q in QUANTITIES}
_STILL = np.array(STILL)


@compiled_once
def _swing(times, rows, column, first, last):
    """Standard deviation of a column about a straight line over the rows from ``first`` up to ``last``."""
    n, t0 = last - first, times[first]
    st = sy = stt = sty = syy = 0.0
    y0 = rows[first, column]
    for i in range(first, last):
        t, y = times[i] - t0, rows[i, column] - y0
        st, sy, stt, sty, syy = st + t, sy + y, stt + t * t, sty + t * y, syy + y * y
    vtt, vty, vyy = stt - st * st / n, sty - st * sy / n, syy - sy * sy / n
    left = vyy - (vty * vty / vtt if vtt > 0.0 else 0.0)
    return math.sqrt(max(left, 0.0) / n)


@compiled_once
def _measure(times, out, still, growth, found):
    """`QUANTITIES` of each run of ``out`` (jobs, n, 15) into ``found`` (jobs, 10); NaN, and not stable, for one that
    left all bounds."""
    n = times.size
    for job in range(out.shape[0]):
        rows = out[job]
        contact, least, hover, count, peak_speed, peak_roll, peak_sway = math.nan, math.inf, 0.0, 0, -math.inf, 0.0, 0.0
        touches_late = False
        for i in range(n):
            gap = min(rows[i, 8], min(rows[i, 9], rows[i, 10]))
            if gap < 0.0 and math.isnan(contact):
                contact = times[i]
            least = min(least, gap)
            peak_speed = max(peak_speed, rows[i, 4])
            peak_roll = max(peak_roll, abs(rows[i, 3]))
            peak_sway = max(peak_sway, abs(rows[i, 1]))
            if 2 * i >= n - 1:
                hover += rows[i, 8]
                count += 1
                touches_late = touches_late or gap < 0.0
        third = max(n // 3, 2)
        most = 0.0
        for k, column in enumerate((8, 1, 3)):
            before = _swing(times, rows, column, 0, third) + still[k]
            most = max(most, (_swing(times, rows, column, n - third, n) + still[k]) / before)
        if not math.isfinite(rows[n - 1, 0]):
            for k in range(9):
                found[job, k] = math.nan
            found[job, 9] = 0.0
            continue
        found[job, 0], found[job, 1] = contact, least
        found[job, 2] = math.nan if touches_late else hover / count
        found[job, 3], found[job, 4] = rows[n - 1, 0] - rows[0, 0], rows[n - 1, 4]
        found[job, 5], found[job, 6], found[job, 7], found[job, 8] = peak_speed, peak_roll, peak_sway, most
        found[job, 9] = 1.0 if least >= 0.0 and most <= growth else 0.0


def measure(times: np.ndarray, out: np.ndarray) -> np.ndarray:
    """What is read off runs ``out`` (jobs, n, 15) at ``times`` (n,): (jobs, quantities), columns as in `QUANTITIES`,
    SI."""
    found = np.empty((len(out), len(QUANTITIES)))
    _measure(times, out, _STILL, GROWTH, found)
    return found
