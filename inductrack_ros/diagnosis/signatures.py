"""Forces of any shape as columns of a regression: bases over what a force may depend on, and the runs' responses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.effects.stand_in import basis
from ..core.state import COORDINATES, MOVING
from ..estimation.fit import Fit
from ..estimation.problem import Problem
from ..estimation.response import VARIABLES, RunResponse

__all__ = ["VARIABLES", "RunResponse", "basis", "in_coordinate", "knots", "moving_coordinates", "responses"]


def responses(problem: Problem, fit: Fit) -> list[RunResponse]:
    """`RunResponse` of every run at a fit."""
    return problem.for_runs(lambda i: problem.response(fit.structure, i, fit.theta, fit.states[i]))


def knots(responses: Sequence[RunResponse], variable: str, count: int) -> tuple[float, float] | None:
    """Start and spacing of ``count`` basis functions over the range a variable covers in all runs; None if it does not move."""
    values = np.concatenate([r.variables[variable] for r in responses])
    values = values[np.isfinite(values)]
    low, high = np.quantile(values, [0.001, 0.999]) if values.size else (0.0, 0.0)
    scale = max(abs(low), abs(high), 1e-9)
    if high - low < 1e-6 * scale:
        return None
    return float(low), float((high - low) / (count - 1))


def in_coordinate(coordinate: int, histories: np.ndarray) -> np.ndarray:
    """Force histories (n, 4, l) from those (n, l) of one coordinate."""
    forces = np.zeros((histories.shape[0], 4, histories.shape[1]))
    forces[:, coordinate] = histories
    return forces


def moving_coordinates(dof: int) -> list[int]:
    """Indices of the coordinates that move."""
    return [i for i, c in enumerate(COORDINATES) if c in MOVING[dof]]
