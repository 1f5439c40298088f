"""Refits from scratch side by side, over horizons that grow: what others beat over one does not start into the next.

Over a short horizon nothing has been thrown off yet and a refit costs next to nothing, so most of the field is gone before whole
runs, with their impacts and their instability, are simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.fit import Fit, chi_square, fit, growing
from ..estimation.problem import Problem
from ..estimation.structure import Structure

#: Of a field in which none comes near the noise so many go on, of the others more; so many are refitted to convergence.
FEW, SEVERAL, BEST = 4, 8, 2
#: What another beats by so much in χ² over a horizon is not what is sought.
BEATEN = 25.0
#: Horizons are never closer than this (s).
LEAST = 0.06
#: Entries of a table that the data tell less than this part of the best known one about are not seen.
SEEN = 1e-3


@dataclass(frozen=True)
class Trial:
    """A set of effects, fitted: what it costs in χ² and in parameters."""

    fit: Fit
    names: tuple[str, ...]
    full: bool
    occam: float = 0.0  # what its stand-ins' freedom costs

    @property
    def label(self) -> str:
        """Its effects, for people."""
        return " + ".join(self.names)

    @property
    def chi2(self) -> float:
        """χ² of all samples."""
        return self.fit.chi2

    @property
    def stands_in(self) -> bool:
        """Whether a force of any shape is among its effects."""
        return any(n.startswith("stand_in") for n in self.names)


@dataclass(frozen=True)
class Start:
    """Where a refit begins: the effects, structure and theta, the price of a stand-in's freedom, and a name for people."""

    names: tuple[str, ...]
    structure: Structure
    theta: np.ndarray
    occam: float
    label: str


def race(problem: Problem, starts: Sequence[Start], spread: Callable[[Callable, Sequence], list], tell: Callable[[str], None]) -> list[Trial]:
    """Trials over all of the runs, best first, from ``starts``; ``spread`` maps a task over the workers.

    Where the few that are left lose the runs between one horizon and the next, they are taken there in smaller steps.
    """

    def begin(part: Problem, s: Start) -> Trial:
        return Trial(fit(part, s.structure, None, s.theta, 8, tolerance=1.0, settle=True), s.names, False, s.occam)

    def go_on(part: Problem, t: Trial, settle: bool = True) -> Trial:
        return replace(t, fit=fit(part, t.fit.structure, t.fit.states, _continued(part, t.fit), 8, tolerance=1.0, settle=settle))

    def refine(t: Trial, iterations: int) -> Trial:
        return replace(t, fit=fit(problem, t.fit.structure, t.fit.states, _continued(problem, t.fit), iterations))

    field: list[Trial] = []
    reached, horizons = 0.0, growing(problem)
    while horizons:
        part = problem.within(horizons[0])
        tell(_told(field or starts, horizons[0]))
        settle = len(horizons) > 1 or len(field) <= FEW  # over whole runs it costs most
        if reached:
            new = _ranked(spread(lambda t, part=part, settle=settle: go_on(part, t, settle), field))
        else:
            new = _ranked(spread(lambda s, part=part: begin(part, s), starts))
        if new and new[0].fit.rough:
            if field and len(field) <= FEW and horizons[0] - reached > LEAST:
                horizons.insert(0, 0.5 * (reached + horizons[0]))
                continue
            new = _ranked(spread(lambda t, part=part: go_on(part, t), new[:FEW]))
        field = new
        if not field or field[0].fit.rough:  # none of them alone: longer horizons would only tell the same
            break
        best = _cost(field[0])
        field = [t for i, t in enumerate(_near_noise(field)) if i < FEW or _cost(t) < best + BEATEN]
        reached = horizons.pop(0)
    field = _ranked({(t.names, t.fit.model.effects[t.names[-1]].get("variable")): t for t in reversed(field)}.values())[:SEVERAL]
    if field:
        tell(_told(field, np.inf))
    lost = not field or field[0].fit.rough
    for count, iterations in ((FEW, 4), (BEST, 10)) if lost else ((SEVERAL, 4), (FEW, 10), (BEST, 30)):
        field = _near_noise(field)
        field[:count] = _ranked(spread(lambda t, most=iterations: refine(t, most), field[:count]))
    return [replace(t, full=k < BEST) for k, t in enumerate(field)]


def _told(field: Sequence[Trial | Start], horizon: float) -> str:
    """Who is in the race, for people."""
    labels = list(dict.fromkeys(t.label for t in field))
    more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
    return f"{', '.join(labels[:3])}{more} over {f'{horizon:.2g} s' if np.isfinite(horizon) else 'all'} of each run"


def _cost(trial: Trial) -> float:
    return trial.chi2 + trial.occam


def _ranked(trials: Sequence[Trial]) -> list[Trial]:
    return sorted((t for t in trials if np.isfinite(t.chi2)), key=_cost)


def _near_noise(field: Sequence[Trial]) -> list[Trial]:
    """Those near the noise; the first few where none is."""
    return [t for t in field if not t.fit.rough] or list(field[:FEW])


def _continued(problem: Problem, f: Fit) -> np.ndarray:
    """Theta to go on from over a longer horizon: the tables as they are or constant beyond what the data have seen, whichever predicts better."""
    if not f.structure.tables:
        return f.theta
    theta = f.theta.copy()
    for columns in f.structure.tables.values():
        told = sum(np.nansum(part.by_theta[:, columns] ** 2, axis=0) for part in f.linear)
        seen = np.flatnonzero(told > SEEN * told.max())
        if seen.size:
            nearest = seen[np.abs(np.arange(len(columns))[:, None] - seen).argmin(axis=1)]
            theta[columns] = f.theta[columns][nearest]
    return min(f.theta, theta, key=lambda t: chi_square(problem.residuals(f.structure, t, f.states)))
