"""A misfit that no effect explains: which coordinate, what it depends on, its shape, and a smooth stand-in.

All that a force may act on and depend on is tried with one of any smooth shape, first to first order (`signatures`), then the best in full
simulation as a ``stand_in_*`` effect, whose table is refined where the force acts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.effects.stand_in import ACTS_ON
from ..estimation.fit import Fit, fit, fit_from_scratch
from ..estimation.structure import ENDS, Structure
from .gate import Projector
from .look import Look
from .race import Start, Trial
from .search import ALIKE, Search
from .signatures import VARIABLES, RunResponse, acts_on, basis, in_words, responses
from .smooth import smoothest

#: Intervals of the table that every variable is tried with, and of the finer one along the track and in time.
INTERVALS, FINEST = 32, 160
#: Shapes refitted in full simulation, and how often the best is laid anew.
FULL, REFINEMENTS = 3, 2
#: Shapes that promise less than this part of the best are not refitted.
CLOSE = 0.8
#: A first-order shape that reaches so many weights, or times the thrust, is far from any truth, and too stiff to simulate: not a place to start.
ABSURD = 20.0
#: A force below this part of its peak counts as none, and a table that is mostly none is laid anew over the rest.
ACTIVE, ZOOM = 0.05, 0.4
#: A table's curve is looked at so often in each of its intervals.
PER_STEP = 10


@dataclass(frozen=True)
class Shape:
    """A force that ``acts_on`` a coordinate or the thrust, on ``variable``, as a table, with twice the log evidence it promises over none.

    ``weight`` is that of its roughness, ``occam`` the part of the fall in χ² that its freedom alone would have bought.
    """

    acts_on: str
    variable: str
    start: float
    step: float
    values: np.ndarray
    promise: float
    weight: float
    occam: float

    @property
    def name(self) -> str:
        """Name of the stand-in effect."""
        return f"stand_in_{self.acts_on}"

    @property
    def label(self) -> str:
        """The shape in words."""
        return f"any {in_words(self.acts_on, self.variable)}"

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


def shapes(look: Look, sizes: Callable[[str], Sequence[int]]) -> list[Shape]:
    """All that a force may act on and depend on, with that of the ``sizes`` of its table that suits it, most promising first."""
    runs = look.responses
    spans = {v: span for v in VARIABLES if (span := _span(runs, v)) is not None}
    tables = [(v, *span, n) for v, span in spans.items() for n in sizes(v)]
    laws: dict[tuple[str, str], Shape] = {}
    for what, variables in acts_on(runs, look.problem.dof).items():
        if f"stand_in_{what}" not in look.fit.structure.effects:
            for shape in _linear(runs, look.project, look.project.residual, what, [t for t in tables if t[0] in variables]):
                law = what, shape.variable
                laws[law] = max(laws.get(law, shape), shape, key=lambda s: s.promise)
    found = sorted(laws.values(), key=lambda s: -s.promise)
    best = [_zoomed(runs, look.project, look.project.residual, s) for s in found[:FULL]]
    return [s for s in best if s.promise > max(CLOSE * best[0].promise, 0.0)]


def _sizes(variable: str) -> tuple[int, ...]:
    """Intervals of a variable's table: what changes along the track or in time may change often."""
    return {"drive": (6,), "surge": (INTERVALS, FINEST), "time": (INTERVALS, FINEST)}.get(variable, (INTERVALS,))


def _span(runs: Sequence[RunResponse], variable: str) -> tuple[float, float] | None:
    """Range of a variable: all that its sensor saw where it has one (a simulation may be thrown far off), else the simulated."""
    values = np.concatenate([r.measured(variable) for r in runs])
    if not values.size:
        values = np.concatenate([r.variables[variable] for r in runs])
        values = values[np.isfinite(values)]
    if not values.size:
        return None
    low, high = np.quantile(values, [0.001, 0.999])
    return (float(low), float(high)) if high - low > 1e-6 * max(abs(low), abs(high), 1e-9) else None


