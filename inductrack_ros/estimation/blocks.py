# SPDX-License-Identifier: Apache-2.0
"""Normal equations of blocks of columns (the entries of a table, a sine and a cosine), each alone beside the nuisance,
at several powers of the disturbances."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .kalman import Columns, LinearRun, log_determinant
from .problem import Problem
from .processes import augmented
from .scores import whitened, widened
from .shooting import Fit


@dataclass(frozen=True)
class Blocks:
    """What runs tell of c columns in blocks at one power, whitened.

    - nuisance: products of the residual and of the columns by theta, (1 + g, 1 + g)
    - cross: of these with all columns, (1 + g, c)
    - own: of each block's columns, (l, l)
    - tally: see `log_determinant`
    """

    nuisance: np.ndarray
    cross: np.ndarray
    own: tuple[np.ndarray, ...]
    tally: np.ndarray

    @classmethod
    def of(cls, w: np.ndarray, tally: np.ndarray, g: int, widths: Sequence[int]) -> Blocks:
        """From whitened columns (m, 1 + g + c) and the tally of their run."""
        known, more = w[:, : 1 + g], w[:, 1 + g :]
        own = tuple(part.T @ part for part in np.split(more, np.cumsum(widths)[:-1], axis=1))
        return cls(known.T @ known, known.T @ more, own, tally)

    @classmethod
    def together(cls, runs: Sequence[Blocks]) -> Blocks:
        """What several runs tell."""
        nuisance, cross, tally = (np.sum([getattr(r, n) for r in runs], axis=0) for n in ("nuisance", "cross", "tally"))
        return cls(nuisance, cross, tuple(np.sum(k, axis=0) for k in zip(*(r.own for r in runs), strict=True)), tally)

    @property
    def crosses(self) -> list[np.ndarray]:
        """Each block's part (1 + g, l) of ``cross``."""
        return np.split(self.cross, np.cumsum([len(own) for own in self.own])[:-1], axis=1)

    def gram(self, block: int) -> np.ndarray:
        """The products (1 + g + l, 1 + g + l) of residual, nuisance and one block."""
        cross = self.crosses[block]
        return np.block([[self.nuisance, cross], [cross.T, self.own[block]]])

    def projected(self, fit: Fit) -> tuple[list[tuple[np.ndarray, np.ndarray]], float]:
        """The normal equations (l, l) and (l,) of each block, the nuisance projected out, and the deviance without."""
        prior = fit.structure.precision
        b = -self.nuisance[1:, 0] + prior @ (fit.structure.centre - fit.theta)
        A = self.nuisance[1:, 1:] + prior
        inverse = np.linalg.pinv(A, rcond=1e-14, hermitian=True) if len(A) else np.zeros((0, 0))
        step = inverse @ b
        deviance = float(self.nuisance[0, 0] - b @ step) + log_determinant(self.tally)
        equations = [
            (own - B[1:].T @ inverse @ B[1:], -B[0] - B[1:].T @ step)
            for own, B in zip(self.own, self.crosses, strict=True)
        ]
        return equations, deviance


def blocks_of(
    problem: Problem,
    fit: Fit,
    systems: Sequence[LinearRun],
    powers: Sequence[np.ndarray],
    columns: Callable[[int], Columns] | None = None,
    widths: Sequence[int] = (),
) -> list[list[Blocks]]:
    """What each run tells at each power, beside a fit's processes, of ``columns`` in blocks of these ``widths``.

    A run's columns are made when it is its turn, and nothing is kept of them."""

    def one(i: int) -> list[Blocks]:
        wide = widened(systems[i], [columns(i)] if columns else [])
        system = augmented(problem, fit.structure, i, wide, fit.processes)
        return [Blocks.of(*whitened(problem, i, system, power), len(fit.theta), widths) for power in powers]

    return [list(at_power) for at_power in zip(*problem.for_runs(one), strict=True)]
