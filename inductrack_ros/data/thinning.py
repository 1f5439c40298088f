# SPDX-License-Identifier: Apache-2.0
"""Fewer readings of a campaign that is longer than can be held in memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .campaign import Campaign
from .measurement import Run

#: So many runs stay before any is shortened: as many as a start has states.
LEAST_RUNS = 8


def thinned(campaign: Campaign, most: int, spacing: float) -> tuple[Campaign, str]:
    """The campaign with about ``most`` rows, no fewer than one in ``spacing`` s, and what was left out in words (empty
    where nothing was).

    First runs are left out, evenly, then the ends of runs, then readings: of so many rows in a row the first of each
    channel stays. Nothing is averaged, so each reading keeps its moment and its noise."""
    runs = _shortened(_some(campaign.runs, most * spacing), most * spacing)
    step = max(1, -(-sum(len(run.times) for run in runs) // most))
    runs = tuple(_thinned(run, step) for run in runs) if step > 1 else runs
    rows, left = (sum(len(run.times) for run in some) for some in (campaign.runs, runs))
    if left == rows:
        return campaign, ""
    return replace(campaign, runs=runs), _said(campaign.runs, runs, step, (rows, left))


def _some(runs: tuple[Run, ...], seconds: float) -> tuple[Run, ...]:
    """Some of the runs, evenly, that last no longer than so many seconds together, as far as `LEAST_RUNS` are left."""
    share = seconds / max(sum(run.duration for run in runs), seconds)
    number = max(min(LEAST_RUNS, len(runs)), int(share * len(runs)))
    return tuple(runs[int(k)] for k in np.linspace(0, len(runs) - 1, number))


def _shortened(runs: tuple[Run, ...], seconds: float) -> tuple[Run, ...]:
    """The beginnings of the runs, so that all last so many seconds together; short runs stay whole."""
    left, longest = seconds, np.inf
    for k, duration in enumerate(sorted(run.duration for run in runs)):
        if duration > (share := left / (len(runs) - k)):
            longest = share
            break
        left -= duration
    return tuple(_only(run, np.flatnonzero(run.times <= longest)) if run.duration > longest else run for run in runs)


def _thinned(run: Run, step: int) -> Run:
    """The first reading of each channel in every ``step`` rows."""
    measured = run.measured
    kept = np.zeros_like(measured)
    for c in range(measured.shape[1]):
        own = np.flatnonzero(measured[:, c])
        kept[own[np.diff(own // step, prepend=-1) > 0], c] = True
    return _only(replace(run, values=np.where(kept, run.values, np.nan)), np.flatnonzero(kept.any(axis=1)))


def _only(run: Run, rows: np.ndarray) -> Run:
    """A run with some of its rows."""
    numbers = None if run.numbers is None else run.numbers[rows]
    return replace(run, times=run.times[rows], values=run.values[rows], stamps=run.stamps[rows], numbers=numbers)


def _said(before: tuple[Run, ...], after: tuple[Run, ...], step: int, rows: tuple[int, int]) -> str:
    parts = []
    if len(after) < len(before):
        parts.append(f"{len(after)} of {len(before)} runs")
    longest = [max(run.duration for run in some) for some in (before, after)]
    if longest[1] < 0.9 * longest[0]:
        parts.append(f"their first {longest[1]:.3g} s")
    if step > 1:
        parts.append(f"one reading of each channel in {step} rows")
    how = " and ".join(parts) if len(parts) < 3 else f"{parts[0]}, {parts[1]} and {parts[2]}"
    return f"{rows[1]:,} of {rows[0]:,} rows are used ({how}): more would neither fit in memory nor end in time"
