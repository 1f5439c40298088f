# SPDX-License-Identifier: Apache-2.0
"""The model made linear about steady flight: stiffness, natural frequencies, damping, and what grows.

Steady flight at a speed needs a thrust that equals the drag: the drive current is trimmed so. Steady values of the coil
current are the paper's; with the effect `coil_current_dynamics` the current lags (Post and Ryutov), two states more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ..core.kernel import QUANTITIES
from ..core.model import Model
from ..core.state import INDEX

#: Steps of the central differences by coordinate: surge, sway, heave, roll, then their rates.
STEPS = np.array([1e-6, 1e-6, 1e-6, 1e-6, 1e-4, 1e-5, 1e-5, 1e-5])
_SWAY, _HEAVE, _ROLL = INDEX["sway"], INDEX["heave"], INDEX["roll"]
_NONE = np.empty(0)


@dataclass(frozen=True)
class Modes:
    """Small motions about steady flight at ``speed`` (m/s).

    Stiffnesses in N/m and N·m/rad, ``sway_roll`` the coupling of both (N/rad); frequencies in Hz; dampings in N·s/m of
    a damper in heave that would do the same; ``growth`` (1/s) of a speed error; ``gap`` (m) under the top array;
    ``drive_current`` (A) that holds the speed."""

    speed: float
    gap: float
    drive_current: float
    heave_stiffness: float
    sway_stiffness: float
    roll_stiffness: float
    sway_roll: float
    heave_frequency: float
    lateral_frequencies: tuple[float, float]
    lateral_growth: float
    held_damping: float
    coupling_damping: float
    current_damping: float
    both_damping: float
    growth: float
    eigenvalues: NDArray[np.complex128]


def derivative(model: Model, x: NDArray[np.float64], drive_current: float) -> NDArray[np.float64]:
    """dx/dt of the whole state, effects' states included."""
    kernel, vector = model.kernel, model.vector.copy()
    vector[kernel.parameters.index("drive_current")] = drive_current
    dx, q = np.zeros(len(x)), np.zeros(len(QUANTITIES))
    kernel.evaluate(
        0.0, np.ascontiguousarray(x), vector, model.switches, model.moving, 0.0, True, _NONE, _NONE, _NONE, dx, q
    )
    return dx


def jacobian(model: Model, x: NDArray[np.float64], drive_current: float, states: list[int]) -> NDArray[np.float64]:
    """Derivatives of dx/dt by the state, both limited to ``states``."""
    steps = np.concatenate([STEPS, np.maximum(1e-6 * np.abs(x[8:]), 1e-9)])
    columns = []
    for s in states:
        up, down = x.copy(), x.copy()
        up[s] += steps[s]
        down[s] -= steps[s]
        columns.append(
            (derivative(model, up, drive_current) - derivative(model, down, drive_current))[states] / (2 * steps[s])
        )
    return np.column_stack(columns)


def trim_current(model: Model, speed: float) -> float:
    """Drive current (A) at which thrust equals drag on the equilibrium heave: thrust is proportional to it."""
    x = model.initial_state(surge_rate=speed)
    q = model.quantities(x, drive_current=1000.0)
    return 1000.0 * q["magnetic_drag"] / q["thrust"]


def modes(model: Model, speed: float) -> Modes:
    """Linearise ``model`` (4-DOF, no effects) about steady flight."""
    held = model.with_changes(dof=1)
    lagging = model.with_changes(effects=["coil_current_dynamics"])
    x, current = model.with_effect_states(model.initial_state(surge_rate=speed)), trim_current(model, speed)
    mass, inertia = model.parameters["mass"], model.parameters["roll_inertia"]
    moving = list(range(1, 8))  # the place along the track changes nothing

    A = jacobian(model, x, current, moving)
    at = {s: moving.index(s) for s in moving}
    rows = {c: at[4 + c] for c in (_SWAY, _HEAVE, _ROLL)}
    eigenvalues = np.linalg.eigvals(A)
    heave_rate = np.sqrt(-A[rows[_HEAVE], at[_HEAVE]])
    lateral = jacobian(model, x, current, [1, 3, 5, 7])
    side = np.linalg.eigvals(lateral)
    frequencies = np.sort(np.abs(side.imag[side.imag > 1e-6])) / (2 * np.pi)

    def damping(m: Model, states: list[int]) -> float:
        """2 m × the decay of the eigenvalue pair that swings as heave does."""
        start = m.with_effect_states(m.initial_state(surge_rate=speed))
        values = np.linalg.eigvals(jacobian(m, start, current, states))
        pair = values[np.argmin(np.abs(values - 1j * heave_rate))]
        return float(-2 * mass * pair.real)

    lag = list(range(8, len(lagging.kernel.states)))
    return Modes(
        speed,
        float(x[_HEAVE] + model.parameters["nominal_gap"]),
        current,
        float(-mass * A[rows[_HEAVE], at[_HEAVE]]),
        float(-mass * A[rows[_SWAY], at[_SWAY]]),
        float(-inertia * A[rows[_ROLL], at[_ROLL]]),
        float(-mass * A[rows[_SWAY], at[_ROLL]]),
        float(heave_rate / (2 * np.pi)),
        (float(frequencies[0]), float(frequencies[-1])),
        float(side.real.max()),
        damping(held, [2, 6]),
        damping(model, [2, 4, 6]),
        damping(lagging.with_changes(dof=1), [2, 6, *lag]),
        damping(lagging, [2, 4, 6, *lag]),
        float(eigenvalues.real[np.abs(eigenvalues.imag) < 1e-6].max()),
        eigenvalues,
    )


def sign_change(model: Model, damping: str, low: float, high: float) -> float:
    """Speed (m/s) at which a damping of `Modes`, by name, changes its sign."""
    return float(brentq(lambda v: getattr(modes(model, v), damping), low, high, xtol=1e-4))


def corner_speed(model: Model) -> float:
    """R/kL (m/s): the speed at which the reactance of a track circuit equals its resistance."""
    p = model.parameters
    return p["resistance"] / (2 * np.pi / p["wavelength"] * p["inductance"])
