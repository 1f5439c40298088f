# SPDX-License-Identifier: Apache-2.0
"""How smooth a table of forces should be: as smooth as makes the data most probable, its values integrated out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from ..estimation.structure import ENDS, roughness

#: Weights of roughness tried, relative to the data's weight on the table.
WEIGHTS = np.logspace(-9, 9, 37)


@dataclass(frozen=True)
class Smooth:
    """A table's values (l,), the weight of its roughness, twice the log evidence it promises over none, and ``occam``,
    the part of the fall in χ² that its freedom alone would have bought."""

    values: np.ndarray
    weight: float
    promise: float
    occam: float


def smoothest_of(effect: str, whole: np.ndarray, told: np.ndarray, local: bool = False) -> Smooth:
    """The table of a stand-in that explains a residual best, from the normal equations (l, l) and (l,) of what each
    value does to the measurements over noise.

    That of a ``local`` force is none at its ends.
    """
    free = slice(ENDS, -ENDS) if local else slice(None)
    gram, score = whole[free, free].copy(), told[free]
    unit = max(np.trace(gram) / len(gram), 1e-12)  # where no run has been at all, any will do
    gram += np.diag(np.full(len(gram), 1e-12 * unit))  # nothing is known where no run has been
    plain, bent = (roughness(effect, len(told), weight)[free, free] for weight in (0.0, 1.0))
    bent = bent - plain
    bends = np.linalg.eigvalsh(bent)
    best = max((_with_weight(gram, score, unit * w, plain, bent, bends) for w in WEIGHTS), key=lambda s: s.promise)
    return replace(best, values=np.pad(best.values, ENDS)) if local else best


def _with_weight(
    gram: np.ndarray, score: np.ndarray, weight: float, plain: np.ndarray, bent: np.ndarray, bends: np.ndarray
) -> Smooth:
    """With the prior ``plain`` + weight ``bent``, whose eigenvalues ``bends`` are, at one weight."""
    prior = plain + weight * bent
    try:
        factor = linalg.cho_factor(gram + prior)
    except (linalg.LinAlgError, ValueError):  # responses beyond all bounds: nothing can be had from them
        return Smooth(np.zeros(len(gram)), weight, -np.inf, np.inf)
    values = linalg.cho_solve(factor, score)
    told = 2 * np.log(np.diag(factor[0])).sum() - np.log(plain[0, 0] + weight * np.maximum(bends, 0.0)).sum()
    return Smooth(
        values, weight, float(values @ score - told), max(float(values @ prior @ values), 0.0) + max(float(told), 0.0)
    )
