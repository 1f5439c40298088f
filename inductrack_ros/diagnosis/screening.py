# SPDX-License-Identifier: Apache-2.0
"""Candidates and what each promises at a fit: known effects, sets of them, and forces of any shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from scipy import stats

from ..core.effects import Effect, catalogue
from ..core.effects.stand_in import VARIABLES, basis, over, parameters
from ..core.state import COORDINATES, MOVING
from ..estimation import columns
from ..estimation.kalman import Columns, LinearRun, log_determinant, run_filter
from ..estimation.likelihood import NO_POWER, tally
from ..estimation.linear import acting, force_columns, histories, outputs_of
from ..estimation.problem import Problem
from ..estimation.processes import augmented
from ..estimation.scores import TWO_SHARES, Background, Scores, pushed_by, scores, shares_in, shares_of, widened
from ..estimation.shooting import Fit
from ..estimation.structure import Structure
from . import placed, unheard
from .factor import Factor
from .laws.forms import ALONG
from .settings import COARSE, FINE, IN_PAIRS, IN_TRIPLES, LARGEST_SET, LEVEL, MEDIUM
from .smooth import Smooth, smoothest_of

#: The effect that is sought at every wavelength, from this many metres up, and how many of the best wavelengths are
#: candidates.
WAVES = "guideway_waviness"
SHORTEST_WAVE, WAVE_STARTS, HIGHEST_WAVE = catalogue()[WAVES].parameters["wavelength"].fit_from, 2, 1e-3
TOTALS = ("force_surge", "force_sway", "force_heave", "moment_roll")
#: Columns that are whitened together: a bound on memory alone.
AT_ONCE = 120
#: Shares of the power beside which a force of any shape is asked for, where something is known to be missing and where
#: not.
FINE_SHARES, COARSE_SHARES = (1.0, 1e-2, 1e-4), (1.0, 0.0)


@dataclass(frozen=True)
class Candidate:
    """An effect that could be missing: its name, where its parameters start, how many parameters and independent tries
    it stands for."""

    label: str
    name: str
    start: Mapping[str, float] = field(default_factory=dict)
    parameters: int = 1
    tries: int = 1
    sized: tuple[str, ...] = ()  # beside a start that leaves the size open, the parameter that each column is of
    unheard: tuple[np.ndarray, ...] = ()  # by run, the readings (m,) that its sensor would not respond to

    def price(self, family: int) -> float:
        """Fall of the deviance that chance reaches in `LEVEL` of campaigns with ``family`` candidates."""
        return float(stats.chi2.isf(LEVEL / (family * self.tries), max(self.parameters, 1)))


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
        return list({s.members[0].name: s for s in reversed(singles)}.values())[::-1]


def names(problem: Problem, structure: Structure) -> list[str]:
    """Full names of all effects not yet in the structure, as far as they can matter in these runs."""
    averaged = all(d.averaged for d in problem.runs)
    found = []
    for name, item in structure.model.known_effects.items():
        if item.screened and not (item.only and (item.only == "averaged") != averaged):
            found += [f"{name}:{c}" for c in problem.channels] if item.of_channel else [name]
    return [n for n in found if n not in structure.effects]


def sought(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], wavy: bool
) -> tuple[dict[str, Candidate], dict[str, list[Columns]]]:
    """All candidates and, for each, what it would do to every run."""
    known = fit.model.known_effects
    somewhere = [n for n in names(problem, fit.structure) if placed.is_placed(known[n.partition(":")[0]])]
    at_once = {n: start for n in names(problem, fit.structure) if (start := _of_readings(problem, known, n))}
    wanted = [n for n in names(problem, fit.structure) if n not in (WAVES, *somewhere, *at_once)]
    parameters = {n: known[n.partition(":")[0]].parameters for n in wanted}
    candidates = {n: Candidate(n, n, {}, len(parameters[n])) for n in wanted}
    told = columns.told_by_forces(problem, fit)
    parts = columns.of_parameters(problem, fit, [n for n in wanted if parameters[n]], told)
    parts |= {n: columns.of_switch(problem, fit, n) for n in wanted if not parameters[n]}
    follows = wavy and not fit.exact  # a plant that nothing shakes does not follow its readings
    for n, start in at_once.items():
        dead = unheard.unheard(problem, fit, n, start) if follows else ()
        candidates[n] = Candidate(n, n, start, len(start), unheard=dead if any(d.any() for d in dead) else ())
        parts[n] = columns.of_switch(problem, fit, n, start)
    if wavy and WAVES in names(problem, fit.structure):
        for candidate, part in _waves(problem, fit, systems):
            candidates[candidate.label], parts[candidate.label] = candidate, part
    covered = placed.ranges([outputs_of(problem, fit, i) for i in range(len(problem.runs))]) if somewhere else {}
    for name in somewhere:
        for candidate, part in _placed(problem, fit, systems, name, covered, told):
            candidates[candidate.label], parts[candidate.label] = candidate, part
    return candidates, parts


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
        s.labels: s
        for c in candidates.values()
        if c.unheard
        for s in [_censored(problem, fit, systems, c, price, len(candidates))]
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


def _of_readings(problem: Problem, known: Mapping[str, Effect], name: str) -> Mapping[str, float]:
    """Where the parameters of an effect of a sensor start as its readings say; empty where it is asked for while it
    vanishes."""
    base, _, channel = name.partition(":")
    starts = known[base].starts
    if not channel or not starts:
        return {}
    mine = problem.channels.index(channel)
    return starts(np.concatenate([d.y[d.channel == mine] for d in problem.runs]))[0]


def _sets(candidates: Mapping[str, Candidate], found: Scores) -> tuple[CandidateSet, ...]:
    """Single candidates and the pairs and triples of the best, cheapest first.

    Which are the best is asked without bounds: beside another an effect may turn its sign."""
    family = len(candidates)

    def of(labels: Sequence[str]) -> CandidateSet:
        members = tuple(candidates[n] for n in labels)
        e = found.expected(labels)
        edges = np.cumsum([0] + [len(found.places[n]) for n in labels])
        sizes = {n: e.size[a:b] for n, a, b in zip(labels, edges[:-1], edges[1:], strict=True)}
        return CandidateSet(
            members, e.deviance, e.deviance + sum(m.price(family) for m in members), sizes, e.background
        )

    sets = [of([n]) for n in candidates]
    anywhere = {n: found.unbounded.expected([n]).deviance + c.price(family) for n, c in candidates.items()}
    best = sorted(candidates, key=lambda n: anywhere[n])
    for size, limit in zip(range(2, LARGEST_SET + 1), (IN_PAIRS, IN_TRIPLES), strict=True):
        pairs = (p for p in combinations(best[:limit], size) if len({candidates[n].name for n in p}) == size)
        sets += [of(p) for p in pairs]
    return tuple(sorted(sets, key=lambda s: s.cost))


# ---------------------------------------------------------------- effects at a place


def _placed(
    problem: Problem,
    fit: Fit,
    systems: Sequence[LinearRun],
    name: str,
    covered: Mapping[str, tuple[float, float]],
    told: Sequence[columns.Told],
) -> list[tuple[Candidate, list[Columns]]]:
    """An effect at the best few of the starts that it declares for runs that cover these ranges: it shows nothing of
    them while it vanishes."""
    item = fit.model.known_effects[name]
    asked = placed.tried(item, covered)
    if not asked.starts:
        return []
    plain = Structure(fit.model, ())

    def columns_of(starts: Sequence[int]) -> list[list[Columns]]:
        """What each of some starts would do to every run."""
        rows = [r for k in starts for r in asked.of(k)]
        wide, thetas = placed.thetas(plain, np.empty(0), name, [asked.rows[r][2] for r in rows])
        steps = np.array([asked.rows[r][3] for r in rows])

        def one(i: int) -> Columns:
            path = columns.carried(problem, wide, i, fit.paths[i]) if item.states else fit.paths[i]
            means = None if columns.needs_integration(item) else told[i]
            return columns.differences(problem, wide, i, path, thetas, steps, fit.model.active_states, means)

        every, edges = problem.for_runs(one), np.cumsum([0] + [len(asked.of(k)) for k in starts])
        return [[c.some(slice(a, b)) for c in every] for a, b in zip(edges[:-1], edges[1:], strict=True)]

    promised = np.empty(len(asked.starts))
    for some in np.array_split(np.arange(len(promised)), max(1, -(-len(asked.rows) // AT_ONCE))):
        wanted = {str(k): parts for k, parts in zip(some, columns_of(some.tolist()), strict=True)}
        of_some = scores(problem, fit, wanted, systems, shares=TWO_SHARES)
        promised[some] = [of_some.expected([str(k)]).deviance for k in some]
    best = np.argsort(promised, kind="stable")[:WAVE_STARTS].tolist()
    found = []
    for k, parts in zip(best, columns_of(best), strict=True):
        own = tuple(asked.rows[r][1] for r in asked.of(k))
        start = {p: float(v) for p, v in asked.starts[k].items()}
        found.append((Candidate(f"{name}@{k}", name, start, len(item.parameters), len(asked.starts), own), parts))
    return found


# ---------------------------------------------------------------- waves of the track


def _waves(problem: Problem, fit: Fit, systems: Sequence[LinearRun]) -> list[tuple[Candidate, list[Columns]]]:
    """Waviness at every wavelength the runs can tell apart: the best few, with amplitude and phase to start from."""
    stiffness = problem.for_runs(lambda i: _track_stiffness(problem, fit, i))
    reach = max(float(np.ptp(path[:, 0])) for path in fit.paths)
    fastest = max(float(np.abs(path[:, 4]).max()) for path in fit.paths)
    spacing = max(float(np.median(np.diff(d.grid))) for d in problem.runs)
    shortest = max(SHORTEST_WAVE, 2.5 * fastest * spacing)
    if reach < shortest:
        return []
    numbers = np.arange(1, max(2, int(reach / shortest * 1.5)) + 1) / (1.5 * reach)

    def parts(i: int, some: np.ndarray) -> Columns:
        phase = 2 * np.pi * np.outer(fit.paths[i][:, 0], some)
        height = np.stack([np.sin(phase), np.cos(phase)], axis=2).reshape(len(phase), -1)
        forces = stiffness[i][:, :, None] * height[:, None, :]
        return force_columns(problem.runs[i], problem.sigma, fit.model, forces)

    tried = []
    for some in np.array_split(numbers, max(1, 2 * len(numbers) // AT_ONCE)):
        powers = shares_of(fit.power, TWO_SHARES)
        for deviances, sizes in _each(problem, fit, systems, lambda i, some=some: parts(i, some), len(some), powers):
            tried += [(d, nu, s) for d, nu, s in zip(deviances, some, sizes, strict=True)]
    tried.sort(key=lambda t: t[0])
    found: list[tuple[Candidate, list[Columns]]] = []
    taken: list[float] = []
    for _, nu, (a, b) in tried:
        if all(abs(nu - other) > 1.5 / reach for other in taken):
            taken.append(nu)
            start = {
                "amplitude": min(float(np.hypot(a, b)), HIGHEST_WAVE),
                "wavelength": float(1 / nu),
                "phase": float(np.arctan2(b, a)),
            }
            candidate = Candidate(f"{WAVES}@{1 / nu:.3g}", WAVES, start, 3, 2 * len(numbers))
            found.append((candidate, [parts(i, np.array([nu])) for i in range(len(problem.runs))]))
        if len(found) == WAVE_STARTS:
            break
    return found


Parts = Callable[[int], Columns]  # the columns of a run


def _each(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], parts: Parts, count: int, powers: Sequence[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """At each power the deviance (k,) that each of ``count`` pairs of columns promises, and its coefficients (k, 2)."""
    found = []
    for gram, score, base in _blocks(problem, fit, systems, parts, [2] * count, powers):
        sizes = np.array(
            [
                np.linalg.lstsq(g + 1e-9 * np.trace(g) * np.eye(2) + 1e-12 * np.eye(2), s, rcond=None)[0]
                for g, s in zip(gram, score, strict=True)
            ]
        )
        found.append((base - np.array([s @ x for s, x in zip(score, sizes, strict=True)]), sizes))
    return found


def _blocks(
    problem: Problem,
    fit: Fit,
    systems: Sequence[LinearRun],
    parts: Parts,
    widths: Sequence[int],
    powers: Sequence[np.ndarray],
) -> list[tuple[list[np.ndarray], list[np.ndarray], float]]:
    """Normal equations of blocks of columns at each power, the nuisance projected out: each block's matrix and right-
    hand side, and the deviance without. A run's columns are made when it is its turn, and nothing is kept of them."""
    edges = np.cumsum([0, *widths])
    blocks = list(zip(edges[:-1], edges[1:], strict=True))
    g = 1 + len(fit.theta)

    def one(i: int) -> list:
        system = augmented(problem, fit.structure, i, widened(systems[i], [parts(i)]), fit.processes)
        found = []
        for power in powers:
            filtered = run_filter(system, power, smooth=False)
            w = filtered.scored(system)
            nuisance, more = w[:, :g], w[:, g:]
            own = [more[:, a:b].T @ more[:, a:b] for a, b in blocks]
            found.append((nuisance.T @ nuisance, nuisance.T @ more, own, tally(problem, i, filtered, system)))
        return found

    runs = problem.for_runs(one)
    return [_projected(fit, blocks, [run[k] for run in runs]) for k in range(len(powers))]


