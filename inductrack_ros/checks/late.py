# SPDX-License-Identifier: Apache-2.0
"""A sensor all of whose channels come late.

A delay that is a large part of a swing looks like a sign, a unit or a stranger in each channel alone. One delay mends
all of them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..data import Run
from ..data.measurement import Array
from .finding import IMPOSSIBLE, Finding, number, shared
from .noise_found import Channel

#: Samples of a run that are shifted against each other, runs that are asked, and half the samples of a difference, as
#: few of these as stand over the noise.
LONGEST, RUNS, HALVES = 2000, 4, (8, 16, 32)
#: Part of a channel's variance that the other explains where they belong to each other, and where they do not.
SAME, OTHER = 0.8, 0.5
#: Samples that say something.
FEWEST = 128
#: A channel moves where its differences are so many times their noise.
MOVES = 4.0

#: A channel, its derivative, and of which order that is.
Pair = tuple[str, str, int]


def one_delay(runs: list[Run], channels: Mapping[str, Channel], pairs: list[Pair]) -> float | None:
    """Seconds by which all derivatives come after what they are derivatives of, where one delay makes them the same and
    none does not; None where there is no such."""
    told = [found for pair in pairs if (found := _together(runs[:RUNS], channels, pair)) is not None]
    if len(told) < 2:
        return None
    most = min(len(part) // 2 for part, _ in told)
    step = told[0][1]
    table = np.stack([part[len(part) // 2 - most : len(part) // 2 + most + 1] for part, _ in told])
    k = int(np.argmax(table.mean(axis=0)))
    if table[:, k].min() < SAME or table[:, most].min() > OTHER:
        return None
    return (k - most) * step


def late(delay: float, pairs: list[Pair]) -> Finding:
    """The finding about a delay of all derivatives."""
    wholes, derivatives = [p[0] for p in pairs], [p[1] for p in pairs]
    text = (
        f"{shared(derivatives)} are all {number(1e3 * abs(delay))} ms {'later' if delay > 0 else 'earlier'} than"
        f" {shared(wholes)}"
    )
    remedy = "stamp both sensors with one clock, a message when it is measured and not when it is sent"
    size = {"offset": delay, "whole": wholes[-1], "channels": derivatives}
    return Finding("offset", IMPOSSIBLE, text, remedy, derivatives[-1], size=size)


def _together(runs: list[Run], channels: Mapping[str, Channel], pair: Pair) -> tuple[Array, float] | None:
    """What runs say of one pair, on the delays that all of them have."""
    parts = [part for run in runs if (part := _explained(run, channels, pair)) is not None]
    if not parts:
        return None
    most = min(len(part) // 2 for part, _ in parts)
    cut = [part[len(part) // 2 - most : len(part) // 2 + most + 1] for part, _ in parts]
    return np.mean(cut, axis=0), float(np.median([step for _, step in parts]))


def _explained(run: Run, channels: Mapping[str, Channel], pair: Pair) -> tuple[Array, float] | None:
    """By delay (samples, from minus to plus a half of them) the part of a channel's variance that its derivative
    explains, and the time between samples; None where nothing moves."""
    whole, derivative, order = pair
    if not {whole, derivative} <= set(run.channels):
        return None
    count = min(len(run.times), LONGEST)
    t = np.linspace(run.times[0], run.times[count - 1], count)
    step = float(t[1] - t[0]) if count > 1 else 0.0
    x, v = (_evenly(run, c, t) for c in (whole, derivative))
    if (~np.isnan(x) & ~np.isnan(v)).sum() < FEWEST:
        return None
    for half in HALVES:
        did, should, noise = _differences(x, v, order, half)
        if len(did) and np.nanstd(did) > MOVES * noise * channels[whole].noise:
            most = len(did) // 2
            return np.array([_part(did / step**order, should, j) for j in range(-most, most + 1)]), step
    return None


def _differences(x: Array, v: Array, order: int, half: int) -> tuple[Array, Array, float]:
    """Differences of a channel over ``half`` samples on each side, per sample, the means of its derivative that should
    be the same, and their noise for noise of size 1."""
    if order == 1:
        box = np.convolve(np.ones(2 * half), [0.5, 0.5]) / (2 * half)
        did, noise = (x[2 * half :] - x[: -2 * half]) / (2 * half), np.sqrt(2.0) / (2 * half)
        should = np.convolve(v, box, "valid")
    else:
        box = np.convolve(np.ones(half), np.ones(half)) / half**2
        did, noise = (x[2 * half :] - 2.0 * x[half:-half] + x[: -2 * half]) / half**2, np.sqrt(6.0) / half**2
        should = np.convolve(v, box, "valid")[1:]
    count = min(len(did), len(should))
    return did[:count], should[:count], noise


def _evenly(run: Run, channel: str, times: Array) -> Array:
    """A channel at even times, NaN before it begins and behind its end."""
    known = ~np.isnan(run[channel])
    if not known.any():
        return np.full(len(times), np.nan)
    return np.interp(times, run.times[known], run[channel][known], np.nan, np.nan)


def _part(did: Array, should: Array, delay: int) -> float:
    """Part of the variance of what a channel did that its derivative explains so many samples later."""
    a = did[max(-delay, 0) : len(did) - max(delay, 0)]
    b = should[max(delay, 0) : len(should) - max(-delay, 0)]
    both = ~np.isnan(a) & ~np.isnan(b)
    a, b = a[both], b[both]
    size = float(((a - a.mean()) ** 2).sum()) if len(a) >= FEWEST // 2 else 0.0
    return max(1.0 - float(((a - b) ** 2).sum()) / size, -1.0) if size > 0.0 else -1.0
