# SPDX-License-Identifier: Apache-2.0
"""Clocks that are set while a run is recorded, by less than a hole is long: the travel goes on as in one usual step.

And stamps of one sensor that nearly stand still, for their fractions of a second are in another unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..data import Run
from ..data.measurement import Array
from . import levels
from .finding import IMPOSSIBLE, Finding, number, shared, spot

#: Steps around the one that is looked at, over which stamps that were only late make up for it, and beside these, from
#: which the speed is taken.
AROUND, BESIDE = 4, 8
#: A step is another one from this part on, and a run of which so large a part is another has uneven stamps.
OTHER, MANY = 0.5, 0.1
#: The travel lacks what the clock gained to this part, and the speeds before and behind are alike to it.
SAME = 0.25
#: What is lacked is so many times what the travel scatters by.
CLEAR = 10.0


def was_set(run: Run) -> Finding | None:
    """The first place where the clock was set by a few steps while the cradle went on; None where there is none."""
    if "surge" not in run.channels:
        return None
    times, travel = run.samples("surge")
    reach = AROUND + BESIDE
    steps = np.diff(times)
    if len(steps) < 2 * reach + levels.FEW:
        return None
    usual = float(np.median(steps))
    other = np.flatnonzero((np.abs(steps - usual) > OTHER * usual) & (steps <= levels.HOLE * usual))
    if len(other) > MANY * len(steps):
        return None
    other = other[(other >= reach) & (other < len(steps) - reach)]
    gained = steps[other] - usual
    speed, apart, scatter = _speed_beside(times, travel, other)
    lacked = speed * _across(times, other) - _across(travel, other)
    expected = speed * gained
    told = (np.abs(lacked - expected) < SAME * np.abs(expected)) & (np.abs(expected) > CLEAR * scatter)
    told &= apart < SAME * np.abs(speed)
    if not told.any():
        return None
    k = int(np.argmax(told))
    known = np.flatnonzero(~np.isnan(run["surge"]))
    how = "ahead" if gained[k] > 0.0 else "back"
    text = (
        f"the clock of {run.file.name} jumps {how} by {number(1e3 * abs(gained[k]))} ms at"
        f" {spot(run, int(known[other[k] + 1]))}, while the cradle went on as from one sample to the next"
    )
    remedy = "take the jump out of the later stamps, or record with a clock that is not set meanwhile"
    size = {"jump": float(gained[k]), "sample": int(known[other[k] + 1])}
    return Finding("clock_jump", IMPOSSIBLE, text, remedy, run=run.name, size=size)


def _across(values: Array, steps: NDArray[np.intp]) -> Array:
    """(m,) By how much values change over the stretch around each step."""
    return values[steps + AROUND + 1] - values[steps - AROUND]


def _speed_beside(times: Array, travel: Array, steps: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """(m,) each: the mean speed before and behind the stretch around each step, how far apart the two are, and by how
    much the travel beside it scatters about them."""
    speeds, left = [], []
    for first in (-AROUND - BESIDE, AROUND + 1):
        rows = steps[:, None] + np.arange(first, first + BESIDE + 1)
        t, x = times[rows], travel[rows]
        t = t - t.mean(axis=1, keepdims=True)
        x = x - x.mean(axis=1, keepdims=True)
        speed = (t * x).sum(axis=1) / (t * t).sum(axis=1)
        speeds.append(speed)
        left.append(np.std(x - speed[:, None] * t, axis=1))
    return 0.5 * (speeds[0] + speeds[1]), np.abs(speeds[1] - speeds[0]), np.hypot(*left)


def stand_still(run: Run) -> Finding | None:
    """A sensor whose stamps follow each other in next to no time, and then none come for long."""
    for channel in run.channels:
        times = run.samples(channel)[0]
        if len(times) < levels.FEW:
            continue
        usual, mean = float(np.median(np.diff(times))), float(times[-1] - times[0]) / (len(times) - 1)
        if usual * levels.SPLIT >= mean:
            continue
        alike = [c for c in run.channels if len(t := run.samples(c)[0]) == len(times) and (t == times).all()]
        text = (
            f"{shared(alike)} in {run.file.name} are stamped {number(1e6 * usual)} µs apart, then none for long: one"
            f" comes every {number(1e3 * mean)} ms on average"
        )
        remedy = "look at the sensor's header stamps: does nanosec hold microseconds or milliseconds?"
        size = {"step": usual, "mean": mean, "channels": alike}
        return Finding("time_unit", IMPOSSIBLE, text, remedy, run=run.name, size=size)
    return None