def _projected(
    fit: Fit, blocks: Sequence[tuple[int, int]], found: Sequence[tuple]
) -> tuple[list[np.ndarray], list[np.ndarray], float]:
    """What all runs tell of blocks of columns, the nuisance projected out."""
    prior, pull = fit.structure.precision, fit.structure.precision @ (fit.structure.centre - fit.theta)
    small, cross = (sum((f[part] for f in found), np.zeros(())) for part in (0, 1))
    A, b = small[1:, 1:] + prior, -small[1:, 0] + pull
    inverse = np.linalg.pinv(A, rcond=1e-14, hermitian=True) if len(A) else np.zeros((0, 0))
    step = inverse @ b
    base = float(small[0, 0] - b @ step) + log_determinant(sum((f[3] for f in found), np.zeros(())))
    gram, score = [], []
    for k, (lo, hi) in enumerate(blocks):
        B = cross[1:, lo:hi]
        gram.append(sum((f[2][k] for f in found), np.zeros(())) - B.T @ inverse @ B)
        score.append(-cross[0, lo:hi] - B.T @ step)
    return gram, score, base


def _track_stiffness(problem: Problem, fit: Fit, i: int) -> np.ndarray:
    """Generalised force per height of the track, (n, 4), along a run: minus its derivative by heave."""
    h = 1e-5
    above, below = (columns.quantities(problem, fit, i, TOTALS, raised) for raised in (h, -h))
    return (below - above) / (2 * h)


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
    def parameters(self) -> dict[str, float]:
        """As a stand-in has it, without values."""
        times = self.factor.parameters if self.factor else {}
        return {**parameters(self.variable, self.start, self.step), **times}

    @property
    def swings(self) -> bool:
        """Whether it is over a variable along which a force may change often."""
        return self.variable in ALONG


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
        a, table = self.asked, smoothest_of(self.gram, self.score, samples, self.asked.swings)
        times = a.factor.parameters if a.factor else {}
        return Law(self.acts_on, a.variable, a.start, a.step, table, table.promise - self.rise, self.power, times)


