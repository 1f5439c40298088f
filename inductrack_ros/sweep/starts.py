# SPDX-License-Identifier: Apache-2.0
"""Where many runs start: the equilibrium heave of each at once, as `Model.initial_state` has it for one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..core.model import Model
from ..core.state import INDEX, MOTION

_HEAVE, _SPEED, _HEAVE_ACCELERATION = INDEX["heave"], INDEX["surge_rate"], INDEX["heave_acceleration"]
_NONE = np.empty(0)


def on_equilibrium(model: Model, states: np.ndarray, P: np.ndarray) -> np.ndarray:
    """``states`` (runs, 8) with each heave where the vertical forces balance under its row of P (runs, p).

    NaN where there is no such heave: nothing carries the cradle, or the lift exceeds its weight at any gap.
    """
    force = _vertical(model, states[:, _SPEED], P)
    gap = P[:, model.kernel.parameters.index("nominal_gap")]
    low, high = -gap - 2e-3, np.maximum(gap, 1e-3)
    at_low, at_high = force(low), force(high)
    for _ in range(6):
        lifts = at_high >= 0
        if not lifts.any():
            break
        high = np.where(lifts, 2 * high, high)
        at_high = np.where(lifts, force(high), at_high)
    heave = _roots(force, low, high, at_low, at_high)
    found = states.copy()
    found[:, _HEAVE] = np.where((at_low > 0) & (at_high < 0), heave, np.nan)
    return found


def _vertical(model: Model, speeds: np.ndarray, P: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The heave acceleration (runs,) as a function of the heaves (runs,), level and centred: one call of the compiled
    kernel for all."""
    steady = np.array([not model.passes_on(model.known_effects[name]) for name in model.kernel.effects], bool)
    on = np.tile(model.switches & steady, (len(speeds), 1))
    x = np.zeros((len(speeds), len(model.kernel.states)))
    out = np.empty((len(speeds), 1, len(MOTION)))
    moving = np.array([0.0, 0.0, 1.0, 0.0])

    def force(heave: np.ndarray) -> np.ndarray:
        x[:, _HEAVE], x[:, _SPEED] = heave, speeds
        if model.carries_states:
            x[:] = [model.with_effect_states(s, 0.0, p) for s, p in zip(x, P, strict=True)]
        model.kernel.simulate_batch(
            np.zeros(1), 0.0, x, P, on, moving, np.zeros(len(x)), True, _NONE, _NONE, _NONE, 1.0, out
        )
        return out[:, 0, _HEAVE_ACCELERATION].copy()

    return force


def _roots(force: Callable, a: np.ndarray, b: np.ndarray, fa: np.ndarray, fb: np.ndarray) -> np.ndarray:
    """Where ``force`` is zero between a and b (runs,), by Chandrupatla's method: `scipy.optimize.elementwise`, which
    older SciPy has not."""
    a, b, fa, fb = b.copy(), a.copy(), fb.copy(), fa.copy()
    c, fc = a.copy(), fa.copy()
    t = np.full(a.shape, 0.5)
    for _ in range(80):
        x = a + t * (b - a)
        fx = force(x)
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        width = np.abs(b - a)
        tolerance = 1e-15 + 1e-14 * np.abs(best)
        done = (width <= 2 * tolerance) | (fa == 0) | (fb == 0)
        if (done | ~np.isfinite(fx)).all():
            break
        with np.errstate(divide="ignore", invalid="ignore"):
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            inverse = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
            t = np.where((1 - np.sqrt(1 - xi) < phi) & (phi < np.sqrt(xi)), inverse, 0.5)
            least = tolerance / width
        t = np.where(np.isfinite(t), np.clip(t, least, 1 - least), 0.5)
    return best
