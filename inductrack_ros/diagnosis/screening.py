# SPDX-License-Identifier: Apache-2.0
"""What each candidate promises at a fit: known effects, sets of them, and forces of any shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from ..core.effects.stand_in import VARIABLES, basis, over, parameters
from ..core.state import COORDINATES, MOVING
from ..estimation.blocks import Blocks, blocks_of
from ..estimation.kalman import Columns, LinearRun
from ..estimation.likelihood import NO_POWER
from ..estimation.linear import acting, force_columns, histories
from ..estimation.problem import Problem
from ..estimation.processes import augmented
from ..estimation.run_model import RunModel
from ..estimation.scores import Background, Scores, pushed_by, scores, shares_in, whitened
from ..estimation.shooting import Fit, all_histories
from ..estimation.structure import Structure
from . import unheard
from .candidates import Candidate, sought
from .factor import Factor, factors_of
from .laws.forms import ALONG
from .settings import COARSE, FINE, IN_PAIRS, IN_TRIPLES, LARGEST_SET, MEDIUM
from .smooth import Smooth, smoothest_of

#: Shares of the power beside which a force of any shape is asked for, where something is known to be missing and where
#: not.
FINE_SHARES, COARSE_SHARES = (1.0, 1e-2, 1e-4), (1.0, 0.0)

Spans = Mapping[str, tuple[float, float]]  # by variable, from where to where it goes in all runs


@dataclass(frozen=True)
class CandidateSet:
    """Candidates taken together: the deviance they promise, that with what chance would reach, and the background that
    suits them."""

    members: tuple[Candidate, ...]
    deviance: float
    cost: float
    sizes: Mapping[str, np.ndarray]
    background: Background

    @property
    def labels(self) -> tuple[str, ...]:
        """Its members' labels."""
        return tuple(m.label for m in self.members)

    @property
    def names(self) -> tuple[str, ...]:
        """Its members' effects."""
        return tuple(m.name for m in self.members)

    @property
    def title(self) -> str:
        """As the log calls it."""
        return " + ".join(self.names)

    def price(self, family: int) -> float:
        """What its members cost by chance, see `Candidate.price`."""
        return sum(m.price(family) for m in self.members)


@dataclass(frozen=True)
class Screening:
    """All candidates at a fit with their scores, and the ``sets`` of them, cheapest first."""

    candidates: Mapping[str, Candidate]
    scores: Scores
    sets: tuple[CandidateSet, ...]

    @property
    def family(self) -> int:
        """How many rivals there are."""
        return len(self.candidates)

    @property
    def singles(self) -> list[CandidateSet]:
        """The single effects, each from its most promising start only; cheapest first."""
        singles = [s for s in self.sets if len(s.members) == 1]
        return list({s.title: s for s in reversed(singles)}.values())[::-1]


def screen(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], backgrounds: Sequence[Background] = (), wavy: bool = True
) -> Screening:
    """Every candidate and every small set of them at a fit, beside each of the backgrounds (the fit's own unless
    given); ``wavy``, where something shakes the plant: waves of the track too."""
    candidates, parts = sought(problem, fit, systems, wavy)
    bounds = {n: _reach(fit, n) for n, c in candidates.items() if c.parameters and not c.start}
    found = scores(problem, fit, parts, systems, backgrounds, bounds=bounds)
    sets = {s.labels: s for s in _sets(candidates, found)}
    price = backgrounds[0].price if backgrounds else 0.0
    sets |= {
        (c.label,): _censored(problem, fit, systems, c, price, len(candidates))
        for c in candidates.values()
        if c.unheard
    }
    return Screening(candidates, found, tuple(sorted(sets.values(), key=lambda s: s.cost)))


def _reach(fit: Fit, name: str) -> np.ndarray:
    """How far the parameters (k, 2) of an effect may go from where it vanishes, in typical sizes."""
    wide = Structure(fit.model, ()).plus(name)
    return (np.array(wide.bounds) - wide.start).T


def _censored(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], one: Candidate, price: float, family: int
) -> CandidateSet:
    """A candidate alone, with what the readings promise that its sensor responds to."""
    deviance, background = unheard.promised(problem, fit, systems, one.unheard, price)
    sizes = {one.label: np.zeros(len(one.start))}
    return CandidateSet((one,), deviance, deviance + one.price(family), sizes, background)


