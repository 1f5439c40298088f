# SPDX-License-Identifier: Apache-2.0
"""Another zero of heave: that of one run alone; that of the gap above, with its sign changed.

How much of the weight the model's lift carries at the measured places is a property of the rig, whatever its size:
what a run has alone is its own. Another zero of heave leaves sway and roll as they are; another load or weaker
magnets do not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from ..data import Campaign
from ..data.measurement import Array
from . import levels
from .balance import OVERLAP, SURE, Held, bad, hold, middle, stops
from .changes import Change, above
from .finding import IMPOSSIBLE, WARNING, Finding, quantity
from .room import room_of
from .windows import FEWEST, SWINGING


@dataclass(frozen=True)
class _Carried:
    """In each window of a run (w,) the model's lift over the lift that carries the cradle as measured, and the speed
    (m/s)."""

    parts: Array
    speeds: Array

    @property
    def usual(self) -> float:
        """Median of the parts."""
        return float(np.median(self.parts))

    def among(self, others: list[_Carried]) -> _Carried:
        """The windows whose speeds lie between those of the others."""
        reach = np.concatenate([other.speeds for other in others])
        rows = (self.speeds >= reach.min()) & (self.speeds <= reach.max())
        return _Carried(self.parts[rows], self.speeds[rows])

    def is_alone(self, others: list[_Carried]) -> bool:
        """Whether it surely is off, to one side of every other run, by more than what belongs may be."""
        if len(self.parts) < FEWEST:
            return False
        mine, error = middle(self.parts)
        theirs = [middle(other.parts) for other in others]
        sides = {np.sign(mine - part) for part, _ in theirs}
        sure = (abs(mine - part) > max(SURE * np.hypot(error, e), levels.GOOD) for part, e in theirs)
        return len(sides) == 1 and all(sure)


def zeros_apart(campaign: Campaign, held: Held) -> list[Finding]:
    """Findings about runs whose heave has a zero of its own, where most runs agree."""
    carried = _carried(held)
    usual = float(np.median([c.usual for c in carried.values()])) if carried else 0.0
    rest = [k for k, c in carried.items() if abs(c.usual - usual) < levels.GOOD]
    found = []
    for k in carried.keys() - rest:
        others = [carried[j] for j in rest if campaign.runs[j].conditions == campaign.runs[k].conditions]
        if len(others) < 2 or 2 * len(rest) <= len(carried) or not carried[k].is_alone(others):
            continue
        run = hold(held.windows.some(held.windows.run == k), held.model, held.reading)
        zero = _zero(run, float(np.median([c.usual for c in others])))
        if zero is not None:
            found.append(_finding(campaign, k, zero, run, carried[k].among(others).is_alone(others)))
    return found


def negative_gap(held: Held) -> Change | None:
    """Heave that is the gap above with a minus, where surely more of the lift is so explained; None where not.

    Such a heave rests where a cradle may rest and swings as one does: 5 mm under the middle are 5 mm over the track.
    How the lift grows with the heave and with the speed tells, which neither another size of the lift makes up for nor
    an aerodynamic one."""
    if "heave" not in held.windows.values or held.reading.zeros or held.reading.swapped or not stops(held.model):
        return None
    left, count = _unexplained(held), held.free.sum() / OVERLAP

    def surely_less(other: float) -> bool:
        return bool(count >= 1.0 and stats.f.sf(left / other, count, count) < 2.0 * stats.norm.sf(SURE))

    if not surely_less(held.noise("heave") ** 2):  # and no reading leaves less
        return None
    change = above(held.reading, held.model, -1.0)
    then = hold(held.windows, held.model, change.reading)
    belongs = then.misfits.get("heave", 2.0) < levels.GOOD and not bad(then.misfits)
    return change if belongs and surely_less(_unexplained(then)) else None


def _unexplained(held: Held) -> float:
    """Mean square of what carries the cradle besides the lift of the model in one size, and a force with the square of
    the speed; NaN where that is not known."""
    free, weight = held.free, held.weight
    lift, needed = held.should("heave") + weight, held.did("heave") + weight
    speed = np.median(held.motion.states["surge_rate"], axis=1)
    columns = np.stack([lift, weight * speed**2], axis=1)[free]
    square, product = columns.T @ columns, columns.T @ needed[free]
    if not np.isfinite(square).all() or np.linalg.matrix_rank(square) < len(square):
        return np.nan
    return float(np.mean((needed[free] - columns @ np.linalg.solve(square, product)) ** 2))


def _carried(held: Held) -> dict[int, _Carried]:
    """What carries each run of which enough windows are free, by its number."""
    lift, needed = held.should("heave") + held.weight, held.did("heave") + held.weight
    clear = held.free & (needed > 0.0)
    speeds = np.median(held.motion.states["surge_rate"], axis=1)
    rows = {int(k): clear & (held.windows.run == k) for k in np.unique(held.windows.run)}
    return {k: _Carried((lift / needed)[r], speeds[r]) for k, r in rows.items() if r.sum() >= FEWEST}


def _zero(run: Held, usual: float) -> float | None:
    """What a run's heave is too large by (m), so that without it the lift is the ``usual`` part and all belongs; None
    where nothing does it."""

    def read(zero: float) -> Held:
        return hold(run.windows, run.model, run.reading.plus("heave", -zero))

    def off(zero: float) -> float:
        then = read(zero)
        lift, needed = then.should("heave") + then.weight, then.did("heave") + then.weight
        return float(np.median(lift / needed)) - usual

    room = room_of(run.model)["heave"]
    if not off(-room) * off(room) < 0.0:
        return None
    zero = float(optimize.brentq(off, -room, room, xtol=1e-5))
    left = read(zero).misfits
    return zero if left.get("heave", 2.0) < levels.GOOD and not bad(left) else None


def _finding(campaign: Campaign, k: int, zero: float, run: Held, as_fast: bool) -> Finding:
    """The finding about a run's zero, which cannot be so where runs ``as_fast`` have none, and sway or roll swing more
    nearly as usual than with a lift of that size."""
    name, off = campaign.runs[k].name, quantity("heave", round(zero, 5))
    lift = _carried(run)[k].usual
    slopes = [s for c in SWINGING if c in run.coordinates and (s := run.slope(c)) is not None]
    swings = bool(slopes) and all(abs(log) < 0.5 * abs(np.log(lift)) for log, _ in slopes)
    text = (
        f"in {name} alone of {len(campaign.runs)} runs the zero of heave is off by about {off}: as it is"
        f" written the model's lift is {lift:.2g} times what carries the cradle, unlike in the others"
    )
    remedy = f"subtract {zero:.2g} m there, or leave the run out"
    remedy += "" if swings else "; or was its load another?"
    remedy += "" if as_fast else "; or does the lift change so with the speed?"
    severity = IMPOSSIBLE if swings and as_fast else WARNING
    return Finding("zero", severity, text, remedy, "heave", name, size={"zero": zero, "lift": lift, "runs": [name]})
