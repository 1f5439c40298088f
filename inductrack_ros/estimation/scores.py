# SPDX-License-Identifier: Apache-2.0
"""What further columns would explain at a fit: whitened scores at several powers of the disturbances.

A missing effect makes the plant look shaken, and a shaken plant hides it. So every question is asked at the power that
the fit found and at smaller ones, of all coordinates down to none and of each alone. Each answer may take the power
that suits it best. All of it is linear algebra on the normal equations of one linearisation, whatever the number of
runs and samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear

from ..core.state import COORDINATES
from .kalman import Columns, LinearRun, log_determinant, run_filter
from .likelihood import NO_POWER, tally
from .problem import Problem
from .processes import Process, augmented
from .shooting import Fit

#: Shares of the fitted power at which scores are taken; 0 is the deterministic plant.
SHARES = (1.0, 1e-1, 1e-2, 1e-4, 0.0)
#: The same for a choice among many starts of one effect.
TWO_SHARES = (1.0, 1e-2)
#: The share of one coordinate's power beside the whole of the others': what is missing there has passed for it.
ALONE = 1e-2
#: Prior standard deviation of a column's coefficient, in typical sizes.
WIDE = 300.0
#: A column that keeps less than this part of its square beside the others is one of them.
SEEN = 1e-9


@dataclass(frozen=True)
class Background:
    """A power (4,) of the disturbances and processes beside it, and what the processes cost by chance."""

    power: np.ndarray
    processes: tuple[Process, ...]
    price: float = 0.0


@dataclass(frozen=True)
class Level:
    """The normal equations at one power (4,) beside some processes: ``gram`` (1 + g + c, 1 + g + c) of residual,
    nuisance and columns, whitened, and the innovations' log determinant."""

    power: np.ndarray
    background: Background
    gram: np.ndarray
    log_determinant: float

    def suits(self, coordinate: str) -> bool:
        """Whether it is one for what is missing in a coordinate: not another's power alone is less than fitted."""
        others = np.array(COORDINATES) != coordinate
        less = self.power < self.background.power
        return bool(less[others].all() or not less[others].any())


@dataclass(frozen=True)
class Expected:
    """What some columns promise: the deviance with them (and the price of the processes), their coefficients (c,) and
    covariance (c, c), and the level that suits them."""

    deviance: float
    size: np.ndarray
    covariance: np.ndarray
    level: Level

    @property
    def background(self) -> Background:
        """The background that suits them."""
        return self.level.background


@dataclass(frozen=True)
class TableBeside:
    """A table beside c columns of something known, all nuisance projected out.

    - deviance: without the table
    - gram, score: the normal equations (l, l) and (l,) of its values
    - size: the columns' coefficients (c,) without it; moves: by how much each of its values lowers them (c, l)
    """

    deviance: float
    gram: np.ndarray
    score: np.ndarray
    size: np.ndarray
    moves: np.ndarray


