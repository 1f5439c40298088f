# SPDX-License-Identifier: Apache-2.0
"""Effects that show nothing of where or how fast they are while they vanish: sought at each of the starts that they
declare.

An effect with ``starts`` is asked where its shape may lie in these runs (a place along the track, a frequency). At each
start the other parameters, where it vanishes, are what a small size of them would do; where a start leaves none, it is
what the whole effect would do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.effects import Effect
from ..core.state import OUTPUTS
from ..estimation.problem import THETA_STEP
from ..estimation.structure import Structure

#: Times a typical size that a start may be.
LARGEST = 30.0


@dataclass(frozen=True)
class Tried:
    """An effect's starts and what is asked of each: ``rows`` of (start, parameter or '' for the whole effect, values,
    step in typical sizes)."""

    starts: tuple[Mapping[str, float], ...]
    rows: tuple[tuple[int, str, Mapping[str, float], float], ...]

    def of(self, start: int) -> list[int]:
        """The rows of one start."""
        return [r for r, row in enumerate(self.rows) if row[0] == start]

    def sized(self, start: int, item: Effect, sizes: Sequence[float]) -> dict[str, float]:
        """A start with its other parameters at the sizes (typical ones) that the data ask for."""
        values = dict(self.starts[start])
        for r, size in zip(self.of(start), sizes, strict=True):
            if name := self.rows[r][1]:
                declared = item.parameters[name]
                size = float(np.clip(size, -LARGEST, LARGEST))
                values[name] = min(max(declared.default + size * declared.typical, declared.low), declared.high)
        return values


def is_placed(item: Effect) -> bool:
    """Whether an effect of the cradle is to be sought at several starts."""
    return item.starts is not None and not item.of_sensor


def tried(item: Effect, ranges: Mapping[str, tuple[float, float]]) -> Tried:
    """What to ask of an effect whose runs cover these ranges."""
    starts = tuple(item.starts(ranges)) if item.starts else ()
    rows = []
    for k, start in enumerate(starts):
        rest = [p for p in item.parameters if p not in start]
        for name in rest:
            rows.append(
                (
                    k,
                    name,
                    {**start, name: item.parameters[name].default + THETA_STEP * item.parameters[name].typical},
                    THETA_STEP,
                )
            )
        if not rest:
            rows.append((k, "", start, 1.0))
    return Tried(starts, tuple(rows))


def thetas(
    structure: Structure, theta: np.ndarray, name: str, asked: Sequence[Mapping[str, float]]
) -> tuple[Structure, np.ndarray]:
    """The structure with the effect, and a row of theta for the effect where it vanishes and for all values asked."""
    wide = structure.plus(name)
    item, found = wide.model.known_effects[name], []
    for values in ({}, *asked):
        own = [values.get(p, d.default) for p, d in item.parameters.items()]
        all_values = [structure.value(f) for f in structure.free] + own
        row = wide.encode(all_values)
        row[: len(theta)] = theta
        found.append(row)
    return wide, np.array(found)


def ranges(outputs: Sequence[np.ndarray]) -> dict[str, tuple[float, float]]:
    """The range of every column of `state.OUTPUTS` over runs (n, w), as far as they have it."""
    every = np.concatenate(outputs)
    return {
        name: (float(np.nanmin(every[:, k])), float(np.nanmax(every[:, k])))
        for k, name in enumerate(OUTPUTS[: every.shape[1]])
    }
