# SPDX-License-Identifier: Apache-2.0
"""Do the channels belong to this model's motion at all? What the model's forces at the measured places would do to the
speeds, against what the speeds did, over short windows; and the gaps at those places against the gaps measured.

Nothing is fitted: a missing effect changes these sums by parts, a wrong unit or a flipped axis turns them over.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from ..core.model import Model
from ..core.state import COORDINATES, GAPS, RATES
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .noise_found import Channel

#: Windows in all and at least, places in each where the model is asked, and half lengths (samples) that are tried.
WINDOWS, FEWEST, PLACES, HALVES = 160, 8, 9, (4, 8, 16, 32, 64)
#: The change of speed over a window is to be this many times its noise.
CLEAR = 8.0
#: Two currents differ where they are so many standard errors apart, for they are two of many that are looked at. So
#: many neighbouring windows share samples.
SURE, OVERLAP = 6.0, 4
#: Coordinates whose swing decides how long a window is: heave has its weight besides, surge goes on.
SWINGING = ("sway", "roll")
#: Nearer to the track than this part of the nominal gap a window is left out: contact is stiffer than the data are
#: fine.
CLOSE = 0.05
#: Deeper in the track than this part of the nominal gap, in half of the windows, nothing is that is read rightly.
DEEP = 0.5


@dataclass(frozen=True)
class Reading:
    """How the data are read: what their time, their drive current and each channel is multiplied by; two channels that
    change places."""

    time: float = 1.0
    current: float = 1.0
    channels: Mapping[str, float] = field(default_factory=dict)
    swapped: tuple[str, ...] = ()

    def of(self, channel: str) -> float:
        """The factor of a channel."""
        return self.channels.get(channel, 1.0)

    def source(self, channel: str) -> str:
        """The column in which a channel stands."""
        return self.swapped[1 - self.swapped.index(channel)] if channel in self.swapped else channel

    def times(self, channel: str, factor: float) -> Reading:
        """The same with one channel multiplied."""
        return replace(self, channels={**self.channels, channel: factor * self.of(channel)})


@dataclass(frozen=True)
class Windows:
    """Windows of all runs: times (w, p) from each window's middle, channels (w, p) by name, drive current (w,), None
    where pulses drive."""

    times: Array
    values: Mapping[str, Array]
    current: Array
    pulsed: bool
    noise: Mapping[str, float]


def windows_of(campaign: Campaign, channels: Mapping[str, Channel], most: int = WINDOWS) -> Windows | None:
    """About ``most`` windows spread over the campaign; None where the runs are too short or do not tell place and
    speed."""
    stated = all("surge_rate" in run.initial_state for run in campaign.runs)
    if not ({"heave", "gap_top"} & channels.keys()) or not (stated or {"surge", "surge_rate"} & channels.keys()):
        return None
    names = [c for c in (*COORDINATES, "surge_rate", *GAPS) if all(c in run.channels for run in campaign.runs)]
    names = [c for c in names if c in channels]
    if not {"heave", "gap_top"} & set(names):  # measured in some runs only
        return None
    half = _half(campaign, channels, [c for c in names if c in SWINGING])
    cut = [_cut(run, names, half, -(-most // len(campaign.runs))) for run in campaign.runs]
    parts = [p for p in cut if p is not None]
    if not parts or sum(len(p[0]) for p in parts) < FEWEST:
        return None
    times = np.concatenate([p[0] for p in parts])
    table = np.concatenate([p[1] for p in parts])
    current = np.concatenate([p[2] for p in parts])
    values = {c: table[:, :, k] for k, c in enumerate(names)}
    if not {"surge", "surge_rate"} & values.keys():
        if not stated:
            return None
        values["surge_rate"] = np.repeat(
            [run.initial_state["surge_rate"] for run, p in zip(campaign.runs, cut, strict=True) if p for _ in p[0]],
            PLACES,
        ).reshape(times.shape)
    noise = {c: channels[c].scatter for c in names}
    return Windows(times, values, current, any(run.pulses is not None for run in campaign.runs), noise)


def _half(campaign: Campaign, channels: Mapping[str, Channel], names: list[str]) -> int:
    """Half length of the windows: long enough that the bend of what swings stands over its noise, where any length
    does."""
    shortest = min(len(run.times) for run in campaign.runs)
    fitting = [h for h in HALVES if 2 * h + 1 <= shortest // 3] or HALVES[:1]
    for half in fitting:
        bends = {c: [_bend(run[c], half) for run in campaign.runs if c in run.channels] for c in names}
        known = {c: (y := np.abs(np.concatenate(b)))[~np.isnan(y)] for c, b in bends.items() if b}
        sizes = {c: float(np.median(y)) for c, y in known.items() if len(y)}
        if all(size > CLEAR * 2.4 * channels[c].scatter for c, size in sizes.items()):
            return half
    return fitting[-1]


def _bend(values: Array, half: int) -> Array:
    """Second differences over ``half`` samples, of at most a few thousand places."""
    values = values[:20_000]
    return values[2 * half :] - 2 * values[half:-half] + values[: -2 * half]


def _cut(run: Run, names: list[str], half: int, most: int) -> tuple[Array, Array, Array] | None:
    """Times (w, p), values (w, p, c) and current (w,) of up to ``most`` windows of a run, where nothing is missing."""
    last = len(run.times) - 1 - 2 * half
    if last < 0:
        return None
    first = np.unique(np.linspace(0, last, min(2 * last // half + 1, most)).astype(int))
    rows = first[:, None] + np.arange(PLACES) * (2 * half // (PLACES - 1))
    columns = [run.channels.index(c) for c in names]
    times, values = run.times[rows], run.values[rows][:, :, columns]
    width = times[:, -1] - times[:, 0]
    good = ~np.isnan(values).any(axis=(1, 2)) & (width < 1.5 * np.median(width))
    middle = times[:, PLACES // 2]
    current = (
        np.interp(middle, *run.inputs["drive_current"])
        if "drive_current" in run.inputs
        else np.full(len(middle), run.drive_current)
    )
    return (times - middle[:, None])[good], values[good], current[good]


def misfits(windows: Windows, model: Model, reading: Reading) -> dict[str, float]:
    """By coordinate and gap how far data, read so, and model are apart: 0 is the same, 1 nothing in common, infinite
    what cannot be.

    Absent is what the data are too noisy, too near to the track or too few to say.
    """
    motion = _motion(windows, model, reading)
    places = _evaluate(windows, model, reading, motion)
    nearest = np.min([places[g] for g in GAPS], axis=0).min(axis=1)
    nominal = model.parameters["nominal_gap"]
    free = nearest > CLOSE * nominal if model.parameters["contact_stiffness"] > 0.0 else np.ones(len(nearest), bool)
    if stops(model) and np.median(nearest) < -DEEP * nominal:
        return dict.fromkeys((c for c in motion.coordinates if c != "surge"), np.inf)
    found = {}
    driven = windows.current != 0.0
    for c in motion.coordinates:
        if c == "surge" and windows.pulsed:
            continue
        # Runs that coast say nothing of the drive, and are not to hide it.
        groups = (free & driven, free & ~driven) if c == "surge" else (free,)
        off = [
            f
            for rows in groups
            if rows.sum() >= FEWEST and (f := _off(c, windows, model, reading, motion, places, rows)) is not None
        ]
        if off:
            found[c] = max(off)
    found |= _gap_misfits(windows, reading, places, nominal)
    return found


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


def _off(
    c: str, windows: Windows, model: Model, reading: Reading, motion: _Motion, places: Mapping[str, Array], rows: Array
) -> float | None:
    """How far a coordinate's changes of speed in some windows are from what they should be; None where neither stands
    over the noise."""
    did, should = motion.change(c)[rows], _change(motion.times, places[f"{c}_acceleration"])[rows]
    noise = (
        2.4
        * abs(reading.of(c))
        * windows.noise.get(reading.source(c), windows.noise.get("gap_top", 0.0))
        / float(np.median(motion.times[:, -1]))
    )
    size = max(np.median(np.abs(did)), np.median(np.abs(should)), _ground(c, model, motion, places))
    return float(np.median(np.abs(did - should)) / size) if size > CLEAR * noise else None


def _ground(coordinate: str, model: Model, motion: _Motion, places: Mapping[str, Array]) -> float:
    """Change of speed by forces that stand against each other, of whose sum a few percent more or less mean nothing:
    weight; half the drag."""
    if coordinate == "heave":
        force = np.full_like(motion.times, model.parameters["gravity"])
    elif coordinate == "surge":
        force = 0.5 * places["magnetic_drag"] / model.parameters["mass"]
    else:
        return 0.0
    return float(np.median(_change(motion.times, force)))


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
    states = {c: reading.of(c) * windows.values[reading.source(c)] for c in windows.values if c in COORDINATES}
    if "heave" not in states:
        states |= _by_gaps(windows, model, reading, states)
    if "surge" in states:
        x, m = states["surge"], PLACES // 2
        speed = (x[:, -1] - x[:, 0]) / (times[:, -1] - times[:, 0])
        bend = ((x[:, -1] - x[:, m]) / times[:, -1] - (x[:, m] - x[:, 0]) / -times[:, 0]) / times[:, -1]
        states["surge_rate"] = speed[:, None] + bend[:, None] * times
    else:
        states["surge_rate"] = reading.of("surge_rate") * windows.values["surge_rate"]
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
    opened = np.stack([reading.of(g) * windows.values[reading.source(g)] - rest[g] for g in names])
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
    with np.errstate(all="ignore"):
        for i in range(shape[0]):
            for j in range(shape[1]):
                q = model.quantities(state[:, i, j], drive_current=float(current[i]))
                result[:, i, j] = [q[name] for name in wanted]
    return dict(zip(wanted, np.nan_to_num(result, nan=1e30, posinf=1e30, neginf=-1e30).clip(-1e30, 1e30), strict=True))


def _change(times: Array, acceleration: Array) -> Array:
    """(w,) What `_Motion.change` is under an acceleration (w, p): its mean weighted by a triangle."""
    m = PLACES // 2
    weight = np.where(times > 0, 1 - times / times[:, -1:], 1 - times / times[:, :1])
    step = np.diff(times, axis=1)
    y = weight * acceleration
    assert times.shape[1] == 2 * m + 1
    return (0.5 * (y[:, 1:] + y[:, :-1]) * step).sum(axis=1)


def stops(model: Model) -> bool:
    """Whether a track that repels and stops the cradle is there at all: other plants are written as this model without
    magnets or contact."""
    return (
        model.parameters["contact_stiffness"] > 0.0
        and max(model.parameters["width_top"], model.parameters["width_side"]) > 0.0
    )


def _gap_misfits(windows: Windows, reading: Reading, places: Mapping[str, Array], nominal: float) -> dict[str, float]:
    """By measured gap how far it is from the gap at the measured place, up to a constant: a sensor's zero is its
    own."""
    measured = [g for g in GAPS if g in windows.values]
    if not {"sway", "heave", "roll"} <= windows.values.keys():
        return {}
    found = {}
    for g in measured:
        did, should = reading.of(g) * windows.values[reading.source(g)], places[g]
        off = np.median(did - should)
        size = np.hypot(*(np.median(np.abs(y - np.median(y))) for y in (did, should)))
        noise = abs(reading.of(g)) * windows.noise[g]
        if abs(off) > 20 * nominal:
            found[g] = np.inf
        elif size > CLEAR * noise:
            found[g] = float(np.median(np.abs(did - should - off)) / size)
    return found


def bad(found: Mapping[str, float]) -> list[str]:
    """Channels that do not belong to the model's motion."""
    return [c for c, f in found.items() if f > (levels.BAD_SURGE if c == "surge" else levels.BAD)]


def total(found: Mapping[str, float], among: Iterable[str]) -> float:
    """How far the channels are off in all; one that says nothing counts as half off."""
    return float(sum(min(found.get(c, 0.5), 2.0) ** 2 for c in among))
