# SPDX-License-Identifier: Apache-2.0
"""Channels that were brought to a higher rate by lines or cubics between fewer readings: what lies between two readings
holds no noise of its own, and is no measurement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, place
from .noise_found import READINGS
from .steps import step_of

#: Differences of an order one above that of the polynomials are 0 between the readings, and not at them.
ORDERS = ((2, "lines"), (4, "cubics"))
#: The last bits of a number, of which differences between readings are made where they are 0.
BITS = 1e-13
#: At the readings they are, typically, so many times what rounding makes. Noise on coarse steps is not.
CLEAR = 10.0
#: Steps in time are even where they differ by less than this part.
UNEVEN = 1e-3
#: At least this part of the differences is 0 where there are three samples for each reading.
SHARE = 0.5


def resampled(campaign: Campaign) -> list[Finding]:
    """A finding for each channel that was interpolated throughout, in some runs or in all."""
    findings = []
    for channel in campaign.channels:
        for order, by in ORDERS:
            between = {r.name: _between(r, channel, order) for r in campaign.runs if channel in r.channels}
            if any(map(len, between.values())):
                findings.append(_finding(campaign, channel, by, {n: rows for n, rows in between.items() if len(rows)}))
                break
    return findings


def _between(run: Run, channel: str, order: int) -> NDArray[np.intp]:
    """Sample numbers between the readings; none where the samples are not evenly spaced or not interpolated."""
    known = np.flatnonzero(~np.isnan(run[channel]))
    t, y = run.times[known], run[channel][known]
    if not len(_readings(t[:READINGS], y[:READINGS], order)):  # of a long run its beginning tells
        return known[:0]
    readings = _readings(t, y, order)
    return np.delete(known, [0, *readings.tolist(), len(known) - 1]) if len(readings) else known[:0]


def _readings(times: Array, values: Array, order: int) -> NDArray[np.intp]:
    """Numbers of the samples (n,) between which all others were interpolated; none where they were not."""
    nowhere, steps = np.empty(0, np.intp), np.diff(times)
    if len(times) < levels.FEW or np.ptp(steps) > UNEVEN * np.median(steps):
        return nowhere
    size = np.abs(np.diff(values, order))
    nothing = 2.0 ** (order - 1) * max(step_of(values[:READINGS]), _last_place(values[:READINGS]))
    large = size > nothing
    moving = (np.diff(values) != 0.0)[: len(size)]
    if not large.any() or np.mean(~large & moving) < SHARE:
        return nowhere
    found = _peaks(size, large)
    apart = np.diff(found)
    if len(found) < levels.FEW or np.mean(np.abs(apart - np.median(apart)) > 1) > SHARE:
        return nowhere
    if np.median(apart) < 3 or np.median(size[found]) < CLEAR * nothing:
        return nowhere
    if np.median(size[found]) - size[found].min() <= nothing:
        return nowhere  # one step again and again: an even motion that is rounded
    return found + order // 2


def _last_place(values: Array) -> float:
    """What the last decimal place is worth that values are written with."""
    bits = BITS * float(np.abs(values).max())
    places = (k for k in range(16) if np.abs(np.round(values, k) - values).max() <= bits)
    return max(10.0 ** -next(places, 16), bits)


def _peaks(size: Array, large: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Where each stretch of ``large`` differences is at its largest."""
    places = np.flatnonzero(large)
    parts = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
    return np.array([part[np.argmax(size[part])] for part in parts], np.intp)


def _finding(campaign: Campaign, channel: str, by: str, between: dict[str, NDArray[np.intp]]) -> Finding:
    count = sum(map(len, between.values()))
    runs = [run for run in campaign.runs if run.name in between]
    total = sum(len(run.samples(channel)[0]) for run in runs)
    every = total / (total - count)
    text = (
        f"{channel} was resampled by {by} between readings that are {every:.0f} samples apart (first behind"
        f" {place(runs[0], int(between[runs[0].name][0]) - 1)}): {count} samples between them are no measurements"
    )
    remedy = "hand in the readings at the rate they were taken"
    size = {"count": count, "every": every}
    return Finding("resampled", SET_ASIDE, text, remedy, channel, samples=as_samples(between), size=size)
