# SPDX-License-Identifier: Apache-2.0
"""How finely each channel reads and how noisy it is, from the samples alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..data import Campaign, Run
from . import levels
from .local import deviations, misses, second_differences, some_blocks, spread
from .steps import FEWEST_READINGS, step_of

#: Samples of a channel in each run that its step is looked for in.
READINGS = 20_000
#: Steps are looked for from this part of the noise on where few readings are one step apart: half of one may matter.
SMALLEST_STEP = 0.5


@dataclass(frozen=True)
class Channel:
    """What one channel's samples in all runs show.

    - noise: standard deviation of what neighbours do not predict
    - by_reach: typical error of the cubics of each of `local.REACHES`; noise and motion together make it
    - smooth: the noise by the line through two neighbours alone; larger where motion shows in it
    - step: what its readings are whole multiples of, 0 where no step shows; where some runs alone read in steps that
      are larger than their noise, the largest of them
    - low, middle, high: the median is ``middle``; 98 % of the samples lie between the two others
    - count: number of samples
    - every: s, the usual time between two of them
    - stepped: names of the runs that read in steps, where not all do
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
    stepped: tuple[str, ...] = ()

    @property
    def spread(self) -> float:
        """What 98 % of its samples span."""
        return self.high - self.low

    @property
    def scatter(self) -> float:
        """The noise, and at least what the steps make: their errors are alike where the channel moves by nearly whole
        steps, so that neighbours do not show them."""
        return max(self.noise, self.step / np.sqrt(12.0))

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
    noise = spread(left)
    step, stepped = step_of(np.concatenate([y[:READINGS] for _, y in runs]), SMALLEST_STEP * noise), ()
    if not step and len(runs) > 1:
        step, stepped = _step_of_some(campaign, channel)
    steps = [np.median(np.diff(t)) for t, _ in runs if len(t) > 1]
    sizes = noise, reaches, spread(lines), step, float(low), float(middle), float(high)
    return Channel(*sizes, sum(len(y) for _, y in runs), float(np.median(steps)) if steps else 0.0, stepped)


def _step_of_some(campaign: Campaign, channel: str) -> tuple[float, tuple[str, ...]]:
    """The largest step, and the names, of the runs of a channel that read in steps larger than their noise."""

    def step(run: Run) -> float:
        times, values = run.samples(channel)
        if len(np.unique(values[:READINGS])) < FEWEST_READINGS:
            return 0.0
        noise = spread(deviations(times, values))
        found = step_of(values[:READINGS], SMALLEST_STEP * noise)
        return found if found > levels.STEP_MATTERS * noise else 0.0

    steps = {run.name: s for run in campaign.runs if channel in run.channels and (s := step(run))}
    return max(steps.values(), default=0.0), tuple(steps)
