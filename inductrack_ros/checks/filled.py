# SPDX-License-Identifier: Apache-2.0
"""Stretches that run in a straight line although the channel is noisy: filled in where nothing was measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, place, quantity
from .noise_found import Channel

#: A sample is on the line through its neighbours to this part of the noise: of noisy samples one in thirty is.
ON_LINE = 0.05
#: So many samples beside a stretch miss their line by this part of the noise, typically.
BESIDE, NOISY = 16, 0.3


def filled(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding for each channel of which some stretch was interpolated."""
    findings = []
    for channel, about in channels.items():
        if not (about.resolved and 4.0 * about.step < ON_LINE * about.noise):
            continue
        rows = {run.name: _straight(run, channel, about) for run in campaign.runs if channel in run.channels}
        samples = as_samples(rows)
        if not samples:
            continue
        run = next(r for r in campaign.runs if r.name in samples)
        count = sum(map(len, samples.values()))
        text = (
            f"{channel} runs in a straight line for {_first_stretch(samples[run.name])} samples from"
            f" {place(run, samples[run.name][0])}, where its noise is {quantity(channel, about.noise)}: filled in where"
            f" nothing was measured; {count} such samples in all"
        )
        size = {"count": count, "share": count / about.count}
        findings.append(
            Finding("filled", SET_ASIDE, text, "leave such cells empty", channel, samples=samples, size=size)
        )
    return findings


def _straight(run: Run, channel: str, about: Channel) -> NDArray[np.intp]:
    """Sample numbers that lie on a line, many in a row; what repeats one value is a sensor's, not a line."""
    known = np.flatnonzero(~np.isnan(run[channel]))
    if len(known) < levels.FLAT + 2:
        return known[:0]
    t, y = run.times[known], run[channel][known]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    off = y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]
    on = (np.abs(off) < ON_LINE * about.noise) & (y[2:] != y[:-2])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    long = [b - a >= levels.FLAT and _noisy_beside(off, a, b, about.noise) for a, b in zip(starts, ends, strict=True)]
    rows = [np.arange(a, b) + 1 for a, b in zip(starts[long], ends[long], strict=True)]
    return known[np.concatenate(rows)] if rows else known[:0]


def _noisy_beside(off: Array, start: int, end: int, noise: float) -> bool:
    """Whether samples beside a stretch miss their line as noisy ones do."""
    beside = np.abs(np.concatenate([off[max(start - BESIDE, 0) : start], off[end : end + BESIDE]]))
    return len(beside) > 0 and float(np.median(beside)) > NOISY * noise


def _first_stretch(samples: tuple[int, ...]) -> int:
    """How many of the numbers follow each other from the first on."""
    gaps = np.flatnonzero(np.diff(samples) > 1)
    return int(gaps[0]) + 1 if len(gaps) else len(samples)
