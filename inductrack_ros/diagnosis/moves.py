# SPDX-License-Identifier: Apache-2.0
"""The moves of the search: from one fitted model to another with an effect more, less or exchanged."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..checks import Finding
from ..core.effects.stand_in import ACTS_ON, VARIABLES, parameters
from ..core.state import COORDINATES
from ..estimation import columns
from ..estimation import fit as end_to_end
from ..estimation.kalman import LinearRun
from ..estimation.likelihood import NO_POWER, Point, evidence_of
from ..estimation.problem import Problem
from ..estimation.processes import augmented
from ..estimation.shooting import ANEW, FLOWN_STEPS, Fit, exactly, first_power, fit, linearise_all
from ..estimation.structure import Structure
from ..workers import Cluster, Threads
from . import background, placed, unheard
from .candidates import Candidate, names
from .screening import CandidateSet, Law, Screening, screen, table_of
from .settings import LEVEL, LOOK_STEPS, NEAR, REFIT_STEPS, REFITTED, SHAKEN, TWINS


class OutOfTime(Exception):
    """The time that a diagnosis may take is used up."""


@dataclass(frozen=True)
class Task:
    """What is searched: the problem, channels whose noise is given, findings of the look at the data, who hears of
    progress, and until when (`time.monotonic`) there is time."""

    problem: Problem
    given: tuple[str, ...] = ()
    hints: tuple[Finding, ...] = ()
    tell: Callable[[str], None] = lambda _: None
    workers: Threads | Cluster = field(default_factory=Threads)
    until: float = np.inf

    def say(self, text: str) -> None:
        """Tell what is done next. Raises `OutOfTime` where there is no time for it."""
        if time.monotonic() > self.until:
            raise OutOfTime
        self.tell(text)


@dataclass(frozen=True)
class State:
    """Where the search stands: the fit, the effects added in their order, what they cost by chance, and the log."""

    fit: Fit
    added: tuple[str, ...] = ()
    price: float = 0.0
    log: tuple[str, ...] = ()
    rounds: tuple[tuple[tuple[str, ...], Screening], ...] = ()
    freedom: tuple[tuple[str, float], ...] = ()  # what that of each force of any shape costs
    closed: Mapping[str, float] = field(default_factory=dict)  # what those cost that a closed form describes for less
    twins: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by effect, what the data cannot tell from it
    rivals: Mapping[str, State] = field(default_factory=dict)  # the states with those in its place
    far: bool = False  # more is missing than the search may add
    stopped: str = ""  # why the search was broken off; empty where it was not
    odd: Finding | None = None  # a run to be set aside before the search goes on

    def cost(self, task: Task) -> float:
        """The deviance and what chance would have taken off it."""
        return self.fit.deviance + self.price + background.price(task.problem, task.given, self.fit.processes)

    @property
    def known(self) -> tuple[str, ...]:
        """The known effects among those added."""
        return tuple(n for n in self.added if not n.startswith("stand_in"))

    @property
    def rival_fits(self) -> dict[str, Fit]:
        """By twin, the fit with it in the place of what it is like."""
        return {name: s.fit for name, s in self.rivals.items()}

    @property
    def stands_in(self) -> bool:
        """Whether a force of any shape is among the effects."""
        return len(self.known) < len(self.added)

    @property
    def verdict(self) -> str:
        """What a search that ends here says of the model."""
        if self.stands_in or self.stopped or self.far:
            return "unknown_effect"
        return "missing_effect" if self.known else "adequate"

    def told(self, line: str) -> State:
        """The state with a line more in its log."""
        return replace(self, log=(*self.log, line))


def shaken(task: Task, state: State, systems: Sequence[LinearRun] | None = None) -> list[str]:
    """Coordinates in which something moves the cradle that the model does not have."""
    problem, f = task.problem, state.fit
    systems = systems or linearise_all(problem, f)
    full = problem.for_runs(lambda i: augmented(problem, f.structure, i, systems[i], f.processes))
    here = evidence_of(problem, f.structure, full, f.theta, f.power).deviance
    found = []
    for c, name in enumerate(COORDINATES):
        if f.power[c] > NO_POWER:
            still = evidence_of(problem, f.structure, full, f.theta, np.where(np.arange(4) == c, 0.0, f.power)).deviance
            if still > here + SHAKEN:
                found.append(name)
    return found


def screened(
    task: Task,
    state: State,
    systems: Sequence[LinearRun] | None = None,
    quiet: Sequence[Fit] | None = None,
    wavy: bool = True,
) -> Screening:
    """All candidates beside a state's fit and each background that may stand beside it; ``quiet`` as
    `background.quieter` gives it, ``wavy``: waves of the track too."""
    systems = systems or linearise_all(task.problem, state.fit)
    quiet = quiet or background.quieter(task.problem, state.fit, task.given, systems)
    beside = background.backgrounds(task.problem, task.given, quiet)
    return screen(task.problem, state.fit, systems, beside, wavy)


def last_screened(task: Task, state: State) -> State:
    """The state whose last round is that of all candidates beside the answer."""
    if state.rounds and state.rounds[-1][0] == state.added:
        return state
    return replace(state, rounds=(*state.rounds, (state.added, screened(task, state))))


def law_price() -> float:
    """Twice the log evidence by which a force of any shape wrongly stands out in `LEVEL` of campaigns, at the most (a
    Bayes factor, laws counted)."""
    return 2.0 * float(np.log(len(VARIABLES) * len(ACTS_ON) / LEVEL))


def refitted(task: Task, state: State, found: CandidateSet, family: int, steps: int = LOOK_STEPS) -> State:
    """The state with a set of known effects, beside the background that suits it, after a few steps."""
    task.say(" + ".join([*state.added, *found.names]))
    structure, point = with_effects(task.problem, state.fit, found)
    beside = found.background
    new = fit(task.problem, structure, replace(point, power=beside.power, processes=beside.processes), steps)
    return grown(state, found, family, new).told(
        f"{found.title}: deviance {state.fit.deviance:.0f} -> {new.deviance:.0f} (expected {found.deviance:.0f})"
    )


def with_effects(problem: Problem, f: Fit, found: CandidateSet) -> tuple[Structure, Point]:
    """A fit's structure and point with a set of known effects at the sizes that it promises."""
    for member in found.members:
        if member.unheard:
            f = unheard.without(problem, f, member.unheard, LOOK_STEPS)
    structure, theta, paths = f.structure, f.theta, f.paths
    for member in found.members:
        structure = structure.plus(member.name, member.start)
        begin = structure.start[len(theta) :]
        step = _first_step(structure, member, found.sizes[member.label], len(begin))
        theta = np.clip(np.concatenate([theta, begin + step]), *structure.bounds)
        if not f.model.carries_states and structure.model.carries_states:
            paths = columns.all_carried(problem, structure, paths)
    return structure, replace(f.point, theta=theta, paths=paths)


