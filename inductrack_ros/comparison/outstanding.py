# SPDX-License-Identifier: Apache-2.0
"""Where most goes wrong, once every window starts afresh: a region of speed, gap, place or contact, or several that the
runs cannot tell apart.

A region is the stretches around the worst of its kind whose error, beyond the noise, is at least a quarter of the
worst's. It stands out where the error inside exceeds that outside by `STANDS_OUT`. Regions of several kinds often hold
the same samples (a run that gains speed passes each place at one speed). A second one is left out only where the data
speak against it: where samples of its own, outside the first, are sound, or samples of the first, outside it, are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..data.measurement import Array
from .result import RunComparison, Stretch, column
from .stretches import FEWEST

#: Error inside a region over that outside, from which on it is named.
STANDS_OUT = 1.25
#: A sample's squared error over noise counts up to here, so that one spike makes no region.
CAP = 1e4
#: Share of the worst squared error beyond noise, below which samples are sound.
SOUND = 0.25


@dataclass(frozen=True)
class Region:
    """Samples with ``by`` between ``low`` and ``high``; None: no limit on that side."""

    by: str
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Outstanding:
    """Regions that the runs cannot tell apart, the most telling first; error over noise inside the first and outside;
    the channel with the largest error inside."""

    regions: tuple[Region, ...]
    inside: float
    outside: float
    channel: str


def outstanding(
    runs: Sequence[RunComparison], stretches: Sequence[Stretch], channels: Sequence[str]
) -> Outstanding | None:
    """What stands out; None where nothing does, or where no window was started afresh."""
    if any(r.restarted is None for r in runs):
        return None
    squares = np.concatenate([_per_sample(r.restarted) for r in runs])
    known = np.isfinite(squares)
    found = []
    for by in dict.fromkeys(s.by for s in stretches):
        values = np.concatenate([r.conditions[by] for r in runs])
        region = _region([s for s in stretches if s.by == by], values, np.where(known, squares, np.nan))
        if region is not None:
            inside = _holds(region, values) & known
            contrast = _rms(squares[inside]) / max(_rms(squares[known & ~inside]), 1.0)
            if contrast > STANDS_OUT:
                found.append((contrast, region, inside))
    if not found:
        return None
    found.sort(key=lambda f: -f[0])
    _, first, mine = found[0]
    together = [first, *(r for _, r, its in found[1:] if _as_good(squares, mine, its))]
    errors = {c: _rms(np.concatenate([column(r, r.restarted, c) for r in runs])[mine] ** 2) for c in channels}
    channel = max(errors, key=lambda c: -1.0 if np.isnan(errors[c]) else errors[c])
    return Outstanding(tuple(together), _rms(squares[mine]), _rms(squares[known & ~mine]), channel)


def _per_sample(table: Array) -> Array:
    """Mean squared error over noise of each sample (n,), NaN where nothing was measured."""
    present = ~np.isnan(table)
    total = np.where(present, np.minimum(table**2, CAP), 0.0).sum(axis=1)
    with np.errstate(invalid="ignore"):
        return total / present.sum(axis=1)


def _region(stretches: Sequence[Stretch], values: Array, squares: Array) -> Region | None:
    """The worst stretch and its neighbours; None where that is everything, or only what is usual (free flight)."""
    excess = []
    for s in stretches:
        part = squares[(values >= s.low) & (values < s.high)]
        part = part[~np.isnan(part)]
        excess.append(part.mean() - 1.0 if len(part) >= FEWEST else np.nan)
    if not np.isfinite(excess).any():
        return None
    worst = first = last = int(np.nanargmax(excess))
    while first > 0 and excess[first - 1] > SOUND * excess[worst]:
        first -= 1
    while last + 1 < len(stretches) and excess[last + 1] > SOUND * excess[worst]:
        last += 1
    if first == 0 and last == len(stretches) - 1:
        return None
    if stretches[worst].by == "contact" and not stretches[worst].low:
        return None
    low = stretches[first].low if first > 0 else None
    high = stretches[last].high if last + 1 < len(stretches) else None
    return Region(stretches[worst].by, low, high)


def _holds(region: Region, values: Array) -> NDArray[np.bool_]:
    inside = np.ones(len(values), bool)
    if region.low is not None:
        inside &= values >= region.low
    if region.high is not None:
        inside &= values < region.high
    return inside


def _as_good(squares: Array, first: NDArray[np.bool_], second: NDArray[np.bool_]) -> bool:
    """Whether the data leave open which of two regions it is."""
    common, own, missed = squares[first & second], squares[second & ~first], squares[first & ~second]
    if len(common) < FEWEST:
        return False
    sound = 1.0 + SOUND * (common.mean() - 1.0)
    return (len(own) < FEWEST or own.mean() > sound) and (len(missed) < FEWEST or missed.mean() <= sound)


def _rms(squares: Array) -> float:
    known = squares[~np.isnan(squares)]
    return float(np.sqrt(known.mean())) if known.size else float("nan")
