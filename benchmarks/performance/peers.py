# SPDX-License-Identifier: Apache-2.0
"""What a user would write for one run: the model as a function, and a solver of scipy or SUNDIALS.

The function is plain Python on numbers, with the contact as an `if`; numba compiles the same text for the second peer.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, sin, sqrt

import numba
import numpy as np
from scipy.integrate import solve_ivp


def right_hand_side(t, x, p):
    """Time derivative (8,) of the state (8,); p are the 22 parameters in the order of `core.parameters`."""
    (
        eta,
        gamma,
        b0,
        wavelength,
        inductance,
        resistance,
        mass,
        tau,
        current,
        coils,
        w_top,
        w_side,
        g,
        gap,
        stiffness,
        damping,
        inertia,
        top,
        off,
        height,
    ) = p[:20]
    c = sqrt(0.5)
    sway, heave, roll, v, sway_rate, heave_rate, roll_rate = x[1], x[2], x[3], x[4], x[5], x[6], x[7]
    k = 2 * pi / wavelength
    speed = max(v, 0.0)
    omega = k * speed
    co, si = cos(roll), sin(roll)
    tx, ty = -si * top, co * top
    rx, ry = -co * off - si * height, -si * off + co * height
    lx, ly = co * off - si * height, si * off + co * height
    g1 = gap + heave + ty - top
    g2 = gap - c * (sway + rx + off + heave + ry - height)
    g3 = gap + c * (sway + lx - off - heave - ly + height)
    r1 = heave_rate + roll_rate * tx
    r2 = -c * (sway_rate - roll_rate * ry + heave_rate + roll_rate * rx)
    r3 = c * (sway_rate - roll_rate * ly - heave_rate - roll_rate * lx)
    o1 = w_top * exp(min(-k * g1, 50.0))  # a solver may try states far off
    o2 = w_side * exp(min(-k * g2, 50.0))
    o3 = w_side * exp(min(-k * g3, 50.0))
    overlap = o1 + o2 + o3
    flux = eta * b0 / k * overlap
    reactance = omega * inductance
    common = flux * omega / (resistance**2 + reactance**2)
    lift = coils * b0 * common * reactance
    drag = overlap * coils * b0 * common * resistance
    thrust = gamma * overlap * b0 * 4 * speed / wavelength * tau / pi * current
    f1, f2, f3 = o1 * lift, o2 * lift, o3 * lift
    if stiffness * g1 + damping * max(r1, 0.0) < 0:
        f1 -= stiffness * g1 + damping * r1
    if stiffness * g2 + damping * max(r2, 0.0) < 0:
        f2 -= stiffness * g2 + damping * r2
    if stiffness * g3 + damping * max(r3, 0.0) < 0:
        f3 -= stiffness * g3 + damping * r3
    return np.array([
        v, sway_rate, heave_rate, roll_rate,
        (thrust - drag) / mass,
        c * (f3 - f2) / mass,
        (f1 - c * (f2 + f3)) / mass - g,
        (tx * f1 + c * f2 * (ry - rx) - c * f3 * (lx + ly)) / inertia,
    ])  # fmt: skip


compiled = numba.njit(right_hand_side)


def scipy_run(
    method: str, function: Callable, P: np.ndarray, state: np.ndarray, times: np.ndarray, rtol: float
) -> np.ndarray:
    """States (n, 8) by `solve_ivp`."""
    p = P if function is compiled else P.tolist()
    result = solve_ivp(function, (times[0], times[-1]), state, method, times, args=(p,), rtol=rtol, atol=1e-3 * rtol)
    return result.y.T if result.success else np.full((times.size, 8), np.nan)


def cvode_run(
    method: str, function: Callable, P: np.ndarray, state: np.ndarray, times: np.ndarray, rtol: float
) -> np.ndarray:
    """States (n, 8) by CVODE, through scikit-sundae."""
    from sksundae.cvode import CVODE

    p = P if function is compiled else P.tolist()

    def in_place(t, y, yp):
        yp[:] = function(t, y, p)

    result = CVODE(in_place, method=method, rtol=rtol, atol=1e-3 * rtol, max_num_steps=1_000_000).solve(times, state)
    return result.y if len(result.y) == times.size else np.full((times.size, 8), np.nan)


def solvers() -> dict[str, tuple[Callable, str]]:
    """The solvers that are installed."""
    found = {"LSODA": (scipy_run, "LSODA"), "DOP853": (scipy_run, "DOP853")}
    try:
        import sksundae  # noqa: F401
    except ImportError:
        return found
    return found | {"CVODE": (cvode_run, "BDF")}