def _linear(runs, project, residual, what, tables) -> list[Shape]:
    """To first order, the smooth table that fits a residual best for each of ``tables`` (variable, low, high, intervals)."""
    blocks = [basis_of(runs, v, low, (high - low) / n, n + 1) for v, low, high, n in tables]
    edges = np.cumsum([0] + [b[0].shape[1] for b in blocks])
    responded = [r.respond(r.forces(what, np.hstack([b[i] for b in blocks]))) for i, r in enumerate(runs)]
    columns = project(project.stack(responded))
    shapes_ = []
    for (variable, low, high, n), a, b in zip(tables, edges[:-1], edges[1:], strict=True):
        best = smoothest(f"stand_in_{what}", columns[:, a:b], residual)
        shapes_.append(Shape(what, variable, low, (high - low) / n, best.values, best.promise, best.weight, best.occam))
    return shapes_


def basis_of(runs: Sequence[RunResponse], variable: str, start: float, step: float, count: int) -> list[np.ndarray]:
    """Basis functions (n, count) of a variable along each run."""
    return [basis(r.variables[variable], start, step, count) for r in runs]


def _zoomed(runs, project, residual, shape: Shape) -> Shape:
    """The shape laid anew where its force acts, if that is a small part of the range."""
    count = len(shape.values)
    u = shape.start + np.linspace(0, count - 1, PER_STEP * count) * shape.step
    force = basis(u, shape.start, shape.step, count) @ shape.values
    force -= np.median(force)
    on = np.abs(force) > ACTIVE * np.abs(force).max()
    if not on.any() or on.mean() > ZOOM:
        return shape
    low, high = u[on].min() - 2 * shape.step, u[on].max() + 2 * shape.step
    table = (shape.variable, float(low), float(high), INTERVALS)
    return max(shape, *_linear(runs, project, residual, shape.acts_on, [table]), key=lambda s: s.promise)


def stand_ins(search: Search, trial: Trial) -> list[Trial]:
    """The trial with a stand-in, for the most promising shapes, refitted in full simulation; best first."""
    rough = trial.fit.rough
    if rough:
        found: dict[tuple[str, str], Start] = {}
        for look in [*search.near(trial), search.look(trial)]:
            found = {(s.acts_on, s.variable): _start(trial, s, look.fit) for s in shapes(look, lambda v: _sizes(v)[-1:])} | found
        done = search.race(list(found.values()))
    else:
        done = [t for t in search.map(lambda s: _refit(search, trial, s), shapes(search.look(trial), _sizes)) if t is not None]
    done.sort(key=lambda t: penalised(search, t))
    for k in range(REFINEMENTS if done else 0):
        finer = _refit(search, trial, _relaid(search, done[0]), done[0])
        first_guess = rough and not k  # its smoothness was chosen from the beginnings of the runs
        if finer is None or not first_guess and penalised(search, finer) > penalised(search, done[0]) - 1.0:
            break
        done[0] = finer
    if done and not done[0].fit.hopeless and (local := localised(search, done[0])) and penalised(search, local) < penalised(search, done[0]):
        done[0] = local
    for t in done[:1]:
        search.keep(t)
    return done


def _relaid(search: Search, trial: Trial) -> Shape:
    """The last stand-in's shape anew from where it stands: finer where it must be, as smooth as the evidence says."""
    f, name = trial.fit, trial.names[-1]
    table = [k for k, n in enumerate(f.structure.free) if n.startswith(f"{name}.values[")]
    runs = responses(search.problem, f)
    project = Projector(search.problem, f, leave=table)
    effect = f.model.effects[name]
    what, variable = name.removeprefix("stand_in_"), VARIABLES[int(effect["variable"])]
    now = basis_of(runs, variable, effect["start"], effect["step"], int(effect["knots"]))
    made = project.stack([r.respond(r.forces(what, b @ np.array(effect["values"])[:, None])) for r, b in zip(runs, now, strict=True)])
    residual = project(made)[:, 0] + project.residual
    low, high = _span(runs, variable)
    wide = _linear(runs, project, residual, what, [(variable, low, high, n) for n in _sizes(variable)])
    end = effect["start"] + (effect["knots"] - 1) * effect["step"]
    same = _linear(runs, project, residual, what, [(variable, effect["start"], end, INTERVALS)])
    best = max([*wide, *(same if variable != "drive" else [])], key=lambda s: s.promise)
    return _zoomed(runs, project, residual, best)


