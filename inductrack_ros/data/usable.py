"""Which runs of a campaign a model can be held against: those whose clock can be so, with more samples than freedom."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.errors import InputError
from ..core.model import Model
from ..core.state import MOVING, STATES
from .campaign import Campaign
from .measurement import Run

#: Steps (s) that no rig has between its samples, and that one has only if its file says that its time is in seconds.
LONGEST_STEP, SLOW_STEP = 600.0, 0.25
#: Fewer samples than this do not tell a slow logger from a wrong unit.
FEW = 20
#: A step of so many s and so many usual steps is no gap in a run.
JUMP, JUMP_STEPS = 10.0, 100.0
#: Measured values of a run for each of its free initial states, at least: with one for each anything fits.
VALUES_TO_A_STATE = 2


def usable(campaign: Campaign, model: Model) -> Campaign:
    """The campaign without the runs that hold too little for a verdict, which its notes name.

    Raises InputError where a clock cannot be meant in seconds or jumps, and where no run is left.
    """
    for run in campaign.runs:
        _require_a_clock(run)
    moving = MOVING[campaign.dof or model.dof]
    kept, remarks = [], list(campaign.remarks)
    for run in campaign.runs:
        free = [s for s in STATES if s.removesuffix("_rate") in moving and s not in run.initial_state]
        values = int(run.measured.sum())
        if values >= VALUES_TO_A_STATE * len(free):
            kept.append(run)
            continue
        remarks.append(
            f"{run.name} left out: {values} measured values say nothing beside {len(free)} free initial states; "
            "record longer, or give initial_state"
        )
    if not kept:
        raise InputError(f"{campaign.folder}: {remarks[-1].replace(' left out', '', 1)}")
    return replace(campaign, runs=tuple(kept), remarks=tuple(remarks))


def _require_a_clock(run: Run) -> None:
    steps = np.diff(run.times)
    usual, longest = float(np.median(steps)), float(steps.max())
    if usual >= LONGEST_STEP or (not run.seconds_stated and len(steps) >= FEW and usual >= SLOW_STEP):
        unit = next((u for u, f in (("ms", 1e3), ("µs", 1e6)) if usual / f < SLOW_STEP), "ns")
        right = "" if usual >= LONGEST_STEP else "; if it is right, name it 'time [s]'"
        raise InputError(
            f"{run.file}: time is in seconds: this run would last {run.duration:.6g} s with a sample every {usual:.4g} s; "
            f"if it was written in {unit}, name its column 'time [{unit}]'{right}"
        )
    if longest >= LONGEST_STEP or longest > JUMP and longest > JUMP_STEPS * usual:
        i = int(np.argmax(steps))
        raise InputError(
            f"{run.file}: the clock jumps by {longest:.6g} s between samples {i + 1} and {i + 2} of {len(run.times)}; "
            "correct the stamps, or make two runs of it"
        )
