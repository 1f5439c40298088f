"""The set of effects that is the answer: single ones, a force of any shape, pairs, triples, whatever leaves nothing but noise first.

Then a backward pass takes out what is not needed, and effects are exchanged for what explains more in their place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..estimation.fit import NOISE_TOLERANCE
from .candidates import visible
from .gate import Gate
from .moves import OutOfTime
from .placed import is_placed
from .race import Trial
from .result import INTERRUPTED, OUT_OF_TIME
from .search import QUICK_LATER, Search
from .unknown import localised, penalised, stand_ins

#: Candidates tried as the first effect; sets kept at each size.
QUICK_FIRST, BEAM = 24, 2
#: Effects sought one after the other, at the most.
MOST_EFFECTS = 3
#: Two sets whose residuals differ by less than this part of the misfit that either leaves are twins.
SAME = 0.25
#: An effect without which χ² is so much larger is not one to take back.
NEEDED = 100.0
#: Known effects are tried first where the best promises this part of what any force of one variable does.
PREFER_KNOWN = 0.8
#: Two of them also where, with one of the best so many, they promise this part of the whole misfit.
TWO_EXPLAIN, FIRST_OF_TWO = 0.95, 8
#: This part of the misfit, or of what another takes off it, is nearly all; a set that takes off less than this is not yet near an answer.
NEARLY, MUCH = 0.9, 0.5
#: Candidates beside a force of any shape that are refitted, where that takes off nearly all: first order says well which.
BESIDE = 4
#: A set that leaves so many times what the best leaves of the misfit is not followed.
FAR = 10.0
#: Quick refits this close to the best are refitted in full before they are judged.
CLOSE = 60.0


def find(
    search: Search,
    root: Trial,
    notes: list[str],
    answer: Trial | None = None,
    consult: Callable[[Search, Trial], Trial | None] = lambda *_: None,
) -> tuple[Trial, Gate]:
    """The set of effects that is the answer, and what the gate says of it; an interruption goes to ``notes``.

    ``consult`` is asked for a proposal where no single effect leaves noise. ``answer`` is that under a larger noise: what failed then
    fails now, so that nothing else is sought if it passes again.
    """
    try:
        root, gate = search.judged(root)
        chosen, found_gate = (root, gate) if gate.adequate else answer and _passing(search, [answer]) or _seek(search, root, consult)
    except (KeyboardInterrupt, OutOfTime) as stop:  # what was finished is kept; a second Ctrl-C ends it
        search.tell = lambda _: None  # there is no time left that could run out
        chosen = search.finish(_cheapest(search, search.trials.values()))
        found_gate = search.gate(chosen)
        notes.append(INTERRUPTED if isinstance(stop, KeyboardInterrupt) else OUT_OF_TIME)
        return chosen, found_gate
    if len(chosen.names) > len(root.names) + 1:
        chosen, found_gate = search.judged(_prune(search, chosen))
    if chosen.stands_in and found_gate.adequate:
        chosen, found_gate = _recognised(search, chosen, found_gate)
    if len(chosen.names) > len(root.names) + 1:
        better, better_gate = search.judged(_exchanged(search, chosen))
        if better_gate.adequate or not found_gate.adequate:
            chosen, found_gate = better, better_gate
    if found_gate.doubtful and not chosen.stands_in:
        notes.append(f"the tests find something left (p = {found_gate.smallest:.2g}), but nothing tried explains it better than chance would")
        found_gate = replace(found_gate, adequate=True)
    search.trials[frozenset(chosen.names)] = chosen  # whatever else was found with the same effects
    return chosen, found_gate


def _seek(search: Search, root: Trial, consult: Callable[[Search, Trial], Trial | None]) -> tuple[Trial, Gate]:
    """The cheapest set of effects that leaves noise; with a stand-in in it where nothing known does."""
    singles = _grown(search, root, QUICK_FIRST)
    if passing := _passing(search, singles):
        return passing
    proposal = consult(search, root)
    if proposal is not None and (passing := _passing(search, [proposal])):
        return passing
    tried, first = [root], _first_effects(search, root, singles)
    unknown_first = not (_points_to_known(search, singles[0] if singles else root) or _two_explain(search, root))
    if unknown_first and (found := _force_of_any_shape(search, root, first, tried)):
        return found
    beam, unknown_tried = _varied(singles), unknown_first
    for _ in range(MOST_EFFECTS - 1):
        if any(t.stands_in and _explains(t, root) for t in tried) and not any(_one_more_explains(search, t) for t in beam[:1]):
            break
        reached = max(map(search.reach, beam), default=0.0)
        grown: list[Trial] = []
        for trial in beam:
            grown = _ranked(search, [*grown, *_grown(search, trial, QUICK_LATER)])
            if passing := _passing(search, grown):
                return passing
        beam = _varied(grown)
        if not beam or beam[0].fit.hopeless and max(map(search.reach, beam)) <= reached:  # not what throws the runs off
            tried.extend(beam)
            break
        beam[0] = search.finish(beam[0])
        if not unknown_tried and not _explains(beam[0], root) and not _one_more_explains(search, beam[0]):  # what is missing most may be none of the known
            unknown_tried = True
            if found := _force_of_any_shape(search, root, first, tried):
                return found
        if _explains(beam[0], root, part=MUCH):
            beam[0] = _exchanged(search, beam[0])
        tried.append(beam[0])
        if passing := _passing(search, beam[:1]):
            return passing
    if not unknown_tried and (found := _force_of_any_shape(search, root, first, tried)):
        return found
    return _least(search, root, tried)


def _explains(trial: Trial, root: Trial, best: float | None = None, part: float = NEARLY) -> bool:
    """Whether a trial takes nearly all (that ``part``) off the misfit, or of what one with a χ² of ``best`` does."""
    best = trial.fit.samples if best is None else best
    return trial.chi2 < root.chi2 - part * (root.chi2 - best)


def _first_effects(search: Search, root: Trial, singles: Sequence[Trial]) -> list[Trial]:
    """The best of single effects over whole runs, and over their beginnings where that does not show: what comes later may hide it."""
    early = {s.candidate.name: s.promise for s in search.near(root)[0].screened}
    best = max(early, key=early.get, default="")
    shows = any(early.get(t.names[-1], 0.0) > NEARLY * early.get(best, 0.0) for t in singles[:1])
    hidden = None if shows else search.trials.get(frozenset(root.names) | {best})
    return [*singles[:1], *([hidden] if hidden else [])]


def _force_of_any_shape(search: Search, root: Trial, first: Sequence[Trial], tried: list[Trial]) -> tuple[Trial, Gate] | None:
    """A stand-in that leaves noise, or the cheapest set of one and known effects that does; what was tried goes to ``tried``.

    Of a force and a known effect either may show first: those of the known that did are tried with a stand-in beside them too.
    """
    found = stand_ins(search, root)[:BEAM]
    for known in range(MOST_EFFECTS):
        if passing := _passing(search, found):
            return passing
        tried.extend(found[:1])
        near = [t for t in _varied(found) if _explains(t, root)]
        found = _grown(search, near[0], BESIDE) if near else []
        if passing := _passing(search, found):
            return passing
        others = [] if known else [t for single in first for t in stand_ins(search, single)[:1]]
        found = _ranked(search, [*found, *others, *(t for trial in near[1:] for t in _grown(search, trial, BESIDE))])
    return None


def _recognised(search: Search, trial: Trial, gate: Gate) -> tuple[Trial, Gate]:
    """The trial, or one with known effects in the place of its stand-in if that leaves noise too: with one, or with as many as are allowed.

    If there is none, the one with a stand-in that is none but at one place, alone or with a known effect beside it.
    """
    name = next(n for n in trial.names if n.startswith("stand_in"))
    room = MOST_EFFECTS - (len(trial.names) - len(search.base.structure.effects))
    for count in range(1, room + 2):
        known = search.recognise(trial, name) if count == 1 else search.recognise_together(trial, name, count)
        if found := _cheaper(search, known, trial):
            return found
    local = [localised(search, trial, beside) for beside in ((False, True) if room > 0 else (False,))]
    return _cheaper(search, [t for t in local if t], trial) or (trial, gate)


def _cheaper(search: Search, others: Sequence[Trial], trial: Trial) -> tuple[Trial, Gate] | None:
    """The cheapest of others, if it is cheaper than a trial and leaves nothing but noise."""
    if others and penalised(search, other := _cheapest(search, others)) < penalised(search, trial):
        other, gate = search.judged(other)
        return (other, gate) if gate.adequate else None
    return None


def _least(search: Search, root: Trial, tried: Sequence[Trial]) -> tuple[Trial, Gate]:
    """Where no set leaves noise: the best there is, with one more unknown force beside it."""
    best = _cheapest(search, tried)
    if named := _named(search, root, best):
        tried = [t for t in (named, *tried) if set(t.names) >= set(named.names)]
        best = _cheapest(search, tried)
    for _ in range(2):
        best, gate = search.judged(best)
        if gate.adequate or best.stands_in and best.chi2 < (1 + NOISE_TOLERANCE) ** 2 * best.fit.samples:
            break
        tried = [*tried, *stand_ins(search, best)[:1]]
        best = _cheapest(search, tried)
    return search.judged(best)


def _cheapest(search: Search, trials: Iterable[Trial]) -> Trial:
    return min(trials, key=lambda t: penalised(search, t))


def _named(search: Search, root: Trial, best: Trial) -> Trial | None:
    """The smallest set of known effects that explains nearly all that the best does, where that is a force of any shape and lacks them.

    Such a force follows one run, or many that are alike, whatever the reason, and where it too leaves more than noise nothing speaks for it.
    """
    others = (t for names, t in search.trials.items() if names > frozenset(root.names) and not t.stands_in)
    known = [t for t in others if _explains(t, root, best.chi2)]
    if not known or not best.stands_in or any(set(t.names) <= set(best.names) for t in known):
        return None
    return search.finish(min(known, key=lambda t: (len(t.names), t.chi2)))


def _grown(search: Search, trial: Trial, limit: int) -> list[Trial]:
    """All significant sets one effect larger, each once, cheapest first."""
    return _ranked(search, [t for t in search.grow(trial, limit) if _significant(search, t, trial)])


def _ranked(search: Search, trials: Iterable[Trial]) -> list[Trial]:
    """Each set of effects once, cheapest first."""
    found: dict[frozenset[str], Trial] = {}
    for t in sorted(trials, key=lambda t: penalised(search, t)):
        found.setdefault(frozenset(t.names), t)
    return list(found.values())


def _varied(ranked: Sequence[Trial]) -> list[Trial]:
    """The cheapest sets, `BEAM` of them, without those that leave the same misfit as a cheaper one: a twin leads nowhere new."""
    beam: list[Trial] = []
    for trial in ranked:
        if len(beam) < BEAM and not _far(trial, ranked[0]) and all(_apart(trial, t) > SAME * min(_excess(trial), _excess(t)) for t in beam):
            beam.append(trial)
    return beam


def _excess(trial: Trial) -> float:
    """What a trial leaves beyond noise."""
    return trial.chi2 - trial.fit.samples


def _far(trial: Trial, best: Trial) -> bool:
    """Whether a trial leaves so much more of the misfit than the best that it leads nowhere."""
    return _excess(trial) > FAR * max(_excess(best), np.sqrt(2 * best.fit.samples))


def _apart(one: Trial, other: Trial) -> float:
    """Squared difference of two sets' residuals over noise."""
    return sum(float(np.nansum((a.residual - b.residual) ** 2)) for a, b in zip(one.fit.linear, other.fit.linear, strict=True))


