# SPDX-License-Identifier: Apache-2.0
"""Samples at the beginning of a run that were taken before the cradle was let go: what held it is in no model."""

from __future__ import annotations

import numpy as np

from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, shared, spot
from .local import deviations, spread
from .noise_found import step_of

#: Samples that are looked at for where the cradle stands, and that are away from there in a row once it moves.
STANDS = 3
#: From rest a steady force takes as long over a way as from there over three more, one that grows evenly 1.7 times as
#: long. What took so many times as long was held.
HELD = 4.0


def rest(campaign: Campaign) -> list[Finding]:
    """A finding where runs stand still before they move. Where the drive changes in time, that is what may let them
    go."""
    held = {run.name: np.arange(_held(run)) for run in campaign.runs if not run.pulses and not run.inputs}
    samples = as_samples(held)
    if not samples:
        return []
    run = next(r for r in campaign.runs if r.name in samples)
    count = len(samples[run.name])
    more = f" (and so {shared(list(samples)[1:])})" if len(samples) > 1 else ""
    text = (
        f"{run.file.name} stands still for its first {count} samples, up to {spot(run, count - 1)} at"
        f" {run.times[count - 1]:.6g} s{more}: nothing in a model holds it there, the run begins where it is let go"
    )
    return [Finding("rest", SET_ASIDE, text, samples=samples, size={"count": sum(map(len, samples.values()))})]


def _held(run: Run) -> int:
    """How many samples of a run were taken before the cradle was let go."""
    travel = next((c for c in ("surge", "surge_rate") if c in run.channels), None)
    known = np.flatnonzero(~np.isnan(run[travel])) if travel else np.empty(0, np.intp)
    if travel is None or len(known) < levels.FEW:
        return 0
    times, values = run.times[known], run[travel][known]
    stands = float(np.median(values[:STANDS]))
    away = np.abs(values - stands)
    near = levels.sigmas(len(values)) * max(spread(deviations(times, values)), step_of(values), 1e-9)
    leaves, goes_on = (_stays_beyond(away, size) for size in (near, 4.0 * near))
    if travel == "surge_rate" and abs(stands) > near:  # it moves evenly
        return 0
    if leaves is None or goes_on is None or leaves < STANDS or _speed(times, values, travel) < levels.MOVING:
        return 0
    slowly = times[goes_on] - times[leaves]
    if times[leaves] - times[0] < HELD * slowly:
        return 0
    return int(np.searchsorted(run.times, times[leaves - 1] - slowly))


def _stays_beyond(sizes: Array, limit: float) -> int | None:
    """The first sample from which on several in a row are larger than a limit."""
    inside = np.convolve(sizes <= limit, np.ones(STANDS), "valid")
    rows = np.flatnonzero(inside == 0)
    return int(rows[0]) if len(rows) else None


def _speed(times: Array, values: Array, channel: str) -> float:
    """The speed (m/s) that a tenth of the samples exceed."""
    speeds = np.diff(values) / np.diff(times) if channel == "surge" else values
    return float(np.quantile(np.abs(speeds), 0.9))
