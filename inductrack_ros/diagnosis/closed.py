# SPDX-License-Identifier: Apache-2.0
"""A force of a closed form, where no table pays: a bump costs its three parameters, a table around it many more. Forms
times a second variable are asked for too.

Only where something moves the cradle that the model does not have. The force is added as its table, so that all that
asks for the shape of an unknown force goes on as with any other; only what it costs is that of the form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from scipy import stats

from ..core.effects.stand_in import covered, over
from ..core.state import COORDINATES
from ..estimation.kalman import LinearRun
from ..estimation.scores import pushed_by
from ..estimation.shooting import Fit, all_histories, linearise_all
from .factor import Factor
from .laws.code import Written
from .laws.fitting import Fitted, Table, fitted, starts_of
from .laws.forms import Form, Range, forms_on
from .laws.propose import in_place
from .moves import State, Task, described, shaken, with_law
from .screening import Asked, Equations, equations, products, sizes_of, tables_on_one
from .settings import FORCES_REFITTED, LEVEL


@dataclass(frozen=True)
class Promise:
    """A closed form over the ``range`` of a table, its ``price`` by chance, and by how much the deviance falls beyond
    that."""

    asked: Equations
    form: Fitted
    range: Range
    price: float
    gain: float


def add_closed(task: Task, state: State) -> State:
    """Add a force that has a closed form, where that pays."""
    if state.stands_in:
        return state
    systems = linearise_all(task.problem, state.fit)
    lacking = shaken(task, state, systems)
    promised = [p for p in promises(task, state.fit, systems, lacking) if p.gain > 0.0] if lacking else []
    tried = [_refitted(task, state, p) for p in promised[:FORCES_REFITTED]]
    best = min(tried, key=lambda s: s.cost(task), default=state)
    if best.cost(task) < state.cost(task):
        return best
    return state.told("no force of a closed form pays either") if tried else state


def promises(task: Task, f: Fit, systems: Sequence[LinearRun], lacking: Sequence[str]) -> list[Promise]:
    """What closed forms promise on all that a force may depend on and act on, the best first."""
    problem = task.problem
    on_one = {on: t for on, t in tables_on_one(problem, f, lacking).items() if pushed_by(on) in lacking}
    runs = all_histories(problem, f)
    rough = {on: products(runs, on) for on in on_one if on in COORDINATES}
    found = _best(task, f, systems, on_one, lacking)
    near = [p for p in _best(task, f, systems, rough, lacking) if p.gain > 0.0][:FORCES_REFITTED]
    fine = {on: [t for p in near if p.asked.acts_on == on for t in _finer(p.asked.asked)] for on in rough}
    return sorted([*found, *_best(task, f, systems, fine, lacking, rough)], key=lambda p: -p.gain)


def _finer(rough: Asked) -> list[Asked]:
    """The same with the steps of forces on one variable."""
    low, high = covered(rough.start, rough.step, rough.count)
    return [
        replace(rough, **dict(zip(("start", "step", "count"), over(low, high, n), strict=True)))
        for n in sizes_of(rough.variable, True)
    ]


def _best(
    task: Task,
    f: Fit,
    systems: Sequence[LinearRun],
    tables: Mapping[str, Sequence[Asked]],
    lacking: Sequence[str],
    chosen_from: Mapping[str, Sequence[Asked]] | None = None,
) -> list[Promise]:
    """What closed forms promise in the place of tables; of each coordinate, variable and factor the best, the best of
    all first. The tables were ``chosen_from`` as many as chance counts.

    A form is fitted only where its table leaves it room: none can take off more than all that the data say."""
    tables = {on: asked for on, asked in tables.items() if asked}
    family = sum(len(_forms(on, a)) for on, asked in (chosen_from or tables).items() for a in _once(asked))
    best: dict[tuple, Promise] = {}
    for e in equations(task.problem, f, systems, tables, lacking):
        table = Table.of(e.acts_on, e.asked.parameters, e.gram, e.score)
        whole = float(table.wanted @ table.wanted) - e.rise  # what a form without any misfit would take off
        prices = {form.name: price_of(form, table, family) for form in _forms(e.acts_on, e.asked)}
        room = [form for form in _forms(e.acts_on, e.asked) if prices[form.name] < whole]
        for one in fitted(table, task.problem.samples, room):
            price = prices[one.form.name]
            p, key = Promise(e, one, table.range, price, whole - one.misfit - price), (e.acts_on, *_pair(e.asked))
            best[key] = max(best.get(key, p), p, key=lambda x: x.gain)
    return sorted(best.values(), key=lambda p: -p.gain)


def _forms(on: str, asked: Asked) -> tuple[Form, ...]:
    return forms_on(asked.variable, on, asked.factor is not None)


def _pair(asked: Asked) -> tuple[str, Factor | None]:
    return asked.variable, asked.factor


def _once(asked: Sequence[Asked]) -> list[Asked]:
    """One table of each variable and factor."""
    return list({_pair(a): a for a in asked}.values())


def price_of(form: Form, table: Table, family: int) -> float:
    """Fall of the deviance that chance reaches in half of `LEVEL` of campaigns with a form among ``family``, each
    sought from all its starts; the other half is for forces on another number of variables."""
    return float(stats.chi2.isf(0.5 * LEVEL / (family * starts_of(table, form)), form.count))


def _refitted(task: Task, state: State, p: Promise) -> State:
    """The state with the table of a form, at the price of the form, refitted in full in the table's place."""
    e = p.asked
    grown = with_law(task, state, replace(e.law(task.problem.samples), gain=p.gain))
    name = grown.added[-1]
    law = Written(p.form.form, e.acts_on, e.asked.variable, p.form.parameters, p.range, factor=e.asked.factor)
    new = in_place(task, grown.fit, name, law)
    cost = new.deviance + p.price - grown.fit.deviance
    return described(task, grown, name, cost).told(f"as {law.form.title}: deviance {new.deviance:.0f}")