def grown(state: State, found: CandidateSet, family: int, new: Fit) -> State:
    """The state with a set of known effects, as fitted, and what it costs by chance."""
    return replace(state, fit=new, added=(*state.added, *found.names), price=state.price + found.price(family))


@dataclass(frozen=True)
class _Flown:
    """A set of known effects whose runs were fitted from end to end from a point nearby, and its χ² with what chance
    would reach."""

    cost: float
    found: CandidateSet
    structure: Structure
    point: Point
    fit: end_to_end.Fit


def exact_ones(task: Task, state: State, sets: Sequence[CandidateSet], family: int) -> list[State]:
    """Of sets of known effects those that leave nothing but noise where contact is taken exactly; cheapest first.

    What leaves noise in all runs does so in each, and what is near to the cheapest is so in each. So a set is first
    asked for the one run that told most against those before. Only those near to the cheapest are weighed beside the
    sensors as they are."""
    flown: list[_Flown] = []
    asked: tuple[int, float] | None = None  # a run, and the largest χ² there of a set that is still in question
    for s in sets if state.fit.exact or touches(state.fit) else ():
        task.say(" + ".join([*state.added, *s.names]) + ", contact taken exactly")
        structure, point = with_effects(task.problem, state.fit, s)
        if asked and fitted_end_to_end(task, structure, point, asked[:1]).chi2 > asked[1]:
            continue
        whole = _flown_exactly(task, structure, point)
        if not whole.leaves_noise:
            hardest = int(np.argmax(whole.of_runs - [len(part.residual) for part in whole.linear]))
            asked = hardest, _most_left(task, hardest)
            continue
        flown.append(_Flown(whole.chi2 + s.price(family), s, structure, point, whole))
        flown.sort(key=lambda f: f.cost)
        asked = _told_apart([f.fit for f in flown]) or asked
    found = dict[tuple[str, ...], State]()  # of one effect from several starts the cheapest
    for f in flown:
        if f.cost < flown[0].cost + NEAR and f.found.names not in found:
            new = exactly(task.problem, f.structure, f.point, REFIT_STEPS, f.fit)
            found[f.found.names] = grown(state, f.found, family, new).told(
                f"{f.found.title}: leaves noise with contact taken exactly; deviance {new.deviance:.0f}"
            )
    return sorted(found.values(), key=lambda x: x.cost(task))


