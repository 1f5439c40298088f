# SPDX-License-Identifier: Apache-2.0
"""One effect added by hand: everything refitted with it, and what that gains."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..checks import Finding, admit
from ..core.effects import split_name
from ..core.errors import InputError
from ..core.model import Model
from ..data.campaign import Campaign
from ..estimation.scores import Background
from . import support
from .candidates import Candidate
from .diagnose import base_fit, diagnosis_of
from .moves import State, Task, refitted, screened, settled
from .result import Diagnosis
from .screening import CandidateSet
from .strategy import add_background, add_known, add_unknown


@threadpool_limits.wrap(limits=1, user_api="blas")  # as `diagnose` is
def add_effect(
    campaign: Campaign,
    model: Model,
    name: str,
    tell: Callable[[str], None] = lambda _: None,
    hear: Callable[[tuple[Finding, ...]], None] = lambda _: None,
) -> Diagnosis:
    """The diagnosis that ``name`` and nothing else is missing; its one chosen rival says what the effect takes off the
    deviance.

    ``verdict`` is ``unknown_effect`` where more than noise is left, else ``missing_effect``, or ``adequate`` where the
    effect gains no more than chance would. ``hear`` is told what a look at the data finds.

    Raises `InputError` for data that cannot be meant as they are written. It is raised as well for an effect that is
    not known, that is in the model already, or that is a fault of a sensor that no run has."""
    campaign, seen = admit(campaign, model)
    hear(seen)
    item, _ = split_name(name, model.known_effects, campaign.channels)
    if name in model.effects:
        raise InputError(f"'{name}' is in the model already; nothing to add")
    if name.startswith("stand_in"):
        raise InputError(f"'{name}' stands for what is not known; `inductrack diagnose` adds it where it must")
    notes = support.inspect(campaign)
    tell("fitting what is known")
    problem, base, undetermined = base_fit(campaign, model, seen)
    task = Task(problem, tuple(campaign.noise_std), tuple(seen), tell)
    before = add_background(task, State(base))
    screening = screened(task, before)
    before = replace(before, rounds=(((), screening),))
    starts = [s for s in screening.sets if s.names == (name,)]
    if not starts and item.screened:
        raise InputError(f"'{name}' leaves no trace in these runs, whatever its size; it cannot be fitted to them")
    starts = starts or [_as_it_is(before, name, len(item.parameters))]
    added = min((refitted(task, before, s, 1) for s in starts), key=lambda s: s.cost(task))
    if not math.isfinite(added.fit.deviance):
        raise InputError(f"'{name}' cannot be fitted to these runs: no size of it follows them")
    added = settled(task, added)
    gains = added.cost(task) < before.cost(task)  # both before contact is taken exactly, which counts other readings
    added = add_background(task, added)
    gains = gains or added.fit.exact and not before.fit.exact  # it alone leaves nothing but noise, in contact too
    added = replace(added, rounds=(*added.rounds, (added.added, screened(task, added))))
    found = diagnosis_of(campaign, task, added, base, undetermined, notes)
    verdict = "unknown_effect" if _something_left(task, added) else "missing_effect" if gains else "adequate"
    own = [r for r in found.rivals if r.name == name]
    return replace(found, verdict=verdict, effects=(name,), rivals=tuple(replace(r, chosen=gains) for r in own[:1]))


def _as_it_is(state: State, name: str, parameters: int) -> CandidateSet:
    """An effect that no search asks for, from where its parameters start."""
    f = state.fit
    beside = Background(f.power, f.processes)
    return CandidateSet(
        (Candidate(name, name, {}, parameters),), f.deviance, f.deviance, {name: np.zeros(parameters)}, beside
    )


def _something_left(task: Task, state: State) -> bool:
    """Whether the search would go on: add another known effect, or a force of any shape, that keeps what it
    promises."""
    return any(stage(task, state).added != state.added for stage in (add_known, add_unknown))
