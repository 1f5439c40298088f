# SPDX-License-Identifier: Apache-2.0
"""Leads, for a model so far from the rig that more is missing than may be added.

Beside a plant that is shaken as much as such a rig seems to be, many effects explain a little. What tells them apart is
how well the runs are predicted from their starts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..estimation import fit as end_to_end
from ..estimation.likelihood import Point
from ..estimation.problem import Problem
from ..estimation.shooting import fit
from .moves import State, Task, fitted_end_to_end, grown, screened, with_effects
from .screening import CandidateSet
from .settings import LEAD, REFIT_STEPS, TWINS


def best_lead(task: Task, state: State, rival: State | None = None) -> State | None:
    """The state with the known effect that predicts the runs best, ``far`` where that leaves more than noise; None
    where it leaves more than the part `LEAD` of the open-loop error, or costs hardly less than a ``rival``, and where
    that leaves no more than noise.

    Each parameter costs what it does by Schwarz's criterion, the size of the error being unknown: log(n), against
    n log(error). Errors of a wrong model last, so n counts those that are independent."""
    against = fitted_end_to_end(task, rival.fit.structure, rival.fit.point) if rival else None
    if against and against.leaves_noise:
        return None
    screening = screened(task, state)
    state = replace(state, rounds=(*state.rounds, (state.added, screening)))
    plain = fitted_end_to_end(task, state.fit.structure, state.fit.point)
    independent = _independent(task.problem, plain)
    error = _left(task.problem, plain)

    def cost(tried: end_to_end.Fit) -> float:
        return independent * np.log(_left(task.problem, tried)) + len(tried.theta) * np.log(max(independent, 1.0))

    most = cost(against) if against else np.inf
    tried = [f for f in (_with(task, state, one) for one in screening.singles) if f.left < LEAD * error]
    for f in sorted((f for f in tried if cost(f.fit) < most - TWINS), key=lambda f: cost(f.fit)):
        new = fit(task.problem, f.fit.structure, replace(f.point, theta=f.fit.theta), REFIT_STEPS)
        if not new.lost:
            line = f"{f.one.title}: open-loop χ² per sample {error:.3g} -> {f.left:.3g}"
            found = grown(state, f.one, screening.family, new).told(line)
            return replace(found, far=not f.fit.leaves_noise)
    return None


@dataclass(frozen=True)
class Flown:
    """The runs flown from their starts with one more effect: the point it began at, the fit from end to end, and what
    is left (χ² a sample)."""

    one: CandidateSet
    point: Point
    fit: end_to_end.Fit
    left: float


def _with(task: Task, state: State, one: CandidateSet) -> Flown:
    task.say(f"{one.title}, flown from the start")
    structure, point = with_effects(task.problem, state.fit, one)
    found = fitted_end_to_end(task, structure, point)
    return Flown(one, point, found, _left(task.problem, found))


def _left(problem: Problem, found: end_to_end.Fit) -> float:
    left = found.chi2 / problem.samples
    return left if np.isfinite(left) else np.inf


def _independent(problem: Problem, found: end_to_end.Fit) -> float:
    """How many of the errors are independent, by how much neighbours are alike (of an autoregression of first
    order)."""
    number = 0.0
    for data, part in zip(problem.runs, found.linear, strict=True):
        for c in range(len(problem.channels)):
            r = part.residual[(data.channel == c) & np.isfinite(part.residual)]
            alike = float(r[1:] @ r[:-1]) / max(float(r @ r), 1e-300) if len(r) > 1 else 0.0
            number += len(r) * (1.0 - abs(alike)) / (1.0 + abs(alike))
    return number