def _told_apart(flown: Sequence[end_to_end.Fit]) -> tuple[int, float] | None:
    """The run that tells the first of some fits best from another, and the largest χ² in it that is near to the
    first's; None where no run does. The first leaves noise: what leaves more in one run does not make that good in
    others."""
    apart = np.max([f.of_runs - flown[0].of_runs for f in flown], axis=0)
    run = int(np.argmax(apart))
    return (run, float(flown[0].of_runs[run]) + NEAR) if apart[run] > NEAR else None


def fitted_end_to_end(
    task: Task, structure: Structure, point: Point, runs: Sequence[int] | None = None, settle: bool = False
) -> end_to_end.Fit:
    """Runs (all, unless said) fitted from end to end, with contact taken exactly, from a point nearby; ``settle``: each
    run's initial state anew where a joint step falls short."""
    problem = task.problem
    runs = range(len(problem.runs)) if runs is None else runs
    found = {p.on: p.size for p in point.processes if p.kind == background.WHITE and p.on not in task.given}
    part = problem.subset(runs).with_changes(sigma=problem.sigma * [found.get(c, 1.0) for c in problem.channels])
    states = [point.paths[i][0, :8] for i in runs]
    return end_to_end.fit(part, structure, states, point.theta, FLOWN_STEPS, settle=settle)


def _flown_exactly(task: Task, structure: Structure, point: Point) -> end_to_end.Fit:
    """All runs fitted from end to end. Past a contact the valleys are so curved that joint steps alone creep."""
    return fitted_end_to_end(task, structure, point, settle=True)


def _most_left(task: Task, run: int) -> float:
    """The largest χ² of one run where all runs together leave noise: what all may leave beyond its expectation, and the
    luck of the others."""
    mine, every = len(task.problem.runs[run].y), task.problem.samples
    return mine + end_to_end.most_noise(every) - every + end_to_end.NOISE * float(np.sqrt(2.0 * (every - mine)))


def touches(f: Fit) -> bool:
    """Whether runs touch the track and contact is not taken exactly yet."""
    return not f.exact and any(t.any() for t in f.touching)


def all_refitted(task: Task, state: State, sets: Sequence[CandidateSet], family: int) -> list[State]:
    """The state with each of several sets of known effects; a cluster's workers refit them at once."""
    if isinstance(task.workers, Threads):
        return [refitted(task, state, s, family) for s in sets]
    task.say("refitting " + ", ".join(s.title for s in sets))
    there = replace(task, tell=lambda _: None, workers=Threads(), until=np.inf)
    return task.workers.map(lambda s: refitted(there, state, s, family), list(sets))


