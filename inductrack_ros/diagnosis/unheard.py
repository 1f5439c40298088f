# SPDX-License-Identifier: Apache-2.0
"""Readings at which a sensor with some effect would not respond: one at the end of its range says only that the
coordinate is at least there.

A trajectory that was fitted to such readings follows them, so the effect shows nothing of itself there. It is told by
what the data want without these readings (censored data)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..estimation.kalman import MUTE, LinearRun
from ..estimation.likelihood import evidence_of
from ..estimation.problem import Problem
from ..estimation.processes import augmented
from ..estimation.run_model import RunModel
from ..estimation.scores import SHARES, Background
from ..estimation.shooting import Fit, fit, outputs_of
from ..estimation.structure import Structure

#: A coordinate that may be off by so many sigmas is not heard where the sensor shows less than this part of that. The
#: trajectory says where, not the readings: those at the end of a range are the ones with the largest noise.
REACH, HEARD = 3.0, 0.9


def unheard(problem: Problem, f: Fit, name: str, start: Mapping[str, float]) -> tuple[np.ndarray, ...]:
    """By run, the readings (m,) of a sensor's channel that it would not respond to with an effect at these values."""
    plain = Structure(f.model, ())
    faulty, mine = plain.plus(name, start, ()), problem.channels.index(name.partition(":")[2])

    def one(i: int) -> np.ndarray:
        data, none = problem.runs[i], np.zeros((1, 0))
        outputs, own = outputs_of(problem, f, i), np.flatnonzero(data.channel == mine)
        shown = []
        for side in (-REACH, REACH):
            moved = outputs[:, None].copy()
            moved[data.row[own], 0, data.column[own]] += side * problem.sigma[mine]
            shown.append(RunModel(problem, faulty, i).read(moved, none)[0][own])
        found = np.zeros(len(data.y), bool)
        found[own] = shown[1] - shown[0] < HEARD * 2.0 * REACH * problem.sigma[mine]
        return found

    return tuple(problem.for_runs(one))


def promised(
    problem: Problem, f: Fit, systems: Sequence[LinearRun], dead: Sequence[np.ndarray], price: float
) -> tuple[float, Background]:
    """The deviance without these readings, each of which costs what noise would, at the power that suits best, and the
    background there; ``price`` is what its processes cost by chance."""
    muted = [s.muted(d) for s, d in zip(systems, dead, strict=True)]
    full = problem.for_runs(lambda i: augmented(problem, f.structure, i, muted[i], f.processes))
    powers = [share * f.power for share in SHARES]
    deviances = [evidence_of(problem, f.structure, full, f.theta, power).deviance for power in powers]
    best = int(np.argmin(deviances))
    scored = sum(int((d & s.scored).sum()) for s, d in zip(muted, dead, strict=True))
    muting = sum(float(np.log(MUTE) * (d & s.charged).sum()) for s, d in zip(muted, dead, strict=True))
    return deviances[best] - muting + scored + price, Background(powers[best], f.processes, price)


def without(problem: Problem, f: Fit, dead: Sequence[np.ndarray], steps: int) -> Fit:
    """The fit that these readings have no part in."""
    variances = tuple(np.where(d, MUTE, problem.variance(i)) for i, d in enumerate(dead))
    return fit(problem.with_changes(variances=variances), f.structure, f.point, steps)
