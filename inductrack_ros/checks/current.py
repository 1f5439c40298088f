# SPDX-License-Identifier: Apache-2.0
"""The drive current against what accelerates the cradle: by which factor are the two apart?

The thrust is proportional to the current, so that the factor is solved for and not tried: a sign, a slip by ten, √2
between effective value and amplitude, the current of another run. A factor that all runs share may be γ, of which the
thrust is a multiple too; one that a run has alone is its current's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..core.model import Model
from ..data import Campaign
from . import levels
from .balance import Reading, Windows, bad, misfits, needed_current, windows_of
from .finding import IMPOSSIBLE, WARNING, Finding, number, shared
from .noise_found import Channel

#: The factor is √2 where it is this near to it.
_NEAR = 1.1


def drive(campaign: Campaign, windows: Windows, model: Model, left: Mapping[str, float]) -> list[Finding]:
    """A finding where another current brings surge, which alone is off, to where the model has it; ``left`` is how far
    channels are off with the current as stated."""
    if bad(left) != ["surge"] or windows.pulsed:
        return []
    coasting = not windows.current.any()
    if coasting:  # the factor of one ampere is the current
        windows = replace(windows, current=np.ones_like(windows.current))
    factor = needed_current(windows, model)
    if factor is None:
        return []
    then = misfits(windows, model, Reading(current=factor))
    if bad(then) or not then.get("surge", 2.0) < levels.GOOD:
        return []
    size = {"off": dict(left), "then": dict(then), "factor": factor, "explains": ["surge"]}
    if coasting:
        push = _thrust(windows, model, factor) / model.parameters["gravity"]
        text = f"drive_current is 0, where the cradle is accelerated as by {number(factor)} A"
        severity = IMPOSSIBLE if push > levels.PUSH else WARNING
        return [Finding("unlike", severity, text, "was the drive on?", "drive_current", size=size)]
    return [_finding(stated_currents(campaign), size, model)]


def stated_currents(campaign: Campaign) -> str:
    """The drive currents of the runs that are driven, in words."""
    return f"drive_current ({shared([f'{run.drive_current:g}' for run in campaign.runs if run.drive_current])} A)"


def _thrust(windows: Windows, model: Model, current: float) -> float:
    """Acceleration (m/s²) that a current gives at the windows' mean speed."""
    speed = _speed(windows)
    state = model.initial_state(surge_rate=abs(speed))
    with_it, without = (model.quantities(state, drive_current=c)["surge_acceleration"] for c in (current, 0.0))
    return abs(with_it - without)


def _speed(windows: Windows) -> float:
    """Median speed (m/s) in the windows."""
    if "surge" not in windows.values:
        return float(np.median(windows.values["surge_rate"]))
    travel, times = windows.values["surge"], windows.times
    return float(np.median((travel[:, -1] - travel[:, 0]) / (times[:, -1] - times[:, 0])))


@dataclass(frozen=True)
class _Driven:
    """By which factor a run's current is too small, and how fast the run is (m/s)."""

    factor: float
    speed: float


def against_others(
    campaign: Campaign, channels: Mapping[str, Channel], model: Model, most: int, findings: list[Finding]
) -> list[Finding]:
    """The findings about some runs' drive current, held against what the other runs need: a factor of all is said once;
    one that runs have alone, at no other speed than the rest, is no property of the rig."""
    mine = [f for f in findings if f.channel == "drive_current" and f.severity == WARNING and f.size["factor"] > 0.0]
    if not mine or len(campaign.runs) == 1:
        return findings
    driven = _driven(campaign, channels, model, most)
    factors = [d.factor for d in driven.values()]
    rest = [f for f in findings if f not in mine]
    said_off = {run.name for run in campaign.runs if run.drive_current == 0.0}
    shared_by_all = len(factors) > 1 and min(factors) > 0.0 and max(factors) < levels.ONE_CURRENT * min(factors)
    if shared_by_all and not any(said_off & set(f.size.get("runs", ())) for f in mine):
        size = {**mine[0].size, "factor": float(np.median(factors)), "runs": list(driven)}
        return [*rest, _finding(stated_currents(campaign), size, model)]
    return [*rest, *(_apart(f, driven) for f in mine)]


def _driven(campaign: Campaign, channels: Mapping[str, Channel], model: Model, most: int) -> dict[str, _Driven]:
    """What is known of the current of each run that is said to be driven."""
    found = {}
    for run in campaign.runs:
        windows = windows_of(replace(campaign, runs=(run,)), channels, most) if run.drive_current else None
        factor = None if windows is None or windows.pulsed else needed_current(windows, model)
        if windows is not None and factor is not None:
            found[run.name] = _Driven(factor, _speed(windows))
    return found


def _apart(finding: Finding, driven: Mapping[str, _Driven]) -> Finding:
    """The finding as one that cannot be so, where the other runs have one factor, these another, and speed explains it
    not: a drive that weakens with the speed gives the faster runs less."""
    runs = finding.size.get("runs", ())
    odd = [driven[name] for name in runs if name in driven]
    others = [d for name, d in driven.items() if name not in runs]
    if not odd or not others or min(d.factor for d in (*odd, *others)) <= 0.0:
        return finding
    least, most = (pick(d.factor for d in others) for pick in (min, max))
    slowest, fastest = (pick(d.speed for d in others) for pick in (min, max))
    too_much = all(d.factor > levels.SCALE * most and d.speed > slowest / levels.ONE_CURRENT for d in odd)
    too_little = all(levels.SCALE * d.factor < least and d.speed < fastest * levels.ONE_CURRENT for d in odd)
    alike = most < levels.ONE_CURRENT * least
    if not (alike and (too_much or too_little)):
        return finding
    remedy = finding.remedy.partition(" (")[0] + "; the other runs move as theirs says"
    return replace(finding, severity=IMPOSSIBLE, remedy=remedy)


def _finding(stated: str, size: Mapping[str, Any], model: Model) -> Finding:
    """What is said of the ``factor`` that the current lacks: more than any effect makes of it cannot be so."""
    factor = size["factor"]
    if factor < 0.0:
        text = f"{stated} acts against what accelerates the cradle as measured"
        remedy = "change its sign in campaign.yaml: a positive current drives along surge"
        return Finding("axis_flipped", IMPOSSIBLE, text, remedy, "drive_current", size=size)
    text = f"{stated} is {number(1 / factor)} times what accelerates the cradle as measured"
    if not 1 / levels.UNIT < factor < levels.UNIT:
        remedy = "drive_current is in A; correct it in campaign.yaml"
        return Finding("unit", IMPOSSIBLE, text, remedy, "drive_current", size=size)
    remedy = "look at drive_current"
    if 1 / _NEAR < max(factor, 1 / factor) / np.sqrt(2.0) < _NEAR:
        remedy = "is it an effective value where the model takes an amplitude, or the other way round?"
    taken_up = number(factor * model.parameters["gamma"])
    remedy += f" (a fit that may move gamma takes {taken_up} for it, and says nothing more of the current)"
    return Finding("unlike", WARNING, text, remedy, "drive_current", size=size)
