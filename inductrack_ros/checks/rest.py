# SPDX-License-Identifier: Apache-2.0
"""Samples before the cradle was let go and after it was caught: what held or caught it is in no model."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.state import GAPS
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, shared, spot
from .local import deviations, spread
from .noise_found import step_of
from .touch import Touch

#: Samples that are looked at for where the cradle stands, and that are away from there in a row once it moves.
STANDS = 3
#: From rest a steady force takes as long over a way as from there over three more, one that grows evenly 1.7 times as
#: long. What took so many times as long was held.
HELD = 4.0


def rest(campaign: Campaign, touch: Touch | None) -> list[Finding]:
    """Findings where runs stand still before they move, and where they are brought to rest and stay there. Where the
    drive changes in time, that is what may let them go; where they touch the track, its friction may stop them."""
    held = {run.name: np.arange(_held(run)) for run in campaign.runs if not run.pulses and not run.inputs}
    caught = {run.name: np.arange(len(run.times) - _caught(run, touch), len(run.times)) for run in campaign.runs}
    return [*_before(campaign, as_samples(held)), *_behind(campaign, as_samples(caught))]


def _before(campaign: Campaign, samples: Mapping[str, tuple[int, ...]]) -> list[Finding]:
    """A finding where runs begin at rest."""
    if not samples:
        return []
    run = next(r for r in campaign.runs if r.name in samples)
    count = len(samples[run.name])
    text = (
        f"{run.file.name} stands still for its first {count} samples, up to {spot(run, count - 1)} at"
        f" {run.times[count - 1]:.6g} s{_others(samples)}: nothing in a model holds it there, the run begins where it"
        " is let go"
    )
    return [Finding("rest", SET_ASIDE, text, samples=samples, size={"count": sum(map(len, samples.values()))})]


def _behind(campaign: Campaign, samples: Mapping[str, tuple[int, ...]]) -> list[Finding]:
    """A finding where runs end at rest."""
    if not samples:
        return []
    run = next(r for r in campaign.runs if r.name in samples)
    first = samples[run.name][0]
    text = (
        f"{run.file.name} is stopped and stands still to its end, from {spot(run, first)} at {run.times[first]:.6g} s"
        f" on{_others(samples)}: what catches a cradle is in no model, the run ends before it"
    )
    return [Finding("rest", SET_ASIDE, text, samples=samples, size={"count": sum(map(len, samples.values()))})]


def _others(samples: Mapping[str, tuple[int, ...]]) -> str:
    return f" (and so {shared(list(samples)[1:])})" if len(samples) > 1 else ""


def _held(run: Run) -> int:
    """How many samples of a run were taken before the cradle was let go."""
    times, values, channel = _travel(run)
    stood = _stood(times, values, channel)
    return 0 if stood is None else int(np.searchsorted(run.times, times[stood[0] - 1] - stood[1]))


def _caught(run: Run, touch: Touch | None) -> int:
    """How many samples of a run were taken after the cradle was caught.

    It stands, looked at backwards as at the beginning. Before that it was slowed down much harder than ever before,
    while it was clear of the track."""
    if touch is None or touch.gaps and not {"heave", *GAPS} & {*run.channels}:
        return 0
    times, values, channel = _travel(run)
    stood = _stood(run.times[-1] - times[::-1], values[::-1], channel)
    if stood is None:
        return 0
    last = len(times) - stood[0]  # the first known sample at rest
    if not np.nanmax(np.ptp(run.values[run.times >= times[last]], axis=0), initial=0.0):
        return 0  # a logger that hangs
    begins = _braked(times[: last + 1], values[: last + 1], channel)
    if begins is None or touch.near(run)[np.searchsorted(run.times, begins)]:
        return 0
    return int(np.count_nonzero(run.times >= begins))


def _braked(times: Array, values: Array, channel: str) -> float | None:
    """When it began that a cradle was slowed down until it stands at the last sample; None where it came to rest by
    itself: evenly, or as the drag of magnets takes its speed, 2.4 times as fast as in as long a time before."""
    if len(times) < levels.FEW:
        return None
    mean = np.diff(values) / np.diff(times) if channel == "surge" else values[1:]
    middle = 0.5 * (times[1:] + times[:-1])
    speeds = np.abs(np.convolve(mean, np.ones(STANDS) / STANDS, "same"))
    left = times[-1] - middle + 1e-9
    k = int(np.argmax(speeds**2 / left))  # a steady force makes it the largest where it sets in
    first = max(min(int(np.searchsorted(middle, middle[k] - left[k])), k - 2 * STANDS), 0)
    if k < levels.FEW or k - first < STANDS or speeds[k] < levels.MOVING:  # so few samples tell of no usual drag
        return None
    lost = abs(float(np.median(speeds[first : first + STANDS])) - speeds[k])
    before = lost / (middle[k] - middle[first])
    return float(times[k - STANDS // 2]) if speeds[k] > HELD * before * left[k] else None


def _travel(run: Run) -> tuple[Array, Array, str]:
    """Times and values of what tells where the cradle is along the track, or its speed, and which of the two it is."""
    channel = next((c for c in ("surge", "surge_rate") if c in run.channels), "")
    known = np.flatnonzero(~np.isnan(run[channel])) if channel else np.empty(0, np.intp)
    return run.times[known], run[channel][known] if channel else np.empty(0), channel


def _stood(times: Array, values: Array, channel: str) -> tuple[int, float] | None:
    """Of a cradle that stood still at first: its first sample that is away, and how long (s) it took to be well away;
    None where it did not stand."""
    if len(times) < levels.FEW:
        return None
    stands = float(np.median(values[:STANDS]))
    away = np.abs(values - stands)
    near = levels.sigmas(len(values)) * max(spread(deviations(times, values)), step_of(values), 1e-9)
    leaves, goes_on = (_stays_beyond(away, size) for size in (near, 4.0 * near))
    if channel == "surge_rate" and abs(stands) > near:  # it moves evenly
        return None
    if leaves is None or goes_on is None or leaves < STANDS or _speed(times, values, channel) < levels.MOVING:
        return None
    slowly = float(times[goes_on] - times[leaves])
    return None if times[leaves] - times[0] < HELD * slowly else (leaves, slowly)


def _stays_beyond(sizes: Array, limit: float) -> int | None:
    """The first sample from which on several in a row are larger than a limit."""
    inside = np.convolve(sizes <= limit, np.ones(STANDS), "valid")
    rows = np.flatnonzero(inside == 0)
    return int(rows[0]) if len(rows) else None


def _speed(times: Array, values: Array, channel: str) -> float:
    """The speed (m/s) that a tenth of the samples exceed."""
    speeds = np.diff(values) / np.diff(times) if channel == "surge" else values
    return float(np.quantile(np.abs(speeds), 0.9))
