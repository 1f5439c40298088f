# SPDX-License-Identifier: Apache-2.0
"""The search for what is missing, on one page: screen, refit, add, until nothing more is explained; then prune and
exchange; and again where these changed what is there.

Every stage is a function from one `State` to the next with a reason in the log, which ``inductrack diagnose --explain``
prints. What log and rig do besides (`background`) and physics compete: both are judged by the deviance with what chance
would take off it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..estimation.likelihood import TOLERANCE, Lost
from ..estimation.shooting import linearise_all
from . import background
from .beside import add_beside
from .closed import add_closed
from .forces import best_force, promised
from .leads import best_lead
from .moves import (
    OutOfTime,
    State,
    Task,
    all_refitted,
    exact_ones,
    last_screened,
    rivals,
    screened,
    settled,
    shaken,
    surely_needed,
    taken_exactly,
    without,
)
from .pairs import SURER, add_pair
from .screening import CandidateSet, Screening
from .settings import MOST_EFFECTS, MOST_REFITTED, NEAR, REFITTED, ROUNDS, TWINS

#: Findings of the look at the data that are effects of the catalogue.
EFFECT_SEEN = {"saturated": "sensor_saturation"}

Stage = Callable[[Task, State], State]


def search(task: Task, state: State) -> State:
    """The state with everything that the data say is missing, or with a run that has to be set aside first; what log
    and rig do besides was looked for before (`add_background`)."""
    start, revised, lead = state, list[set[str]](), None
    while True:
        known = _through(task, state, ADDING[:1])
        state = _through(task, known, ADDING[1:])
        if known.far and state.fit is not known.fit:  # how much is missing beside that is asked anew
            state = _through(task, replace(state, far=False), ADDING)
        if state.odd:
            return state
        if state.far and not state.stopped and (led := _led(task, start, state)) is not state:
            if led.far or led.stopped or lead:
                return led
            lead = state = led  # it leaves noise: is anything missing beside it?
            continue
        grown = set(state.added)
        if state.stopped or revised and grown == revised[-1]:
            break
        state = _through(task, state, REVISING)
        left = set(state.added)
        if state.stopped or left == grown or left in revised:
            break
        revised.append(left)  # something went: what is missing beside the rest is asked anew
    if state.stopped:
        return likeliest(task, state)
    if len(state.added) > MOST_EFFECTS:
        doubt = f"{len(state.added)} effects are more than {MOST_EFFECTS}: the model is too far from the rig to be sure"
        return _led(task, start, replace(state.told(doubt), far=True))
    if len(state.added) > 1 and any(h.kind == "unlike" for h in task.hints):
        led = _led(task, start, state, rival=state)  # on such a rig one may predict better than all that imitate it
        if led is not state:
            return led
    if state.verdict == "unknown_effect":
        return likeliest(task, state)
    state = last_screened(task, likeliest(task, state))
    if not (promise := unkept(state)):
        return state
    return _led(task, start, replace(state.told(f"{promise} promises much beside that, and keeps none"), far=True))


def unkept(state: State) -> str:
    """The single effect that promises far more beside an answer than it costs, although no refit kept that; empty where
    none does. Then what is missing is none of the known effects, and these are only like it."""
    screening = state.rounds[-1][1]
    best = next(iter(screening.singles), None)
    return best.members[0].name if best and best.cost < screening.scores.plain - NEAR else ""


def _led(task: Task, start: State, found: State, rival: State | None = None) -> State:
    """The one effect with which a model far from the rig predicts the runs best, in the place of all that was found.

    It is sought from where the search began. Where no effect explains more than it leaves, or predicts better than a
    ``rival``, what was found stays. Where one leaves more than noise (``far``), the next effect is asked for once this
    one is added."""
    try:
        lead = best_lead(task, start, rival)
        if lead is None:
            return found
        state = add_background(task, lead)
    except Lost:  # a model that leads beyond all numbers is no lead
        return found
    except (KeyboardInterrupt, OutOfTime) as stop:
        return _broken_off(found, stop)
    return replace(state, far=lead.far, log=(*found.log, *state.log[len(start.log) :]))


def _broken_off(state: State, stop: BaseException) -> State:
    """The state, with why the search ends at it."""
    return replace(state, stopped="interrupted" if isinstance(stop, KeyboardInterrupt) else "out of time")


def _through(task: Task, state: State, stages: Sequence[tuple[str, Stage]]) -> State:
    """All of some stages, one after the other, as far as there is time."""
    for name, stage in stages:
        if state.odd:
            break
        try:
            state = _repeated(task, state, name, stage)
        except (KeyboardInterrupt, OutOfTime) as stop:
            return _broken_off(state, stop)
    return state


def _repeated(task: Task, state: State, name: str, stage: Stage) -> State:
    """A stage as long as it changes what is added."""
    for _ in range(ROUNDS):
        task.say(name)
        before, state = state, stage(task, state)
        if state.fit is before.fit or stage is not exchange and state.added == before.added:
            break
    return state


def add_background(task: Task, state: State) -> State:
    """Add what log and rig do besides, as far as it pays; take out what no longer does. Contact is exact where that
    leaves noise."""
    state = taken_exactly(task, state)
    new = background.improved(
        task.problem, background.lean(task.problem, state.fit, task.given), task.given, task.hints, task.tell
    )
    kinds = ", ".join(dict.fromkeys(f"{p.kind} {p.on}".strip() for p in new.processes)) or "nothing"
    return replace(state, fit=new).told(f"beside the model: {kinds}; deviance {new.deviance:.0f}")


def add_known(task: Task, state: State) -> State:
    """Add the set of known effects that explains most, where it takes off more than chance would.

    Forces of any shape compete: where one keeps more than every known set, the known would only imitate it. First order
    flatters both kinds, so both are compared refitted.
    """
    state = replace(state, far=False)
    systems = linearise_all(task.problem, state.fit)
    lacking = shaken(task, state, systems)
    quiet = background.quieter(task.problem, state.fit, task.given, systems)
    screening = screened(task, state, systems, quiet, wavy=bool(lacking))
    state = replace(state, rounds=(*state.rounds, (state.added, screening)))
    pays = bool(screening.sets) and screening.sets[0].cost <= screening.scores.plain
    if pays and len(state.added) >= MOST_EFFECTS:
        if (other := exchange(task, state)).added != state.added:  # a wrong one among them may be what leaves more
            return other
        return replace(state.told(f"more would pay, but {MOST_EFFECTS} effects are the most that are sought"), far=True)
    seen = seen_before(task, screening)
    near = closest(screening) if pays else []
    exact = exact_ones(task, state, [*near, *(s for s in seen if s not in near)], screening.family) if pays else []
    # What is read during a contact counts too where contact is exact: no cost compares with one without that.
    if exact and (not state.fit.exact or exact[0].cost(task) < state.cost(task)):
        return add_background(task, exact[0])
    tried = [best_kept(task, state, screening)] if pays else []
    tried += [settled(task, t) for t in all_refitted(task, state, seen, screening.family)]
    forces = promised(task, state, systems, quiet) if lacking and not state.stands_in else []
    if forces and forces[0].cost < min((s.cost(task) for s in tried), default=state.cost(task)) + NEAR:
        if (forced := best_force(task, state, forces)).odd:
            return forced
        tried.append(forced)
    if not tried:
        return state.told("no known effect explains more than chance would")
    found = plainest(task, tried)
    if found.cost(task) > state.cost(task):
        return state.told(f"{' + '.join(found.added)} promises more than it keeps")
    if lacking and not found.stands_in and len(state.known) < 2 <= len(found.known):
        found = product_instead(task, state, found)
    known = [t for t in tried if t.known != state.known]
    if not found.stands_in or state.stands_in or not known:
        return add_background(task, found)
    # The force was refitted beside less noise. Each is judged beside the noise that suits it.
    return best_beside_its_noise(task, (found, plainest(task, known)))


def best_beside_its_noise(task: Task, states: Sequence[State]) -> State:
    """The plainest of some states, each with what log and rig do besides.

    Where contact is exact, what is read during it counts too and leaves noise: no cost compares with one without
    that."""
    each = [add_background(task, t) for t in states]
    return plainest(task, [t for t in each if t.fit.exact] or each)


def product_instead(task: Task, state: State, found: State) -> State:
    """A force on two variables in the place of several known effects, where it is surely cheaper: each of them may show
    a part of what it does. It is sought beside none of them."""
    bare = state
    for name in state.known:
        bare = without(task, bare, name)
    product = add_pair(task, bare)
    return product if product.stands_in and product.cost(task) + SURER < found.cost(task) else found


def best_kept(task: Task, state: State, screening: Screening) -> State:
    """The cheapest of the sets of known effects when refitted.

    First order is as wrong of others as of those refitted: single effects are tried as long as their promise is nearer
    to the best than that."""
    plain, family = screening.scores.plain, screening.family
    batch, kept, done, reach = promising(screening, plain), [], [], -np.inf
    while batch and len(done) < MOST_REFITTED:
        tried = _smallest_first(task, state, batch, family)
        cheapest, best = min(tried, key=lambda one: one[1].cost(task))
        parts = parts_of(task, best, [t for _, t in tried], NEAR)
        kept, done = [*kept, *(settled(task, t) for t in (*parts, best))], [*done, *batch]
        promised = cheapest.deviance
        reach = max(reach, promised + abs(kept[-1].fit.deviance - promised))
        batch = [s for s in screening.singles if s.deviance < min(reach, plain) and s not in done][:REFITTED]
    return plainest(task, kept)


def plainest(task: Task, states: Sequence[State]) -> State:
    """The cheapest of some states, or a part of its effects where the data cannot tell that from the whole: the next
    round asks anew what is missing beside."""
    best = min(states, key=lambda s: s.cost(task))
    return min(parts_of(task, best, states, TWINS), key=lambda s: s.cost(task), default=best)


def parts_of(task: Task, whole: State, states: Sequence[State], within: float) -> list[State]:
    """Those of some states that have a part of the effects of one, and cost less than ``within`` more."""
    return [s for s in states if set(s.added) < set(whole.added) and s.cost(task) < whole.cost(task) + within]


def _smallest_first(
    task: Task, state: State, batch: Sequence[CandidateSet], family: int
) -> list[tuple[CandidateSet, State]]:
    """Sets of known effects with their refits, but for those that promise less than a smaller one keeps."""
    found: list[tuple[CandidateSet, State]] = []
    for size in sorted({len(s.members) for s in batch}):
        least = min((refit.cost(task) for _, refit in found), default=np.inf)
        mine = [s for s in batch if len(s.members) == size and s.cost + state.price < least]
        found += zip(mine, all_refitted(task, state, mine, family), strict=True)
    return found


def seen_before(task: Task, screening: Screening) -> list[CandidateSet]:
    """The single effects that the look at the data saw: they are tried whatever first order says of them."""
    seen = {f"{EFFECT_SEEN[h.kind]}:{h.channel}" for h in task.hints if h.kind in EFFECT_SEEN}
    return [s for s in screening.singles if s.members[0].name in seen]


def closest(screening: Screening) -> list[CandidateSet]:
    """The single effects that promise most, as far as they are near to the best of them and promise something."""
    singles = [s for s in screening.sets if len(s.members) == 1]
    near = [s for s in singles if s.deviance < min(singles[0].deviance + NEAR, screening.scores.plain)]
    return near[:MOST_REFITTED]


def promising(screening: Screening, plain: float) -> list[CandidateSet]:
    """The sets to refit: the best, those near to it, and the best single effect and pair, for first order flatters
    large sets far off."""
    best = screening.sets[0].cost
    near = [s for s in screening.sets[:REFITTED] if s.cost < min(best + NEAR, plain)]
    smallest = [next((s for s in screening.sets if len(s.members) == size and s.cost < plain), None) for size in (1, 2)]
    return near + [s for s in smallest if s is not None and s not in near]


def add_unknown(task: Task, state: State) -> State:
    """Add a force of any shape where one is still missing."""
    if state.stands_in:
        return state
    systems = linearise_all(task.problem, state.fit)
    forces = promised(task, state, systems, background.quieter(task.problem, state.fit, task.given, systems))
    if not forces:
        return state.told("no force of any shape is missing")
    found = best_force(task, state, forces)
    if found.odd:
        return found
    if found.cost(task) < state.cost(task):
        return add_background(task, found)
    law = forces[0].law
    return state.told(f"a force in {law.acts_on} on {law.variable} promises more than it keeps")


def prune(task: Task, state: State) -> State:
    """Take out whatever is not needed, the last added first."""
    for name in [n for n in reversed(state.added) if not surely_needed(task, state, n)]:
        smaller = without(task, state, name)
        if smaller.cost(task) < state.cost(task):
            twins = {n: t for n, t in smaller.twins.items() if n != name}
            return prune(task, replace(smaller, twins=twins).told(f"{name} is not needed"))
    return state


def exchange(task: Task, state: State) -> State:
    """Put another effect in the place of one where that explains more: the first were chosen while the later were still
    missing.

    Those that explain as much are twins: the data cannot tell them apart.
    """
    twins, alike = {}, {}
    for name in state.known:
        state, others = rivals(task, state, name)
        best = others[0] if others else state
        other = best.added[-1]
        if others and best.cost(task) < state.cost(task) - (TOLERANCE if other == name else TWINS):
            return best.told(f"{other} instead of {name}" if other != name else f"{name} from another start")
        close = [o for o in others if o.added[-1] != name and o.fit.deviance < state.fit.deviance + TWINS]
        twins[name] = tuple(o.added[-1] for o in close)
        alike |= {o.added[-1]: o for o in close}
    return replace(state, twins={n: t for n, t in twins.items() if t}, rivals=alike)


def likeliest(task: Task, state: State) -> State:
    """The state with the likeliest of twins in the first place. The set of them stays as it is, so nothing is asked
    anew."""
    pairs = [(name, state.rivals[other]) for name, others in state.twins.items() for other in others]
    same = [(n, o) for n, o in pairs if set(o.added) ^ set(state.added) == {n, o.added[-1]}]
    if not same:
        return state
    name, found = min(same, key=lambda pair: pair[1].cost(task))
    if found.cost(task) > state.cost(task) - TOLERANCE:
        return state
    other = found.added[-1]
    left = {n: t for n, t in state.twins.items() if n != name}
    twins = left | {other: (name, *(n for n in state.twins[name] if n != other))}
    rest = {n: s for n, s in state.rivals.items() if n != other}
    found = replace(found, twins=twins, rivals=rest | {name: state}, rounds=state.rounds)
    return found.told(f"{other} rather than {name}, although the data hardly tell them apart")


#: The stages that add, then those that take out or exchange; as long as these change the set, all begins anew.
ADDING: tuple[tuple[str, Stage], ...] = (
    ("known effects", add_known),
    ("a force of any shape", add_unknown),
    ("a force of any shape beside a known effect", add_beside),
    ("a force of a closed form", add_closed),
    ("a force on two variables", add_pair),
)
REVISING: tuple[tuple[str, Stage], ...] = (
    ("what is not needed", prune),
    ("what explains more in another's place", exchange),
    ("what is not needed", prune),
)
