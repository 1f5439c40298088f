# SPDX-License-Identifier: Apache-2.0
"""What a sample should be by its neighbours: interpolation over the few samples around it, and the noise that shows.

Everything here is linear in the samples and works through a run a block at a time, so that its memory does not grow
with the run."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..data.measurement import Array

#: Neighbours, at these distances on both sides, whose cubics predict the sample between them. No two share a neighbour:
#: one bad sample spoils one prediction.
REACHES = ((1, 2), (3, 5), (4, 6))
#: Samples on each side that a prediction needs.
MARGIN = 6
#: Samples worked on at a time, and so many of these blocks are enough for a statistic.
BLOCK, ENOUGH = 1 << 15, 3
#: Steps that differ by less than this part of themselves are even.
EVEN = 1e-6
#: Four in five normal numbers are smaller than this; beyond `CLIP` nearly none are.
FOUR_IN_FIVE, CLIP = 1.2816, 4.0


def blocks(count: int) -> Iterator[slice]:
    """Overlapping slices, each with `MARGIN` samples more on both sides where there are any, that cover ``count``
    samples."""
    for first in range(0, max(count - 2 * MARGIN, 0), BLOCK):
        yield slice(first, min(first + BLOCK + 2 * MARGIN, count))


def some_blocks(count: int) -> list[slice]:
    """All blocks, or `ENOUGH` of many, spread evenly: what says how noisy a channel is need not see all of a long
    run."""
    parts = list(blocks(count))
    return (
        [parts[i] for i in np.unique(np.linspace(0, len(parts) - 1, ENOUGH).astype(int))]
        if len(parts) > ENOUGH
        else parts
    )


def predictions(
    times: Array, values: Array, reaches: tuple[tuple[int, int], ...] = REACHES, at: NDArray[np.intp] | None = None
) -> tuple[Array, Array]:
    """Predictions (p, m) of the samples ``at`` by the cubic through four neighbours, for each of the p reaches.

    Besides, the standard deviation (p, m) of measured minus predicted for noise of size 1. ``at`` are numbers of
    samples; unless given, all inner ones (``MARGIN … n − MARGIN``).

    times, values: (n,).
    """
    n = len(times)

    def shifted(column: Array, s: int) -> Array:
        return column[MARGIN + s : n - MARGIN + s] if at is None else column[at + s]

    t = shifted(times, 0)
    result = np.empty((2, len(reaches), max(len(t), 0)))
    even = at is None and _even(times)
    for k, (near, far) in enumerate(reaches):
        steps = (-far, -near, near, far)
        total, power = 0.0, 1.0
        for i, s in enumerate(steps):
            weight = 1.0
            for j, other in enumerate(steps):
                if j != i and even:
                    weight *= other / (other - s)
                elif j != i:
                    d = shifted(times, other) - t
                    weight = weight * (d / (d - (shifted(times, s) - t)))
            total = total + weight * shifted(values, s)
            power = power + weight * weight
        result[0, k], result[1, k] = total, np.sqrt(power)
    return result[0], result[1]


def _even(times: Array) -> bool:
    """Whether steps are all the same but for the digits a file writes."""
    steps = np.diff(times)
    return len(steps) > 0 and bool(np.ptp(steps) < EVEN * abs(steps[0]))


def deviations(times: Array, values: Array) -> Array:
    """(m,) Inner samples minus the cubic through their four nearest neighbours, scaled to the noise's standard
    deviation; of all samples, or of a long run's `ENOUGH` blocks spread over it."""
    parts = [np.empty(0)]
    for part in some_blocks(len(times)):
        predicted, sizes = predictions(times[part], values[part], REACHES[:1])
        parts.append((values[part][MARGIN : len(predicted[0]) + MARGIN] - predicted[0]) / sizes[0])
    return np.concatenate(parts)


def misses(times: Array, values: Array) -> Array:
    """(p, m) each inner sample minus its prediction by each of `REACHES`; of a long run, its first block."""
    part = next(blocks(len(times)), slice(0, 0))
    predicted, _ = predictions(times[part], values[part])
    return values[part][MARGIN : MARGIN + predicted.shape[1]] - predicted


def second_differences(times: Array, values: Array) -> Array:
    """(n − 2,) each inner sample minus the line through its two neighbours, scaled to the noise's standard
    deviation."""
    if len(times) < 3:
        return np.empty(0)
    a, b = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    left = b / (a + b)
    return (values[1:-1] - left * values[:-2] - (1 - left) * values[2:]) / np.sqrt(1 + left**2 + (1 - left) ** 2)


def spread(values: Array) -> float:
    """Standard deviation without what lies beyond `CLIP` of them, started from the size that four in five do not
    exceed; NaN for nothing."""
    if not len(values):
        return float("nan")
    sizes = np.abs(values)
    s = float(np.quantile(sizes, 0.8)) / FOUR_IN_FIVE
    for _ in range(5):
        inside = sizes[sizes < CLIP * s]
        s = float(np.sqrt(np.mean(inside**2))) if len(inside) else s
    return s
