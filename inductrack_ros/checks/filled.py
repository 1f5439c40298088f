# SPDX-License-Identifier: Apache-2.0
"""Stretches that run in a straight line although the channel is noisy: filled in where nothing was measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.state import COORDINATES, GAPS
from ..data import Campaign, Run
from ..data.measurement import Array
from ..data.stretches import stretches
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, place, quantity
from .noise_found import Channel

#: A sample is on the line through its neighbours to this part of the noise: of noisy samples one in thirty is.
ON_LINE = 0.05
#: So many samples beside a stretch miss their line by this part of the noise, typically.
BESIDE, NOISY = 16, 0.3


def filled(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding for each place and gap of which some stretch was interpolated. What hangs on forces may be noisy now
    and calm then."""
    findings = []
    for channel, about in channels.items():
        if channel not in (*COORDINATES, *GAPS) or not about.resolved or 4.0 * about.step > ON_LINE * about.noise:
            continue
        lines = [
            (run, rows) for run in campaign.runs if channel in run.channels for rows in _lines(run, channel, about)
        ]
        if not lines:
            continue
        run, rows = lines[0]
        samples = as_samples({r.name: np.concatenate([n for q, n in lines if q.name == r.name]) for r, _ in lines})
        count = sum(map(len, samples.values()))
        text = (
            f"{channel} runs in a straight line for {len(rows)} samples from {place(run, int(rows[0]))}, where its"
            f" noise is {quantity(channel, about.noise)}: filled in where nothing was measured; {count} such samples in"
            " all"
        )
        size = {"count": count, "share": count / about.count}
        findings.append(
            Finding("filled", SET_ASIDE, text, "leave such cells empty", channel, samples=samples, size=size)
        )
    return findings


def _lines(run: Run, channel: str, about: Channel) -> list[NDArray[np.intp]]:
    """Sample numbers of each stretch that lies on a line; what repeats one value is a sensor's, not a line."""
    known = np.flatnonzero(~np.isnan(run[channel]))
    if len(known) < levels.FLAT + 2:
        return []
    t, y = run.times[known], run[channel][known]
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    off = y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:]
    on = (np.abs(off) < ON_LINE * about.noise) & (y[2:] != y[:-2])
    return [
        known[a + 1 : b + 1] for a, b in stretches(on) if b - a >= levels.FLAT and _noisy_beside(off, a, b, about.noise)
    ]


def _noisy_beside(off: Array, start: int, end: int, noise: float) -> bool:
    """Whether samples beside a stretch miss their line as noisy ones do."""
    beside = np.abs(np.concatenate([off[max(start - BESIDE, 0) : start], off[end : end + BESIDE]]))
    return len(beside) > 0 and float(np.median(beside)) > NOISY * noise