def laws(
    problem: Problem,
    fit: Fit,
    systems: Sequence[LinearRun],
    fine: Sequence[str],
    variables: Sequence[str] | None = None,
) -> list[Law]:
    """Forces of any shape on all they may act on, most telling first; with ``fine`` tables where something is known to
    be missing."""
    best: dict[tuple[str, str], Law] = {}
    for e in equations(problem, fit, systems, tables_on_one(problem, fit, fine, variables), fine):
        law = e.law(problem.samples)
        best[law.acts_on, law.variable] = max(best.get((law.acts_on, law.variable), law), law, key=lambda x: x.gain)
    return sorted(best.values(), key=lambda x: -x.gain)


def tables_on_one(
    problem: Problem, fit: Fit, fine: Sequence[str], variables: Sequence[str] | None = None
) -> dict[str, list[Asked]]:
    """The tables of forces on one variable, for all that a force may act on."""
    spans = spans_of([histories(d, path) for d, path in zip(problem.runs, fit.paths, strict=True)])
    spans = {v: span for v, span in spans.items() if variables is None or v in variables}
    return {
        on: [
            Asked(v, *over(*span, n))
            for v, span in asked_over(on, spans).items()
            for n in sizes_of(v, pushed_by(on) in fine)
        ]
        for on in acted_on(problem, fit)
    }