def _passing(search: Search, ranked: list[Trial]) -> tuple[Trial, Gate] | None:
    """The first of the two cheapest, which are refitted in place, that leaves nothing but noise."""
    ranked[:1] = [search.finish(t) for t in ranked[:1]]
    ranked[1:2] = [t if _far(t, ranked[0]) else search.finish(t) for t in ranked[1:2]]
    ranked[:2] = sorted(ranked[:2], key=lambda t: penalised(search, t))
    for k, t in enumerate(ranked[:2]):
        if not _far(t, ranked[0]):
            ranked[k], gate = search.judged(t)
            if gate.adequate:
                return ranked[k], gate
    return None


def _points_to_known(search: Search, trial: Trial) -> bool:
    """Whether what is left looks, to first order, more like a known effect than like a force of some other law."""
    look = search.near(trial)[0]
    known = max((s.promise for s in look.screened), default=0.0)
    price = np.log(look.fit.samples)
    force = max((t.statistic - t.dof * price for t in look.gate.tests if t.law), default=0.0)
    return known > PREFER_KNOWN * force


def _two_explain(search: Search, trial: Trial) -> bool:
    """Whether two candidates together promise nearly all of the misfit: drag and a slope, say, are one force of the speed too."""
    look = search.near(trial)[0]
    project, known = look.project, trial.fit.model.known_effects
    # One whose place was sought is nearly a force of the place itself, and says nothing for known physics.
    laws = [s for s in look.screened if not is_placed(known[s.candidate.name.partition(":")[0]])]
    signatures = [c for s in laws if (c := visible(project, s.columns)).shape[1]]
    wanted = TWO_EXPLAIN * (look.fit.chi2 - look.fit.samples)
    for i, one in enumerate(signatures[:FIRST_OF_TWO]):
        q = np.linalg.qr(one)[0]
        first, rest = q.T @ project.residual, project.residual - q @ (q.T @ project.residual)
        for other in signatures[i + 1 :]:
            second = np.linalg.qr(other - q @ (q.T @ other))[0].T @ rest
            if first @ first + second @ second > wanted:
                return True
    return False


