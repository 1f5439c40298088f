# SPDX-License-Identifier: Apache-2.0
"""The likelihood of all runs as linear systems, and the disturbances and processes that make it greatest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .kalman import Filtered, LinearRun, Smoothed, log_determinant, run_filter, run_smoother
from .problem import STATE_PRIOR, Problem
from .processes import Process, augmented, of_variances, resized, variances
from .run_model import RunModel
from .structure import Structure

#: Greatest power of the disturbances (m²/s³, rad²/s³).
ROUGHEST = 1e6
#: Below this power of an acceleration a disturbance moves nothing that any sensor of the package could see in an hour.
NO_POWER = 1e-14
#: The power falls by no more than this in a step, so that the trajectories can follow (continuation).
FALL = 1e-3
#: Length of a step of the power's logarithm over its ratio's where that is ``FAR_ABOVE`` (below this), and at the most.
REACH, LONGEST_REACH, FAR_ABOVE = 3.0, 8.0, -0.7
#: One that falls below this part of itself is still on its way.
RESTING = 0.3
#: What is expected of a disturbance of which no reading tells.
UNTOLD = 1e-300
#: A step that changes the deviance by less than this has converged.
TOLERANCE = 0.5


class Lost(ArithmeticError):
    """A point about which the runs lead beyond all numbers: nothing can be weighed there."""


@dataclass(frozen=True)
class Point:
    """Where a fit stands: theta (g,), each run's trajectory (n, N), the disturbances' power (4,), the processes beside
    them, and whether contact is taken ``exactly`` (see `exactly`)."""

    theta: np.ndarray
    paths: tuple[np.ndarray, ...]
    power: np.ndarray
    processes: tuple[Process, ...] = ()
    exact: bool = False


@dataclass(frozen=True)
class Evidence:
    """What the data say at a point: twice the negative log likelihood, whitened residuals of each run and their columns
    by theta."""

    deviance: float
    chi2: float
    whitened: tuple[np.ndarray, ...]
    filtered: tuple[Filtered, ...]
    step: np.ndarray
    covariance: np.ndarray


def evidence_of(
    problem: Problem, structure: Structure, systems: Sequence[LinearRun], theta: np.ndarray, power: np.ndarray
) -> Evidence:
    """The likelihood of linear runs at a power of the disturbances, theta's best step (g,) within its bounds, and its
    covariance (g, g). Raises `Lost`."""
    shaken = np.where(power > NO_POWER, power, 0.0)
    filtered = tuple(problem.for_runs(lambda i: run_filter(systems[i], shaken)))
    g = len(theta)
    A, b = structure.precision.copy(), structure.precision @ (structure.centre - theta)
    whitened = [f.scored(system) for f, system in zip(filtered, systems, strict=True)]
    led = all(np.isfinite(system.inputs[:-1]).all() for system in systems)
    if not led or not all(np.isfinite(w).all() for w in whitened):
        raise Lost
    tallies = [tally(problem, i, f, system) for i, (f, system) in enumerate(zip(filtered, systems, strict=True))]
    for w in whitened:
        A += w[:, 1:].T @ w[:, 1:]
        b -= w[:, 1:].T @ w[:, 0]
    step, free = _bounded(A, b, theta, structure)
    left = tuple(w[:, 0] + w[:, 1:] @ step for w in whitened)
    chi2 = sum(float(r @ r) for r in left)
    covariance = np.zeros((g, g))
    if free.any():
        covariance[np.ix_(free, free)] = np.linalg.pinv(A[np.ix_(free, free)], rcond=1e-15, hermitian=True)
    deviance = chi2 + structure.surprise(theta + step) + log_determinant(sum(tallies, np.zeros(())))
    return Evidence(deviance, chi2, left, filtered, step, covariance)


def tally(problem: Problem, i: int, filtered: Filtered, system: LinearRun) -> np.ndarray:
    """What `log_determinant` needs of run i, (5, channels)."""
    return filtered.tally(system, problem.runs[i].channel, len(problem.channels))


def _bounded(A: np.ndarray, b: np.ndarray, theta: np.ndarray, structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """The minimiser of a quadratic within theta's bounds by an active set, and which entries are free (g,)."""
    low, high = structure.bounds
    free = np.ones(len(theta), bool)
    free[structure.held] = False
    step = np.zeros(len(theta))
    for _ in range(len(theta) + 1):
        step[~free & (step == 0.0)] = 0.0
        if free.any():
            step[free] = np.linalg.lstsq(
                A[np.ix_(free, free)], b[free] - A[np.ix_(free, ~free)] @ step[~free], rcond=1e-14
            )[0]
        over = free & ((theta + step < low) | (theta + step > high))
        if not over.any():
            break
        step[over] = np.clip(theta + step, low, high)[over] - theta[over]
        free &= ~over
    return step, free


