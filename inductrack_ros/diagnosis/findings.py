# SPDX-License-Identifier: Apache-2.0
"""What log and rig do besides, told: every process and every shaken coordinate of an answer as a `Finding` with its
size."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..checks import NOTE, WARNING, Finding
from ..checks.finding import number, quantity
from ..core.state import COORDINATES
from ..estimation.problem import Problem
from ..estimation.processes import COLOURED, HUM, JITTER, NOISY_RUN, RUN_TO_RUN, WHITE, Process
from .belonging import odd_by
from .moves import State, Task, shaken

#: Noise that differs from what is stated by less than this part of it is not worth a word.
WORTH_SAYING = 0.1
#: Kinds that a fit sees better than the look at the data: where the fit has none, there is none.
BETTER_SEEN = (COLOURED, HUM, JITTER)
SHAKEN = "shaken"


def findings(task: Task, state: State) -> tuple[Finding, ...]:
    """Findings of an answer, those of the look at the data among them as far as the fit does not know better."""
    own = [f for p in state.fit.processes if (f := _of_process(task, state, p)) is not None]
    own += [_of_shaking(task.problem, state, c) for c in shaken(task, state)]
    seen = {(f.kind, f.channel) for f in own}
    return tuple(own) + tuple(h for h in task.hints if h.kind not in BETTER_SEEN and (h.kind, h.channel) not in seen)


def _of_process(task: Task, state: State, p: Process) -> Finding | None:
    """The finding that a process is; None of noise that is as stated or was not, of contact and of rounding."""
    channels = task.problem.channels
    std = float(p.size * task.problem.sigma[channels.index(p.on)]) if p.on in channels else p.size
    if p.kind == WHITE:
        return _of_stated_noise(state, p.on) if p.on in task.given else None
    if p.kind == NOISY_RUN:
        text = f"the noise of {p.on} is {number(p.size)} times that of the other runs, in all channels"
        return Finding(WHITE, WARNING, text, "look what was different in that run", run=p.on, size={"ratio": p.size})
    if p.kind == COLOURED:
        text = (
            f"the noise of {p.on} is coloured: it forgets itself in {number(1e3 * p.time)} ms, {quantity(p.on, std)}"
            " of it (standard deviation)"
        )
        return Finding(COLOURED, NOTE, text, channel=p.on, size={"correlation_time": float(p.time), "std": std})
    if p.kind == HUM:
        text = f"{p.on} hums at {number(1.0 / p.time, 4)} Hz, amplitude {quantity(p.on, std)}"
        return Finding(HUM, NOTE, text, channel=p.on, size={"frequency": float(1.0 / p.time), "amplitude": std})
    if p.kind == JITTER:
        text = (
            f"the stamps are off by {number(1e3 * p.size)} ms from sample to sample (standard deviation), in all"
            " channels at once"
        )
        return Finding(JITTER, NOTE, text, size={"std": float(p.size)})
    if p.kind == RUN_TO_RUN:
        return odd_by(task, state, p) or _of_difference(state, p)
    return None


def _of_stated_noise(state: State, channel: str) -> Finding | None:
    """The finding that a channel's noise is of another size than stated; none where it is coloured, which says so."""
    sizes = {p.kind: p.size for p in state.fit.processes if p.on == channel and p.kind in (WHITE, COLOURED)}
    ratio = sizes[WHITE]
    if COLOURED in sizes or not abs(ratio - 1.0) > WORTH_SAYING:
        return None
    text = f"the noise of {channel} is {number(ratio)} times the stated noise_std"
    return Finding(WHITE, WARNING, text, "correct noise_std", channel, size={"ratio": ratio})


def _of_difference(state: State, p: Process) -> Finding:
    share = _relative(state, p)
    text = (
        f"{p.on} differs from run to run by {number(100 * share)} % (standard deviation): the rig, or what the log"
        " says of it, is not the same in every run"
    )
    return Finding(RUN_TO_RUN, NOTE, text, size={"parameter": p.on, "relative_std": share})


def _relative(state: State, p: Process) -> float:
    """Standard deviation of a parameter from run to run over its value."""
    f = state.fit
    spread = f.structure.spread(f.theta, np.where([n == p.on for n in f.structure.free], p.size, 0.0))[p.on]
    return float(spread / abs(f.values[p.on]))


def _of_shaking(problem: Problem, state: State, coordinate: str) -> Finding:
    c = COORDINATES.index(coordinate)
    inertia = state.fit.model.parameters["roll_inertia" if coordinate == "roll" else "mass"]
    unit = "N·m/√Hz" if coordinate == "roll" else "N/√Hz"
    size = float(np.sqrt(state.fit.power[c]) * inertia)
    text = f"something shakes the cradle in {coordinate}: {number(size)} {unit}, white as far as can be seen"
    return Finding(SHAKEN, NOTE, text, size={"coordinate": coordinate, "size": size, "unit": unit})


def hidden_by(found: Iterable[Finding]) -> str:
    """What also swallows physics, in words; empty where nothing does."""
    words = {COLOURED: "coloured noise", SHAKEN: "a shaken plant", RUN_TO_RUN: "what differs from run to run"}
    kinds = {f.kind for f in found}
    return " and ".join(text for kind, text in words.items() if kind in kinds)
