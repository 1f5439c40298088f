"""The search for what is missing, on one page: screen, refit, add, until nothing more is explained; then prune.

Every stage is a function from one `State` to the next with a reason for the log (``inductrack diagnose --explain``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.effects.stand_in import VARIABLES
from ..estimation import columns
from ..estimation.problem import Problem
from ..estimation.shooting import ANEW, FIRST_POWER, NO_POWER, Fit, Point, fit, linearise_all, weigh
from .screening import Candidate, CandidateSet, Law, Screening, laws, names, screen
from .settings import LEVEL, LOOK_STEPS, NEAR, REFIT_STEPS, REFITTED, ROUNDS, SHAKEN, TWINS


@dataclass(frozen=True)
class State:
    """Where the search stands: the fit, the effects added in their order, what they cost by chance, and the log."""

    fit: Fit
    added: tuple[str, ...] = ()
    price: float = 0.0
    log: tuple[str, ...] = ()
    rounds: tuple[tuple[tuple[str, ...], Screening], ...] = ()
    freedom: tuple[tuple[str, float], ...] = ()  # what that of each force of any shape costs

    @property
    def cost(self) -> float:
        """The deviance and what chance would have taken off it."""
        return self.fit.deviance + self.price

    def told(self, line: str) -> State:
        """The state with a line more in its log."""
        return replace(self, log=(*self.log, line))


Stage = Callable[[Problem, State], State]


def search(problem: Problem, base: Fit, tell: Callable[[str], None] = lambda _: None) -> State:
    """The state with everything that the data say is missing."""
    state = State(base)
    for name, stage in STAGES:
        tell(name)
        state = stage(problem, state)
    return state


# ---------------------------------------------------------------- stages


def add_known(problem: Problem, state: State) -> State:
    """Add the set of known effects that explains most, round by round, as long as it takes off more than chance would.

    A force of any shape that promises far less cost than any known set comes first, for the known would only imitate it.
    """
    for _ in range(ROUNDS):
        systems = linearise_all(problem, state.fit)
        lacking = shaken(problem, state.fit, systems)
        screening = screen(problem, state.fit, systems, wavy=bool(lacking))
        state = replace(state, rounds=(*state.rounds, (state.added, screening)))
        plain = screening.scores.plain
        best = screening.sets[0] if screening.sets else None
        if lacking and not any(n.startswith("stand_in") for n in state.added):
            law = _first(laws(problem, state.fit, systems, lacking))
            if law and law.gain > law_price(problem) and (best is None or plain - law.gain + law_price(problem) < best.cost - NEAR):
                new = _with_law(problem, state, law)
                if new.cost < state.cost:
                    state = new
                    continue
        if best is None or best.cost > plain:
            return state.told("no known effect explains more than chance would")
        tried = [s for s in screening.sets[:REFITTED] if s.cost < min(best.cost + NEAR, plain)]
        refitted = sorted((_with_known(problem, state, s, screening.family) for s in tried), key=lambda s: s.cost)
        refitted[0] = _settled(problem, refitted[0])
        if refitted[0].cost > state.cost:
            return state.told(f"{' + '.join(refitted[0].added)} promises more than it keeps")
        state = refitted[0]
    return state


def add_unknown(problem: Problem, state: State) -> State:
    """Add a force of any shape where one is still missing."""
    if any(n.startswith("stand_in") for n in state.added):
        return state
    systems = linearise_all(problem, state.fit)
    law = _first(laws(problem, state.fit, systems, shaken(problem, state.fit, systems)))
    if law is None or law.gain < law_price(problem):
        return state.told("no force of any shape is missing")
    new = _with_law(problem, state, law)
    return new if new.cost < state.cost else state.told(f"a force in {law.acts_on} on {law.variable} promises more than it keeps")


def prune(problem: Problem, state: State) -> State:
    """Take out whatever is not needed, the last added first."""
    for name in reversed(state.added):
        if len(state.added) == 1:
            break
        smaller = without(problem, state, name)
        if smaller.cost < state.cost:
            return prune(problem, smaller.told(f"{name} is not needed"))
    return state


STAGES: tuple[tuple[str, Stage], ...] = (
    ("known effects", add_known),
    ("a force of any shape", add_unknown),
    ("what is not needed", prune),
)


# ---------------------------------------------------------------- moves


def shaken(problem: Problem, f: Fit, systems: Sequence | None = None) -> list[str]:
    """Coordinates in which something moves the cradle that the model does not have."""
    systems = systems or linearise_all(problem, f)
    here = weigh(problem, f.structure, systems, f.theta, f.power).deviance
    found = []
    for c, name in enumerate(("surge", "sway", "heave", "roll")):
        if f.power[c] > NO_POWER:
            still = weigh(problem, f.structure, systems, f.theta, np.where(np.arange(4) == c, 0.0, f.power)).deviance
            if still > here + SHAKEN:
                found.append(name)
    return found


def law_price(problem: Problem) -> float:
    """Twice the log evidence by which a force of any shape wrongly stands out in `LEVEL` of campaigns, at the most (a Bayes factor, laws counted)."""
    return 2.0 * float(np.log(len(VARIABLES) * 5 / LEVEL))


def _first(items: Sequence):
    return items[0] if items else None


def _with_known(problem: Problem, state: State, found: CandidateSet, family: int, steps: int = LOOK_STEPS) -> State:
    structure, theta, paths = state.fit.structure, state.fit.theta, state.fit.paths
    for member in found.members:
        structure = structure.plus(member.name, member.start)
        begin = structure.start[len(theta) :]
        step = np.zeros(len(begin)) if member.start else found.sizes[member.label][: len(begin)]
        theta = np.clip(np.concatenate([theta, begin + step]), *structure.bounds)
        if not state.fit.model.carries_states and structure.model.carries_states:
            paths = tuple(problem.for_runs(lambda i, s=structure: columns.carried(problem, s, i, paths[i])))
    new = fit(problem, structure, Point(theta, paths, state.fit.power), steps)
    labels = " + ".join(m.name for m in found.members)
    price = state.price + sum(m.price(family) for m in found.members)
    grown = State(new, (*state.added, *(m.name for m in found.members)), price, state.log, state.rounds, state.freedom)
    return grown.told(f"{labels}: deviance {state.fit.deviance:.0f} -> {new.deviance:.0f} (expected {found.deviance:.0f})")


def _settled(problem: Problem, state: State) -> State:
    """The state fitted on to convergence."""
    f = state.fit
    if f.converged:
        return state
    new = fit(problem, f.structure, f.point, REFIT_STEPS)
    return replace(state, fit=min(new, f, key=lambda x: x.deviance))


def _with_law(problem: Problem, state: State, law: Law) -> State:
    old = state.fit.structure
    values = {
        "variable": float(VARIABLES.index(law.variable)), "start": law.start, "step": law.step,
        "knots": float(len(law.table.values)), "values": tuple(float(v) for v in law.table.values),
    }  # fmt: skip
    structure = old.plus(law.name, values, free=[f"values[{k}]" for k in range(len(law.table.values))])
    structure = replace(structure, smoothness={**old.smoothness, law.name: law.table.weight})
    theta = np.concatenate([state.fit.theta, law.table.values / structure.scale[len(state.fit.theta) :]])
    new = fit(problem, structure, Point(theta, state.fit.paths, state.fit.power), REFIT_STEPS)
    freedom = (*state.freedom, (law.name, law.table.occam))
    grown = State(new, (*state.added, law.name), state.price + law.table.occam + law_price(problem), state.log, state.rounds, freedom)
    return grown.told(f"any force in {law.acts_on} on {law.variable}: deviance {state.fit.deviance:.0f} -> {new.deviance:.0f} (gain {law.gain:.0f})")


def without(problem: Problem, state: State, name: str, steps: int = REFIT_STEPS) -> State:
    """The state without one of its effects, refitted from where it stands."""
    f = state.fit
    structure = f.structure.minus(name)
    kept = [f.structure.free.index(n) for n in structure.free]
    power = np.maximum(f.power, ANEW * FIRST_POWER) * problem.model.moving
    new = fit(problem, structure, Point(f.theta[kept], f.paths, power), steps)
    price = state.price - _share(problem, state, name)
    freedom = tuple(f for f in state.freedom if f[0] != name)
    return State(new, tuple(n for n in state.added if n != name), price, state.log, state.rounds, freedom)


def _share(problem: Problem, state: State, name: str) -> float:
    """What one effect of a state costs by chance."""
    if name.startswith("stand_in"):
        return law_price(problem) + dict(state.freedom)[name]
    count = sum(n.rpartition(".")[0] == name for n in state.fit.structure.free)
    return Candidate(name, name, {}, count).price(len(names(problem, state.fit.structure)) + 1)


def rivals(problem: Problem, state: State, name: str) -> list[State]:
    """States with another known effect in the place of one, refitted where they come near; cheapest first."""
    smaller = without(problem, state, name)
    screening = screen(problem, smaller.fit)
    own = [s for s in screening.sets if len(s.members) == 1 and s.members[0].name != name]
    reach = state.fit.deviance + NEAR
    near = [s for s in own if s.deviance < reach][:REFITTED]
    tried = [_with_known(problem, smaller, s, screening.family) for s in near]
    close = [_settled(problem, t) if t.fit.deviance < state.fit.deviance + TWINS * 3 else t for t in tried]
    return sorted(close, key=lambda s: s.cost)
