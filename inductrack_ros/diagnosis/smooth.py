"""How smooth a table of forces should be: as smooth as makes the data most probable, its values integrated out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from ..core.effects.stand_in import VARIABLES, basis
from ..core.state import INDEX, STATES
from ..estimation.fit import Fit
from ..estimation.problem import Problem
from ..estimation.structure import ENDS, Structure, roughness
from .gate import Projector

#: Weights of roughness tried, relative to the data's weight on the table.
WEIGHTS = np.logspace(-9, 9, 37)
#: A table that is too short is laid so much of its length longer than it must be.
MARGIN = 0.1


@dataclass(frozen=True)
class Smooth:
    """A table's values (l,), the weight of its roughness, twice the log evidence it promises over none, and ``occam``, the part of the
    fall in χ² that its freedom alone would have bought."""

    values: np.ndarray
    weight: float
    promise: float
    occam: float


def smoothest(effect: str, columns: np.ndarray, residual: np.ndarray, local: bool = False) -> Smooth:
    """The table of a stand-in whose columns (N, l), what each value does to the measurements over noise, explain a residual (N,) best.

    That of a ``local`` force is none at its ends.
    """
    return smoothest_of(effect, columns.T @ columns, columns.T @ residual, local)


def smoothest_of(effect: str, whole: np.ndarray, told: np.ndarray, local: bool = False) -> Smooth:
    """The same from the normal equations (l, l) and (l,) of the columns."""
    free = slice(ENDS, -ENDS) if local else slice(None)
    gram, score = whole[free, free].copy(), told[free]
    unit = max(np.trace(gram) / len(gram), 1e-12)  # where no run has been at all, any will do
    gram += np.diag(np.full(len(gram), 1e-12 * unit))  # nothing is known where no run has been
    plain, bent = (roughness(effect, len(told), weight)[free, free] for weight in (0.0, 1.0))
    bent = bent - plain
    bends = np.linalg.eigvalsh(bent)
    best = max((_with_weight(gram, score, unit * w, plain, bent, bends) for w in WEIGHTS), key=lambda s: s.promise)
    return replace(best, values=np.pad(best.values, ENDS)) if local else best


def _with_weight(gram: np.ndarray, score: np.ndarray, weight: float, plain: np.ndarray, bent: np.ndarray, bends: np.ndarray) -> Smooth:
    """With the prior ``plain`` + weight ``bent``, whose eigenvalues ``bends`` are, at one weight."""
    prior = plain + weight * bent
    try:
        factor = linalg.cho_factor(gram + prior)
    except (linalg.LinAlgError, ValueError):  # responses beyond all bounds: nothing can be had from them
        return Smooth(np.zeros(len(gram)), weight, -np.inf, np.inf)
    values = linalg.cho_solve(factor, score)
    told = 2 * np.log(np.diag(factor[0])).sum() - np.log(plain[0, 0] + weight * np.maximum(bends, 0.0)).sum()
    return Smooth(values, weight, float(values @ score - told), max(float(values @ prior @ values), 0.0) + max(float(told), 0.0))


def smoothed(problem: Problem, fit: Fit, effect: str) -> tuple[Structure, float]:
    """A fit's structure with the smoothness of a stand-in's table as the data that were fitted say, and that table's ``occam``."""
    table = fit.structure.tables[effect]
    project = Projector(problem, fit, leave=table)
    scale = fit.structure.scale[table]
    columns = project(project.stack([part.by_theta[:, table] / scale for part in fit.linear]))
    best = smoothest(effect, columns, project.residual + columns @ (fit.theta[table] * scale), effect in fit.structure.local)
    return replace(fit.structure, smoothness={**fit.structure.smoothness, effect: best.weight}), best.occam


def covering(problem: Problem, fit: Fit, effect: str) -> tuple[Structure, np.ndarray]:
    """A fit's structure and theta with a stand-in's table laid anew, as it was and straight on, where the runs go beyond it."""
    table = fit.model.effects[effect]
    start, step, count = table["start"], table["step"], int(table["knots"])
    end = start + (count - 1) * step
    seen = _histories(problem, fit, VARIABLES[int(table["variable"])])
    low, high = np.quantile(seen, [0.001, 0.999]) if seen.size else (start, end)
    if low > start - step and high < end + step:
        return fit.structure, fit.theta
    low, high = min(low - MARGIN * (end - low), start), max(high + MARGIN * (high - start), end)
    u = np.linspace(low, high, 10 * count)
    inner = np.clip(u, start + 2 * step, end - 2 * step)  # the last of the splines fade out
    value, further = (basis(x, start, step, count) @ np.array(table["values"])[:count] for x in (inner, inner + 0.1 * step))
    shape = value + (further - value) / (0.1 * step) * (u - inner)
    wider = float((high - low) / (count - 1))
    coefficients = np.linalg.lstsq(basis(u, low, wider, count), shape, rcond=1e-6)[0]
    effects = {**fit.structure.model.effects, effect: {**fit.structure.model.effects[effect], "start": float(low), "step": wider}}
    structure, theta = replace(fit.structure, model=fit.structure.model.with_changes(effects=effects)), fit.theta.copy()
    mine = fit.structure.tables[effect]
    theta[mine] = coefficients / fit.structure.scale[mine]
    return structure, theta


def _histories(problem: Problem, fit: Fit, variable: str) -> np.ndarray:
    """What a variable goes through in all runs; empty where it is none of the states, whose range is known from the start."""
    if variable not in STATES:
        return np.empty(0)

    def task(i: int) -> np.ndarray:
        return problem.simulate(fit.structure, i, fit.theta[None], fit.states[i][None])[0][:, INDEX[variable]]

    values = np.concatenate(problem.for_runs(task))
    return values[np.isfinite(values)]
