# SPDX-License-Identifier: Apache-2.0
"""Do the channels belong to this model's motion at all? What the model's forces at the measured places would do to the
speeds, against what the speeds did, over short windows; and the gaps at those places against the gaps measured.

Nothing is fitted: a missing effect changes these sums by parts, a wrong unit or a flipped axis turns them over.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import stats

from ..core.model import Model
from ..core.parameters import PARAMETERS
from ..core.state import COORDINATES, GAPS, RATES
from ..data.measurement import Array
from . import levels
from .windows import CLEAR, FEWEST, PLACES, Reading, Windows

#: Two currents differ where they are so many standard errors apart, for they are two of many that are looked at. So
#: many neighbouring windows share samples.
SURE, OVERLAP = 6.0, 4
#: Nearer to the track than this part of the nominal gap a window is left out: contact is stiffer than the data are
#: fine.
CLOSE = 0.05
#: Deeper in the track than this part of the nominal gap, in half of the windows, nothing is that is read rightly.
DEEP = 0.5


@dataclass(frozen=True)
class Held:
    """Windows that are read in one way, held against the model: their motion, and the model's gaps and accelerations
    (w, p) by name at the measured places."""

    windows: Windows
    model: Model
    reading: Reading
    motion: _Motion
    places: Mapping[str, Array]

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Those that move and are measured."""
        return self.motion.coordinates

    def did(self, coordinate: str) -> Array:
        """(w,) How a coordinate's speed changed."""
        return self.motion.change(coordinate)

    def should(self, coordinate: str) -> Array:
        """(w,) How the model's forces at the measured places change it."""
        return _change(self.motion.times, self.places[f"{coordinate}_acceleration"])

    @property
    def weight(self) -> Array:
        """(w,) How the weight alone would change heave's speed."""
        return _change(self.motion.times, np.full_like(self.motion.times, self.model.parameters["gravity"]))

    @cached_property
    def nearest(self) -> Array:
        """(w,) The smallest gap in each window."""
        return np.min([self.places[g] for g in GAPS], axis=0).min(axis=1)

    @property
    def free(self) -> Array:
        """(w,) Where nothing touches."""
        touches = self.model.parameters["contact_stiffness"] > 0.0
        return self.nearest > CLOSE * self.model.parameters["nominal_gap"] if touches else self.nearest == self.nearest

    def slope(self, coordinate: str) -> tuple[float, float] | None:
        """The logarithm of the slope, within runs, of what a speed did on what it should have done, and its standard
        error; None where it is not surely above 0."""
        free = self.free
        if free.sum() < FEWEST:
            return None
        run = self.windows.run[free]
        did, should = (_within(y[free], run) for y in (self.did(coordinate), self.should(coordinate)))
        if not (size := float(should @ should)):
            return None
        slope = float(did @ should) / size
        error = float(np.sqrt(OVERLAP * np.mean((did - slope * should) ** 2) / size))
        return (float(np.log(slope)), error / slope) if slope > SURE * error else None

    @cached_property
    def misfits(self) -> dict[str, float]:
        """By coordinate and gap how far data and model are apart: 0 is the same, 1 nothing in common, infinite what
        cannot be.

        Absent is what the data are too noisy, too near to the track or too few to say."""
        if stops(self.model) and np.median(self.nearest) < -DEEP * self.model.parameters["nominal_gap"]:
            return dict.fromkeys((c for c in self.coordinates if c != "surge"), np.inf)
        found, free, driven = {}, self.free, self.windows.current != 0.0
        for c in self.coordinates:
            if c == "surge" and self.windows.pulsed:
                continue
            # Runs that coast say nothing of the drive, and are not to hide it.
            groups = (free & driven, free & ~driven) if c == "surge" else (free,)
            off = [f for rows in groups if rows.sum() >= FEWEST and (f := self._off(c, rows)) is not None]
            if off:
                found[c] = max(off)
        return found | self._gap_misfits()

    def noise(self, coordinate: str) -> float:
        """Standard deviation of `did` by the noise of what is measured."""
        sensor = self.windows.noise.get(self.reading.source(coordinate), self.windows.noise.get("gap_top", 0.0))
        return 2.4 * abs(self.reading.of(coordinate)) * sensor / float(np.median(self.motion.times[:, -1]))

    def _off(self, coordinate: str, rows: Array) -> float | None:
        """How far a coordinate's changes of speed in some windows are from what they should be; None where neither
        stands over the noise."""
        did, should = self.did(coordinate)[rows], self.should(coordinate)[rows]
        size = max(np.median(np.abs(did)), np.median(np.abs(should)), self._ground(coordinate))
        return float(np.median(np.abs(did - should)) / size) if size > CLEAR * self.noise(coordinate) else None

    def _ground(self, coordinate: str) -> float:
        """Change of speed by forces that stand against each other, of whose sum a few percent more or less mean
        nothing: weight; half the drag."""
        if coordinate == "heave":
            return float(np.median(self.weight))
        if coordinate == "surge":
            drag = 0.5 * self.places["magnetic_drag"] / self.model.parameters["mass"]
            return float(np.median(_change(self.motion.times, drag)))
        return 0.0

    def _gap_misfits(self) -> dict[str, float]:
        """By measured gap how far it is from the gap at the measured place, up to a constant: a sensor's zero is its
        own."""
        measured = [g for g in GAPS if g in self.windows.values]
        if not {"sway", "heave", "roll"} <= self.windows.values.keys():
            return {}
        found = {}
        for g in measured:
            did, should = self.reading.values(self.windows, g), self.places[g]
            off = np.median(did - should)
            size = np.hypot(*(np.median(np.abs(y - np.median(y))) for y in (did, should)))
            noise = abs(self.reading.of(g)) * self.windows.noise[g]
            if abs(off) > 20 * self.model.parameters["nominal_gap"]:
                found[g] = np.inf
            elif size > CLEAR * noise:
                found[g] = float(np.median(np.abs(did - should - off)) / size)
        return found


