# SPDX-License-Identifier: Apache-2.0
"""A hum that the innovations of all channels show together: one that is slower than a cradle's motion may be hides in
each log, but not in what a fit leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from ..data.measurement import Array
from ..estimation.problem import Problem
from .settings import LEVEL

#: The spectrum is read at so many frequencies for each that a run of its length tells apart.
PADDED = 4
#: A hum turns so many times in the longest run at least: what turns less is a course, and physics makes those.
TURNS = 5


def humming(problem: Problem, whitened: Sequence[Array]) -> dict[str, float]:
    """Period (s) by channel that hums; ``whitened`` (m,) are each run's innovations, NaN where they do
    not count.

    The power of white noise at a frequency is an exponential variable, so that of all runs and channels together is a
    gamma variable. The strongest frequency is a hum where chance makes such a one in `LEVEL` of campaigns, all
    frequencies counted. The channels that show it are those in which chance makes it as seldom, all channels
    counted."""
    step = float(np.median(np.concatenate([np.diff(np.unique(d.time)) for d in problem.runs])))
    longest = max(float(np.ptp(d.time)) for d in problem.runs)
    size = PADDED * (round(longest / step) + 1)
    frequencies = np.fft.rfftfreq(size, step)
    power, count = np.zeros((len(problem.channels), len(frequencies))), np.zeros(len(problem.channels))
    for d, w in zip(problem.runs, whitened, strict=True):
        for c in np.unique(d.channel[np.isfinite(w)]):
            mine = (d.channel == c) & np.isfinite(w)
            placed = np.bincount(np.round((d.time[mine] - d.time[0]) / step).astype(int), w[mine])
            power[c] += np.abs(np.fft.rfft(placed, size)) ** 2 / max(float(w[mine] @ w[mine]), 1e-300)
            count[c] += 1
    asked = frequencies > TURNS / longest
    if not asked.any() or not count.any():
        return {}
    chances = stats.gamma.logsf(power.sum(axis=0), count.sum())[asked]
    best = int(np.argmin(chances))
    if chances[best] + np.log(asked.sum() / PADDED) > np.log(LEVEL):
        return {}
    own = stats.gamma.sf(power[:, asked][:, best], np.maximum(count, 1.0))
    period = 1.0 / float(frequencies[asked][best])
    return {c: period for c, p in zip(problem.channels, own, strict=True) if p * len(own) < LEVEL}