def localised(search: Search, trial: Trial, beside: bool = False) -> Trial | None:
    """The trial with its last stand-in none but at one place, alone or ``beside`` the known effect that does the rest; None if there is no such place.

    One table holds a wind that is everywhere as well as a rail that is bent at one place, but not that both its ends are as high.
    """
    f, name = trial.fit, next(n for n in reversed(trial.names) if n.startswith("stand_in"))
    table, what = f.model.effects[name], name.removeprefix("stand_in_")
    variable = VARIABLES[int(table["variable"])]
    runs = responses(search.problem, f)
    if name in f.structure.local or (place := _place(table, *_span(runs, variable))) is None:
        return None
    low, step = place[0], (place[1] - place[0]) / INTERVALS
    project, wanted, standing = search.beside(trial, name)
    blocks = basis_of(runs, variable, low, step, INTERVALS + 1)
    force = project(project.stack([r.respond(r.forces(what, b)) for r, b in zip(runs, blocks, strict=True)]))
    known = [(s.candidate.name, c) for s, c in standing if c.shape[1] == s.candidate.parameters > 0] if beside else [("", np.empty((len(wanted), 0)))]
    effect, columns = max(known, key=lambda k: _share(wanted, force[:, ENDS:-ENDS], k[1]), default=("", None))
    if columns is None or _share(wanted, force[:, ENDS:-ENDS], columns) < ALIKE**2:
        return None
    q = np.linalg.qr(columns)[0]
    of_force, of_rest = (x - q @ (q.T @ x) for x in (force, project.residual + wanted))
    best = smoothest(name, of_force, of_rest, local=True)
    size = np.linalg.lstsq(columns, project.residual + wanted - force @ best.values, rcond=1e-9)[0]
    return _placed(search, trial, Shape(what, variable, low, step, best.values, best.promise, best.weight, best.occam), effect, size)


def _place(table: Mapping[str, object], low: float, high: float) -> tuple[float, float] | None:
    """Where a table departs from its level between two values, with room on both sides; None if that is not the smaller part."""
    start, step, count = table["start"], table["step"], int(table["knots"])
    u = np.linspace(low, high, int(PER_STEP * (high - low) / step) + 2)
    force = basis(u, start, step, count) @ np.array(table["values"])[:count]
    departs = np.abs(force - np.median(force))
    off, peak = np.flatnonzero(departs <= ACTIVE * departs.max()), int(np.argmax(departs))
    left, right = u[off[off < peak].max(initial=0)], u[off[off > peak].min(initial=len(u) - 1)]
    room = 0.5 * (right - left)
    return (float(left - room), float(right + room)) if right - left < ZOOM * (high - low) else None


def _share(wanted: np.ndarray, *columns: np.ndarray) -> float:
    """The part of a vector (N,) that columns (N, l) can do, to first order."""
    together = np.hstack(columns)
    told = together.T @ wanted
    return float(told @ np.linalg.lstsq(together.T @ together, told, rcond=1e-9)[0] / (wanted @ wanted))