def hold(windows: Windows, model: Model, reading: Reading) -> Held:
    """The windows, read so, held against the model."""
    motion = _motion(windows, model, reading)
    return Held(windows, model, reading, motion, _evaluate(windows, model, reading, motion))


def misfits(windows: Windows, model: Model, reading: Reading) -> dict[str, float]:
    """How far the windows, read so, and the model are apart: `Held.misfits`."""
    return hold(windows, model, reading).misfits


def needed_factor(windows: Windows, model: Model) -> float | None:
    """What the drive current must be multiplied by so that surge changes its speed as measured; None where the windows
    do not show it, for what each of them says scatters too widely to tell the factor from 1."""
    current = needed_currents(windows, model)
    if current is None:
        return None
    known = ~np.isnan(current) & (windows.current != 0.0)
    if known.sum() < FEWEST:
        return None
    factor, error = middle(current[known] / windows.current[known])
    return factor or None if abs(factor - 1.0) > SURE * error else None


def needed_currents(windows: Windows, model: Model) -> Array | None:
    """(w,) The drive current (A) that changes surge's speed as measured in each window, NaN where a current does
    nothing; None where surge is not measured."""
    motion = _motion(windows, model, Reading())
    if "surge" not in motion.coordinates:
        return None
    one = replace(windows, current=np.ones_like(windows.current))
    none, ampere = (
        _change(motion.times, _evaluate(one, model, Reading(current=k), motion)["surge_acceleration"])
        for k in (0.0, 1.0)
    )
    does = ampere != none
    lacks = motion.change("surge") - none
    return np.divide(lacks, ampere - none, out=np.full(len(lacks), np.nan), where=does)


def middle(values: Array) -> tuple[float, float]:
    """Median over windows, and its standard error: also forces that the model lacks make windows differ."""
    median = float(np.median(values))
    scatter = float(np.median(np.abs(values - median)) / stats.norm.ppf(0.75))
    return median, scatter * float(np.sqrt(0.5 * np.pi * OVERLAP / len(values)))


@dataclass(frozen=True)
class _Motion:
    """The windows as they are read: times (w, p) and states by name (w, p); ``coordinates`` are those that move and are
    measured."""

    times: Array
    states: Mapping[str, Array]
    coordinates: tuple[str, ...]

    def change(self, coordinate: str) -> Array:
        """(w,) Mean speed of a coordinate over a window's second half minus that over its first."""
        x, t, m = self.states[coordinate], self.times, PLACES // 2
        return (x[:, -1] - x[:, m]) / t[:, -1] - (x[:, m] - x[:, 0]) / -t[:, 0]


