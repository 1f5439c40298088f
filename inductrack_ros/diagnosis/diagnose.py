"""The whole diagnosis: fit first, is anything missing, which effect, how sure, what would settle it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from ..core.effects.stand_in import basis
from ..core.errors import InputError
from ..core.model import Model
from ..core.state import INDEX
from ..data.campaign import Campaign
from ..estimation import noise
from ..estimation.fit import Fit, fit, fit_from_scratch
from ..estimation.problem import Problem
from ..estimation.structure import Structure
from ..workers import Cluster, Threads
from . import support
from .candidates import visible
from .experiment import propose
from .gate import NOISE_TOLERANCE, Gate
from .race import Trial
from .result import INTERRUPTED, Diagnosis, Limit, Rival, RunTraces, Step, Unknown
from .search import BEAM, QUICK_FIRST, QUICK_LATER, Search
from .signatures import VARIABLES
from .unknown import penalised, stand_ins

#: Effects sought one after the other, at the most.
MOST_EFFECTS = 3
#: Rivals whose χ² after refitting is within this of the best cannot be told from it (chance of wronging the truth below 1 %).
TWINS = 6.6
#: Quick refits this close to the best are refitted in full before they are judged.
CLOSE = 60.0
#: Noise that was not given and turns out below this part of what was estimated beside the misfit: the search is done again, at most so often.
SHARPER, ROUNDS = 0.95, 3
#: Two sets whose residuals differ by less than this part of the misfit that either leaves are twins.
SAME = 0.25
#: An effect without which χ² is so much larger is not one to take back.
NEEDED = 100.0
#: Known effects are tried first where the best promises this part of what any force of one variable does.
PREFER_KNOWN = 0.8
#: Two of them also where, with one of the best so many, they promise this part of the whole misfit.
NEARLY_ALL, FIRST_OF_TWO = 0.95, 8
#: A known effect that explains this part of what a force of any shape does, which leaves more than noise too, is named before it.
NAMED = 0.9
#: Candidates beside a force of any shape that are refitted: near the noise first order says well which.
BESIDE = 4
#: Of so many runs one is left out of the fit when errors on unseen runs are wanted.
LEFT_OUT = 4


def diagnose(
    campaign: Campaign, model: Model, tell: Callable[[str], None] = lambda _: None, workers: Threads | Cluster | None = None
) -> Diagnosis:
    """Diagnose a campaign against a model, whose effects (if any) are kept and refitted.

    ``tell`` hears what is being tried; ``workers`` do the refits. Raises `InputError` for a campaign that cannot be fitted at all.
    """
    with threadpool_limits(1, "blas"):  # the threads are ours: many small matrices at once
        return _diagnose(campaign, model, tell, workers)


def _diagnose(campaign: Campaign, model: Model, tell: Callable[[str], None], workers: Threads | Cluster | None) -> Diagnosis:
    began = time.monotonic()
    notes = support.inspect(campaign)
    tell("fitting what is known")
    problem, base, undetermined = base_fit(campaign, model)
    notes += support.undetermined(undetermined, base)
    for _ in range(ROUNDS):
        search = Search(problem, base, tell, workers)
        root = search.trials[frozenset(base.structure.effects)]
        chosen, found_gate = _find(search, root, notes)
        sigma = noise.from_residuals(problem, [p.residual for p in chosen.fit.linear], campaign.noise_std)
        if INTERRUPTED in notes or (sigma > SHARPER * problem.sigma).all():
            break
        tell("the noise is smaller than it seemed beside the misfit: once more")
        problem = problem.with_sigma(sigma)
        base = fit(problem, base.structure, base.states, base.theta)
    new = tuple(n for n in chosen.names if n not in root.names)
    stand_in = [n for n in new if n.startswith("stand_in")]
    effects = tuple(n for n in new if n not in stand_in)
    verdict = "adequate" if not new and found_gate.adequate else "missing_effect" if found_gate.adequate and not stand_in else "unknown_effect"
    twins = _twins(search, chosen, effects)
    tell("how well it predicts runs left out")
    path = [tuple(new[:k]) for k in range(len(new) + 1)]
    steps = tuple(step_of(search, search.part(chosen, (*root.names, *p)), p) for p in path)
    unknown = _unknown(search, chosen, found_gate, stand_in, steps) if verdict == "unknown_effect" else None
    experiment, proposal = None, None
    if twins or verdict == "unknown_effect":
        tell("which run would settle what is open")
        experiment, proposal = propose(search, chosen, twins, unknown, undetermined)
    if verdict == "unknown_effect" and (odd := support.disagreeing(problem, base)):
        notes.append(
            f"runs disagree: {', '.join(odd)} and the others each fit the model alone, with other values of {', '.join(base.structure.free)}; "
            "was the rig changed between them?"
        )
        experiment = f"repeat one of {', '.join(odd)} and one of the others without touching the rig in between, or diagnose them apart"
    notes += support.leftover(problem, chosen.fit, campaign.noise_std, found_gate)
    f = chosen.fit
    deviations = f.deviations
    return Diagnosis(
        campaign=campaign.name,
        verdict=verdict,
        effects=effects,
        model=f.model,
        parameters={n: (v, deviations[n]) for n, v in f.values.items() if "values[" not in n},
        indistinguishable=twins,
        unknown=unknown,
        next_experiment=experiment,
        steps=steps,
        rivals=_rivals(search, root, chosen),
        limits=_limits(search, chosen),
        noise=dict(zip(problem.channels, problem.sigma.tolist(), strict=True)),
        noise_given=tuple(campaign.noise_std),
        notes=tuple(notes),
        tests=found_gate.tests[:12],
        p_value=found_gate.p_scores,
        traces=traces_of(search, chosen, root, new),
        proposal=proposal,
        seconds=time.monotonic() - began,
    )


def _find(search: Search, root: Trial, notes: list[str]) -> tuple[Trial, Gate]:
    """The set of effects that is the answer, and what the gate says of it; an interruption is noted."""
    try:
        gate = search.gate(root)
        chosen, found_gate = (root, gate) if gate.adequate else _seek(search, root)
    except KeyboardInterrupt:  # what was finished is kept; a second Ctrl-C ends it
        search.tell("interrupted: reporting what was found so far")
        chosen = search.finish(min(search.trials.values(), key=lambda t: penalised(search, t)))
        found_gate = search.gate(chosen)
        notes.append(INTERRUPTED)
    if len(chosen.names) > len(root.names) + 1:
        chosen = _prune(search, chosen)
        better = _exchanged(search, chosen)
        if better is not chosen and (search.gate(better).adequate or not found_gate.adequate):
            chosen = better
        found_gate = search.gate(chosen)
    return chosen, found_gate


def base_fit(campaign: Campaign, model: Model) -> tuple[Problem, Fit, tuple[str, ...]]:
    """The problem with its noise, the fit of the model as it is, and the parameters that the data cannot determine."""
    guess = noise.from_samples(campaign) | dict(campaign.noise_std)
    for channel, value in guess.items():
        if not np.isfinite(value) or value <= 0:
            raise InputError(
                f"{campaign.folder}: {channel} never changes from sample to sample, so its noise cannot be estimated; "
                f"give noise_std: {{{channel}: …}} in campaign.yaml, or leave the channel out"
            )
    problem = Problem(campaign, model, guess)
    free = tuple(campaign.free) + tuple(f"{e}.{p}" for e, values in model.effects.items() for p in values if p != "variable" and not e.startswith("stand_in"))
    structure = Structure(problem.model, free)
    structure.check()
    base = fit_from_scratch(problem, structure)
    if not np.isfinite(base.chi2):
        raise InputError(f"{campaign.folder}: the model cannot follow the runs at all; look at the units, the model and drive_current")
    undetermined = base.undetermined
    if undetermined:
        kept = tuple(n for n in free if n not in undetermined)
        structure = Structure(problem.model, kept)
        base = fit(problem, structure, base.states, [t for t, n in zip(base.theta, free, strict=True) if n in kept])
    for _ in range(2 if len(campaign.noise_std) < len(problem.channels) else 0):
        problem = problem.with_sigma(noise.from_residuals(problem, [p.residual for p in base.linear], campaign.noise_std))
        base = fit(problem, structure, base.states, base.theta)
    return problem, base, undetermined


def _seek(search: Search, root: Trial) -> tuple[Trial, Gate]:
    """The cheapest set of effects that leaves noise; with a stand-in in it where nothing known does."""
    singles = _grown(search, root, QUICK_FIRST)
    if passing := _passing(search, singles):
        return passing
    tried = [root]

    def unknown() -> tuple[Trial, Gate] | None:
        for start in [root, *singles[:1]]:
            found = stand_ins(search, start)[:1]
            tried.extend(found)
            if passing := _passing(search, found) or beside(found):
                return passing
        return None

    def beside(found: list[Trial]) -> tuple[Trial, Gate] | None:
        for _ in range(MOST_EFFECTS - 1):
            if not found or found[0].fit.rough:
                return None
            found = _grown(search, found[0], BESIDE)
            if passing := _passing(search, found):
                return passing
            tried.extend(found[:1])
        return None

    ways = [unknown]
    if not (_points_to_known(search, singles[0] if singles else root) or _two_explain(search, root)):
        if result := ways.pop()():
            return result
    beam = _varied(singles)
    for _ in range(MOST_EFFECTS - 1):
        reached = max(map(search.reach, beam), default=0.0)
        grown: list[Trial] = []
        for trial in beam:
            grown = _grown(search, trial, QUICK_LATER, grown)
            if passing := _passing(search, grown):
                return passing
        beam = _varied(grown)
        if not beam or beam[0].fit.hopeless and max(map(search.reach, beam)) <= reached:  # not what throws the runs off
            tried.extend(beam)
            break
        beam[0] = _exchanged(search, search.finish(beam[0]))
        tried.append(beam[0])
        if passing := _passing(search, beam[:1]):
            return passing
        if ways and beam[0].fit.rough and (result := ways.pop()()):  # what is missing most may be none of the known
            return result
    if ways and (result := ways.pop()()):
        return result
    # Neither alone: one more unknown force beside the best there is.
    best = min(tried, key=lambda t: penalised(search, t))
    if named := _named(search, root, best):
        tried = [t for t in (named, *tried) if set(t.names) >= set(named.names)]
        best = min(tried, key=lambda t: penalised(search, t))
    for _ in range(2):
        if search.gate(best).adequate or best.stands_in and best.chi2 < (1 + NOISE_TOLERANCE) ** 2 * best.fit.samples:
            break
        tried += stand_ins(search, best)[:1]
        best = min(tried, key=lambda t: penalised(search, t))
    return best, search.gate(best)


def _named(search: Search, root: Trial, best: Trial) -> Trial | None:
    """The smallest set of known effects that explains nearly all that the best does, where that is but a force of any shape.

    Such a force follows one run, or many that are alike, whatever the reason, and where it too leaves more than noise nothing speaks for it.
    """
    if not best.stands_in or any(not n.startswith("stand_in") for n in best.names if n not in root.names):
        return None
    wanted = root.chi2 - NAMED * (root.chi2 - best.chi2)
    known = [t for names, t in search.trials.items() if names > frozenset(root.names) and not t.stands_in and t.chi2 < wanted]
    return search.finish(min(known, key=lambda t: (len(t.names), t.chi2))) if known else None


def _grown(search: Search, trial: Trial, limit: int, beside: Sequence[Trial] = ()) -> list[Trial]:
    """All significant sets one effect larger and those ``beside``, each once, cheapest first."""
    grown = {frozenset(t.names): t for t in beside}
    for t in search.grow(trial, limit):
        key = frozenset(t.names)
        if _significant(search, t, trial) and (key not in grown or t.chi2 < grown[key].chi2):
            grown[key] = t
    return sorted(grown.values(), key=lambda t: penalised(search, t))


def _varied(ranked: Sequence[Trial]) -> list[Trial]:
    """The cheapest sets, `BEAM` of them, without those that leave the same misfit as a cheaper one: a twin leads nowhere new."""
    beam: list[Trial] = []
    for trial in ranked:
        excess = trial.chi2 - trial.fit.samples
        if len(beam) < BEAM and all(_apart(trial, t) > SAME * min(excess, t.chi2 - t.fit.samples) for t in beam):
            beam.append(trial)
    return beam


def _apart(one: Trial, other: Trial) -> float:
    """Squared difference of two sets' residuals over noise."""
    return sum(float(np.nansum((a.residual - b.residual) ** 2)) for a, b in zip(one.fit.linear, other.fit.linear, strict=True))


