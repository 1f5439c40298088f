# SPDX-License-Identifier: Apache-2.0
"""What the track does to a cradle that touches it: where that may be, and how far from its neighbours it can throw a
sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..core.model import Model
from ..core.state import ACCELERATIONS, FURTHER, GAPS, INDEX, RATES
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .local import MARGIN

#: Rolls (rad) at which the gaps are asked of the model; between them they are interpolated.
ROLLS = np.linspace(-1.0, 1.0, 81)
#: Step (m) of sway and heave, in which gaps are linear.
STEP = 1e-3


@dataclass(frozen=True)
class Touch:
    """Bounds of what contact does, and the gaps by place.

    - room: m, between the track above and that below no array moves further
    - speed: m/s, none crosses that room faster
    - acceleration: m/s², what the contact's spring and damper make of that speed
    - lever: m, arm of an array about the roll axis
    - closest: m, at a smaller gap the cradle may touch
    - gaps: by gap how it opens with sway and heave, and (81,) how large it is at `ROLLS` (m); empty where nothing can
      be touched"""

    room: float
    speed: float
    acceleration: float
    lever: float
    closest: float
    gaps: Mapping[str, tuple[float, float, Array]]

    @classmethod
    def of(cls, model: Model) -> Touch:
        """The bounds that a model's geometry, weight and contact give."""
        p = model.parameters
        room = 2.0 * float(np.sqrt(2.0)) * p["nominal_gap"]
        hardest = levels.HARDEST * p["gravity"]
        speed = float(np.sqrt(2.0 * hardest * room))
        stop = float(np.sqrt(p["contact_stiffness"] / p["mass"])) + p["contact_damping"] / p["mass"]
        lever = max(float(np.sqrt(0.5)) * p["magnet_side_offset"], 1e-3)
        gaps = _gaps(model) if p["contact_stiffness"] > 0.0 else {}
        return cls(room, speed, speed * stop + hardest, lever, levels.TOUCHING * p["nominal_gap"], gaps)

    def reach(self, channel: str, steps: Array) -> Array:
        """(m,) How far a sample can stand from where its neighbours, ``steps`` (m,) s apart, would have it."""
        scale = self.lever if channel.startswith("roll") else 1.0
        if channel in ACCELERATIONS:
            return np.full_like(steps, self.acceleration / scale)
        if channel in FURTHER:  # nobody knows what a blow does to it
            return np.full_like(steps, np.inf)
        if channel in RATES:
            return np.full_like(steps, 2.0 * self.speed / scale)
        return np.minimum(2.0 * self.speed * steps, np.inf if channel == "surge" else self.room) / scale

    def near(self, run: Run) -> NDArray[np.bool_]:
        """(n,) Whether the cradle may touch at a sample or beside it, by the gaps that are measured and those at the
        measured places.

        What is not measured is taken to be at its zero. A single sample, which may be the bad one, decides nothing.
        """
        smallest = np.full(len(run.times), np.inf)
        for gap, (by_sway, by_heave, by_roll) in self.gaps.items():
            sway, heave, roll = (run[c] if c in run.channels else 0.0 for c in ("sway", "heave", "roll"))
            place = by_sway * sway + by_heave * heave + np.interp(roll, ROLLS, by_roll)
            measured = [run[gap]] if gap in run.channels else []
            for opening in [place, *measured] if np.ndim(place) else measured:
                smallest = np.fmin(smallest, _towards(run.times, opening))
        return ndimage.minimum_filter1d(smallest, 2 * MARGIN + 1) < self.closest

    def calm(self, campaign: Campaign) -> Campaign:
        """The campaign without the samples at which the cradle may touch."""

        def apart(run: Run) -> Run:
            near = self.near(run)
            return replace(run, values=np.where(near[:, None], np.nan, run.values)) if near.any() else run

        return replace(campaign, runs=tuple(map(apart, campaign.runs)))


def _gaps(model: Model) -> dict[str, tuple[float, float, Array]]:
    """By gap its slopes along sway and heave, and its size at `ROLLS`."""

    def at(**place: float) -> dict[str, float]:
        x = np.zeros(8)
        for name, value in place.items():
            x[INDEX[name]] = value
        return model.quantities(x)

    rest, aside, up = at(), at(sway=STEP), at(heave=STEP)
    rolled = [at(roll=float(r)) for r in ROLLS]
    return {g: ((aside[g] - rest[g]) / STEP, (up[g] - rest[g]) / STEP, np.array([q[g] for q in rolled])) for g in GAPS}


def _towards(times: Array, opening: Array) -> Array:
    """(n,) A gap, less what it may close until the next sample; infinite where it is not known."""
    known = np.flatnonzero(~np.isnan(opening))
    result = np.full(len(times), np.inf)
    if len(known) > 2 * MARGIN:
        usual = ndimage.median_filter(opening[known], 5, mode="nearest")
        closing = np.abs(np.gradient(usual, times[known])) * np.gradient(times[known])
        result[known] = usual - ndimage.maximum_filter1d(closing, 5)
    return result