@dataclass(frozen=True)
class MostLikely:
    """Linear runs with the disturbances that suit them: their power (4,) and processes, what the data say there, where
    they lead, and by how much other variances would lower the deviance (``to_gain``)."""

    power: np.ndarray
    processes: tuple[Process, ...]
    systems: tuple[LinearRun, ...]
    evidence: Evidence
    smooth: tuple[Smoothed, ...]
    next_power: np.ndarray
    next_processes: tuple[Process, ...]
    to_gain: float


def maximise_evidence(
    problem: Problem, structure: Structure, plain: Sequence[LinearRun], point: Point, passes: int, follow: bool = False
) -> MostLikely:
    """The disturbances' power and the processes' sizes that make linear runs about a point most likely.

    A fixed-point iteration of all variances in their logarithm (MacKay 1992), its steps lengthened as the last two tell
    (secant). With ``follow`` it ends where a variance is so far from its place that the trajectories have to follow
    first."""
    moving = problem.model.moving > 0.0
    power, processes, before, last = np.maximum(point.power, NO_POWER), point.processes, None, np.inf
    n_states = plain[0].transitions.shape[1]
    for left in reversed(range(passes)):
        systems = tuple(problem.for_runs(lambda i, p=processes: augmented(problem, structure, i, plain[i], p)))
        evidence = evidence_of(problem, structure, systems, point.theta, power)
        smooth = tuple(problem.for_runs(lambda i, s=systems, e=evidence: run_smoother(s[i], e.filtered[i], e.step)))
        here = np.concatenate([power, variances(processes)])
        found, expected = found_and_expected(problem, processes, power, smooth, n_states)
        ratio = np.clip(np.log(found) - np.log(expected), -50.0, 50.0)
        there = next_variances(here, ratio, before)
        told_of = moving & (expected[:4] > UNTOLD)
        next_power = np.where(told_of, np.clip(there[:4], NO_POWER, ROUGHEST), NO_POWER)
        next_processes = resized(processes, there[4:])
        there = np.concatenate([next_power, variances(next_processes)])
        if not left or abs(last - evidence.deviance) < TOLERANCE or follow and (there < RESTING * here).any():
            break
        power, processes, before, last = next_power, next_processes, (here, ratio), evidence.deviance
    movable = ~np.isclose(there, here, rtol=1e-6, atol=0.0)  # what is at its least or most stays
    gain = to_gain(found[movable], expected[movable])
    return MostLikely(power, processes, systems, evidence, smooth, next_power, next_processes, gain)


def found_and_expected(
    problem: Problem, processes: Sequence[Process], power: np.ndarray, smooth: Sequence[Smoothed], n_states: int
) -> np.ndarray:
    """What the data show of each disturbance and process, and what its variance would make them show, (2, 4 + p); equal
    at the likeliest. The second is how many of its values the data tell."""
    of_power = np.sum([s.of_power for s in smooth], axis=0) * power
    of_processes = of_variances(problem, processes, smooth, n_states)
    return np.maximum(np.concatenate([of_power, of_processes], axis=1), UNTOLD)


def to_gain(found: np.ndarray, expected: np.ndarray) -> float:
    """By how much the likeliest variances would lower the deviance, as those of n values would: n (r − 1 − log r) for a
    ratio r of found to expected. No more than n (1 − r) where they fall: what is told of a variance falls with it."""
    r = np.clip(found / expected, 1e-50, 1e50)
    return float(np.sum(expected * np.where(r < 1.0, np.minimum(1.0 - r, r - 1.0 - np.log(r)), r - 1.0 - np.log(r))))