def _one_more_explains(search: Search, trial: Trial) -> bool:
    """Whether one more known effect promises, to first order, nearly all of what a trial leaves."""
    return not trial.fit.hopeless and max((s.promise for s in search.screened(trial)), default=0.0) > NEARLY * _excess(trial)


def _significant(search: Search, trial: Trial, parent: Trial) -> bool:
    """Whether the last effect takes more off χ² than chance would, its rivals counted."""
    s = next((s for s in search.screened(parent) if s.candidate.name == trial.names[-1]), None)
    return s is None or parent.chi2 - trial.chi2 > s.candidate.threshold(len(search.screened(parent)))


def _prune(search: Search, trial: Trial) -> Trial:
    """Backward pass: whatever can go without the rest failing goes."""
    start = search.trials[frozenset(search.base.structure.effects)]
    for name in trial.names:
        if name in start.names or len(trial.names) == 1:
            continue
        smaller = search.without(trial, name)
        if smaller.chi2 > trial.chi2 + NEEDED:
            continue
        smaller, gate = search.judged(smaller)
        if gate.adequate or penalised(search, smaller) <= penalised(search, trial) and not _named(search, start, smaller):
            return _prune(search, smaller)
    return trial


def _exchanged(search: Search, trial: Trial) -> Trial:
    """The trial with its effects exchanged, one at a time, as long as another in its place explains more.

    The first effects were chosen while the later ones were still missing, and may have stood in for them. Beside a force that
    stands in for anything there is nothing to be learned from that.
    """
    if trial.stands_in:
        return trial
    for name in [n for n in trial.names if n not in search.base.structure.effects]:
        for other in search.rivals(trial, name)[:1]:
            if other.chi2 < trial.chi2 + CLOSE:
                other = search.finish(other)
            if penalised(search, other) < penalised(search, trial):
                return _exchanged(search, other)
    return trial
