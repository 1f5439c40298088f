# SPDX-License-Identifier: Apache-2.0
"""The run that tells the most of one parameter, where nothing else is open (c-optimal design), or two such runs.

To first order: a run of the menu adds to what the fit knows the information that its readings have of the parameters,
with its own initial state fitted too. Of runs that do almost as well the gentlest is taken."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ..estimation.problem import Problem
from ..estimation.shooting import Fit
from . import experiment
from .experiment import MenuRun
from .result import Proposal

#: A gentler run is taken where it leaves the parameter no more than this share wider than the best.
GENTLER = 1.1
#: Two different runs are proposed where they do better than the best one made twice by this factor.
WORTH_TWO = 0.9


def sharpen(
    problem: Problem, at_once: Callable[[Callable, Sequence], list], f: Fit, name: str
) -> tuple[str, Proposal] | None:
    """The run, or two, that would determine a free parameter ``name`` of the fit best; in words and in numbers. None
    where no run of the menu is within the rig's limits and off the track."""
    limits, k = problem.limits, f.structure.free.index(name)
    runs = [run for batch in experiment.batches(replace(limits, contact=False)) for run in batch]
    told = at_once(lambda run: information(problem, f, run), runs)
    known = np.linalg.pinv(f.covariance, hermitian=True)
    made = [(run, M) for run, M in zip(runs, told, strict=True) if M is not None]
    if not made:
        return None

    def left(*more: np.ndarray) -> float:
        return float(np.sqrt(np.linalg.pinv(known + sum(more), hermitian=True)[k, k]))

    def value(deviation: float) -> float:
        return f.structure.spread(f.theta, np.where(np.arange(len(f.theta)) == k, deviation, 0.0))[name]

    singles = [left(M) for _, M in made]
    first = next(i for i, s in enumerate(singles) if s <= GENTLER * min(singles))
    pairs = {(i, j): left(made[i][1], made[j][1]) for i, j in combinations(range(len(made)), 2)}
    best = min(pairs.values(), default=np.inf)
    twice = min(left(M, M) for _, M in made)
    now, then = f.deviations[name], value(singles[first])
    one = made[first][0].proposal({}, {name: then})
    said = f"{one.words}: would bring the standard deviation of {name} from {now:.2g} to {then:.2g}"
    if not best < WORTH_TWO * twice:
        return said, one
    i, j = next(pair for pair, s in pairs.items() if s <= GENTLER * best)
    after = {name: value(pairs[i, j])}
    two = replace(made[i][0].proposal({}, after), second=made[j][0].proposal({}))
    return f"{said}; two runs, {two.words}: to {after[name]:.2g}", two


def information(problem: Problem, f: Fit, run: MenuRun) -> np.ndarray | None:
    """What a run of the menu tells of theta, (g, g): the inverse of the covariance that it alone would leave. None
    where there is no such run within the limits, off the track."""
    made = experiment.made_run(problem, f.model, run)
    if made is None:
        return None
    (linear,) = made.linearise(f.structure, f.theta, [made.runs[0].guess])
    there = np.logical_and(np.isfinite(linear.by_theta).all(axis=1), np.isfinite(linear.by_state).all(axis=1))
    by_theta, by_state = linear.by_theta[there], linear.by_state[there]
    if by_state.shape[1]:
        scale = np.maximum(np.linalg.norm(by_state, axis=0), 1e-300)
        basis = np.linalg.qr(by_state / scale)[0]
        by_theta = by_theta - basis @ (basis.T @ by_theta)
    return by_theta.T @ by_theta
