"""What a sample should be by its neighbours: interpolation over the few samples around it, and the noise that shows.

Everything here is linear in the samples and works through a run a block at a time, so that its memory does not grow with the run.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..data.measurement import Array

#: Neighbours, at these distances on both sides, whose cubics predict the sample between them. No two share a neighbour: one bad sample spoils one prediction.
REACHES = ((1, 2), (3, 5), (4, 6))
#: Samples on each side that a prediction needs.
MARGIN = 6
#: Samples worked on at a time.
BLOCK = 1 << 16
#: Four in five normal numbers are smaller than this; beyond `CLIP` nearly none are.
FOUR_IN_FIVE, CLIP = 1.2816, 4.0


def blocks(count: int) -> Iterator[slice]:
    """Overlapping slices, each with `MARGIN` samples more on both sides where there are any, that cover ``count`` samples."""
    for first in range(0, max(count - 2 * MARGIN, 0), BLOCK):
        yield slice(first, min(first + BLOCK + 2 * MARGIN, count))


def predictions(times: Array, values: Array, reaches: tuple[tuple[int, int], ...] = REACHES) -> tuple[Array, Array]:
    """Predictions (p, m) of the inner samples ``MARGIN … n − MARGIN`` by the cubic through four neighbours, for each of the p reaches,
    and the standard deviation (p, m) of measured minus predicted for noise of size 1. times, values: (n,)."""
    n = len(times)
    inner = slice(MARGIN, n - MARGIN)
    result = np.empty((2, len(reaches), max(n - 2 * MARGIN, 0)))
    t = times[inner]
    for k, (near, far) in enumerate(reaches):
        steps = (-far, -near, near, far)
        d = [times[MARGIN + s : n - MARGIN + s] - t for s in steps]
        total, power = 0.0, 1.0
        for i, s in enumerate(steps):
            weight = 1.0
            for j in range(4):
                if j != i:
                    weight = weight * (d[j] / (d[j] - d[i]))
            total = total + weight * values[MARGIN + s : n - MARGIN + s]
            power = power + weight * weight
        result[0, k], result[1, k] = total, np.sqrt(power)
    return result[0], result[1]


def deviations(times: Array, values: Array) -> Array:
    """(n − 2·MARGIN,) each inner sample minus the cubic through its four nearest neighbours, scaled to the noise's standard deviation."""
    parts = [np.empty(0)]
    for part in blocks(len(times)):
        predicted, sizes = predictions(times[part], values[part], REACHES[:1])
        parts.append((values[part][MARGIN : len(predicted[0]) + MARGIN] - predicted[0]) / sizes[0])
    return np.concatenate(parts)


def misses(times: Array, values: Array) -> Array:
    """(p, m) each inner sample minus its prediction by each of `REACHES`; of a long run, its first block."""
    part = next(blocks(len(times)), slice(0, 0))
    predicted, _ = predictions(times[part], values[part])
    return values[part][MARGIN : MARGIN + predicted.shape[1]] - predicted


def second_differences(times: Array, values: Array) -> Array:
    """(n − 2,) each inner sample minus the line through its two neighbours, scaled to the noise's standard deviation."""
    if len(times) < 3:
        return np.empty(0)
    a, b = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    left = b / (a + b)
    return (values[1:-1] - left * values[:-2] - (1 - left) * values[2:]) / np.sqrt(1 + left**2 + (1 - left) ** 2)


def spread(values: Array) -> float:
    """Standard deviation without what lies beyond `CLIP` of them, started from the size that four in five do not exceed; NaN for nothing."""
    if not len(values):
        return float("nan")
    sizes = np.abs(values)
    s = float(np.quantile(sizes, 0.8)) / FOUR_IN_FIVE
    for _ in range(5):
        inside = sizes[sizes < CLIP * s]
        s = float(np.sqrt(np.mean(inside**2))) if len(inside) else s
    return s
