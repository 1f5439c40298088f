# SPDX-License-Identifier: Apache-2.0
"""Least squares over all runs: global parameters and each run's initial state, by Levenberg–Marquardt.

The normal equations have an arrow's shape, for each run's initial state meets only its own samples. So the initial
states are eliminated run by run (Schur complement), and the step costs next to nothing beside the simulations. Where a
joint step falls short of its promise, each run's initial state is fitted anew beside the new parameters (variable
projection)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .problem import BOTH_SIDES, STATE_PRIOR, Linearisation, Problem
from .structure import Fitted, Structure

#: Residuals and derivatives (over noise) beyond this are those of a simulation that has left all bounds.
LOST = 1e12
#: Part of a large misfit's χ² that is not worth another step: nobody needs the wrong model's parameters to many digits.
COARSE = 1e-4
#: Damping above which a small step proves nothing; steps in a row that win nothing before a fit ends.
LOOSE, IDLE = 1e-3, 2
#: Steps of each run by itself after a joint step that fell short of its promise; after how many such steps, one damped
#: more than the other.
SETTLE, SETTLED = 4, 2
#: Relative error allowed in a stated noise level before its χ² counts as misfit, and standard deviations of χ² that are
#: still noise.
NOISE_TOLERANCE, NOISE = 0.02, 5.0
#: χ² of a sample that a late sensor's model cannot predict (before the run began): its expectation.
UNPREDICTED = 1.0


@dataclass(frozen=True)
class Fit(Fitted):
    """A fitted structure: theta (g,), initial states (8,) a run, χ² of all samples, covariance of theta (g, g)."""

    structure: Structure
    theta: np.ndarray
    states: tuple[np.ndarray, ...]
    chi2: float
    covariance: np.ndarray
    linear: tuple[Linearisation, ...]
    converged: bool

    @property
    def of_runs(self) -> np.ndarray:
        """χ² of each run."""
        return np.array([chi_square([part.residual]) for part in self.linear])

    @property
    def samples(self) -> int:
        """Number of samples compared."""
        return sum(len(part.residual) for part in self.linear)

    @property
    def leaves_noise(self) -> bool:
        """Whether χ² is what noise would leave, if its stated level may be a little wrong."""
        return self.chi2 < most_noise(self.samples)


def most_noise(samples: int) -> float:
    """The largest χ² of so many samples that is still noise, if its stated level may be a little wrong."""
    return float((1 + NOISE_TOLERANCE) ** 2 * (samples + NOISE * np.sqrt(2 * samples)))


def chi_square(residuals: Sequence[np.ndarray]) -> float:
    """χ² of residuals over noise; samples that cannot be predicted count their expectation, diverged runs infinity."""
    total = 0.0
    for r in residuals:
        missing = np.isnan(r)
        if missing.sum() > 0.2 * r.size:
            return np.inf
        total += float(r[~missing] @ r[~missing]) + UNPREDICTED * int(missing.sum())
    return total


def fit(
    problem: Problem,
    structure: Structure,
    states: Sequence[np.ndarray] | None = None,
    theta: np.ndarray | None = None,
    iterations: int = 30,
    tolerance: float = 0.02,
    settle: bool = False,
    sides: Sequence[float] = BOTH_SIDES,
) -> Fit:
    """Fit a structure's free parameters and every run's free initial states.

    Starts from ``theta`` and ``states`` where given (else the structure's own values and the first guess). Stops after
    ``iterations`` or when a step would gain less than ``tolerance`` in χ². With ``settle``, each run's initial state is
    fitted anew beside the new parameters wherever a step falls short: slower, and it arrives where the valleys are so
    curved that joint steps creep. ``sides`` as `Problem.linearise` takes them."""
    theta = structure.start.copy() if theta is None else np.array(theta, float)
    theta = np.clip(theta, *structure.bounds)
    states = [
        np.array(s if s is not None else d.guess)
        for s, d in zip(states or [None] * len(problem.runs), problem.runs, strict=True)
    ]
    damping, of_runs, converged, idle = 1e-3, np.full(len(states), 1e-3), False, 0
    linear = problem.linearise(structure, theta, states, sides)
    now = _point(problem, structure, theta, states, [part.residual for part in linear])
    for _ in range(iterations):
        accepted = False
        for attempt in range(8):
            try:
                proposed = _solve(problem, structure, linear, now, damping, of_runs)
            except np.linalg.LinAlgError:  # derivatives beyond all bounds: nothing to be had from here
                break
            gain = proposed[2]
            enough = tolerance + COARSE * max(now.cost - 2.0 * problem.samples, 0.0)
            if gain < enough and of_runs.max() > LOOSE:  # it may only be the damping that holds
                damping, of_runs = min(damping, LOOSE), np.minimum(of_runs, LOOSE)
                continue
            if gain < enough:
                converged = True
                break
            new, better = _moved(problem, structure, now, proposed, settle and attempt < SETTLED)
            good = (now.cost - new.cost) / gain
            ease = 0.1 if good > 0.5 else 0.5 if good > 0.0 else 1.0
            of_runs = np.where(better, np.maximum(ease * of_runs, 1e-9), 10.0 * of_runs)
            if new.cost < now.cost:
                accepted = True
                damping = max(ease * damping, 1e-9)
                break
            damping *= 10.0
        if converged or not accepted:
            converged = converged or np.isfinite(now.cost)
            break
        idle = idle + 1 if now.cost - new.cost < enough else 0
        converged = idle == IDLE
        now = new
        linear = problem.linearise(structure, now.theta, now.states, sides)
        if converged:
            break
    chi2 = chi_square([part.residual for part in linear])
    return Fit(structure, now.theta, tuple(now.states), chi2, _covariance(structure, linear), tuple(linear), converged)


#: A step of theta (g,) and of each run's initial state (8,), and the fall in cost that it promises.
Proposed = tuple[np.ndarray, list[np.ndarray], float]


@dataclass(frozen=True)
class _Point:
    """Where a fit stands: ``each`` (runs,) is χ² of each run and of its initial state's prior, ``cost`` all of it and
    theta's."""

    theta: np.ndarray
    states: list[np.ndarray]
    residuals: list[np.ndarray]
    each: np.ndarray
    cost: float


def _point(
    problem: Problem,
    structure: Structure,
    theta: np.ndarray,
    states: list[np.ndarray],
    residuals: list[np.ndarray] | None = None,
) -> _Point:
    residuals = problem.residuals(structure, theta, states) if residuals is None else residuals
    prior = [((x - d.guess) / STATE_PRIOR)[d.free_states] for x, d in zip(states, problem.runs, strict=True)]
    each = np.array([chi_square([r]) + p @ p for r, p in zip(residuals, prior, strict=True)])
    return _Point(theta, states, residuals, each, float(each.sum()) + structure.surprise(theta))


def _moved(
    problem: Problem, structure: Structure, now: _Point, proposed: Proposed, settle: bool
) -> tuple[_Point, np.ndarray]:
    """The point a step further, and which runs (runs,) fared better for moving.

    Where the step falls short of the ``gain`` it promises (curved valleys), a run that fares better where it was stays
    there; with ``settle`` each is fitted anew from the better of the two.
    """
    step, local, gain = proposed
    theta = np.clip(now.theta + step, *structure.bounds)
    moved = _point(problem, structure, theta, [x + dx for x, dx in zip(now.states, local, strict=True)])
    if now.cost - moved.cost > 0.5 * gain:
        return moved, np.ones(len(now.states), bool)
    stayed = _point(problem, structure, theta, now.states)
    better = moved.each < stayed.each
    states = [a if b else x for a, x, b in zip(moved.states, stayed.states, better, strict=True)]
    if settle and len(theta):
        states = _settled(problem, Structure(structure.with_theta(theta), ()), states)
        return _point(problem, structure, theta, states), better
    residuals = [a if b else x for a, x, b in zip(moved.residuals, stayed.residuals, better, strict=True)]
    return _point(problem, structure, theta, states, residuals), better


def within_bounds(part: Linearisation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of one run that are within all bounds: residual, derivatives by theta and by the free states."""
    every = np.column_stack([part.residual, part.by_theta, part.by_state])
    rows = (np.abs(every) < LOST).all(axis=1)  # not where NaN
    return part.residual[rows], part.by_theta[rows], part.by_state[rows]


def _settled(problem: Problem, held: Structure, states: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Initial states after some steps of each run by itself, nothing else being free."""

    def task(i: int) -> np.ndarray:
        return fit(problem.subset([i]), held, [states[i]], iterations=SETTLE, tolerance=0.1, sides=(1.0,)).states[0]

    return problem.for_runs(task)


def _solve(
    problem: Problem,
    structure: Structure,
    linear: Sequence[Linearisation],
    now: _Point,
    damping: float,
    of_runs: np.ndarray,
) -> Proposed:
    """The step, theta damped by ``damping``, the states of each run by ``of_runs`` (runs,). Raises `LinAlgError`."""
    theta, g = now.theta, len(now.theta)
    low, high = structure.bounds
    A = structure.precision.copy()
    b = A @ (structure.centre - theta)
    runs = []
    for data, part, x, own in zip(problem.runs, linear, now.states, of_runs, strict=True):
        r, G, X = within_bounds(part)
        f = part.free_states
        weight = STATE_PRIOR[f] ** -2.0
        C = X.T @ X + np.diag(weight)
        d = X.T @ r + weight * (data.guess - x)[f]
        runs.append((C, G.T @ X, d, f, own))
        A += G.T @ G
        b += G.T @ r
    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        raise np.linalg.LinAlgError("a simulation left all bounds")
    held = np.zeros(g, bool)
    held[structure.held] = True
    for _ in range(g + 1):  # parameters that would leave their range are held at its edge
        S, s = A.copy(), b.copy()
        solved = []
        for C, B, d, _, own in runs:
            Cd = C + own * np.diag(np.diag(C))
            inverse = np.linalg.solve(Cd, np.column_stack([B.T, d]))
            solved.append(inverse)
            S = S - B @ inverse[:, :g]
            s = s - B @ inverse[:, g]
        told = np.diag(S) - np.diag(structure.precision)  # not the prior's: a stiff table would hardly move as a whole
        S += damping * np.diag(np.maximum(told, 1e-12 * np.diag(A)))
        free = ~held
        step = np.zeros(g)
        if free.any():
            step[free] = np.linalg.lstsq(S[np.ix_(free, free)], s[free], rcond=1e-13)[0]
        out = ((theta + step < low) & (theta <= low + 1e-12)) | ((theta + step > high) & (theta >= high - 1e-12))
        if not (out & free).any():
            break
        held |= out
    local, gain = [], 2.0 * b @ step - step @ A @ step
    for (C, B, d, f, _), inverse in zip(runs, solved, strict=True):
        dx = inverse[:, g] - inverse[:, :g] @ step
        gain += 2.0 * d @ dx - dx @ C @ dx - 2.0 * step @ B @ dx
        full = np.zeros(8)
        full[f] = dx
        local.append(full)
    return step, local, gain


def _covariance(structure, linear) -> np.ndarray:
    """Covariance of theta with the initial states estimated beside it."""
    g = len(structure.free)
    A = structure.precision.copy()
    for part in linear:
        _, G, X = within_bounds(part)
        C = X.T @ X + np.diag(STATE_PRIOR[part.free_states] ** -2.0)
        A += G.T @ G - (G.T @ X) @ np.linalg.solve(C, X.T @ G)
    covariance = np.zeros((g, g))
    if free := [k for k in range(g) if k not in structure.held]:
        covariance[np.ix_(free, free)] = np.linalg.pinv(A[np.ix_(free, free)], rcond=1e-15, hermitian=True)
    return covariance