def _first_step(structure: Structure, member: Candidate, sizes: np.ndarray, count: int) -> np.ndarray:
    """How far the parameters (count,) of a new effect are expected from where they start."""
    if not member.start:
        return sizes[:count]
    own = [n.rpartition(".")[2] for n in structure.free[len(structure.free) - count :]]
    step = np.zeros(count)
    for name, size in zip(member.sized, sizes, strict=False):
        if name in own:
            step[own.index(name)] = np.clip(size, -placed.LARGEST, placed.LARGEST)
    return step


def settled(task: Task, state: State) -> State:
    """The state fitted on to convergence."""
    f = state.fit
    if f.converged:
        return state
    new = fit(task.problem, f.structure, f.point, REFIT_STEPS)
    return replace(state, fit=min(new, f, key=lambda x: x.deviance))


def with_law(task: Task, state: State, law: Law) -> State:
    """The state with a force of any shape as a table."""
    task.say(f"any force in {law.acts_on} on {law.variable}")
    old = state.fit.structure
    table = {"knots": float(len(law.table.values)), "values": tuple(float(v) for v in law.table.values)}
    values = {**parameters(law.variable, law.start, law.step), **law.times, **table}
    structure = old.plus(law.name, values, free=[f"values[{k}]" for k in range(len(law.table.values))])
    structure = replace(structure, smoothness={**old.smoothness, law.name: law.table.smoothness})
    theta = np.concatenate([state.fit.theta, law.table.values / structure.scale[len(state.fit.theta) :]])
    new = fit(task.problem, structure, replace(state.fit.point, theta=theta), REFIT_STEPS)
    freedom = (*state.freedom, (law.name, law.table.occam))
    price = state.price + law.table.occam + law_price()
    grown = replace(state, fit=new, added=(*state.added, law.name), price=price, freedom=freedom)
    return grown.told(
        f"any force in {law.acts_on} on {law.variable}: deviance {state.fit.deviance:.0f} -> {new.deviance:.0f} (gain"
        f" {law.gain:.0f})"
    )


def described(task: Task, state: State, name: str, cost: float) -> State:
    """The state with a force of any shape at the cost of what describes it, where that is less than its table's."""
    had = _share(task, state, name)
    if cost >= had:
        return state
    return replace(state, price=state.price + cost - had, closed={**state.closed, name: cost})


def taken_exactly(task: Task, state: State) -> State:
    """The state with contact taken exactly, where that leaves nothing but noise; else as it was.

    Until the physics is right, blows are forgiven and only what is read outside a contact counts: then a shaken rig is
    no friction."""
    f = state.fit
    if not touches(f) or not (whole := _flown_exactly(task, f.structure, f.point)).leaves_noise:
        return state
    new = exactly(task.problem, f.structure, f.point, REFIT_STEPS, whole)
    exact = replace(state, fit=new).told(f"contact taken exactly: deviance {new.deviance:.0f}")
    return smoothed_anew(task, exact) if state.stands_in else exact


def smoothed_anew(task: Task, state: State) -> State:
    """The state with the tables of its stand-ins as smooth as the data now say, where that pays: at first order they
    were told by a poorer fit."""
    for name in () if state.fit.lost else state.fit.structure.tables.keys() - state.closed.keys():
        f = state.fit
        table = table_of(task.problem, f, linearise_all(task.problem, f), name)
        structure = replace(f.structure, smoothness={**f.structure.smoothness, name: table.smoothness})
        mine = f.structure.tables[name]
        theta = f.theta.copy()
        theta[mine] = table.values / structure.scale[mine]
        new = fit(task.problem, structure, replace(f.point, theta=theta), REFIT_STEPS)
        had = dict(state.freedom).get(name, 0.0)
        freedom = (*(x for x in state.freedom if x[0] != name), (name, table.occam))
        tried = replace(state, fit=new, price=state.price + table.occam - had, freedom=freedom)
        if tried.cost(task) < state.cost(task):
            state = tried.told(
                f"the table of {name} as smooth as all data say: deviance {f.deviance:.0f} -> {new.deviance:.0f}"
            )
    return state


