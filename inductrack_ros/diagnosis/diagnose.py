# SPDX-License-Identifier: Apache-2.0
"""The whole diagnosis: fit first, search what is missing, how sure that is, what run would settle what is open."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..checks import Finding, admit, set_aside
from ..core.errors import InputError, did_you_mean
from ..core.model import Model
from ..data.campaign import Campaign
from ..data.thinning import thinned
from ..estimation import noise, shooting
from ..estimation.problem import GRID, Problem
from ..estimation.scores import scores
from ..estimation.shooting import Fit, linearise_all
from ..estimation.structure import Structure
from ..workers import Cluster, Threads
from . import answer, background, errors, support
from .belonging import odd_run
from .experiment import look_closer, propose
from .findings import SHAKEN, findings, hidden_by
from .laws.propose import propose_laws
from .moves import State, Task, last_screened
from .result import INTERRUPTED, OUT_OF_TIME, Diagnosis, Proposal, Unknown
from .settings import FIRST_STEPS, MOST_ROWS, UNDETERMINED
from .sharpen import sharpen
from .spikes import outlying
from .strategy import add_background, search

#: Looks for spikes that the model shows, at the most.
SPIKE_ROUNDS = 4
#: Why a search was broken off, as the notes say it.
STOPPED = {"interrupted": INTERRUPTED, "out of time": OUT_OF_TIME}


@threadpool_limits.wrap(limits=1, user_api="blas")  # the threads are ours: many small matrices at once
def diagnose(
    campaign: Campaign,
    model: Model,
    tell: Callable[[str], None] = lambda _: None,
    workers: Threads | Cluster | None = None,
    hear: Callable[[tuple[Finding, ...]], None] = lambda _: None,
    budget: float = np.inf,
) -> Diagnosis:
    """Diagnose a campaign against a model, whose effects (if any) are kept and refitted.

    ``tell`` hears what is being tried, ``hear`` what a look at the data finds; ``workers`` do the refits; after
    ``budget`` (s) the best answer so far is given. Raises `InputError` for data that cannot be meant as they are
    written, and for a campaign that cannot be fitted at all."""
    began = time.monotonic()
    campaign, seen = admit(campaign, model)
    hear(seen)
    notes, log = support.inspect(campaign), ()
    campaign, fewer = thinned(campaign, MOST_ROWS, GRID)
    notes += [fewer] if fewer else []
    while True:
        tell("fitting what is known")
        spikes, (problem, base, undetermined) = spikes_and_fit(campaign, model, seen)
        campaign, seen = set_aside(campaign, spikes), (*seen, *spikes)
        task = Task(problem, tuple(campaign.noise_std), tuple(seen), tell, workers or Threads(), began + budget)
        state = search(task, add_background(task, State(base, log=log)))
        odd = state.odd or (None if state.stopped else odd_run(task, state))
        if odd is None:
            break
        campaign, seen, log = set_aside(campaign, [odd]), (*seen, odd), (*state.log, odd.text)
    notes += support.undetermined(undetermined, base)
    notes += [STOPPED[state.stopped]] if state.stopped else []
    return diagnosis_of(campaign, task, state, base, undetermined, notes)


def diagnosis_of(
    campaign: Campaign, task: Task, state: State, base: Fit, undetermined: Sequence[str], notes: list[str]
) -> Diagnosis:
    """The diagnosis that the end of a search is."""
    state = last_screened(task, state)
    problem, f = task.problem, state.fit
    effects, verdict = state.known, state.verdict
    unknown, screening = answer.unknown_of(state, problem), state.rounds[-1][1]
    sigma = answer.sigma_found(task, state, background.noise_of_rounding(task.hints))
    task.tell("how well it predicts runs left out")
    base = answer.settled_base(task, state, base)
    fits = answer.subsets(task, state, base)
    path = [state.added[:k] for k in range(len(state.added) + 1)]
    steps = tuple(errors.step_of(problem, fits[p], sigma, p) for p in path)
    where = {p[-1]: errors.where_won(problem, fits[p[:-1]], fits[p], sigma) for p in path[1:]}
    experiment, proposal, more = what_next(campaign, task, state, verdict, unknown, undetermined)
    notes += more
    found = findings(task, state)
    if swallowing := hidden_by(found):
        notes.append(f"{swallowing} can hide effects too: what would have shown is listed with that reckoned in")
    notes += support.leftover(problem, f, state.far)
    tests, p_value = answer.tests_of(screening)
    held = [f.structure.free[k] for k in f.structure.held]
    laws = None if state.stopped else propose_laws(task, state, unknown, sigma)
    notes += support.held(f)
    if verdict != "unknown_effect":
        notes += support.predicted(steps, any(x.kind == SHAKEN for x in found))
    deviations = f.deviations
    return Diagnosis(
        campaign=campaign.name,
        verdict=verdict,
        effects=effects,
        model=f.model,
        parameters={n: (v, deviations[n]) for n, v in f.values.items() if "values[" not in n and n not in held},
        indistinguishable=state.twins,
        unknown=unknown,
        next_experiment=experiment,
        steps=steps,
        rivals=answer.rivals_of(state, where),
        limits=answer.limits_of(state, screening),
        noise=dict(zip(problem.channels, sigma.tolist(), strict=True)),
        noise_given=tuple(campaign.noise_std),
        notes=tuple(notes),
        findings=found,
        tests=tests,
        p_value=p_value,
        traces=errors.traces_of(problem, fits | answer.with_laws(state, laws)),
        proposal=proposal,
        log=state.log,
        uncertainty=f.uncertainty,
        laws=laws,
    )


def what_next(
    campaign: Campaign, task: Task, state: State, verdict: str, unknown: Unknown | None, undetermined: Sequence[str]
) -> tuple[str | None, Proposal | None, list[str]]:
    """The run that would settle what is open, or sharpen what the campaign asks for, in words and as numbers; notes."""
    if state.stopped:
        note = "what follows a search was left out: laws, the next experiment, sets of effects not on its way"
        return None, None, [note]
    if state.twins or verdict == "unknown_effect":
        if not state.rivals:
            return look_closer(unknown) if unknown else None, None, []
        task.tell("which run would settle what is open")
        each = task.workers.map
        return *propose(task.problem, each, state.fit, state.rival_fits, state.twins, undetermined), []
    return sharpened(campaign.sharpen, task, state.fit) if campaign.sharpen else (None, None, [])


def sharpened(name: str, task: Task, f: Fit) -> tuple[str | None, Proposal | None, list[str]]:
    """The run that would determine a parameter better, as the campaign asks; what is to be said where there is none."""
    if name not in f.structure.free:
        known = did_you_mean(name, [n for n in f.structure.free if "values[" not in n])
        return None, None, [f"sharpen: '{name}' is not among the fitted parameters{known}"]
    task.tell(f"which run would determine {name} better")
    proposal = sharpen(task.problem, task.workers.map, f, name)
    if proposal is None:
        return None, None, [f"sharpen: no run within the campaign's limits would tell of {name}"]
    return f"{proposal[0]}{' (if nothing shook the cradle)' if f.power.any() else ''}", proposal[1], []


#: A problem, the fit of the model as it is, and the parameters that the data cannot determine.
BaseFit = tuple[Problem, Fit, tuple[str, ...]]


def spikes_and_fit(
    campaign: Campaign, model: Model, seen: Sequence[Finding] = ()
) -> tuple[tuple[Finding, ...], BaseFit]:
    """The spikes that the fit of the model as it is shows, and that fit without them.

    The first hide others: while they are in, the plant looks shaken."""
    spikes: tuple[Finding, ...] = ()
    found = base_fit(campaign, model, seen)
    for _ in range(SPIKE_ROUNDS):
        if (more := outlying(found[0], found[1], campaign, spikes)) == spikes:
            break
        spikes = more
        found = base_fit(set_aside(campaign, spikes), model, (*seen, *spikes))
    return spikes, found


def base_fit(campaign: Campaign, model: Model, seen: Sequence[Finding] = ()) -> BaseFit:
    """The problem with its noise, the fit of the model as it is, and the parameters that the data cannot determine."""
    problem = Problem(campaign, model, _noise(campaign, seen))
    own = tuple(
        f"{e}.{p}"
        for e, values in model.effects.items()
        for p in values
        if p != "variable" and not e.startswith("stand_in")
    )
    structure = Structure(problem.model, tuple(campaign.free) + own)
    structure.check()
    first = background.processes_at_first(problem, tuple(campaign.noise_std), seen)
    base = shooting.fit(problem, structure, None, FIRST_STEPS, first)
    if not np.isfinite(base.deviance):
        raise InputError(
            f"{campaign.folder}: the model cannot follow the runs at all; look at the units, the model and"
            " drive_current"
        )
    undetermined = _undetermined(problem, base)
    if undetermined:
        kept = [k for k, n in enumerate(structure.free) if n not in undetermined]
        structure = Structure(problem.model, tuple(structure.free[k] for k in kept))
        base = shooting.fit(problem, structure, replace(base.point, theta=base.theta[kept]), FIRST_STEPS)
    if any(t.any() for t in base.touching):
        problem = problem.with_contacts(base.touching)
        base = shooting.fit(problem, structure, base.point, FIRST_STEPS)
    return problem, base, undetermined


def _noise(campaign: Campaign, seen: Sequence[Finding]) -> Mapping[str, float]:
    """Noise by channel to begin with: as given, else from neighbouring samples; of rounded readings at least their
    rounding."""
    guess = noise.from_samples(campaign) | dict(campaign.noise_std)
    for channel, size in background.noise_of_rounding(seen).items():
        if channel in guess:
            guess[channel] = float(np.nanmax([guess[channel], size]))
    support.check_noise(campaign, guess)
    return guess


def _undetermined(problem: Problem, base: Fit) -> tuple[str, ...]:
    """Free parameters that the data would say nothing about even if nothing shook the plant: their deviation is that of
    the prior. What a model lacks shakes the plant at first, and would hide a parameter that is well known beside it."""
    still = scores(problem, base, {}, linearise_all(problem, base), shares=(0.0,)).levels[0]
    known = still.gram[1:, 1:] + base.structure.precision
    prior = 1.0 / np.sqrt(np.diag(base.structure.precision))
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(known, rcond=1e-14, hermitian=True)), 0.0))
    return tuple(n for n, d, p in zip(base.structure.free, deviation, prior, strict=True) if d > UNDETERMINED * p)
