# SPDX-License-Identifier: Apache-2.0
"""A clock that runs at another rate: by which one factor on time does all that swings do so as the forces say?

What the speeds did over what they should have done has a slope of 1 in each coordinate, whatever its sensor's scale:
the force back grows as the way out. A factor on time divides all these slopes by its square. So does a lift of another
size, but that does not carry the weight then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from . import levels
from .balance import SURE, Held, hold
from .changes import Change
from .units import TIMES

#: Coordinates that swing, of which so many at least have to agree.
SWING, AGREE = ("sway", "heave", "roll"), 2
#: Speeds change with the clock, and the forces with them: the factor is found in so many steps at most.
STEPS = 12


def at_its_rate(held: Held) -> Held | None:
    """The windows with the one factor on time that makes all channels belong; None where none does, or the slopes are
    off by no more than a sensor's scale may be."""
    now = held
    for _ in range(STEPS):
        slope = _one_slope(now)
        if slope is None or (now is held and abs(slope[0]) < 2.0 * np.log(levels.SCALE)):
            return None
        log, error = slope
        if abs(log) <= error:
            break
        now = hold(held.windows, held.model, replace(now.reading, time=now.reading.time * float(np.exp(0.5 * log))))
    left = now.misfits
    return now if "heave" in left and max(left.values()) < levels.GOOD else None


def clock(before: Held, after: Held) -> Change:
    """The change of time from one to the other, with its unit where it is one."""
    factor = after.reading.time / before.reading.time
    unit = next((unit for seconds, unit in TIMES if abs(np.log(factor / seconds)) < np.log(levels.EXACTLY)), "")
    return Change("unit" if unit else "rate", ("time",), after.reading, unit)


def _one_slope(held: Held) -> tuple[float, float] | None:
    """The logarithm of the slope that the coordinates which swing clearly share, and its standard error; None where
    fewer than `AGREE` do, or they differ by more than their errors and than a sensor's scale may be."""
    known = [s for c in SWING if c in held.coordinates and (s := held.slope(c)) is not None]
    if len(known) < AGREE:
        return None
    logs, errors = np.array(known).T
    weights = errors**-2.0
    mean = float(weights @ logs / weights.sum())
    agree = np.abs(logs - mean) < np.maximum(SURE * errors, np.log(levels.SCALE))
    return (mean, float(weights.sum() ** -0.5)) if agree.all() else None
