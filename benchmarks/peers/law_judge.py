# SPDX-License-Identifier: Apache-2.0
"""How near a proposed force is to the true law, and whether it is of its form: one measure for the package and its
peers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inductrack_ros.diagnosis.laws.fitting import Table, fitted
from inductrack_ros.diagnosis.laws.forms import Form, Range

Force = Callable[[np.ndarray], np.ndarray]

#: How far beyond the range of the data is looked, in parts of it; points on range and beyond together.
BEYOND, POINTS = 0.25, 300
#: A force is of a form that follows it this closely, in parts of its root mean square. It is ours: as generous as a
#: glance at a plot; there would be no need of it if formulas could be told equal by algebra.
ALIKE = 0.05
#: Variables that are never negative on a rig.
FORWARD = ("surge", "time", "surge_rate", "drive")


def wider(variable: str, r: Range) -> np.ndarray:
    """Points (n,) over the range and a quarter beyond either end, where there is such a place."""
    low, high = r.low - BEYOND * r.length, r.high + BEYOND * r.length
    return np.linspace(max(low, 0.0) if variable in FORWARD else low, high, POINTS)


def nearness(force: Force, law: Force, variable: str, r: Range) -> tuple[float, float]:
    """Root mean square of the difference to the law over that of the law: over the range, and beyond it (over that of
    the law in the range)."""
    u = wider(variable, r)
    inside = (u >= r.low) & (u <= r.high)
    true = law(u)
    off, size = np.nan_to_num(force(u) - true, nan=np.inf), _rms(true[inside])
    return _rms(off[inside]) / size, _rms(off[~inside]) / size


def of_form(force: Force, form: Form, variable: str, r: Range) -> bool:
    """Whether the form, with parameters of its own choice, follows the force over the range and a quarter beyond: all
    that the force has besides the form is then negligible."""
    u = wider(variable, r)
    wanted = force(u)
    size = _rms(wanted)
    if not 0.0 < size < np.inf:
        return False
    laid = np.eye(len(u)) / (size * np.sqrt(len(u)))
    best = fitted(Table("", variable, u, laid @ wanted, laid), len(u), [form])[0]
    return best.misfit < ALIKE**2


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.minimum(np.abs(values), 1e150) ** 2)))