def equations(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], tables: Mapping[str, Sequence[Asked]], fine: Sequence[str]
) -> list[Equations]:
    """The normal equations of tables of forces on each coordinate (or the thrust), beside each share of its own
    power."""
    runs = [histories(d, path) for d, path in zip(problem.runs, fit.paths, strict=True)]
    plain = scores(problem, fit, {}, systems).plain
    found: list[Equations] = []
    for on, asked in tables.items():

        def parts(i: int, on=on, asked=asked) -> Columns:
            shapes = np.hstack([a.entries(runs[i]) for a in asked])
            forces = acting(problem, fit.structure, i, fit.theta, fit.paths[i], on, shapes)
            return force_columns(problem.runs[i], problem.sigma, fit.model, forces)

        powers = shares_in(fit.power, on, FINE_SHARES if pushed_by(on) in fine else COARSE_SHARES)
        told = _blocks(problem, fit, systems, parts, [a.count for a in asked], powers)
        for power, (gram, score, base) in zip(powers, told, strict=True):
            found += [Equations(on, *e, power, base - plain) for e in zip(asked, gram, score, strict=True)]
    return found


def table_of(problem: Problem, fit: Fit, systems: Sequence[LinearRun], effect: str) -> Smooth:
    """A stand-in's table as the data ask for it at a fit, and how smooth."""
    swings = VARIABLES[int(fit.model.effects[effect]["variable"])] in ALONG
    return smoothest_of(*asked_of(problem, fit, systems, effect), problem.samples, swings)


