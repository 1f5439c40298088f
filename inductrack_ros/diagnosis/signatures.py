"""Forces of any shape as columns of a regression: bases over what a force may depend on, and the runs' responses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.effects.stand_in import basis
from ..core.state import COORDINATES, MOVING
from ..estimation.fit import Fit
from ..estimation.problem import Problem
from ..estimation.response import VARIABLES, RunResponse

__all__ = ["VARIABLES", "RunResponse", "basis", "acts_on", "in_words", "knots", "responses"]


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


def acts_on(runs: Sequence[RunResponse], dof: int) -> dict[str, tuple[str, ...]]:
    """What a force of any shape may act on in these runs, each with the variables it may depend on.

    A share of the thrust is more than a force only where runs were driven differently, and depends on more than the drive.
    """
    found = {c: VARIABLES for c in COORDINATES if c in MOVING[dof]}
    drives = {r.data.run.drive_current if r.data.averaged else 0.0 for r in runs}
    if "surge" in found and len(drives) > 1:
        found["thrust"] = tuple(v for v in VARIABLES if v != "drive")
    return found


def in_words(what: str, variable: str) -> str:
    """``force in heave on surge``."""
    return f"{'share of the thrust' if what == 'thrust' else f'force in {what}'} on {variable}"