def _motion(windows: Windows, model: Model, reading: Reading) -> _Motion:
    times = windows.times * reading.time
    states = {c: reading.values(windows, c) for c in windows.values if c in COORDINATES}
    if "heave" not in states:
        states |= _by_gaps(windows, model, reading, states)
    if "surge" in states:
        x, m = states["surge"], PLACES // 2
        speed = (x[:, -1] - x[:, 0]) / (times[:, -1] - times[:, 0])
        bend = ((x[:, -1] - x[:, m]) / times[:, -1] - (x[:, m] - x[:, 0]) / -times[:, 0]) / times[:, -1]
        states["surge_rate"] = speed[:, None] + bend[:, None] * times
    else:
        states["surge_rate"] = reading.values(windows, "surge_rate")
    return _Motion(times, states, tuple(c for c in COORDINATES if c in states))


def _by_gaps(windows: Windows, model: Model, reading: Reading, states: Mapping[str, Array]) -> dict[str, Array]:
    """Heave, and where both side gaps are there sway too, from the gaps, at the roll that is measured (or none)."""
    rest = model.quantities(np.zeros(8))
    names = [g for g in GAPS if g in windows.values]
    slopes = {
        c: np.array([(model.quantities(1e-6 * np.eye(8)[k])[g] - rest[g]) / 1e-6 for g in names])
        for k, c in enumerate(COORDINATES)
    }
    wanted = ["heave", "sway"] if {"gap_right", "gap_left"} <= set(names) else ["heave"]
    opened = np.stack([reading.values(windows, g) - rest[g] for g in names])
    if "roll" in states:
        opened = opened - slopes["roll"][:, None, None] * states["roll"]
    solved = np.tensordot(np.linalg.pinv(np.stack([slopes[c] for c in wanted], axis=1)), opened, axes=1)
    return dict(zip(wanted, solved, strict=True))


def _evaluate(windows: Windows, model: Model, reading: Reading, motion: _Motion) -> dict[str, Array]:
    """Gaps and accelerations (w, p) of the model at the places of all windows."""
    order = [*COORDINATES, *RATES]
    wanted = [*GAPS, "magnetic_drag", *(f"{c}_acceleration" for c in COORDINATES)]
    shape = motion.times.shape
    result = np.empty((len(wanted), *shape))
    state = np.zeros((8, *shape))
    for k, name in enumerate(order):
        if name in motion.states:
            state[k] = motion.states[name]
    current = reading.current * windows.current
    models = [_under(model, given) for given in windows.conditions]
    with np.errstate(all="ignore"):
        for i in range(shape[0]):
            mine = models[windows.run[i]] if models else model
            for j in range(shape[1]):
                q = mine.quantities(state[:, i, j], drive_current=float(current[i]))
                result[:, i, j] = [q[name] for name in wanted]
    return dict(zip(wanted, np.nan_to_num(result, nan=1e30, posinf=1e30, neginf=-1e30).clip(-1e30, 1e30), strict=True))


def _under(model: Model, conditions: Mapping[str, float]) -> Model:
    """The model under the conditions of a run."""
    taken = {name: value for name, value in conditions.items() if name in model.kernel.parameters}
    if not taken:
        return model
    own = {name: taken.pop(name) for name in PARAMETERS if name in taken}
    return model.with_changes(own, conditions={**model.conditions, **taken})


def _change(times: Array, acceleration: Array) -> Array:
    """(w,) What `_Motion.change` is under an acceleration (w, p): its mean weighted by a triangle."""
    m = PLACES // 2
    weight = np.where(times > 0, 1 - times / times[:, -1:], 1 - times / times[:, :1])
    step = np.diff(times, axis=1)
    y = weight * acceleration
    assert times.shape[1] == 2 * m + 1
    return (0.5 * (y[:, 1:] + y[:, :-1]) * step).sum(axis=1)


def _within(values: Array, group: Array) -> Array:
    """(w,) Values without the mean of their group."""
    return values - (np.bincount(group, values) / np.maximum(np.bincount(group), 1))[group]


def stops(model: Model) -> bool:
    """Whether a track that repels and stops the cradle is there at all: other plants are written as this model without
    magnets or contact."""
    return (
        model.parameters["contact_stiffness"] > 0.0
        and max(model.parameters["width_top"], model.parameters["width_side"]) > 0.0
    )


def bad(found: Mapping[str, float]) -> list[str]:
    """Channels that do not belong to the model's motion."""
    return [c for c, f in found.items() if f > (levels.BAD_SURGE if c == "surge" else levels.BAD)]


def total(found: Mapping[str, float], among: Iterable[str]) -> float:
    """How far the channels are off in all; one that says nothing counts as half off."""
    return float(sum(min(found.get(c, 0.5), 2.0) ** 2 for c in among))
