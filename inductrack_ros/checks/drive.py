# SPDX-License-Identifier: Apache-2.0
"""Drive pulses that fired and are not in the bag: from the first of them on nobody knows what drove the cradle."""

from __future__ import annotations

import numpy as np

from ..data import Campaign, Run
from . import levels
from .finding import IMPOSSIBLE, SET_ASIDE, Finding

_REMEDY = "record again with nothing else to do for the machine, or with the simulator in lockstep"


def lost_pulses(campaign: Campaign) -> list[Finding]:
    """A finding for each run whose pulses are counted and where some counts are missing (`Run.pulse_counts`)."""
    found = [(run, *lost) for run in campaign.runs if (lost := _lost(run))]
    useless = [run for run, _, rows in found if len(run.times) - len(rows) < levels.FEW]
    severity = IMPOSSIBLE if len(useless) == len(campaign.runs) else SET_ASIDE
    return [
        Finding(
            "lost_pulses",
            severity,
            text if run not in useless else f"{text}: too little of the run is left",
            _REMEDY,
            run=run.name,
            samples={} if run in useless else {run.name: rows},
            size={"count": len(rows)},
        )
        for run, text, rows in found
    ]


def _lost(run: Run) -> tuple[str, tuple[int, ...]] | None:
    """What is missing in a run, and the numbers of its samples from there on."""
    if run.pulses is None or run.pulse_counts is None:
        return None
    missing = np.diff(run.pulse_counts) - 1
    gaps = np.flatnonzero(missing > 0)
    if not len(gaps):
        return None
    last = run.pulses.times[gaps[0]]
    rows = np.flatnonzero(run.times > last)
    lost = int(missing[gaps].sum())
    text = (
        f"{run.file.name}: {lost} of {len(missing) + 1 + lost} pulses that fired are not in the bag, the first after"
        f" {last:.6g} s: what drove the cradle from there on is not known"
    )
    return (text, tuple(rows.tolist())) if len(rows) else None
