# SPDX-License-Identifier: Apache-2.0
"""Forces of any shape, sought beside the noise of a state and beside less of it: a force may do what noise seems to
do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..estimation.kalman import LinearRun
from ..estimation.shooting import Fit
from .belonging import odd_run
from .moves import State, Task, law_price, shaken, smoothed_anew, with_law
from .screening import Law, laws
from .settings import FORCES_REFITTED, NEAR


@dataclass(frozen=True)
class Promise:
    """A force of any shape, the state beside whose noise it is promised, and the cost that it promises."""

    law: Law
    beside: State
    cost: float


def promised(task: Task, state: State, systems: Sequence[LinearRun], quieter: Sequence[Fit]) -> list[Promise]:
    """The forces that gain more than a law costs beside a state or beside less noise, the cheapest first; ``systems``
    are the runs linearised about its trajectories, ``quieter`` as `background.quieter` gives it."""
    found = []
    for quiet in quieter:
        beside = replace(state, fit=quiet)
        cost = beside.cost(task) + law_price()
        tables = laws(task.problem, quiet, systems, shaken(task, beside, systems))
        found += [Promise(law, beside, cost - law.gain) for law in tables if law.gain > law_price()]
    return sorted(found, key=lambda p: p.cost)


def best_force(task: Task, state: State, promises: Sequence[Promise]) -> State:
    """The cheapest when refitted, and as smooth as the refit says, of those that promise most; none while a run is
    there that does not belong."""
    if odd := odd_run(task, state):
        return replace(state, odd=odd)
    near = [p for p in promises if p.cost < promises[0].cost + NEAR][:FORCES_REFITTED]
    return min((smoothed_anew(task, with_law(task, p.beside, p.law)) for p in near), key=lambda s: s.cost(task))
