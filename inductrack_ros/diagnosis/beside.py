# SPDX-License-Identifier: Apache-2.0
"""A force of any shape and a known effect added together, where neither pays alone.

While one is missing, the other explains half of what is wrong, and a plant that is shaken explains all of it for
less."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ..estimation.kalman import LinearRun
from ..estimation.scores import Background, Level, Scores, pushed_by, scores
from ..estimation.shooting import all_histories, linearise_all
from . import background
from .candidates import Candidate, sought
from .moves import State, Task, grown, law_price, shaken, smoothed_anew, with_effects, with_law
from .screening import (
    FINE_SHARES,
    Asked,
    CandidateSet,
    Law,
    acted_on,
    asked_over,
    columns_of,
    sizes_of,
    spans_of,
    tables_over,
)
from .settings import FORCES_REFITTED, MOST_EFFECTS


@dataclass(frozen=True)
class Promise:
    """A known effect and a table together: the effect at the size that it has then, the table, and by how much the
    deviance falls beyond what both cost."""

    one: CandidateSet
    law: Law
    gain: float


def add_beside(task: Task, state: State) -> State:
    """Add a force of any shape and a known effect together, where something shakes a coordinate and neither of them
    pays alone."""
    if state.stands_in or len(state.known) >= MOST_EFFECTS:
        return state
    systems = linearise_all(task.problem, state.fit)
    lacking = shaken(task, state, systems)
    if not lacking:
        return state
    promised = promises(task, state, systems, lacking)
    tried = [_refitted(task, state, p, len(promised)) for p in promised[:FORCES_REFITTED] if p.gain > 0.0]
    best = min(tried, key=lambda s: s.cost(task), default=state)
    if best.cost(task) < state.cost(task):
        return best
    return state.told("no force of any shape pays beside a known effect either") if tried else state


def promises(task: Task, state: State, systems: Sequence[LinearRun], lacking: Sequence[str]) -> list[Promise]:
    """What each known effect and the table that suits it best promise together; the best first."""
    problem, f = task.problem, state.fit
    candidates, parts = sought(problem, f, systems, wavy=True)
    spans = spans_of(all_histories(problem, f))
    tables = {
        f"table {on} {t.variable}": (on, t)
        for on in acted_on(problem, f)
        if pushed_by(on) in lacking
        for t in tables_over(asked_over(on, spans), lambda v: sizes_of(v, True)[:1])
    }
    of_tables = {
        n: problem.for_runs(lambda i, on=on, t=t: columns_of(problem, f, i, on, [t])) for n, (on, t) in tables.items()
    }
    price = background.price(problem, task.given, f.processes)
    found = scores(problem, f, parts | of_tables, systems, [Background(f.power, f.processes, price)], FINE_SHARES)
    of_each = [_best(found, one, tables, problem.samples, len(candidates)) for one in candidates.values()]
    return sorted(of_each, key=lambda p: -p.gain)


def _best(found: Scores, one: Candidate, tables: Mapping[str, tuple[str, Asked]], samples: int, family: int) -> Promise:
    """The table that promises most beside a known effect, at the power that suits both."""

    def at(level: Level, name: str) -> Promise:
        beside, (on, asked) = found.beside(level, one.label, name), tables[name]
        table = asked.smoothest(beside.gram, beside.score, samples)
        size = beside.size - beside.moves @ table.values
        gain = found.plain - beside.deviance + table.promise
        known = CandidateSet((one,), beside.deviance, beside.deviance, {one.label: size}, level.background)
        return Promise(known, asked.law(on, table, gain, level.power), gain - law_price() - one.price(family))

    every = ((level, n) for n, (on, _) in tables.items() for level in found.levels if level.suits(pushed_by(on)))
    return max((at(level, name) for level, name in every), key=lambda p: p.gain)


def _refitted(task: Task, state: State, p: Promise, family: int) -> State:
    """The state with both, refitted together from what they promise."""
    structure, point = with_effects(task.problem, state.fit, p.one)
    there = replace(state.fit, structure=structure, theta=point.theta, paths=point.paths, power=p.law.power)
    new = smoothed_anew(task, with_law(task, grown(state, p.one, family, there), p.law))
    return new.told(f"{p.one.title} and a force in {p.law.acts_on} on {p.law.variable} together")
