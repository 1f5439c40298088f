# SPDX-License-Identifier: Apache-2.0
"""A force of a closed form, where no table pays: a bump costs its three parameters, a table around it many more.

Only where something moves the cradle that the model does not have. The force is added as its table, so that all that
asks for the shape of an unknown force goes on as with any other; only what it costs is that of the form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scipy import stats

from ..core.effects.stand_in import parameters
from ..estimation.kalman import LinearRun
from ..estimation.scores import pushed_by
from ..estimation.shooting import Fit, linearise_all
from .laws.code import Written
from .laws.fitting import Fitted, Table, fitted, starts_of
from .laws.forms import ALONG, Form, Range, forms_on
from .laws.propose import in_place
from .moves import State, Task, described, shaken, with_law
from .screening import Equations, Law, equations
from .settings import FORCES_REFITTED, LEVEL
from .smooth import smoothest_of


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
    """What closed forms promise on all that a force may depend on and act on; of each pair of these the best first.

    A form is fitted only where its table leaves it room: none can take off more than all that the data say."""
    samples = task.problem.samples
    asked = [e for e in equations(task.problem, f, systems, lacking) if pushed_by(e.acts_on) in lacking]
    forms = {(e.acts_on, e.variable): forms_on(e.variable, e.acts_on) for e in asked}
    family = sum(map(len, forms.values()))
    best: dict[tuple[str, str], Promise] = {}
    for e in asked:
        pair = e.acts_on, e.variable
        table = Table.of(e.acts_on, parameters(e.variable, e.start, e.step), e.gram, e.score)
        whole = float(table.wanted @ table.wanted) - e.rise  # what a form without any misfit would take off
        prices = {form.name: price_of(form, table, family) for form in forms[pair]}
        for one in fitted(table, samples, [form for form in forms[pair] if prices[form.name] < whole]):
            price = prices[one.form.name]
            p = Promise(e, one, table.range, price, whole - one.misfit - price)
            best[pair] = max(best.get(pair, p), p, key=lambda x: x.gain)
    return sorted(best.values(), key=lambda p: -p.gain)


def price_of(form: Form, table: Table, family: int) -> float:
    """Fall of the deviance that chance reaches in `LEVEL` of campaigns with a form among ``family``, each sought from
    all its starts."""
    return float(stats.chi2.isf(LEVEL / (family * starts_of(table, form)), form.count))


def _refitted(task: Task, state: State, p: Promise) -> State:
    """The state with the table of a form, at the price of the form, refitted in full in the table's place."""
    e = p.asked
    table = smoothest_of(e.gram, e.score, task.problem.samples, e.variable in ALONG)
    grown = with_law(task, state, Law(e.acts_on, e.variable, e.start, e.step, table, p.gain, e.power))
    name = grown.added[-1]
    law = Written(p.form.form, e.acts_on, e.variable, p.form.parameters, p.range)
    new = in_place(task, grown.fit, name, law)
    cost = new.deviance + p.price - grown.fit.deviance
    return described(task, grown, name, cost).told(f"as {law.form.title}: deviance {new.deviance:.0f}")