def without(task: Task, state: State, name: str, floor: float = 0.0) -> State:
    """The state without one of its effects, refitted from where it stands with at least the share ``floor`` of the
    first power."""
    f = state.fit
    structure = f.structure.minus(name)
    kept = [f.structure.free.index(n) for n in structure.free]
    power = f.power
    if floor:
        power = np.maximum(power, floor * first_power(task.problem, linearise_all(task.problem, f)))
    new = fit(task.problem, structure, replace(f.point, theta=f.theta[kept], power=power), REFIT_STEPS)
    price = state.price - _share(task, state, name)
    left = {
        "added": tuple(n for n in state.added if n != name),
        "freedom": tuple(f for f in state.freedom if f[0] != name),
        "closed": {n: cost for n, cost in state.closed.items() if n != name},
    }
    return replace(state, fit=new, price=price, **left)


def surely_needed(task: Task, state: State, name: str) -> bool:
    """Whether the deviance without an effect would to first order rise by far more than the effect costs (Wald).

    Beside a force of any shape, which may do the same, first order does not tell."""
    f = state.fit
    mine = [k for k, n in enumerate(f.structure.free) if n.rpartition(".")[0] == name]
    if len(mine) != 1 or state.stands_in:  # of several parameters most say where an effect is, not whether
        return False
    vanishing = f.structure.minus(name).plus(name)
    away = f.theta[mine] - vanishing.start[[vanishing.free.index(f.structure.free[k]) for k in mine]]
    rise = float(away @ np.linalg.pinv(f.covariance[np.ix_(mine, mine)], hermitian=True) @ away)
    return rise > _share(task, state, name) + NEAR


def _share(task: Task, state: State, name: str) -> float:
    """What one effect of a state costs by chance."""
    if name.startswith("stand_in"):
        return state.closed.get(name, law_price() + dict(state.freedom)[name])
    count = sum(n.rpartition(".")[0] == name for n in state.fit.structure.free)
    return Candidate(name, name, {}, count).price(len(names(task.problem, state.fit.structure)) + 1)


def rivals(task: Task, state: State, name: str) -> tuple[State, list[State]]:
    """The state, and those with another known effect in the place of one, or the same from another start, refitted
    where they come near; cheapest first. First order is as wrong of the one itself as of the others: near is what
    promises nearly as much as it does, and those most alike are tried besides those that promise most.

    What candidates promised in the place of the last one is told anew: it was screened beside a poorer fit.
    """
    task.say(f"what could stand in the place of {name}")
    smaller = without(task, state, name, ANEW)
    if smaller.fit.lost:
        return state, []
    screening = screened(task, smaller)
    singles = [s for s in screening.sets if len(s.members) == 1]
    own = [s for s in singles if s.title != name or s.members[0].start]
    promised = next((s.deviance for s in singles if s.title == name), -np.inf)
    reach = min(max(state.fit.deviance, promised) + NEAR, screening.scores.plain - TWINS)  # more than by chance
    near = [s for s in own if s.deviance < reach]
    alike = sorted(near, key=lambda s: abs(s.deviance - promised))[:REFITTED]
    near = near[:REFITTED] + [s for s in alike if s not in near[:REFITTED]]
    if state.fit.exact:  # the state leaves noise, so what explains as much does too
        close = exact_ones(task, smaller, near, screening.family)
    else:
        tried = all_refitted(task, smaller, near, screening.family)
        close = [
            settled(task, t) if min(t.fit.deviance - state.fit.deviance, s.deviance - promised) < TWINS * 3 else t
            for t, s in zip(tried, near, strict=True)
        ]
    rounds = tuple((beside, screening if beside == smaller.added else old) for beside, old in state.rounds)
    return replace(state, rounds=rounds), sorted(close, key=lambda s: s.cost(task))
