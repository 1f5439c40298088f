"""Refits from scratch side by side, over horizons that grow: what others beat over one does not start into the next.

Over a short horizon nothing has been thrown off yet and a refit costs next to nothing, so most of the field is gone before whole
runs, with their impacts and their instability, are simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..estimation.fit import Fit, Ladder, chi_square, fit, growing, rough_fit
from ..estimation.problem import Problem
from ..estimation.structure import Structure
from .smooth import covering, smoothed

#: Of a field in which none comes near the noise so many go on, of the others more; so many are refitted to convergence.
FEW, SEVERAL, BEST = 4, 8, 2
#: What another beats by so much in χ² over a horizon is not what is sought.
BEATEN = 25.0
#: Rough fits of the same effects this close in χ², and within a standard deviation in all parameters, are one.
SAME = 10.0
#: A weight of roughness by so much another is worth a refit.
OTHER = 5.0
#: Entries of a table that the data tell less than this part of the best known one about are not seen.
SEEN = 1e-3


@dataclass(frozen=True)
class Trial:
    """A set of effects, fitted: what it costs in χ² and in parameters."""

    fit: Fit
    names: tuple[str, ...]
    full: bool
    freedom: Mapping[str, float] = field(default_factory=dict)  # what that of each of its stand-ins costs in χ²

    @property
    def label(self) -> str:
        """Its effects, for people."""
        return " + ".join(self.names)

    @property
    def chi2(self) -> float:
        """χ² of all samples."""
        return self.fit.chi2

    @property
    def cost(self) -> float:
        """χ² and what the stand-ins' freedom costs."""
        return self.chi2 + sum(self.freedom.values())

    @property
    def stands_in(self) -> bool:
        """Whether a force of any shape is among its effects."""
        return any(n.startswith("stand_in") for n in self.names)


@dataclass(frozen=True)
class Start:
    """Where a refit begins: the effects, structure, theta and states, the price of the stand-ins' freedom, and a name for people."""

    names: tuple[str, ...]
    structure: Structure
    theta: np.ndarray
    states: Sequence[np.ndarray]
    freedom: Mapping[str, float]
    label: str