def _sets(candidates: Mapping[str, Candidate], found: Scores) -> tuple[CandidateSet, ...]:
    """Single candidates and the pairs and triples of the best, cheapest first.

    Which are the best is asked without bounds: beside another an effect may turn its sign."""
    family = len(candidates)

    def of(labels: Sequence[str]) -> CandidateSet:
        e = found.expected(labels)
        edges = np.cumsum([0] + [len(found.places[n]) for n in labels])
        sizes = {n: e.size[a:b] for n, a, b in zip(labels, edges[:-1], edges[1:], strict=True)}
        one = CandidateSet(tuple(candidates[n] for n in labels), e.deviance, e.deviance, sizes, e.background)
        return replace(one, cost=e.deviance + one.price(family))

    sets = [of([n]) for n in candidates]
    anywhere = {n: found.unbounded.expected([n]).deviance + c.price(family) for n, c in candidates.items()}
    best = sorted(candidates, key=lambda n: anywhere[n])
    for size, limit in zip(range(2, LARGEST_SET + 1), (IN_PAIRS, IN_TRIPLES), strict=True):
        pairs = (p for p in combinations(best[:limit], size) if len({candidates[n].name for n in p}) == size)
        sets += [of(p) for p in pairs]
    return tuple(sorted(sets, key=lambda s: s.cost))


# ---------------------------------------------------------------- forces of any shape


@dataclass(frozen=True)
class Law:
    """A force that ``acts_on`` a coordinate or the thrust and depends on ``variable`` in any smooth way, as a table.

    ``gain``: twice the log evidence it has over no such force, the power of the disturbances being what suits each;
    ``times``: the parameters of a stand-in that say what it is multiplied by (`factor`).
    """

    acts_on: str
    variable: str
    start: float
    step: float
    table: Smooth
    gain: float
    power: np.ndarray
    times: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the stand-in effect."""
        return f"stand_in_{self.acts_on}"


@dataclass(frozen=True)
class Asked:
    """A table that is asked for: over a variable from ``start`` in ``count`` − 1 steps of ``step``, times a factor."""

    variable: str
    start: float
    step: float
    count: int
    factor: Factor | None = None

    def entries(self, along: Mapping[str, np.ndarray]) -> np.ndarray:
        """What its entries give along histories (n,), (n, count)."""
        found = basis(along[self.variable], self.start, self.step, self.count)
        return found if self.factor is None else found * self.factor.at(along)[:, None]

    @property
    def times(self) -> dict[str, float]:
        """What it is multiplied by, as a stand-in has it."""
        return self.factor.parameters if self.factor else {}

    @property
    def parameters(self) -> dict[str, float]:
        """As a stand-in has it, without values."""
        return {**parameters(self.variable, self.start, self.step), **self.times}

    def smoothest(self, gram: np.ndarray, score: np.ndarray, samples: int) -> Smooth:
        """The table that explains most, from the normal equations (l, l) and (l,) of its entries."""
        return smoothest_of(gram, score, samples, self.variable in ALONG)

    def law(self, on: str, table: Smooth, gain: float, power: np.ndarray) -> Law:
        """The force on a coordinate, or on the thrust, with this table."""
        return Law(on, self.variable, self.start, self.step, table, gain, power, self.times)


def tables_over(spans: Spans, sizes: Callable[[str], Sequence[int]], factor: Factor | None = None) -> list[Asked]:
    """The tables of a force over each variable, of the ``sizes`` (intervals) that it has."""
    return [Asked(v, *over(*span, n), factor) for v, span in spans.items() for n in sizes(v)]


def products(runs: Sequence[Mapping[str, np.ndarray]], on: str) -> list[Asked]:
    """Tables of forces in a coordinate on one variable times another, as coarse as shows which may be worth more;
    ``runs`` are the histories of all variables."""
    spans = spans_of(runs)
    return [
        t
        for factor in factors_of(on, runs, spans)
        for t in tables_over(
            {v: span for v, span in spans.items() if v != factor.variable},
            lambda v: (MEDIUM if v in ALONG else COARSE,),
            factor,
        )
    ]


def columns_of(problem: Problem, fit: Fit, i: int, on: str, tables: Sequence[Asked]) -> Columns:
    """What each entry of tables of a force on a coordinate, or the thrust, would do to run i along a fit's
    trajectory."""
    along = histories(problem.runs[i], fit.paths[i])
    shapes = np.hstack([t.entries(along) for t in tables])
    forces = acting(RunModel(problem, fit.structure, i), fit.theta, fit.paths[i], on, shapes)
    return force_columns(problem.runs[i], problem.sigma, fit.model, forces)


@dataclass(frozen=True)
class Equations:
    """Normal equations of a table of a force: its matrix ``gram`` (l, l) and right-hand side ``score`` (l,) over noise,
    all else projected out. They hold at a ``power`` (4,) of the disturbances that alone raises the deviance by
    ``rise``."""

    acts_on: str
    asked: Asked
    gram: np.ndarray
    score: np.ndarray
    power: np.ndarray
    rise: float

    def law(self, samples: int) -> Law:
        """The force with the table that the equations ask for, and its gain over no force."""
        table = self.asked.smoothest(self.gram, self.score, samples)
        return self.asked.law(self.acts_on, table, table.promise - self.rise, self.power)


def laws(problem: Problem, fit: Fit, systems: Sequence[LinearRun], fine: Sequence[str]) -> list[Law]:
    """Forces of any shape on all they may act on, most telling first; with ``fine`` tables where something is known to
    be missing."""
    best: dict[tuple[str, str], Law] = {}
    for e in equations(problem, fit, systems, tables_on_one(problem, fit, fine), fine):
        law = e.law(problem.samples)
        best[law.acts_on, law.variable] = max(best.get((law.acts_on, law.variable), law), law, key=lambda x: x.gain)
    return sorted(best.values(), key=lambda x: -x.gain)


def tables_on_one(problem: Problem, fit: Fit, fine: Sequence[str]) -> dict[str, list[Asked]]:
    """The tables of forces on one variable, for all that a force may act on."""
    spans = spans_of(all_histories(problem, fit))
    return {
        on: tables_over(asked_over(on, spans), lambda v, on=on: sizes_of(v, pushed_by(on) in fine))
        for on in acted_on(problem, fit)
    }


def equations(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], tables: Mapping[str, Sequence[Asked]], fine: Sequence[str]
) -> list[Equations]:
    """The normal equations of tables of forces on each coordinate (or the thrust), beside each share of its own
    power."""
    plain = scores(problem, fit, {}, systems).plain
    found: list[Equations] = []
    for on, asked in tables.items():
        powers = shares_in(fit.power, on, FINE_SHARES if pushed_by(on) in fine else COARSE_SHARES)
        widths = [a.count for a in asked]
        told = blocks_of(
            problem, fit, systems, powers, lambda i, on=on, asked=asked: columns_of(problem, fit, i, on, asked), widths
        )
        for power, runs in zip(powers, told, strict=True):
            of_each, deviance = Blocks.together(runs).projected(fit)
            found += [Equations(on, a, *e, power, deviance - plain) for a, e in zip(asked, of_each, strict=True)]
    return found


def table_of(problem: Problem, fit: Fit, systems: Sequence[LinearRun], effect: str) -> Smooth:
    """A stand-in's table as the data ask for it at a fit, and how smooth."""
    swings = VARIABLES[int(fit.model.effects[effect]["variable"])] in ALONG
    return smoothest_of(*asked_of(problem, fit, systems, effect), problem.samples, swings)


