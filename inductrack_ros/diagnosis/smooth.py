# SPDX-License-Identifier: Apache-2.0
"""How smooth a table of forces should be: as smooth as makes the data most probable, its values integrated out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..estimation.structure import Smoothness

#: Weights of roughness tried, relative to the data's weight on the table.
WEIGHTS = np.logspace(-9, 9, 37)
#: An oscillation has at least so many periods in a table, or it is as well a bend; and so many values to a period, or
#: straight lines between them do not follow it.
PERIODS, VALUES = 1.5, 4.0
#: Rates tried for each period more in the table: two neighbours then share most of what they explain.
RATES = 4


@dataclass(frozen=True)
class Smooth:
    """A table of a force.

    - values: (l,); smoothness: what is wanted of them before the data
    - promise: twice the log evidence over no table
    - occam: the part of the fall in χ² that its freedom alone would have bought
    """

    values: np.ndarray
    smoothness: Smoothness
    promise: float
    occam: float


def smoothest_of(gram: np.ndarray, score: np.ndarray, samples: int, swings: bool = False) -> Smooth:
    """The table that explains a residual best, from the normal equations (l, l) and (l,) of its values over noise, told
    by ``samples`` measurements. With ``swings`` it may as well be near to an oscillation as to a straight line.

    Before the data, a value is known as well as one average measurement would tell it (unit information prior, Kass and
    Wasserman 1995). So the price of a table hangs neither on units nor on the size of the rig."""
    unit = max(np.trace(gram) / len(gram), 1e-12)  # where no run has been at all, any will do
    straight = _weighed(gram, score, unit, samples, 0.0, 1)
    turns = _turns(len(gram)) if swings else np.empty(0)
    if not len(turns):
        return straight
    turn = max(turns, key=lambda turn: _swing(gram, score, unit / samples, turn))
    return max(straight, _weighed(gram, score, unit, samples, turn, len(turns)), key=lambda s: s.promise)


def _turns(count: int) -> np.ndarray:
    """Rates (rad from one value to the next) of the oscillations that a table of so many values can tell apart."""
    periods = np.arange(PERIODS, (count - 1) / VALUES, 1.0 / RATES)
    return 2.0 * np.pi * periods / (count - 1)


def _swing(gram: np.ndarray, score: np.ndarray, plain: float, turn: float) -> float:
    """Fall in χ² that a constant and an oscillation promise."""
    k = np.arange(len(gram)) * turn
    shapes = np.column_stack([np.ones(len(gram)), np.sin(k), np.cos(k)])
    told, wanted = shapes.T @ gram @ shapes + plain * shapes.T @ shapes, shapes.T @ score
    return float(wanted @ np.linalg.solve(told, wanted))


def _weighed(gram: np.ndarray, score: np.ndarray, unit: float, samples: int, turn: float, rates: int) -> Smooth:
    """The table at the likeliest weight of its departures; ``rates`` is among how many rates ``turn`` was chosen.

    With the prior precision ``plain`` + a weight times ``bent``, all weights share the modes in which the data and
    ``plain`` together are one and ``bent`` is diagonal."""
    plain, chosen = unit / samples, 2.0 * float(np.log(rates))
    bent = Smoothness(1.0, turn).bending(len(gram))
    known = gram + plain * np.eye(len(gram))
    try:
        stiff, modes = linalg.eigh(bent, known)
        size = 2.0 * np.log(np.diag(linalg.cholesky(known))).sum()
    except (linalg.LinAlgError, ValueError):  # responses beyond all bounds: nothing can be had from them
        return Smooth(np.zeros(len(gram)), Smoothness(), -np.inf, np.inf)
    weights, shown = unit * WEIGHTS[:, None], modes.T @ score
    left = 1.0 + weights * np.maximum(stiff, 0.0)
    bends = np.maximum(np.linalg.eigvalsh(bent), 0.0)
    told = size + np.log(left).sum(axis=1) - np.log(plain + weights * bends).sum(axis=1)
    promise = (shown**2 / left).sum(axis=1) - told - chosen
    best = int(np.argmax(promise))
    wanted, values = Smoothness(float(weights[best, 0]), turn), modes @ (shown / left[best])
    bought = plain * values @ values + wanted.weight * values @ bent @ values
    return Smooth(values, wanted, float(promise[best]), max(float(bought), 0.0) + max(float(told[best]), 0.0) + chosen)
