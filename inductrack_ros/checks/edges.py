# SPDX-License-Identifier: Apache-2.0
"""The first and last samples of a run, which have neighbours on one side only: off where those neighbours miss them by
more than they miss any sample further in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..data import Run
from ..data.measurement import Array
from . import levels
from .local import BLOCK

#: Most samples at an end that are off together, and samples that a run needs to say so.
MOST, FEWEST = 4, 40
#: Parabolas through these neighbours, counted inward, that share none: one bad neighbour spoils one of them.
NODES = ((0, 2, 4), (1, 3, 5))
#: Off is what is missed by this many times the worst miss further in.
WORSE = 1.5
#: An impact is a kink: behind it what is missed grows from sample to sample. Samples that are off stand off at once.
AT_ONCE = 0.7


def at_the_ends(run: Run, channel: str, floor: float, known: NDArray[np.intp]) -> tuple[NDArray[np.intp], Array]:
    """Sample numbers at a run's ends that are off, and by how much.

    known: (n,) the samples of the channel that are good otherwise; floor: what is off by less is noise."""
    rows, sizes = [np.empty(0, np.intp)], [np.empty(0)]
    if len(known) >= FEWEST:
        for numbers in (known[: BLOCK + 16], known[::-1][: BLOCK + 16]):
            off, size = _first(run.times[numbers], run[channel][numbers], floor)
            rows.append(numbers[off])
            sizes.append(size)
    return np.concatenate(rows), np.concatenate(sizes)


def _first(times: Array, values: Array, floor: float) -> tuple[NDArray[np.intp], Array]:
    """Which of the first samples are off, and by how much each."""
    missed = [_missed(times, values, distance) for distance in range(1, MOST + 1)]
    off: dict[int, float] = {}
    for i in range(MOST - 1, -1, -1):
        distance = next((k for k in range(i + 1, MOST + 1) if k not in off), MOST) - i
        away = missed[distance - 1]
        if away[i] > max(WORSE * float(away[2 * MOST :].max()), floor):
            off[i] = float(away[i])
    block = list(range(next(i for i in range(MOST + 1) if i not in off)))
    if block and off[block[-1]] < AT_ONCE * max(off[i] for i in block):
        off = {i: size for i, size in off.items() if i not in block}
    return np.array(sorted(off), np.intp), np.array([off[i] for i in sorted(off)])


def _missed(times: Array, values: Array, distance: int) -> Array:
    """(m,) By how much each sample is missed by the nearer of two parabolas through samples that follow it at
    ``distance`` and further."""
    size = len(times) - distance - NODES[-1][-1]
    t = times[:size]
    answers = []
    for nodes in NODES:
        at = [distance + k for k in nodes]
        total = np.zeros(size)
        for i in at:
            weight = np.ones(size)
            for j in at:
                if j != i:
                    weight *= (t - times[j : j + size]) / (times[i : i + size] - times[j : j + size])
            total += weight * values[i : i + size]
        answers.append(np.abs(values[:size] - total))
    return np.minimum(*answers)


def floor_of(noise: float, step: float, count: int) -> float:
    """What noise and reading steps alone may miss a sample by."""
    return levels.sigmas(count) * 5.0 * max(noise, step)