def _placed(search: Search, trial: Trial, shape: Shape, effect: str, size: np.ndarray) -> Trial:
    """The trial with a local shape in the place of its stand-in, and a known ``effect`` of that size (p,) beside it, if any; fitted."""
    structure, theta = trial.fit.narrowed(shape.name)
    names = tuple(n for n in trial.names if n != shape.name)
    if effect:
        structure, theta, names = structure.plus(effect), np.r_[theta, size + structure.plus(effect).start[len(theta) :]], (*names, effect)
    search.tell(" + ".join([*names, f"{shape.label} at one place"]))
    structure = _with(structure, shape, local=True)
    theta = np.r_[theta, shape.values / structure.scale[len(theta) :]]
    new = _settled(search, structure, trial.fit.states, theta)
    return Trial(new, (*names, shape.name), True, {**trial.freedom, shape.name: shape.occam})


def _with(structure: Structure, shape: Shape, local: bool = False) -> Structure:
    """A structure with a shape as a stand-in, its table free."""
    plain = structure.plus(shape.name, shape.parameters, free=[f"values[{i}]" for i in range(len(shape.values))])
    return replace(plain, smoothness={**plain.smoothness, shape.name: shape.weight}, local=plain.local | {shape.name} if local else plain.local)


def _start(trial: Trial, shape: Shape, near: Fit) -> Start:
    """A trial with a stand-in, at the first-order shape or at none where that leads astray; the rest as in ``near``.

    A change of the thrust is relative to the thrust of the model as given.
    """
    structure = _with(trial.fit.structure, shape)
    g = len(trial.fit.theta)
    theta = structure.start.copy()
    theta[:g] = near.theta[:g]
    for k in structure.held:
        theta[g:] += (near.theta[k] / structure.start[k] - 1) * (1 / structure.scale[g:] + theta[g:])
        theta[k] = structure.start[k]
    unit = 1.0 if shape.acts_on == "thrust" else trial.fit.model.parameters["mass"] * trial.fit.model.parameters["gravity"]
    if not np.abs(shape.values).max() < ABSURD * unit:
        theta[g:] = 0.0
    names = (*trial.names, shape.name)
    return Start(names, structure, theta, near.states, {**trial.freedom, shape.name: shape.occam}, " + ".join([*trial.names, shape.label]))


def _refit(search: Search, trial: Trial, shape: Shape, near: Trial | None = None) -> Trial | None:
    """The trial with this stand-in, fitted; started from ``near``, an earlier fit of nearly the same, where there is one."""
    source = (near or trial).fit
    start = _start(trial, shape, source)
    search.tell(f"{start.label}{' again' if near else ''}")
    structure, theta = start.structure, start.theta
    best = None
    for scale in (1.0, 0.0):  # from the first-order shape, or from nothing
        theta[len(trial.fit.theta) :] *= scale
        new = fit(search.problem, structure, source.states, theta, iterations=6, tolerance=3.0, reuse=source.linear)
        if np.isfinite(new.chi2) and (best is None or new.chi2 < best.chi2):
            best = new
        if best is not None and best.chi2 < trial.chi2:
            break
    if best is None:
        return None
    if near is not None:
        best = _settled(search, structure, best.states, best.theta)
    return Trial(best, start.names, True, start.freedom)


def _settled(search: Search, structure: Structure, states: Sequence[np.ndarray], theta: np.ndarray) -> Fit:
    """Fitted to convergence; where more than noise is left also over growing horizons, for joint steps over whole runs may be trapped."""
    new = fit(search.problem, structure, states, theta, settle=True)
    return new if new.leaves_noise else min(new, fit_from_scratch(search.problem, structure, theta, thorough=False), key=lambda f: f.chi2)


def penalised(search: Search, trial: Trial) -> float:
    """χ² plus what a set of effects costs.

    log N for a parameter, twice the log of how many rivals each effect was picked from, and for a stand-in the evidence's own price.
    """
    plain = [f for f in trial.fit.structure.free if "values[" not in f and f not in search.base.structure.free]
    picked = sum(2 * np.log(len(ACTS_ON) * len(VARIABLES) if e.startswith("stand_in") else 45) for e in trial.names)
    return trial.cost + np.log(trial.fit.samples) * len(plain) + picked
