# SPDX-License-Identifier: Apache-2.0
"""Single bad readings that the fitted model shows and the look at the data could not: beside a contact and at a run's
ends a blow might have done it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..checks import SET_ASIDE, Finding
from ..data.campaign import Campaign
from ..estimation.kalman import LinearRun
from ..estimation.likelihood import maximise_evidence
from ..estimation.problem import Problem, RunData
from ..estimation.shooting import Fit, linearise_all

#: A reading so many standard deviations off is a spike: noise has one in a billion readings. More than this part are
#: none, nor is one whose neighbours are off by this part of it without it.
SPIKE, MOST_SPIKES, ALONE = 6.0, 0.03, 0.5
#: Half of a normal variable's values are within so many standard deviations.
HALF = 0.6745


def outlying(problem: Problem, base: Fit, campaign: Campaign, before: Sequence[Finding] = ()) -> tuple[Finding, ...]:
    """Single readings that no noise and no motion explains, by channel, and those found ``before``, which the fit did
    not see any more. Such a reading is far from what all others say of it, while those before and after are not.

    The numbers of the samples are those in ``campaign``."""
    systems = linearise_all(problem, base)
    off = _deleted_residuals(problem, base, systems)
    peaks = [_peaks(data, size) for data, size in zip(problem.runs, off, strict=True)]
    if not any(p.any() for p in peaks):
        return tuple(before)
    muted = [s.muted(p) for s, p in zip(systems, peaks, strict=True)]
    rest = _deleted_residuals(problem, base, muted)
    alone = [
        p & (_beside(data, r) < ALONE * size) for data, p, size, r in zip(problem.runs, peaks, off, rest, strict=True)
    ]
    times = {run.name: run.times for run in campaign.runs}
    known = {f.channel: f for f in before}
    for c, channel in enumerate(problem.channels):
        samples = dict(known[channel].samples) if channel in known else {}
        for data, a in zip(problem.runs, alone, strict=True):
            if (mine := a & (data.channel == c)).any():
                name = data.run.name
                numbers = np.searchsorted(times[name], data.time[mine]).tolist()
                samples[name] = tuple(sorted({*samples.get(name, ()), *numbers}))
        total = sum(int((data.channel == c).sum()) for data in problem.runs)
        count = sum(map(len, samples.values()))
        if 0 < count < MOST_SPIKES * total:
            known[channel] = _finding(channel, samples, count, total)
    return tuple(known.values())


def _finding(channel: str, samples: Mapping[str, tuple[int, ...]], count: int, total: int) -> Finding:
    many = f"{count} outliers" if count > 1 else "one outlier"
    text = f"{channel} has {many} that the model shows, for neither noise nor motion explains so much"
    size = {"count": count, "share": count / total}
    return Finding("outliers", SET_ASIDE, text, channel=channel, samples=samples, size=size)


def _deleted_residuals(problem: Problem, base: Fit, systems: Sequence[LinearRun]) -> list[np.ndarray]:
    """How far each reading (m,) of each run is from what all others say of it (auxiliary residuals, de Jong and Penzer
    1998).

    The unit is a standard deviation, or what is usual in the channel and run where that is more."""
    smooth = maximise_evidence(problem, base.structure, systems, base.point, 1).smooth
    found = []
    for data, s in zip(problem.runs, smooth, strict=True):
        off = np.sqrt(s.of_readings[0] / np.maximum(s.of_readings[1], 1e-300))
        for c in np.unique(data.channel):
            mine = data.channel == c
            off[mine] /= max(1.0, float(np.median(off[mine])) / HALF)
        found.append(off)
    return found


def _peaks(data: RunData, size: np.ndarray) -> np.ndarray:
    """Readings (m,) beyond `SPIKE` that no neighbour in their channel exceeds."""
    return (size > SPIKE) & (size >= _beside(data, size))


def _beside(data: RunData, size: np.ndarray) -> np.ndarray:
    """The larger of the sizes (m,) of the readings before and after each, in its channel."""
    found = np.zeros(len(size))
    for c in np.unique(data.channel):
        mine = np.flatnonzero(data.channel == c)
        found[mine] = np.maximum(np.append(0.0, size[mine[:-1]]), np.append(size[mine[1:]], 0.0))
    return found
