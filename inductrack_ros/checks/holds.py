# SPDX-License-Identifier: Apache-2.0
"""Channels that are logged more often than they are measured: a value stands until the next one comes, and its repeats
are no measurements."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, number
from .hangs import repeats_of
from .noise_found import READINGS
from .steps import step_of

#: Readings that change by no more than so many of their steps repeat by themselves.
COARSE = 3.0


@dataclass(frozen=True)
class _Series:
    """The readings of a channel in one run: sample ``numbers`` (n,) and ``values`` (n,); where stretches of one value
    begin, and how long they are (s,)."""

    run: Run
    numbers: NDArray[np.intp]
    values: Array
    starts: NDArray[np.intp]
    lengths: NDArray[np.intp]

    @property
    def jumps(self) -> Array:
        """(s − 1,) From each stretch to the next."""
        return np.abs(np.diff(self.values[self.starts]))

    def alone(self, step: float) -> NDArray[np.bool_]:
        """(s,) Stretches that the channel reaches and leaves by more than its readings' steps."""
        far = self.jumps > COARSE * step
        return np.append(False, far) & np.append(far, False)

    def repeats(self, which: NDArray[np.bool_]) -> NDArray[np.intp]:
        """The samples of some stretches but for the first of each."""
        mine = np.repeat(which, self.lengths)
        mine[self.starts] = False
        return self.numbers[mine]


def held(campaign: Campaign) -> list[Finding]:
    """A finding for every channel that is held: at every so many samples, or now and then."""
    findings = []
    for channel in campaign.channels:
        series = [s for run in campaign.runs if channel in run.channels and (s := _series(run, channel)) is not None]
        if sum(len(s.starts) for s in series) < levels.FEW or not any((s.lengths > 1).any() for s in series):
            continue
        step = step_of(np.concatenate([s.values[:READINGS] for s in series]))
        findings += _evenly(channel, series, step) or _now_and_then(channel, series, step, len(campaign.channels))
    return findings


def _series(run: Run, channel: str) -> _Series | None:
    numbers = np.flatnonzero(~np.isnan(run[channel]))
    if len(numbers) <= 2:
        return None
    return _Series(run, numbers, run[channel][numbers], *repeats_of(run[channel][numbers]))


def _evenly(channel: str, series: Iterable[_Series], step: float) -> list[Finding]:
    """The channel is measured every so many samples."""
    every = np.concatenate([s.lengths for s in series])
    usual = float(np.median(every))
    if usual < 2 or np.quantile(every, 0.9) > 2 * usual:
        return []
    if np.median(np.concatenate([s.jumps for s in series])) <= COARSE * step:
        return []
    found = {s.run.name: s.repeats(np.ones(len(s.starts), bool)) for s in series}
    text = f"{channel} is measured every {number(usual, 2)} samples and held in between"
    return [_finding(channel, found, text, usual)]


def _now_and_then(channel: str, series: Iterable[_Series], step: float, family: int) -> list[Finding]:
    """The channel misses a sample now and then and repeats the one before; longer stretches are `hangs`'.

    Of readings that hardly change, as many stay as change by a step up, and as many by a step down. That is counted
    where the channel moves by more before and behind."""
    stay, change, count = 0, 0, 0
    found: dict[str, NDArray[np.intp]] = {}
    for s in series:
        missed = s.alone(step) & (s.lengths > 1) & (s.lengths < levels.FLAT)
        stay, count = stay + int(missed.sum()), count + len(s.values)
        far = s.jumps > COARSE * step
        near = (s.jumps < 1.5 * step)[1:-1]
        change += int((near & far[:-2] & far[2:]).sum())
        found[s.run.name] = s.repeats(missed)
    if stats.binom.sf(stay - 1, stay + change, 1.0 / 3.0) > levels.FALSE_ALARMS / family:
        return []
    share = sum(map(len, found.values())) / count
    text = f"{channel} repeats the reading before it in {number(100.0 * share)} % of the samples, not by chance"
    return [_finding(channel, found, text, 1.0 / (1.0 - share))]


def _finding(channel: str, found: dict[str, NDArray[np.intp]], text: str, every: float) -> Finding:
    count = sum(map(len, found.values()))
    size = {"count": count, "every": every}
    text += f": {count} repeats are no measurements"
    return Finding("held", SET_ASIDE, text, "", channel, samples=as_samples(found), size=size)
