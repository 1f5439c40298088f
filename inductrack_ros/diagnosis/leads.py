# SPDX-License-Identifier: Apache-2.0
"""Leads, for a model so far from the rig that more is missing than may be added.

Beside a plant that is shaken as much as such a rig seems to be, many effects explain a little. What tells them apart is
how well the runs are predicted from their starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimation.likelihood import Point
from ..estimation.shooting import fit
from ..estimation.structure import Structure
from .moves import State, Task, fitted_end_to_end, grown, screened, with_effects
from .screening import CandidateSet
from .settings import LEAD, REFIT_STEPS


def best_lead(task: Task, state: State) -> State | None:
    """The state with the known effect that predicts the runs best; None where it leaves more than the part `LEAD` of
    the open-loop error."""
    screening = screened(task, state)
    state = replace(state, rounds=(*state.rounds, (state.added, screening)))
    error, _ = _flown(task, state.fit.structure, state.fit.point)
    tried = [(one, *_with(task, state, one)) for one in screening.singles]
    for one, left, structure, point in sorted(tried, key=lambda t: t[1]):
        if not left < LEAD * error:
            break
        new = fit(task.problem, structure, point, REFIT_STEPS)
        if not new.lost:
            line = f"{one.members[0].name}: open-loop χ² per sample {error:.3g} -> {left:.3g}"
            return grown(state, one, screening.family, new).told(line)
    return None


def _with(task: Task, state: State, one: CandidateSet) -> tuple[float, Structure, Point]:
    """What an effect leaves of the open-loop error (χ² a sample), and the structure and point with which it does."""
    task.say(f"{one.members[0].name}, flown from the start")
    structure, point = with_effects(task.problem, state.fit, one)
    left, theta = _flown(task, structure, point)
    return left, structure, replace(point, theta=theta)


def _flown(task: Task, structure: Structure, point: Point) -> tuple[float, np.ndarray]:
    found = fitted_end_to_end(task, structure, point, range(len(task.problem.runs)))
    left = found.chi2 / task.problem.samples
    return left if np.isfinite(left) else np.inf, found.theta
