# SPDX-License-Identifier: Apache-2.0
"""Stretches in which a sensor repeats one value that cannot be the end of its range: it hangs, or was lost."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, number, place
from .noise_found import Channel

#: A reading moves into the end of its range by this many usual steps at most, and as many times its noise.
INTO = 5.0
#: A coarse channel that keeps this near (steps) to a value on one side of a stretch of it is at rest. The slowest
#: percent of its motion covers `SLOWEST` steps in as many readings.
AT_REST, SLOWEST = 2.0, 4
#: Channels that are flat over this part of each other's stretches hang together.
TOGETHER = 0.8

Stretch = tuple[Run, NDArray[np.intp]]


def hangs(campaign: Campaign, calm: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding for every channel that hangs. ``calm`` is the campaign without samples at which the cradle may rest on
    the track, where coarse readings repeat."""
    flat: dict[str, list[Stretch]] = {}
    for channel, about in channels.items():
        runs = (campaign if _fine(about) else calm).runs
        flat[channel] = [(run, rows) for run in runs for rows in flat_stretches(run, channel, about)]
    findings = []
    for channel, stretches in flat.items():
        about = channels[channel]
        others = [s for c, many in flat.items() if c != channel and _fine(channels[c]) for s in many]
        hung = [s for s in stretches if not _end_of_range(*s, channel, about) or _fine(about) and _shared(s, others)]
        if hung:
            findings.append(_hung(channel, about, hung))
    return findings


def flat_stretches(run: Run, channel: str, about: Channel) -> list[NDArray[np.intp]]:
    """Sample numbers of each stretch that repeats one value longer than chance and reading steps make it."""
    if channel not in run.channels:
        return []
    numbers = np.flatnonzero(~np.isnan(run[channel]))
    values = run[channel][numbers]
    if len(values) < 3 or np.ptp(values) == 0.0:
        return []
    starts, lengths = repeats_of(values)
    if _fine(about):
        longest, inside = _by_chance(about), 0
    else:
        longest = max(levels.FLAT, SLOWEST * int(np.quantile(lengths, 0.99)))
        inside = int(levels.STUCK * len(values))
    at_end = (values[starts] == values.max()) | (values[starts] == values.min())
    many = lengths >= np.where(at_end, longest, max(longest, inside))
    found = zip(starts[many], lengths[many], strict=True)
    return [numbers[s : s + n] for s, n in found if _fine(about) or not _at_rest(values, s, n, longest, about)]


def _at_rest(values: Array, start: int, length: int, around: int, about: Channel) -> bool:
    """Whether a coarse channel hardly moves on one side of a stretch of one value: the cradle may be at rest."""
    sides = values[max(start - around, 0) : start], values[start + length : start + length + around]
    near = (AT_REST + 0.5) * about.step
    return any(len(side) == around and (np.abs(side - values[start]) < near).all() for side in sides)


def repeats_of(values: Array) -> tuple[Array, Array]:
    """Where stretches of one value begin, and how long they are."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0]))
    return starts, np.diff(np.append(starts, len(values)))


def _fine(about: Channel) -> bool:
    """Whether the readings' step is smaller than the noise, so that a value does not repeat for long."""
    return about.step < about.noise


def _by_chance(about: Channel) -> int:
    """Repeats in a row that noise does not make in all the channel's samples."""
    once = min(about.step / (2.0 * np.sqrt(np.pi) * about.noise), 0.5)
    alone = np.log(levels.FALSE_ALARMS / about.count) / np.log(once) if once > 0.0 else 1.0
    return max(levels.FLAT, 1 + int(np.ceil(alone)))


def _end_of_range(run: Run, rows: NDArray[np.intp], channel: str, about: Channel) -> bool:
    """Whether a stretch is the largest or smallest of its run and the channel moves into it, and does not jump."""
    numbers = np.flatnonzero(~np.isnan(run[channel]))
    times, values = run.times[numbers], run[channel][numbers]
    value = run[channel][rows[0]]
    if value not in (values.min(), values.max()):
        return False
    moves = np.abs(np.diff(values)) / np.diff(times)
    usual = float(np.quantile(moves[moves > 0.0], 0.9))
    first, last = np.searchsorted(numbers, rows[[0, -1]])
    sides = [(first - 1, first)] if first else []
    sides += [(last, last + 1)] if last + 1 < len(numbers) else []
    near = max(about.noise, about.step)
    return all(abs(values[b] - values[a]) <= INTO * (usual * (times[b] - times[a]) + near) for a, b in sides)


def _shared(stretch: Stretch, others: list[Stretch]) -> bool:
    """Whether another channel repeats its value over the same samples: the logger stood still."""
    run, rows = stretch
    for other, theirs in others:
        both = min(rows[-1], theirs[-1]) - max(rows[0], theirs[0])
        if other.name == run.name and both > TOGETHER * max(rows[-1] - rows[0], theirs[-1] - theirs[0]):
            return True
    return False


def _hung(channel: str, about: Channel, stretches: list[Stretch]) -> Finding:
    run, rows = max(stretches, key=lambda s: len(s[1]))
    samples = {r.name: np.concatenate([n for q, n in stretches if q.name == r.name]) for r, _ in stretches}
    count = sum(len(n) for n in samples.values())
    value = float(run[channel][rows[0]]) + 0.0
    text = (
        f"{channel} stays at {number(value, 6)} for {len(rows)} samples from {place(run, int(rows[0]))}: the sensor"
        f" hangs or was lost; {count} such samples in all"
    )
    size = {"count": count, "share": count / about.count, "value": value}
    return Finding("stuck", SET_ASIDE, text, "", channel, samples=as_samples(samples), size=size)