def _passing(search: Search, ranked: list[Trial]) -> tuple[Trial, Gate] | None:
    """The first of the two cheapest, which are refitted in place, that leaves nothing but noise."""
    ranked[:2] = sorted((search.finish(t) for t in ranked[:2]), key=lambda t: penalised(search, t))
    for t in ranked[:2]:
        if (gate := search.gate(t)).adequate:
            return t, gate
    return None


def _points_to_known(search: Search, trial: Trial) -> bool:
    """Whether what is left looks, to first order, more like a known effect than like a force of some other law."""
    look = search.near(trial)[0]
    known = max((s.promise for s in look.screened), default=0.0)
    price = np.log(look.fit.samples)
    force = max((t.statistic - t.dof * price for t in look.gate.tests if t.name.startswith("force in ")), default=0.0)
    return known > PREFER_KNOWN * force


def _two_explain(search: Search, trial: Trial) -> bool:
    """Whether two candidates together promise nearly all of the misfit: drag and a slope, say, are one force of the speed too."""
    look = search.near(trial)[0]
    project = look.project
    signatures = [c for s in look.screened if (c := visible(project, s.columns)).shape[1]]
    wanted = NEARLY_ALL * (look.fit.chi2 - look.fit.samples)
    for i, one in enumerate(signatures[:FIRST_OF_TWO]):
        q = np.linalg.qr(one)[0]
        first, rest = q.T @ project.residual, project.residual - q @ (q.T @ project.residual)
        for other in signatures[i + 1 :]:
            second = np.linalg.qr(other - q @ (q.T @ other))[0].T @ rest
            if first @ first + second @ second > wanted:
                return True
    return False


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
        if search.gate(smaller).adequate or penalised(search, smaller) <= penalised(search, trial) and not _named(search, start, smaller):
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


