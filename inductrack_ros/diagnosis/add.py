"""One effect added by hand: everything refitted with it, and what that gains."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

from threadpoolctl import threadpool_limits

from ..checks import Finding, admit
from ..core.effects import split_name
from ..core.errors import InputError
from ..core.model import Model
from ..data.campaign import Campaign
from ..estimation.fit import Fit, fit, fit_from_scratch
from ..estimation.problem import Problem
from ..estimation.structure import Structure
from . import support
from .candidates import Candidate
from .deterministic import base_fit, step_of, traces_of, where_won
from .known import uncertainty_of
from .race import Trial
from .result import Diagnosis, Rival
from .search import Search


@threadpool_limits.wrap(limits=1, user_api="blas")  # as `diagnose` is
def add_effect(
    campaign: Campaign,
    model: Model,
    name: str,
    tell: Callable[[str], None] = lambda _: None,
    hear: Callable[[tuple[Finding, ...]], None] = lambda _: None,
) -> Diagnosis:
    """The diagnosis that ``name`` and nothing else is missing; its one rival says what the effect takes off χ².

    ``verdict`` is ``unknown_effect`` where more than noise is left, else ``missing_effect``, or ``adequate`` where the
    effect gains no more than chance would. ``hear`` is told what a look at the data finds. Raises `InputError` for data that cannot
    be meant as they are written, and for an effect that is not known, is in the model already, or is a fault of a sensor that no
    run has.
    """
    began = time.monotonic()
    campaign, findings = admit(campaign, model)
    hear(findings)
    item, channel = split_name(name, model.known_effects, campaign.channels)
    if name in model.effects:
        raise InputError(f"'{name}' is in the model already; nothing to add")
    if name.startswith("stand_in"):
        raise InputError(f"'{name}' stands for what is not known; `inductrack diagnose` adds it where it must")
    notes = support.inspect(campaign)
    tell("fitting what is known")
    problem, base, undetermined = base_fit(campaign, model)
    notes += support.undetermined(undetermined, base)
    search = Search(problem, base, tell)
    root = search.trials[frozenset(base.structure.effects)]
    standing = next((s.candidate for s in search.screened(root) if s.candidate.name == name), None)
    if standing is None and item.screened:
        raise InputError(f"'{name}' leaves no trace in these runs, whatever its size; it cannot be fitted to them")
    tell(name)
    starts = standing.starts if standing else ({},)
    f = min((_refit(fit, problem, base, name, start) for start in starts), key=lambda f: f.chi2)
    if not math.isfinite(f.chi2):
        raise InputError(f"'{name}' cannot be fitted to these runs: no size of it follows them")
    trial = search.trials[frozenset((*root.names, name))] = Trial(f, (*root.names, name), True)
    trial, gate = search.judged(trial)
    if not gate.adequate:  # perhaps it is stuck on the way there
        anew = min((_refit(_from_scratch, problem, base, name, start) for start in starts), key=lambda f: f.chi2)
        if anew.chi2 < f.chi2:
            trial = search.trials[frozenset(trial.names)] = Trial(anew, trial.names, True)
            trial, gate = search.judged(trial)
    f = trial.fit
    deviations = f.deviations
    threshold = Candidate(name, ({},), 1, len(item.parameters)).threshold(1)
    gains = root.chi2 - trial.chi2 > threshold
    own = {n: v for n, v in f.values.items() if n.startswith(f"{name}.")}
    rival = Rival(
        name, root.names, root.chi2 - trial.chi2, threshold, own, {n: deviations[n] for n in own},
        chosen=gains, where=where_won(problem, base, f),
    )  # fmt: skip
    tell("how well it predicts runs left out")
    return Diagnosis(
        campaign=campaign.name,
        verdict="unknown_effect" if not gate.adequate else "missing_effect" if gains else "adequate",
        effects=(name,),
        model=f.model,
        parameters={n: (v, deviations[n]) for n, v in f.values.items() if "values[" not in n},
        indistinguishable={},
        unknown=None,
        next_experiment=None,
        steps=(step_of(search, root, ()), step_of(search, trial, (name,))),
        rivals=(rival,),
        noise=dict(zip(problem.channels, problem.sigma.tolist(), strict=True)),
        noise_given=tuple(campaign.noise_std),
        findings=findings,
        notes=tuple(notes),
        tests=gate.tests[:12],
        p_value=gate.p_scores,
        traces=traces_of(search, trial, root, (name,)),
        seconds=time.monotonic() - began,
        uncertainty=uncertainty_of(f),
    )


def _refit(how: Callable[..., Fit], problem: Problem, base: Fit, name: str, start: Mapping[str, float]) -> Fit:
    """Everything refitted with the effect, from one start of its parameters."""
    structure, theta = base.widened(name, start)
    return how(problem, structure, base.states, theta)


def _from_scratch(problem: Problem, structure: Structure, _: object, theta: object) -> Fit:
    return fit_from_scratch(problem, structure, theta)