@dataclass(frozen=True)
class Scores:
    """The scores of named columns at a fit; ``places`` has each name's columns among the c, ``bounds`` (c, 2) how far
    their coefficients may go."""

    nuisance: int
    prior: np.ndarray
    pull: np.ndarray
    places: Mapping[str, np.ndarray]
    levels: tuple[Level, ...]
    bounds: np.ndarray

    @cached_property
    def unbounded(self) -> Scores:
        """The same where the coefficients may go anywhere: what a test asks, and how well each is known."""
        return replace(self, bounds=np.full_like(self.bounds, np.inf) * [-1.0, 1.0])

    @cached_property
    def plain(self) -> float:
        """The deviance with none of them."""
        return self.expected(()).deviance

    def expected(self, names: Sequence[str]) -> Expected:
        """What a set of names promises together, at the power that suits it best."""
        chosen = np.concatenate([self.places[n] for n in names]).astype(int) if names else np.empty(0, int)
        free = sorted((self._at(level, chosen) for level in self.levels), key=lambda e: e.deviance)
        best = self._within(free[0], chosen)
        for e in free[1:]:
            if e.deviance >= best.deviance:  # within the bounds it promises no more than without
                break
            best = min(best, self._within(e, chosen), key=lambda x: x.deviance)
        return best

    def _system(self, level: Level, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal equations of the nuisance and the ``chosen`` columns at one level."""
        g = self.nuisance
        rows = np.concatenate([np.arange(1, 1 + g), 1 + g + chosen])
        A = level.gram[np.ix_(rows, rows)].copy()
        b = -level.gram[rows, 0]
        A[:g, :g] += self.prior
        b[:g] += self.pull
        A[g:, g:] += np.eye(len(chosen)) * WIDE**-2.0
        return A, b

    def _at(self, level: Level, chosen: np.ndarray) -> Expected:
        """What columns promise at one level if their coefficients may go anywhere."""
        A, b = self._system(level, chosen)
        size, covariance = _solved(A, b)
        g = self.nuisance
        deviance = float(level.gram[0, 0] - b @ size) + level.log_determinant + level.background.price
        return Expected(deviance, size[g:], covariance[g:, g:], level)

    def beside(self, level: Level, known: str, table: str) -> TableBeside:
        """The columns of a ``table`` at one level where those of something ``known`` are there too."""
        chosen = self.places[known]
        A, b = self._system(level, chosen)
        size, covariance = _solved(A, b)
        rows = np.concatenate([np.arange(1, 1 + self.nuisance), 1 + self.nuisance + chosen])
        mine = 1 + self.nuisance + self.places[table]
        cross = level.gram[np.ix_(rows, mine)]
        deviance = float(level.gram[0, 0] - b @ size) + level.log_determinant + level.background.price
        gram = level.gram[np.ix_(mine, mine)] - cross.T @ covariance @ cross
        moves = (covariance @ cross)[self.nuisance :]
        return TableBeside(deviance, gram, -level.gram[0, mine] - cross.T @ size, size[self.nuisance :], moves)

    def _within(self, e: Expected, chosen: np.ndarray) -> Expected:
        """The same within the coefficients' bounds."""
        low, high = self.bounds[chosen].T
        if ((e.size >= low) & (e.size <= high)).all():
            return e
        A, b = self._system(e.level, chosen)
        anywhere = np.full(self.nuisance, np.inf)
        size = _bounded(A, b, np.concatenate([-anywhere, low]), np.concatenate([anywhere, high]))
        deviance = float(e.level.gram[0, 0] - 2.0 * b @ size + size @ A @ size)
        deviance += e.level.log_determinant + e.background.price
        return replace(e, deviance=deviance, size=size[self.nuisance :])


def _bounded(A: np.ndarray, b: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The minimiser of a quadratic within bounds (Stark and Parker 1995), with A = RᵀR as the least squares of
    R x − R⁻ᵀ b."""
    unit, values, vectors = _modes(A)
    root = np.sqrt(np.maximum(values, SEEN * len(values)))
    wanted = vectors.T @ (b / unit) / root
    return lsq_linear(root[:, None] * vectors.T, wanted, (low * unit, high * unit), method="bvls").x / unit


def _modes(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The unit (n,) of each coordinate in which the matrix has ones on its diagonal, its eigenvalues there (n,), and
    its modes (n, n)."""
    unit = np.sqrt(np.maximum(np.diag(A), 1e-300))
    values, vectors = np.linalg.eigh(A / np.outer(unit, unit))
    return unit, values, vectors


def _solved(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The minimiser of a quadratic and the inverse of its matrix, both without what cannot be told apart."""
    unit, values, vectors = _modes(A)
    inverse = np.where(values > SEEN * len(values), 1.0 / np.maximum(values, 1e-300), 0.0)
    size = vectors @ (inverse * (vectors.T @ (b / unit))) / unit
    return size, (vectors * inverse) @ vectors.T / np.outer(unit, unit)


def scores(
    problem: Problem,
    fit: Fit,
    named: Mapping[str, Sequence[Columns]],
    systems: Sequence[LinearRun],
    backgrounds: Sequence[Background] = (),
    shares: Sequence[float] = SHARES,
    bounds: Mapping[str, np.ndarray] | None = None,
) -> Scores:
    """The scores at a fit of named columns, each given for every run.

    They are taken at these shares of the power and at one of each coordinate's alone, beside each of the backgrounds
    (the fit's own unless given).

    ``bounds`` (k, 2) of a name's coefficients, where they may not go anywhere."""
    places, end, limits = {}, 0, [np.empty((0, 2))]
    for name, parts in named.items():
        width = parts[0].data.shape[1]
        places[name], end = np.arange(end, end + width), end + width
        limits.append((bounds or {}).get(name, np.tile([-np.inf, np.inf], (width, 1))))
    structure, asked = fit.structure, list[tuple[Background, np.ndarray]]()
    for background in backgrounds or (Background(fit.power, fit.processes),):
        powers = shares_of(background.power, shares)
        powers += [p for c in COORDINATES for p in shares_in(background.power, c, (ALONE,))]
        asked += [(background, p) for k, p in enumerate(powers) if not any((p == q).all() for q in powers[:k])]

    def one(i: int) -> list[tuple[np.ndarray, np.ndarray]]:
        wide = widened(systems[i], [parts[i] for parts in named.values()])
        found = []
        for background, power in asked:
            w, lot = whitened(problem, i, augmented(problem, structure, i, wide, background.processes), power)
            found.append((w.T @ w, lot))
        return found

    found, levels = problem.for_runs(one), []
    for k, (background, power) in enumerate(asked):
        gram, tallies = (sum((run[k][part] for run in found), np.zeros(())) for part in (0, 1))
        levels.append(Level(power, background, gram, log_determinant(tallies)))
    pull = structure.precision @ (structure.centre - fit.theta)
    return Scores(len(fit.theta), structure.precision, pull, places, tuple(levels), np.concatenate(limits))


def whitened(problem: Problem, i: int, system: LinearRun, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All columns of run i whitened at a power, (m, 1 + g + c), 0 where a reading does not count, and the tally of its
    innovations."""
    filtered = run_filter(system, power, smooth=False)
    return filtered.scored(system), tally(problem, i, filtered, system)


def shares_of(power: np.ndarray, shares: Sequence[float]) -> list[np.ndarray]:
    """Shares of a power (4,), exactly 0 where nothing is left of it."""
    return [np.where(share * power > NO_POWER, share * power, 0.0) for share in shares]


def pushed_by(acts_on: str) -> str:
    """The coordinate that a force pushes which acts on one, or on the thrust."""
    return "surge" if acts_on == "thrust" else acts_on


def shares_in(power: np.ndarray, acts_on: str, shares: Sequence[float]) -> list[np.ndarray]:
    """Shares of the power of the coordinate that a force acts on (or the thrust), beside that of the others, (4,) each.

    A force that is missing looks like a disturbance of its own coordinate. The others are shaken as they are."""
    mine = np.array(COORDINATES) == pushed_by(acts_on)
    return [np.where(mine, share, power) for share in shares_of(power, shares)]


def widened(system: LinearRun, parts: Sequence[Columns]) -> LinearRun:
    """A linear run with more columns."""
    if not parts:
        return system
    more = Columns.beside(parts)
    mean = np.concatenate([system.start_mean, np.zeros((len(system.start_mean), more.data.shape[1]))], axis=1)
    return replace(
        system,
        data=np.concatenate([system.data, -more.data], axis=1),
        inputs=np.concatenate([system.inputs, more.inputs], axis=2),
        start_mean=mean,
    )