def next_variances(values: np.ndarray, ratio: np.ndarray, before: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """Variances nearer to the likeliest from the log ``ratio`` of found to expected, and that ``before`` at others,
    where there was one."""
    reach = np.where(ratio < FAR_ABOVE, REACH, 1.0)
    if before is not None:
        moved, change = np.log(values / before[0]), before[1] - ratio
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = moved / change
        reach = np.where(np.isfinite(secant) & (secant > 0), np.clip(secant, 1.0, LONGEST_REACH), reach)
    return values * np.exp(np.clip(reach * ratio, np.log(FALL), -np.log(FALL)))


@dataclass(frozen=True)
class Misses:
    """What a run's trajectory leaves: ``readings`` (m,) over noise, ``defects`` (n − 1, 8) between its nodes, and
    ``start`` (f,), how far its free initial states are from where they were guessed."""

    readings: np.ndarray
    defects: np.ndarray
    start: np.ndarray


Beside = tuple[np.ndarray, np.ndarray]


def misses(run: RunModel, theta: np.ndarray, path: np.ndarray, beside: Beside) -> Misses:
    """What a run leaves on a trajectory (n, N); ``beside`` is what processes add to its readings (m,) and to the way to
    the next node (n, N)."""
    data = run.data
    outputs, ends = run.pieces(path, theta[None])
    if not np.isfinite(ends).all():
        outputs, ends = np.full_like(outputs, np.inf), np.full_like(ends, np.inf)
    left = (data.y - run.read(outputs, theta[None])[0]) / run.sigma
    defects = path[1:, :8] - ends[:-1, 0, :8] - beside[1][:-1, :8]
    free = data.free_states
    return Misses(left - beside[0], defects, path[0, free] - data.guess[free])


def linear_misses(run: RunModel, system: LinearRun, step: np.ndarray, moved: np.ndarray, beside: Beside) -> Misses:
    """What the linear run (without the processes' states) says of `misses` after a step of theta and of the states
    (n, A)."""
    data, active = run.data, run.model.active_states
    node = np.repeat(np.arange(len(moved)), np.diff(system.first))
    left = system.data[:, 0] + system.data[:, 1:] @ step
    left = left - np.einsum("ma,ma->m", system.sensitivity, moved[node]) - beside[0]
    left[~system.known] = np.nan
    led = system.inputs[:, :, 0] + system.inputs[:, :, 1:] @ step + np.einsum("nab,nb->na", system.transitions, moved)
    defects, own = np.zeros((len(moved) - 1, 8)), active < 8
    defects[:, active[own]] = (moved[1:] - led[:-1])[:, own]
    start = np.zeros(8)
    start[active[own]] = (system.start_mean[:, 0] * -1.0 + moved[0])[own]
    return Misses(left, defects - beside[1][:-1, :8], start[data.free_states])


def cost(problem: Problem, i: int, left: Misses, power: np.ndarray, system: LinearRun) -> float:
    """What run i costs: residuals over noise, defects over what the disturbances explain, and its start, squared.

    The ``system`` has the readings' variances and the kicks."""
    total = float(np.nansum(left.readings**2 / system.variance))
    T = np.diff(problem.runs[i].grid)
    for c in np.flatnonzero(problem.model.moving):
        place, rate = left.defects[:, c], left.defects[:, 4 + c]
        q, kicks = max(power[c], NO_POWER), system.kicks[:-1, 4 + c]
        a, b, d = q * T**3 / 3.0, q * T**2 / 2.0, q * T + kicks
        with np.errstate(invalid="ignore"):  # a trajectory that leaves all bounds has infinite defects
            total += float(np.sum((d * place**2 - 2.0 * b * place * rate + a * rate**2) / (a * d - b**2)))
    total += float(np.sum((left.start / STATE_PRIOR[problem.runs[i].free_states]) ** 2))
    return total if np.isfinite(total) else np.inf