def race(
    problem: Problem,
    starts: Sequence[Start],
    spread: Callable[[Callable, Sequence], list],
    tell: Callable[[str], None],
    against: Trial | None = None,
) -> list[Trial]:
    """Trials over all of the runs, best first, from ``starts``.

    ``spread`` maps a task over the workers. A trial that is known already, ``against``, runs with them: what it beats is gone.

    Where the first of the few that are left, which left noise over one horizon, loses the runs before the next, they are taken there in
    smaller steps.
    """

    def begin(part: Problem, s: Start) -> Trial:
        first = rough_fit(part, s.structure, s.states, s.theta)
        if first.rough:
            first = min(first, rough_fit(part, s.structure, theta=s.theta), key=lambda f: f.chi2)
        return smooth(part, Trial(first, s.names, False, s.freedom), True)

    def go_on(part: Problem, t: Trial, settle: bool = True) -> Trial:
        if t.names[-1] in t.fit.structure.smoothness:
            structure, theta = covering(part, t.fit, t.names[-1])
            t = replace(t, fit=replace(t.fit, structure=structure, theta=theta))
        return smooth(part, replace(t, fit=rough_fit(part, t.fit.structure, t.fit.states, _continued(part, t.fit), settle)), settle)

    def smooth(part: Problem, t: Trial, settle: bool) -> Trial:
        """Its table as smooth as this much of the runs says: the beginnings tell less of a force's shape than all."""
        name = t.names[-1]
        if name not in t.fit.structure.smoothness or t.fit.hopeless:
            return t
        structure, price = smoothed(part, t.fit, name)
        t = replace(t, freedom={**t.freedom, name: price})
        if 1 / OTHER < structure.smoothness[name] / t.fit.structure.smoothness[name] < OTHER:
            return t
        return replace(t, fit=rough_fit(part, structure, t.fit.states, t.fit.theta, settle))

    def refine(t: Trial, iterations: int) -> Trial:
        return replace(t, fit=fit(problem, t.fit.structure, t.fit.states, _continued(problem, t.fit), iterations))

    field: list[Trial] = []
    ladder = Ladder(growing(problem) if starts else [])
    while ladder.horizons:
        horizon = ladder.horizons[0]
        part = problem.within(horizon)
        tell(_told(field or starts, horizon))
        settle = len(ladder.horizons) > 1 or len(field) <= FEW  # over whole runs it costs most
        if ladder.reached:
            arrived = spread(lambda t, part=part, settle=settle: go_on(part, t, settle), field)
        else:
            arrived = spread(lambda s, part=part: begin(part, s), starts)
        new = _ranked(arrived)
        first_lost = not new or new[0].fit.rough or not arrived[0].cost < new[0].cost + BEATEN
        if first_lost and 0 < len(field) <= FEW and (field[0].fit.leaves_noise or field[0].stands_in) and ladder.halved():  # a table may be coarse yet
            continue
        if new and new[0].fit.rough:
            new = _ranked(spread(lambda t, part=part: go_on(part, t), new[:FEW]))
        field = new
        if not field or field[0].fit.rough:  # none of them alone: longer horizons would only tell the same
            break
        best = min(field[0].cost, _cost_within(problem, against, horizon))
        field = [t for i, t in enumerate(_distinct(_near_noise(field))) if t.cost < best + BEATEN or not against and i < FEW]
        ladder.climb()
    field = _ranked({_kind(t): t for t in reversed(field)}.values())[:SEVERAL]
    if field:
        tell(_told(field, np.inf))
    if not field or field[0].fit.rough:  # lost; for more than what a next effect would promise beside them nobody needs it
        known_better = against and not against.fit.rough
        return [] if known_better else [replace(t, full=True) for t in _ranked(spread(lambda t: refine(t, 4), field[:BEST]))]
    for count, iterations in (SEVERAL, 4), (FEW, 10), (BEST, 30):
        field = _near_noise(field)
        field[:count] = _ranked(spread(lambda t, most=iterations: refine(t, most), field[:count]))
    return [replace(t, full=k < BEST) for k, t in enumerate(field)]


def _told(field: Sequence[Trial | Start], horizon: float) -> str:
    """Who is in the race, for people."""
    labels = list(dict.fromkeys(t.label for t in field))
    more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
    return f"{', '.join(labels[:3])}{more} over {f'{horizon:.2g} s' if np.isfinite(horizon) else 'all'} of each run"


def _cost_within(problem: Problem, trial: Trial | None, horizon: float) -> float:
    """What a trial costs over the beginnings of the runs; infinite where there is none."""
    if trial is None:
        return np.inf
    parts = zip(problem.runs, trial.fit.linear, strict=True)
    return sum(trial.freedom.values()) + sum(chi_square([part.residual[data.time <= horizon]]) for data, part in parts)


def _ranked(trials: Sequence[Trial]) -> list[Trial]:
    return sorted((t for t in trials if np.isfinite(t.chi2)), key=lambda t: t.cost)


def _near_noise(field: Sequence[Trial]) -> list[Trial]:
    """Those near the noise; the first few where none is."""
    return [t for t in field if not t.fit.rough] or list(field[:FEW])


def _kind(trial: Trial) -> tuple:
    """What a trial tries: its effects, and what the last of them depends on where it is a stand-in."""
    return trial.names, trial.fit.model.effects[trial.names[-1]].get("variable")


def _distinct(field: Sequence[Trial]) -> list[Trial]:
    """Without those that arrived where a better start of the same effects did."""
    found: list[Trial] = []
    for t in field:
        near = (o for o in found if _kind(o) == _kind(t) and len(o.fit.theta) == len(t.fit.theta) and t.chi2 < o.chi2 + SAME)
        if not any((np.abs(t.fit.theta - o.fit.theta) <= np.sqrt(np.diag(o.fit.covariance))).all() for o in near):
            found.append(t)
    return found


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
