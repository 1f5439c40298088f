# SPDX-License-Identifier: Apache-2.0
"""How smooth a table of forces should be: as smooth as makes the data most probable, its values integrated out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..estimation.structure import bending

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


def smoothest_of(gram: np.ndarray, score: np.ndarray, samples: int) -> Smooth:
    """The table that explains a residual best, from the normal equations (l, l) and (l,) of what each value does to
    ``samples`` measurements over noise.

    Before the data, a value is known as well as one average measurement would tell it (unit information prior, Kass and
    Wasserman 1995). So the price of a table hangs neither on units nor on the size of the rig."""
    unit = max(np.trace(gram) / len(gram), 1e-12)  # where no run has been at all, any will do
    bent = bending(len(gram))
    bends = np.maximum(np.linalg.eigvalsh(bent), 0.0)
    tried = (_with_weight(gram, score, unit / samples, unit * w, bent, bends) for w in WEIGHTS)
    return max(tried, key=lambda s: s.promise)


def _with_weight(
    gram: np.ndarray, score: np.ndarray, plain: float, weight: float, bent: np.ndarray, bends: np.ndarray
) -> Smooth:
    """With the prior precision ``plain`` + ``weight`` times ``bent``, whose eigenvalues ``bends`` are."""
    prior = plain * np.eye(len(gram)) + weight * bent
    try:
        factor = linalg.cho_factor(gram + prior)
    except (linalg.LinAlgError, ValueError):  # responses beyond all bounds: nothing can be had from them
        return Smooth(np.zeros(len(gram)), weight, -np.inf, np.inf)
    values = linalg.cho_solve(factor, score)
    told = 2 * np.log(np.diag(factor[0])).sum() - np.log(plain + weight * bends).sum()
    return Smooth(
        values, weight, float(values @ score - told), max(float(values @ prior @ values), 0.0) + max(float(told), 0.0)
    )
