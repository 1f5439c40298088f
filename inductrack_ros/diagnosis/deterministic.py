"""The diagnosis of runs that touch the track on a rig that nothing shakes: every run simulated from its start to its end.

Contact is too stiff for nodes every few milliseconds: what a node's noise does to the normal force looks like friction. A simulation
from end to end is exact there, and can be where log and rig do nothing besides. What `strategy` found is judged first.
It goes once impacts are condensed into one piece of a trajectory.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..core.errors import InputError
from ..core.model import Model
from ..core.state import INDEX
from ..data.campaign import Campaign
from ..estimation import noise, shooting
from ..estimation.fit import Fit, fit, fit_from_scratch
from ..estimation.problem import Problem
from ..estimation.structure import Structure
from ..workers import Cluster, Threads
from . import support
from .answer import curve_of
from .candidates import WAVES, Screened
from .errors import by_channel, column, left_out, rms
from .experiment import propose
from .gate import Gate
from .known import uncertainty_of
from .moves import State
from .race import Trial
from .result import INTERRUPTED, OUT_OF_TIME, Diagnosis, Limit, Rival, RunTraces, Step, Unknown
from .search import Search
from .seek import CLOSE, find
from .settings import TWINS

#: Noise that was not given and turns out below this part of what was estimated beside the misfit: the search is done again, at most so often.
SHARPER, ROUNDS = 0.95, 3
#: χ² over degrees of freedom up to which runs count as fitted when they are fitted apart.
FITS = 1.15


def diagnose(
    campaign: Campaign,
    model: Model,
    consult: Callable[[], State],
    tell: Callable[[str], None] = lambda _: None,
    workers: Threads | Cluster | None = None,
) -> Diagnosis:
    """Diagnose a campaign against a model. ``consult`` gives the end of the search over nodes, where no single effect leaves noise.

    ``tell`` hears what is being tried; ``workers`` do the refits. Raises `InputError` for a campaign that cannot be fitted at all.
    """
    began = time.monotonic()
    notes = support.inspect(campaign)
    tell("simulating the runs from end to end, for they touch the track")
    problem, base, undetermined = base_fit(campaign, model)
    notes += support.undetermined(undetermined, base)
    search = Search(problem, base, tell, workers)
    root = search.trials[frozenset(base.structure.effects)]
    answer = None
    for _ in range(ROUNDS):
        chosen, found_gate = find(search, search.trials[frozenset(base.structure.effects)], notes, answer, lambda s, r: _proposed(s, r, consult()))
        sigma = noise.from_residuals(problem, [p.residual for p in chosen.fit.linear], campaign.noise_std)
        if {INTERRUPTED, OUT_OF_TIME} & {*notes} or (sigma > SHARPER * problem.sigma).all():
            break
        tell("the noise is smaller than it seemed beside the misfit: once more")
        problem = problem.with_sigma(sigma)
        base = fit(problem, base.structure, base.states, base.theta)
        search = search.under(problem, base)
        answer = search.trials[frozenset(chosen.names)]
    root = search.trials[frozenset(base.structure.effects)]
    new = tuple(n for n in chosen.names if n not in root.names)
    stand_in = [n for n in new if n.startswith("stand_in")]
    effects = tuple(n for n in new if n not in stand_in)
    verdict = "adequate" if not new and found_gate.adequate else "missing_effect" if found_gate.adequate and not stand_in else "unknown_effect"
    f, twins = chosen.fit, _twins(search, chosen, effects)
    tell("how well it predicts runs left out")
    path = [tuple(new[:k]) for k in range(len(new) + 1)]
    steps = tuple(step_of(search, search.part(chosen, (*root.names, *p)), p) for p in path)
    unknown = _unknown(search, chosen, found_gate, stand_in, steps) if verdict == "unknown_effect" else None
    experiment, proposal = None, None
    if twins or verdict == "unknown_effect":
        tell("which run would settle what is open")
        rivals = {o: search.trials[(frozenset(chosen.names) - {n}) | {o}].fit for n, others in twins.items() for o in others}
        experiment, proposal = propose(search.problem, search.map, f, rivals, twins, unknown, undetermined)
    if verdict == "unknown_effect" and (odd := disagreeing(problem, base)):
        notes.append(
            f"runs disagree: {', '.join(odd)} and the others each fit the model alone, with other values of {', '.join(base.structure.free)}; "
            "was the rig changed between them?"
        )
        experiment = f"repeat one of {', '.join(odd)} and one of the others without touching the rig in between, or diagnose them apart"
    notes += leftover(problem, chosen.fit, campaign.noise_std, found_gate)
    deviations = f.deviations
    held = [f.structure.free[k] for k in f.structure.held]
    notes += support.held(f)
    return Diagnosis(
        campaign=campaign.name,
        verdict=verdict,
        effects=effects,
        model=f.model,
        parameters={n: (v, deviations[n]) for n, v in f.values.items() if "values[" not in n and n not in held},
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
        log=_log(search, root, chosen, new),
        uncertainty=uncertainty_of(f),
    )


def _log(search: Search, root: Trial, chosen: Trial, new: Sequence[str]) -> tuple[str, ...]:
    """The way to the answer: what each effect takes off χ²."""
    lines = [f"runs simulated from end to end, for they touch the track: χ² {root.chi2:.0f} of {root.fit.samples} samples"]
    for k, name in enumerate(new):
        before, after = (search.part(chosen, (*root.names, *new[:n])) for n in (k, k + 1))
        lines.append(f"{name}: χ² {before.chi2:.0f} -> {after.chi2:.0f}")
    return tuple(lines)


def _proposed(search: Search, root: Trial, state: State) -> Trial | None:
    """The end of the search over nodes as a trial, refitted from end to end; None where it found nothing."""
    if not state.added:
        return None
    f = state.fit
    refitted = fit(search.problem, f.structure, f.states, f.theta, settle=True)
    trial = Trial(refitted, (*root.names, *state.added), True, dict(state.freedom))
    search.keep(trial)
    return trial


def base_fit(campaign: Campaign, model: Model) -> tuple[Problem, Fit, tuple[str, ...]]:
    """The problem with its noise, the fit of the model as it is, and the parameters that the data cannot determine."""
    guess = noise.from_samples(campaign) | dict(campaign.noise_std)
    support.check_noise(campaign, guess)
    problem = Problem(campaign, model, guess)
    free = tuple(campaign.free) + tuple(f"{e}.{p}" for e, values in model.effects.items() for p in values if p != "variable" and not e.startswith("stand_in"))
    structure = Structure(problem.model, free)
    structure.check()
    base = _first_fit(problem, structure)
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


def _first_fit(problem: Problem, structure: Structure) -> Fit:
    """The fit of the model as it is, the better of two ways to start: from multiple shooting, and over growing horizons.

    Shooting finds the sway and roll that nothing measures, growing horizons the right side of an early impact. Runs by pulses are flown
    at an unstable speed that a controller holds; growing horizons do not follow them.
    """
    shot = shooting.fit(problem, structure)
    found = fit(problem, structure, shot.states, shot.theta)
    if np.isfinite(found.chi2) and (found.leaves_noise or not all(data.averaged for data in problem.runs)):
        return found
    return min(found, fit_from_scratch(problem, structure), key=lambda f: f.chi2)


def _twins(search: Search, chosen: Trial, effects: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """For each effect found, what could stand in its place within `TWINS` of χ²; beside a force of any shape only what acts alike."""
    twins = {}
    for name in effects:
        added = frozenset(chosen.names) - {name}
        others = search.recognise(chosen, name) if chosen.stands_in else search.rivals(chosen, name)
        close = [search.converged(search.finish(t)) for t in others if t.chi2 < chosen.chi2 + CLOSE]
        rivals = sorted((t.chi2, next(iter(frozenset(t.names) - added))) for t in close if t.chi2 < chosen.chi2 + TWINS)
        if rivals:
            twins[name] = tuple(n for _, n in rivals)
    return twins


def step_of(search: Search, trial: Trial, shown: tuple[str, ...]) -> Step:
    """Errors with a set of effects: fitted on all runs, and on every fourth when the fit saw only the others."""
    problem, f = search.problem, trial.fit
    residuals = [p.residual for p in f.linear]
    seen, out = left_out(problem)
    heldout, heldout_errors = np.nan, {}
    if seen:
        near = [f.linear[i] for i in seen]
        inner = fit(problem.subset(seen), f.structure, [f.states[i] for i in seen], f.theta, iterations=8, reuse=near)
        model = inner.model
        left = problem.subset(out)
        outer = fit(left, Structure(model, ()), [f.states[i] for i in out], iterations=8, reuse=[f.linear[i] for i in out])
        rest = [p.residual for p in outer.linear]
        heldout, heldout_errors = rms(np.concatenate(rest)), by_channel(left, rest)
    return Step(
        shown, f.reduced_chi2, heldout, by_channel(problem, residuals), heldout_errors,
        {d.run.name: rms(r) for d, r in zip(problem.runs, residuals, strict=True)},
    )  # fmt: skip


def _unknown(search: Search, chosen: Trial, gate: Gate, stand_in: Sequence[str], steps: Sequence[Step]) -> Unknown:
    """What is known of the unknown: the first stand-in's curve, or where the gate's most telling force law points."""
    if not stand_in:
        law = next((t.law for t in gate.tests if t.law), ("heave", "surge"))
        return Unknown.of(*law)
    return curve_of(chosen.fit, stand_in[0])


def _rivals(search: Search, root: Trial, chosen: Trial) -> tuple[Rival, ...]:
    """Every candidate of every round along the path that was taken."""
    found = []
    names = list(root.names)
    for step in [n for n in chosen.names if n not in root.names]:
        parent = search.part(chosen, names)
        screened = search.screened(parent)
        thresholds = {s.candidate.name: s.candidate.threshold(len(screened)) for s in screened}
        round_: list[Rival] = []
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
        tried = {r.name for r in round_}
        found += sorted(round_, key=lambda r: -r.chi2_fall)
        found += [_passed_over(s, names, thresholds) for s in screened if s.candidate.name not in tried]
        names.append(step)
    return tuple(found)


def _passed_over(screened: Screened, beside: Sequence[str], thresholds: Mapping[str, float]) -> Rival:
    """A candidate that promised too little to be refitted: its fall in χ² is the one to first order."""
    name = screened.candidate.name
    words = "not refitted: to first order others explain far more"
    return Rival(name, tuple(beside), screened.promise, thresholds[name], words=words, refitted=False)


def _words(chosen: bool, trial: Trial, parent: Trial, search: Search) -> str:
    """For and against a candidate, in a sentence."""
    left = trial.fit.reduced_chi2
    part = (parent.chi2 - trial.chi2) / max(parent.chi2 - min(t.chi2 for t in search.trials.values()), 1e-9)
    if part < 0:
        return f"makes it worse: χ² per sample {left:.3g}"
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
        if len(structure.free) == first or s.candidate.starts[0] and s.candidate.name != WAVES:  # no size, or none near nothing
            continue
        declared, scale = structure.declarations[first], structure.scale[first]
        size = (np.sqrt(s.candidate.threshold(len(search.screened(chosen)))) + 1.28) * s.deviation
        if s.candidate.name == WAVES:
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
            predicted[subset] = {c: column(data, read, k) for k, c in enumerate(problem.channels) if c in data.run.channels}
        measured = {c: data.run[c] for c in data.run.channels}
        traces.append(RunTraces(data.run.name, data.run.driven, data.run.times, measured, predicted))
    return tuple(traces)


def disagreeing(problem: Problem, base: Fit) -> list[str]:
    """Names of the runs that, taken apart from the others, fit the model with parameters of their own; none if that does not help."""
    if len(problem.runs) < support.FEW_RUNS or not base.structure.free:
        return []
    apart: list[int] = []
    rest = list(range(len(problem.runs)))
    while len(apart) < len(problem.runs) // 2:
        inner = fit(problem.subset(rest), base.structure, [base.states[i] for i in rest], base.theta, iterations=10)
        if inner.reduced_chi2 < FITS:
            break
        worst = int(np.argmax([np.nanmean(p.residual**2) for p in inner.linear]))
        apart.append(rest.pop(worst))
    else:
        return []
    if not apart:
        return []
    own = fit(problem.subset(apart), base.structure, [base.states[i] for i in apart], base.theta, iterations=10)
    return [problem.runs[i].run.name for i in sorted(apart)] if own.reduced_chi2 < FITS else []


def leftover(problem: Problem, final: Fit, given: Mapping[str, float], gate: Gate) -> list[str]:
    """Notes on what the final fit shows: a large misfit, noise levels that do not fit, all-contact data."""
    notes = []
    if final.rough:
        notes.append(f"the runs still miss by {np.sqrt(final.reduced_chi2):.2g} times the noise: what is named is a lead, its size not to be relied on")
    touching = [bool((problem.simulate(final.structure, i, final.theta[None], final.states[i][None])[0][:, 8:11].min(axis=1) < 0).mean() > 0.9) for i in range(len(problem.runs))]
    if all(touching):
        notes.append("the cradle touches the track in every run: lift and damping show little; runs that fly would show them")
    if gate.adequate:
        for c, channel in enumerate(problem.channels):
            if channel in given:
                r = np.concatenate([p.residual[(d.channel == c) & np.isfinite(p.residual)] for d, p in zip(problem.runs, final.linear, strict=True)])
                ratio = float(np.sqrt(np.mean(r**2))) if r.size else 1.0
                if not 0.9 < ratio < 1.1:
                    notes.append(f"the noise of {channel} is {ratio:.2f} times the stated noise_std")
    return notes
