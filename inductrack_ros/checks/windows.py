# SPDX-License-Identifier: Apache-2.0
"""Short windows of all runs, and how they may be read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.state import COORDINATES, GAPS
from ..data import Campaign, Run
from ..data.measurement import Array
from .noise_found import Channel

#: Windows in all and at least, places in each where the model is asked, and half lengths (samples) that are tried.
WINDOWS, FEWEST, PLACES, HALVES = 160, 8, 9, (4, 8, 16, 32, 64)
#: The change of speed over a window is to be this many times its noise.
CLEAR = 8.0
#: Between two readings of a slower sensor that are up to so many of its usual steps apart what lies between is known.
BETWEEN = 2.5
#: Samples of a run that the windows' length is chosen by.
BEGINNING = 20_000
#: Coordinates whose swing decides how long a window is: heave has its weight besides, surge goes on.
SWINGING = ("sway", "roll")


@dataclass(frozen=True)
class Reading:
    """How the data are read: what their time, their drive current and each channel is multiplied by; what is added to
    a channel then (SI); two channels that change places."""

    time: float = 1.0
    current: float = 1.0
    channels: Mapping[str, float] = field(default_factory=dict)
    zeros: Mapping[str, float] = field(default_factory=dict)
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

    def plus(self, channel: str, zero: float) -> Reading:
        """The same with something added to one channel."""
        return replace(self, zeros={**self.zeros, channel: zero + self.zeros.get(channel, 0.0)})

    def values(self, windows: Windows, channel: str) -> Array:
        """(w, p) A channel as it is read."""
        return self.of(channel) * windows.values[self.source(channel)] + self.zeros.get(channel, 0.0)


@dataclass(frozen=True)
class Windows:
    """Windows of all runs: times (w, p) from each window's middle, channels (w, p) by name, drive current (w,), and the
    number (w,) of the run that each is of. ``conditions`` of each run are as campaign.yaml says."""

    times: Array
    values: Mapping[str, Array]
    current: Array
    run: Array
    pulsed: bool
    noise: Mapping[str, float]
    conditions: tuple[Mapping[str, float], ...] = ()

    def some(self, rows: Array) -> Windows:
        """Some of them."""
        values = {c: y[rows] for c, y in self.values.items()}
        return replace(self, times=self.times[rows], values=values, current=self.current[rows], run=self.run[rows])


def windows_of(
    campaign: Campaign, channels: Mapping[str, Channel], most: int = WINDOWS, half: int | None = None
) -> Windows | None:
    """About ``most`` windows spread over the campaign; None where the runs are too short or do not tell place and
    speed. ``half`` is their half length (samples), as long as what swings needs unless given."""
    stated = all("surge_rate" in run.initial_state for run in campaign.runs)
    if not ({"heave", "gap_top"} & channels.keys()) or not (stated or {"surge", "surge_rate"} & channels.keys()):
        return None
    names = [c for c in (*COORDINATES, "surge_rate", *GAPS) if all(c in run.channels for run in campaign.runs)]
    names = [c for c in names if c in channels]
    if not {"heave", "gap_top"} & set(names):  # measured in some runs only
        return None
    grids = [_grid(run, names) for run in campaign.runs]
    half = half or _half(campaign, grids, channels, [c for c in names if c in SWINGING])
    cut = [_cut(run, t, names, half, -(-most // len(grids))) for run, t in zip(campaign.runs, grids, strict=True)]
    parts = [p for p in cut if p is not None]
    if not parts or sum(len(p[0]) for p in parts) < FEWEST:
        return None
    times = np.concatenate([p[0] for p in parts])
    table = np.concatenate([p[1] for p in parts])
    current = np.concatenate([p[2] for p in parts])
    run_of = np.concatenate([np.full(len(p[0]), k) for k, p in enumerate(cut) if p is not None])
    values = {c: table[:, :, k] for k, c in enumerate(names)}
    if not {"surge", "surge_rate"} & values.keys():
        if not stated:
            return None
        values["surge_rate"] = np.repeat(
            [run.initial_state["surge_rate"] for run, p in zip(campaign.runs, cut, strict=True) if p for _ in p[0]],
            PLACES,
        ).reshape(times.shape)
    noise = {c: channels[c].scatter for c in names}
    pulsed = any(run.pulses is not None for run in campaign.runs)
    return Windows(times, values, current, run_of, pulsed, noise, tuple(run.conditions for run in campaign.runs))


def _grid(run: Run, names: list[str]) -> Array:
    """(n,) Times of the samples that windows are cut out of: those of the coordinate that is measured most rarely. A
    rig reads its sensors at rates of their own."""
    told_by = [c for c in names if c in COORDINATES or (c in GAPS and "heave" not in names)]
    return min((run.samples(c)[0] for c in told_by), key=len)


def _at(run: Run, channel: str, times: Array) -> Array:
    """A channel at ``times`` (any shape), in straight lines between its own samples; NaN where it was not measured for
    long."""
    own, values = run.samples(channel)
    if len(own) < 2:
        return np.full(times.shape, np.nan)
    behind = np.clip(np.searchsorted(own, times), 1, len(own) - 1)
    before = behind - 1
    near = own[behind] - own[before] <= BETWEEN * float(np.median(np.diff(own[:BEGINNING])))
    known = (own[behind] == times) | (own[before] == times) | (near & (own[0] < times) & (times < own[-1]))
    return np.where(known, np.interp(times, own, values), np.nan)


def _half(campaign: Campaign, grids: list[Array], channels: Mapping[str, Channel], names: list[str]) -> int:
    """Half length of the windows: long enough that the bend of what swings stands over its noise, where any length
    does."""
    shortest = min(map(len, grids))
    fitting = [h for h in HALVES if 2 * h + 1 <= shortest // 3] or HALVES[:1]
    parts = list(zip(campaign.runs, grids, strict=True))
    table = {c: [_at(run, c, times[:BEGINNING]) for run, times in parts] for c in names}
    for half in fitting:
        bends = {c: np.abs(np.concatenate([_bend(y, half) for y in columns])) for c, columns in table.items()}
        sizes = {c: float(np.nanmedian(y)) for c, y in bends.items() if not np.isnan(y).all()}
        if all(size > CLEAR * 2.4 * channels[c].scatter for c, size in sizes.items()):
            return half
    return fitting[-1]


def _bend(values: Array, half: int) -> Array:
    """Second differences over ``half`` samples."""
    return values[2 * half :] - 2 * values[half:-half] + values[: -2 * half]


def _cut(run: Run, grid: Array, names: list[str], half: int, most: int) -> tuple[Array, Array, Array] | None:
    """Times (w, p), values (w, p, c) and current (w,) of up to ``most`` windows of a run on its ``grid``, where nothing
    is missing."""
    last = len(grid) - 1 - 2 * half
    if last < 0:
        return None
    first = np.unique(np.linspace(0, last, min(2 * last // half + 1, most)).astype(int))
    rows = first[:, None] + np.arange(PLACES) * (2 * half // (PLACES - 1))
    times = grid[rows]
    values = np.stack([_at(run, c, times) for c in names], axis=-1)
    width = times[:, -1] - times[:, 0]
    good = ~np.isnan(values).any(axis=(1, 2)) & (width < 1.5 * np.median(width))
    middle = times[:, PLACES // 2]
    current = (
        np.interp(middle, *run.inputs["drive_current"])
        if "drive_current" in run.inputs
        else np.full(len(middle), run.drive_current)
    )
    return (times - middle[:, None])[good], values[good], current[good]