def asked_of(problem: Problem, fit: Fit, systems: Sequence[LinearRun], effect: str) -> tuple[np.ndarray, np.ndarray]:
    """The normal equations (l, l) and (l,) of the values of a stand-in's table at a fit; all else is nuisance."""
    structure, mine = fit.structure, fit.structure.tables[effect]
    other = np.setdiff1d(np.arange(len(fit.theta)), mine)

    def one(i: int) -> np.ndarray:
        system = augmented(problem, structure, i, systems[i], fit.processes)
        w = run_filter(system, np.where(fit.power > NO_POWER, fit.power, 0.0), smooth=False).scored(system)
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
    if variable == "drive":
        return (6,)
    if not fine:
        return (COARSE,)
    return (MEDIUM, FINE) if variable in ALONG else (MEDIUM,)


def spans_of(runs: Sequence[Mapping[str, np.ndarray]]) -> dict[str, tuple[float, float]]:
    """Ranges of the variables that move, of their histories in all runs."""
    return {v: span for v in runs[0] if (span := span_of([r[v] for r in runs])) is not None}


def span_of(values: Sequence[np.ndarray]) -> tuple[float, float] | None:
    """Range of a variable over all runs; None where it does not move."""
    low, high = np.quantile(np.concatenate(values), [0.001, 0.999])
    return (float(low), float(high)) if high - low > 1e-6 * max(abs(low), abs(high), 1e-9) else None


def asked_over(on: str, spans: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
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
