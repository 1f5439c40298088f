"""A misfit that no effect explains: which coordinate, what it depends on, its shape, and a smooth stand-in.

Every coordinate and variable is tried with a force of any smooth shape, first to first order (`signatures`), then the best in full
simulation as a ``stand_in_*`` effect, whose table is refined where the force acts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.effects.stand_in import TABLE
from ..core.state import COORDINATES
from ..estimation.fit import fit
from .gate import Projector
from .search import Search, Trial
from .signatures import VARIABLES, RunResponse, basis, in_coordinate, moving_coordinates, responses

#: Intervals of the table that every variable is tried with, and the finer ones for the most promising; each is
#: also halved again and again, which costs nothing more.
INTERVALS, FINER, FINEST = 24, 48, 160
#: Shapes refitted in full simulation.
FULL = 3
#: A force below this part of its peak counts as none, and a table that is mostly none is laid anew over the rest.
ACTIVE, ZOOM = 0.05, 0.4


@dataclass(frozen=True)
class Shape:
    """A force in ``coordinate`` on ``variable`` as a table, with the penalised fall in χ² it promises."""

    coordinate: str
    variable: str
    start: float
    step: float
    values: np.ndarray
    promise: float

    @property
    def name(self) -> str:
        """Name of the stand-in effect."""
        return f"stand_in_{self.coordinate}"

    @property
    def parameters(self) -> dict[str, object]:
        """Its parameters."""
        return {
            "variable": float(VARIABLES.index(self.variable)),
            "start": self.start,
            "step": self.step,
            "knots": float(len(self.values)),
            "values": tuple(float(v) for v in self.values),
        }


def shapes(search: Search, trial: Trial) -> list[Shape]:
    """Every coordinate and variable with the table size that suits it, most promising first."""
    problem, f = search.problem, trial.fit
    runs = responses(problem, f)
    project = Projector(problem, f)
    taken = {n for n in trial.names if n.startswith("stand_in")}
    found = []
    for coordinate in moving_coordinates(problem.dof):
        if f"stand_in_{COORDINATES[coordinate]}" not in taken:
            for variable in VARIABLES:
                if (span := _span(runs, variable)) is not None:
                    intervals = 6 if variable == "drive" else INTERVALS
                    found.append(_linear(runs, project, coordinate, variable, *span, intervals))
    found.sort(key=lambda s: -s.promise)
    for i, shape in enumerate(found[: 2 * FULL]):
        finest = FINEST if shape.variable in ("surge", "time") else FINER
        if len(shape.values) > INTERVALS and shape.variable != "drive":
            span = _span(runs, shape.variable)
            finer = _linear(runs, project, COORDINATES.index(shape.coordinate), shape.variable, *span, finest)
            found[i] = max(shape, finer, key=lambda s: s.promise)
    return sorted(found, key=lambda s: -s.promise)


def _span(runs: Sequence[RunResponse], variable: str) -> tuple[float, float] | None:
    values = np.concatenate([r.variables[variable] for r in runs])
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    low, high = np.quantile(values, [0.001, 0.999])
    return (float(low), float(high)) if high - low > 1e-6 * max(abs(low), abs(high), 1e-9) else None


def _linear(runs, project, coordinate, variable, low, high, intervals) -> Shape:
    """The table that fits the residual best to first order, lightly ridged, and its fall in χ² less log N a coefficient.

    The table has ``intervals`` of them or a half, a quarter … of that, whichever promises most.
    """
    step = (high - low) / intervals
    fine = project(project.stack([r.respond(in_coordinate(coordinate, basis(r.variables[variable], low, step, intervals + 1))) for r in runs]))
    gram, score = fine.T @ fine, fine.T @ project.residual
    u = np.linspace(low, high, 4 * intervals + 1)
    best: Shape | None = None
    while intervals >= 3:
        size = (high - low) / intervals
        # A coarser table's columns are combinations of the finest one's.
        mix = np.linalg.lstsq(basis(u, low, step, len(gram)), basis(u, low, size, intervals + 1), rcond=None)[0]
        g, s = mix.T @ gram @ mix, mix.T @ score
        values = np.linalg.solve(g + 1e-6 * np.trace(g) / len(g) * np.eye(len(g)) + 1e-300 * np.eye(len(g)), s)
        fall = float(2 * values @ s - values @ g @ values)
        shape = Shape(COORDINATES[coordinate], variable, low, size, values, fall - len(g) * np.log(len(project.residual)))
        if best is None or shape.promise > best.promise:
            best = shape
        intervals //= 2
    return best


def stand_ins(search: Search, trial: Trial, limit: int = FULL) -> list[Trial]:
    """The trial with a stand-in, for the most promising shapes, refitted in full simulation; best first."""
    candidates = shapes(search, trial)[:limit]
    done = [t for t in search._map(lambda s: _refit(search, trial, s), candidates) if t is not None]
    done = [_zoomed(search, trial, t) for t in done[:1]] + done[1:] if done else done
    return sorted(done, key=lambda t: penalised(search, t))


def _refit(search: Search, trial: Trial, shape: Shape) -> Trial | None:
    search.tell(" + ".join([*trial.names, f"any force in {shape.coordinate} on {shape.variable}"]))
    structure = trial.fit.structure.plus(shape.name, shape.parameters, free=[f"values[{i}]" for i in range(len(shape.values))])
    theta = structure.start.copy()
    theta[: len(trial.fit.theta)] = trial.fit.theta
    best = None
    for scale in (1.0, 0.0):  # from the first-order shape, or from nothing where that leads astray
        start = theta.copy()
        start[len(trial.fit.theta) :] *= scale
        new = fit(search.single, structure, trial.fit.states, start, iterations=8, tolerance=2.0, reuse=trial.fit.linear)
        if np.isfinite(new.chi2) and (best is None or new.chi2 < best.chi2):
            best = new
        if best is not None and best.chi2 < trial.chi2:
            break
    if best is None:
        return None
    final = fit(search.single, structure, best.states, best.theta, iterations=4, tolerance=1.0)
    return Trial(final, (*trial.names, shape.name), True)


def _zoomed(search: Search, base: Trial, trial: Trial) -> Trial:
    """The stand-in laid anew where its force acts, if that is a small part of the range."""
    name = next(n for n in trial.names if n.startswith("stand_in"))
    table = trial.fit.model.effects[name]
    count = int(table["knots"])
    u = table["start"] + np.arange(0, count - 1, 0.1) * table["step"]
    force = basis(u, table["start"], table["step"], count) @ np.array(table["values"])
    force = force - np.median(force)
    on = np.abs(force) > ACTIVE * np.abs(force).max()
    if count < 12 or on.mean() > ZOOM:
        return trial
    low, high = u[on].min() - 2 * table["step"], u[on].max() + 2 * table["step"]
    if high - low > 0.8 * (u[-1] - u[0]):
        return trial
    best = trial
    for finer in (12, 24, 40):
        step = (high - low) / (finer - 1)
        if finer > TABLE or step > table["step"]:
            continue
        x = low + np.arange(finer) * step
        values = np.interp(x, u, force)
        shape = Shape(name.removeprefix("stand_in_"), VARIABLES[int(table["variable"])], float(low), float(step), values, 0.0)
        new = _refit(search, base, shape)
        if new is not None and penalised(search, new) < penalised(search, best):
            best = new
    return best


def penalised(search: Search, trial: Trial) -> float:
    """χ² plus what its effects cost: log N a parameter, and twice the log of how many rivals each was picked from."""
    n = np.log(trial.fit.samples)
    extra = len(trial.fit.theta) - len(search.base.theta)
    picked = sum(2 * np.log(4 * len(VARIABLES) if e.startswith("stand_in") else 45) for e in trial.names)
    return trial.chi2 + n * extra + picked
