# SPDX-License-Identifier: Apache-2.0
"""The drive current against what accelerates the cradle: by which factor are the two apart?

The thrust is proportional to the current, so that the factor is solved for and not tried: a sign, a slip by ten, √2
between effective value and amplitude, the current of another run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..core.model import Model
from ..data import Campaign
from . import levels
from .balance import Reading, Windows, bad, misfits, needed_current
from .finding import IMPOSSIBLE, WARNING, Finding, number, shared

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
        text = f"drive_current is 0, where the cradle is accelerated as by {number(factor)} A"
        return [Finding("unlike", WARNING, text, "was the drive on?", "drive_current", size=size)]
    return [_finding(f"drive_current ({shared([f'{run.drive_current:g}' for run in campaign.runs])} A)", size)]


def _finding(stated: str, size: Mapping[str, Any]) -> Finding:
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
    remedy = "look at drive_current and at the model's parameters"
    if 1 / _NEAR < max(factor, 1 / factor) / np.sqrt(2.0) < _NEAR:
        remedy = "is it an effective value where the model takes an amplitude, or the other way round?"
    return Finding("unlike", WARNING, text, remedy, "drive_current", size=size)
