# SPDX-License-Identifier: Apache-2.0
"""What the runs can tell: are there samples enough, does each coordinate move?"""

from __future__ import annotations

from collections.abc import Mapping

from ..core.model import Model
from ..core.state import COORDINATES, STATES
from ..data import Campaign, Run
from . import levels
from .finding import IMPOSSIBLE, NOTE, SET_ASIDE, Finding, quantity, shared
from .noise_found import Channel


def too_few(campaign: Campaign, model: Model | None) -> list[Finding]:
    """Runs with hardly more values than numbers to be found: any model fits them."""
    short = [
        (run, free)
        for run in campaign.runs
        if int(run.measured.sum()) < levels.VALUES_FOR_EACH * (free := _free(run, model))
    ]
    all_ = len(short) == len(campaign.runs)
    findings = []
    for run, free in short:
        values = int(run.measured.sum())
        text = (
            f"{run.file.name} has {values} values for {free} free numbers of its initial state: any model would fit it"
        )
        remedy = f"record at least {levels.VALUES_FOR_EACH * free} values, or give initial_state in campaign.yaml"
        size = {"values": values, "free": free}
        if all_:
            findings.append(Finding("too_few_samples", IMPOSSIBLE, text, remedy, run=run.name, size=size))
        else:
            findings.append(Finding("too_few_samples", SET_ASIDE, text, remedy, run=run.name, size=size))
    return findings


def _free(run: Run, model: Model | None) -> int:
    """How many numbers of the run's initial state are to be found."""
    held = () if model is None else [c for c, moves in zip(COORDINATES, model.moving, strict=True) if not moves]
    return sum(s.removesuffix("_rate") not in held and s not in run.initial_state for s in STATES)


def held_still(campaign: Campaign, channels: Mapping[str, Channel], model: Model | None) -> list[Finding]:
    """Coordinates that the model holds at rest and that move by far more than their noise. What acts on a cradle that
    does not sway is not what is measured. Where it holds surge the cradle goes on at its speed."""
    if model is None:
        return []
    moving = {c for c, moves in zip(COORDINATES, model.moving, strict=True) if moves} | {"surge"}
    spans = {
        c: channels[c].spread
        for c in COORDINATES
        if c not in moving and c in channels and channels[c].spread > levels.NOISE_IMPOSSIBLE * channels[c].scatter
    }
    if not spans:
        return []
    one = len(spans) == 1
    dof = model.dof if isinstance(model.dof, int) else f"[{', '.join(model.dof)}]"
    sizes = shared([quantity(c, span) for c, span in spans.items()])
    text = f"dof: {dof} holds {shared(spans)}, but {'it spans' if one else 'they span'} {sizes}"
    remedy = f"write dof: 4 to let {'it' if one else 'them'} move, or leave the channel{'' if one else 's'} out"
    size = {"channels": list(spans), "spans": list(spans.values())}
    return [Finding("held_still", IMPOSSIBLE, text, remedy, next(iter(spans)), size=size)]


def excitation(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """Coordinates that do not move beyond their noise: nothing can be said of what acts on them."""
    still = [
        c
        for c in COORDINATES
        if c in channels
        and channels[c].every <= levels.SLOWEST
        and 0.0 < channels[c].spread < levels.MOVES * max(channels[c].noise, channels[c].step / 3.5)
    ]
    if not still:
        return []
    verb = "does" if len(still) == 1 else "do"
    text = (
        f"{shared(still)} {verb} not move beyond the noise in any run: what acts on"
        f" {'it' if len(still) == 1 else 'them'} cannot be told"
    )
    spans = {c: channels[c].spread for c in still}
    return [
        Finding(
            "still",
            NOTE,
            text,
            "start some runs beside the middle of the track",
            still[0],
            size={"channels": still, "span": max(spans.values())},
        )
    ]
