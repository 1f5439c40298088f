# SPDX-License-Identifier: Apache-2.0
"""A drive current that was measured in time: readings that are none, and parts of a run without any."""

from __future__ import annotations

import numpy as np

from ..data import Campaign, Run
from . import levels
from .finding import IMPOSSIBLE, WARNING, Finding, number

#: A part of a run without a reading is said from this part of the run on.
PART = 0.05


def measured_current(campaign: Campaign) -> list[Finding]:
    """Findings about the readings of every run's drive current; alike ones of several runs once."""
    found = [f for run in campaign.runs if "drive_current" in run.inputs for f in (*_fillers(run), *_unknown(run))]
    first = {f.kind: f for f in reversed(found)}
    return [f for f in found if f is first[f.kind]]


def _fillers(run: Run) -> list[Finding]:
    """Readings that stand for none, away from all the rest: between samples the drive would follow them."""
    times, readings = run.inputs["drive_current"]
    filler = np.isin(readings, levels.FILLERS)
    rest = readings[~filler]
    if not filler.any() or not len(rest):
        return []
    low, high = float(rest.min()), float(rest.max())
    apart = filler & ((readings > 2.0 * high - low) | (readings < 2.0 * low - high))
    if not apart.any():
        return []
    k = int(np.argmax(apart))
    text = (
        f"drive_current as measured in {run.name} is {number(float(readings[k]), 6)} A at {number(float(times[k]))} s"
        f" ({int(apart.sum())} such), while the rest lies between {number(low)} and {number(high)} A: a filler for what"
        " was not measured"
    )
    size = {"count": int(apart.sum()), "value": float(readings[k])}
    return [Finding("fillers", IMPOSSIBLE, text, "leave such cells empty", "drive_current", run.name, size=size)]


def _unknown(run: Run) -> list[Finding]:
    """The longest part of a run in which no current was measured."""
    times = run.inputs["drive_current"][0]
    edges = np.concatenate([[0.0], np.clip(times, 0.0, run.duration), [run.duration]])
    k = int(np.argmax(np.diff(edges)))
    start, end = float(edges[k]), float(edges[k + 1])
    if not end - start > PART * run.duration:
        return []
    taken = "the first reading" if k == 0 else "the last reading" if k == len(times) else "a straight line between two"
    text = (
        f"drive_current of {run.name} was not measured from {number(start)} to {number(end)} s: {taken} is taken there"
    )
    remedy = "cut the run to where its current is known, or give drive_current in campaign.yaml"
    size = {"from": start, "to": end}
    return [Finding("hole", WARNING, text, remedy, "drive_current", run.name, size=size)]