def asked_of(problem: Problem, fit: Fit, systems: Sequence[LinearRun], effect: str) -> tuple[np.ndarray, np.ndarray]:
    """The normal equations (l, l) and (l,) of the values of a stand-in's table at a fit; all else is nuisance."""
    structure, mine = fit.structure, fit.structure.tables[effect]
    other = np.setdiff1d(np.arange(len(fit.theta)), mine)
    power = np.where(fit.power > NO_POWER, fit.power, 0.0)

    def one(i: int) -> np.ndarray:
        w, _ = whitened(problem, i, augmented(problem, structure, i, systems[i], fit.processes), power)
        return w.T @ w

    whole = sum(problem.for_runs(one), np.zeros(()))
    o, m, scale = 1 + other, 1 + np.array(mine), structure.scale[mine]
    prior = structure.precision[np.ix_(other, other)]
    inverse = np.linalg.pinv(whole[np.ix_(o, o)] + prior, rcond=1e-14, hermitian=True)
    step = inverse @ (prior @ (structure.centre - fit.theta)[other] - whole[o, 0])
    cross = whole[np.ix_(o, m)]
    gram = (whole[np.ix_(m, m)] - cross.T @ inverse @ cross) / np.outer(scale, scale)
    score = -(whole[m, 0] + cross.T @ step) / scale
    return gram, gram @ (fit.theta[mine] * scale) + score


def sizes_of(variable: str, fine: bool) -> tuple[int, ...]:
    """Intervals of the tables over a variable; a campaign has few drive currents."""
    if variable == "drive":
        return (6,)
    if not fine:
        return (COARSE,)
    return (MEDIUM, FINE) if variable in ALONG else (MEDIUM,)


def spans_of(runs: Sequence[Mapping[str, np.ndarray]]) -> Spans:
    """Ranges of the variables that move, of their histories in all runs."""
    found = {}
    for v in runs[0]:
        low, high = np.quantile(np.concatenate([r[v] for r in runs]), [0.001, 0.999])
        if high - low > 1e-6 * max(abs(low), abs(high), 1e-9):
            found[v] = float(low), float(high)
    return found


def asked_over(on: str, spans: Spans) -> Spans:
    """The variables that a force may depend on, with their ranges; a share of the thrust does not on the drive."""
    return {v: span for v, span in spans.items() if (on, v) != ("thrust", "drive")}


def acted_on(problem: Problem, fit: Fit) -> list[str]:
    """What a force of any shape may act on: the coordinates that move, and the thrust where runs were driven
    differently."""
    found = [c for c in COORDINATES if c in MOVING[problem.dof]]
    drives = {d.run.drive_current if d.averaged else 0.0 for d in problem.runs}
    return [c for c in found if f"stand_in_{c}" not in fit.structure.effects] + (
        ["thrust"] if "surge" in found and len(drives) > 1 else []
    )