def _twins(search: Search, chosen: Trial, effects: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """For each effect found, what could stand in its place within `TWINS` of χ²; beside a force of any shape only what was tried there."""
    twins = {}
    for name in effects:
        added = frozenset(chosen.names) - {name}
        others = search.siblings(chosen, name) if chosen.stands_in else search.rivals(chosen, name)
        close = [search.finish(t) for t in others if t.chi2 < chosen.chi2 + CLOSE]
        rivals = sorted((t.chi2, next(iter(frozenset(t.names) - added))) for t in close if t.chi2 < chosen.chi2 + TWINS)
        if rivals:
            twins[name] = tuple(n for _, n in rivals)
    return twins


def step_of(search: Search, trial: Trial, shown: tuple[str, ...]) -> Step:
    """Errors with a set of effects: fitted on all runs, and on every fourth when the fit saw only the others."""
    problem, f = search.problem, trial.fit
    residuals = [p.residual for p in f.linear]
    out = list(range(LEFT_OUT // 2, len(problem.runs), LEFT_OUT)) or [len(problem.runs) - 1]
    seen = [i for i in range(len(problem.runs)) if i not in out]
    heldout, by_channel = np.nan, {}
    if seen:
        near = [f.linear[i] for i in seen]
        inner = fit(problem.subset(seen), f.structure, [f.states[i] for i in seen], f.theta, iterations=8, reuse=near)
        model = inner.model
        left = problem.subset(out)
        outer = fit(left, Structure(model, ()), [f.states[i] for i in out], iterations=8, reuse=[f.linear[i] for i in out])
        rest = [p.residual for p in outer.linear]
        heldout, by_channel = _rms(np.concatenate(rest)), _by_channel(left, rest)
    return Step(
        shown, f.reduced_chi2, heldout, _by_channel(problem, residuals), by_channel,
        {d.run.name: _rms(r) for d, r in zip(problem.runs, residuals, strict=True)},
    )  # fmt: skip


def _rms(r: np.ndarray) -> float:
    r = r[np.isfinite(r)]
    return float(np.sqrt(np.mean(r**2))) if r.size else float("nan")


def _by_channel(problem: Problem, residuals: Sequence[np.ndarray]) -> dict[str, float]:
    number = np.concatenate([d.channel for d in problem.runs])
    r = np.concatenate(residuals)
    return {c: _rms(r[number == i]) for i, c in enumerate(problem.channels)}


def _unknown(search: Search, chosen: Trial, gate: Gate, stand_in: Sequence[str], steps: Sequence[Step]) -> Unknown:
    """What is known of the unknown: the first stand-in's curve, or where the gate's most telling force law points."""
    if not stand_in:
        law = next((t.name for t in gate.tests if t.name.startswith("force in ")), "force in heave on surge")
        channel, _, variable = law.removeprefix("force in ").partition(" on ")
        return Unknown(channel, (variable,), float("nan"), "N·m" if channel == "roll" else "N", *(np.empty(0),) * 3)
    f, name = chosen.fit, stand_in[0]
    table = f.model.effects[name]
    count = int(table["knots"])
    u = table["start"] + np.linspace(0, count - 1, 400) * table["step"]
    shapes = basis(u, table["start"], table["step"], count)
    force = shapes @ np.array(table["values"])
    mine = f.structure.tables[name]
    scale = f.structure.scale[mine]
    covariance = f.covariance[np.ix_(mine, mine)] * np.outer(scale, scale)
    band = 1.96 * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", shapes, covariance, shapes), 0.0))
    channel = name.removeprefix("stand_in_")
    peak = float(force[np.argmax(np.abs(force))])
    return Unknown(channel, (VARIABLES[int(table["variable"])],), peak, "N·m" if channel == "roll" else "N", u, force, band)


def _rivals(search: Search, root: Trial, chosen: Trial) -> tuple[Rival, ...]:
    """Every candidate of every round along the path that was taken."""
    found = []
    names = list(root.names)
    for step in [n for n in chosen.names if n not in root.names]:
        parent = search.part(chosen, names)
        thresholds = {s.candidate.name: s.candidate.threshold(len(search.screened(parent))) for s in search.screened(parent)}
        round_ = []
        for key, t in search.trials.items():
            added = key - frozenset(names)
            if len(added) == 1 and key > frozenset(names):
                name = next(iter(added))
                f = t.fit
                own = {n: v for n, v in f.values.items() if n.startswith(f"{name}.") and "values[" not in n}
                deviations = f.deviations
                fall = parent.chi2 - t.chi2
                round_.append(
                    Rival(
                        name, tuple(names), fall, thresholds.get(name, np.nan), own, {n: deviations[n] for n in own}, None, name == step,
                        _words(name == step, t, parent, search), where_won(search.problem, parent.fit, f),
                    )  # fmt: skip
                )
        found += sorted(round_, key=lambda r: -r.chi2_fall)
        names.append(step)
    return tuple(found)


def _words(chosen: bool, trial: Trial, parent: Trial, search: Search) -> str:
    """For and against a candidate, in a sentence."""
    left = trial.fit.reduced_chi2
    part = (parent.chi2 - trial.chi2) / max(parent.chi2 - min(t.chi2 for t in search.trials.values()), 1e-9)
    if chosen:
        return f"explains {100 * part:.0f} % of what can be explained; χ² per sample falls to {left:.3g}"
    return f"explains {100 * part:.0f} %; leaves χ² per sample at {left:.3g}"


def where_won(problem: Problem, before: Fit, after: Fit) -> dict[str, dict[str, float]]:
    """Where the fall in χ² was won: parts by run, and by stretch of speed and gap and by contact."""
    gains, speed, gap = [], [], []
    by_run = {}
    for i, (data, a, b) in enumerate(zip(problem.runs, before.linear, after.linear, strict=True)):
        fall = np.nan_to_num(a.residual**2 - b.residual**2)
        by_run[data.run.name] = float(fall.sum())
        out = problem.simulate(after.structure, i, after.theta[None], after.states[i][None])[0]
        gains.append(fall)
        speed.append(out[data.row, INDEX["surge_rate"]])
        gap.append(out[data.row, 8:11].min(axis=1))
    g, v, h = np.concatenate(gains), np.nan_to_num(np.concatenate(speed)), np.nan_to_num(np.concatenate(gap))
    total = g.sum() or 1.0
    where = {"run": {n: x / total for n, x in by_run.items()}, "speed": {}, "gap": {}}
    edges = np.unique(np.round(np.quantile(v, [0, 0.25, 0.5, 0.75, 1]), 1))
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        where["speed"][f"{low:g}–{high:g} m/s"] = float(g[(v >= low) & (v <= high)].sum() / total)
    edges = np.unique(np.round(1e3 * np.quantile(h, [0, 0.25, 0.5, 0.75, 1]), 1))
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        where["gap"][f"{low + 0:g}–{high + 0:g} mm"] = float(g[(1e3 * h >= low) & (1e3 * h <= high)].sum() / total)
    where["contact"] = {"touching": float(g[h < 0].sum() / total), "free": float(g[h >= 0].sum() / total)}
    return where


def _limits(search: Search, chosen: Trial) -> tuple[Limit, ...]:
    """The smallest size of each effect with one parameter that would have been found in nine of ten such campaigns."""
    limits = []
    for s in search.screened(chosen):
        structure = chosen.fit.structure.plus(s.candidate.name, s.candidate.starts[0] if s.candidate.starts else {})
        first = len(chosen.fit.structure.free)
        if len(structure.free) == first:
            continue
        declared, scale = structure.declarations[first], structure.scale[first]
        size = (np.sqrt(s.candidate.threshold(len(search.screened(chosen)))) + 1.28) * s.deviation
        if s.candidate.name == "guideway_waviness":
            value = float(size)
        else:
            neutral = 0.0 if np.isinf(declared.default) else declared.to_fit(declared.default)
            value = declared.from_fit(neutral + size * scale) - (declared.default if declared.fit_as == "x" else 0.0)
        limits.append(Limit(s.candidate.name, structure.free[first].rpartition(".")[2], declared.unit, float(value)))
    return tuple(sorted(limits, key=lambda x: x.name))


def traces_of(search: Search, full: Trial, root: Trial, new: Sequence[str]) -> tuple[RunTraces, ...]:
    """Predictions of each subset of the effects found, refitted, for the report's switches."""
    problem = search.problem
    subsets = [tuple(n for j, n in enumerate(new) if mask >> j & 1) for mask in range(2 ** len(new))]
    fits = {subset: search.part(full, (*root.names, *subset)).fit for subset in subsets}
    traces = []
    for i, data in enumerate(problem.runs):
        predicted = {}
        for subset, f in fits.items():
            out = problem.simulate(f.structure, i, f.theta[None], f.states[i][None])
            read = problem.predict(f.structure, i, f.theta[None], out)[0]
            predicted[subset] = {c: _column(data, read, k) for k, c in enumerate(problem.channels) if c in data.run.channels}
        measured = {c: data.run[c] for c in data.run.channels}
        traces.append(RunTraces(data.run.name, data.run.drive_current, data.run.times, measured, predicted))
    return tuple(traces)


def _column(data, read: np.ndarray, channel: int) -> np.ndarray:
    column = np.full(len(data.run.times), np.nan)
    mine = data.channel == channel
    column[np.searchsorted(data.run.times, data.time[mine])] = read[mine]
    return column

