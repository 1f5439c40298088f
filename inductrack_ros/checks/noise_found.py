# SPDX-License-Identifier: Apache-2.0
"""How finely each channel reads and how noisy it is, from the samples alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..data import Campaign
from ..data.measurement import Array
from . import levels
from .local import deviations, misses, second_differences, some_blocks, spread

#: Samples of a channel in each run that its step is looked for in.
READINGS = 20_000
#: Fewer different readings than this show no step, unless each occurs so many times.
FEWEST_READINGS, OFTEN = 4, 10
#: Readings are whole steps where all but this part of them are, to this part of a step.
EXCEPTIONS, ROUNDED = 0.01, 0.02


@dataclass(frozen=True)
class Channel:
    """What one channel's samples in all runs show.

    - noise: standard deviation of what neighbours do not predict
    - by_reach: typical error of the cubics of each of `local.REACHES`; noise and motion together make it
    - smooth: the noise by the line through two neighbours alone; larger where motion shows in it
    - step: what its readings are whole multiples of, 0 where no step shows
    - low, middle, high: the median is ``middle``; 98 % of the samples lie between the two others
    - count: number of samples
    - every: s, the usual time between two of them
    """

    noise: float
    by_reach: tuple[float, ...]
    smooth: float
    step: float
    low: float
    middle: float
    high: float
    count: int
    every: float = 0.0

    @property
    def spread(self) -> float:
        """What 98 % of its samples span."""
        return self.high - self.low

    @property
    def resolved(self) -> bool:
        """Whether what neighbours do not predict is noise rather than motion between the samples."""
        return self.every <= levels.SLOWEST and self.smooth <= levels.SAME_NOISE * self.noise


def channels_of(campaign: Campaign) -> Mapping[str, Channel]:
    """Every channel of a campaign that has samples, as these show it."""
    known = [
        c
        for c in campaign.channels
        if any(run.measured[:, run.channels.index(c)].any() for run in campaign.runs if c in run.channels)
    ]
    return {channel: _channel(campaign, channel) for channel in known}


def _channel(campaign: Campaign, channel: str) -> Channel:
    runs = [run.samples(channel) for run in campaign.runs if channel in run.channels]
    values = np.concatenate([y[:: max(len(y) // READINGS, 1)] for _, y in runs])
    low, middle, high = np.quantile(values, [0.01, 0.5, 0.99])
    left = np.concatenate([deviations(t, y) for t, y in runs])
    missed = np.concatenate([misses(t, y) for t, y in runs], axis=1)
    lines = np.concatenate(
        [second_differences(t[part], y[part]) for t, y in runs for part in some_blocks(len(t)) or [slice(None)]]
    )
    if not len(left):  # runs too short for four neighbours
        left = lines
    reaches = tuple(map(spread, missed)) if missed.size else (np.inf,) * len(missed)
    step = step_of(np.concatenate([y[:READINGS] for _, y in runs]))
    steps = [np.median(np.diff(t)) for t, _ in runs if len(t) > 1]
    sizes = spread(left), reaches, spread(lines), step, float(low), float(middle), float(high)
    return Channel(*sizes, sum(len(y) for _, y in runs), float(np.median(steps)) if steps else 0.0)


def step_of(readings: Array) -> float:
    """What readings (n,) are whole multiples of, from the differences between those that occur; 0 where no step shows.

    The digits that a file writes are a step too; whether it matters its size beside the noise says.
    """
    different = np.unique(readings)
    if len(different) < 2 or (len(different) < FEWEST_READINGS and len(readings) < OFTEN * len(different)):
        return 0.0
    apart = np.diff(different)
    small = apart[apart > 1e-9 * np.abs(different).max()]
    if not len(small):
        return 0.0
    step = float(np.quantile(small, EXCEPTIONS))
    step = float(np.median(small[small < 1.5 * step]))
    away = readings - different[len(different) // 2]
    # A step from near readings counts those a little further off, and is sharpened by them.
    for reach in (30.0, 1e3, 3e4):
        near = away[np.abs(away) < reach * step]
        steps = np.rint(near / step)
        step = float(steps @ near / (steps @ steps)) if steps.any() else step
    whole = away / step
    return step if np.mean(np.abs(whole - np.rint(whole)) > ROUNDED + 1e-6 * np.abs(whole)) <= EXCEPTIONS else 0.0
