# SPDX-License-Identifier: Apache-2.0
"""The drive pulse by pulse against the averaged law (39): the mean thrust, and what it does to a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ..core.model import Model, Pulses

Array = NDArray[np.float64]


def passing_pulses(model: Model, speed: float, delay: float, coils: range) -> Pulses:
    """Pulses of coils passed at a steady speed, each centred on the moment the field's peak passes, plus ``delay`` (s).

    Coil n stands at n λ/2 and is passed at n λ/2v; its current alternates from coil to coil.
    """
    n = np.array(coils)
    pitch, tau = model.parameters["wavelength"] / 2, model.parameters["pulse_length"]
    sign = 1.0 - 2.0 * (n % 2)
    return Pulses(n * pitch / speed - tau / 2 + delay, n, sign * model.parameters["drive_current"])


def thrust_in_time(
    model: Model, speed: float, delay: float = 0.0, periods: float = 1.0, points: int = 201
) -> tuple[Array, Array]:
    """Times (n,) and pulse-by-pulse thrust (n,) in N at a held speed on the equilibrium heave, from one coil on."""
    pulsed = model.with_changes(drive="pulses")
    pitch, tau = model.parameters["wavelength"] / 2, model.parameters["pulse_length"]
    reach = int(np.ceil((tau + abs(delay)) * speed / pitch)) + 2
    pulses = passing_pulses(pulsed, speed, delay, range(-reach, int(periods) + reach + 1))
    x = pulsed.initial_state(surge_rate=speed)
    times = np.linspace(0.0, periods * pitch / speed, points)
    thrust = np.empty(points)
    for i, t in enumerate(times):
        x[0] = speed * t
        thrust[i] = pulsed.quantities(x, t, pulses=pulses)["thrust"]
    return times, thrust


def mean_ratio(model: Model, speed: float, delay: float = 0.0) -> float:
    """Mean thrust pulse by pulse over that of the averaged law, at a held speed: one pulse's impulse, once every half
    wavelength."""
    pulsed = model.with_changes(drive="pulses")
    pulse = passing_pulses(pulsed, speed, delay, range(1))
    x = pulsed.initial_state(surge_rate=speed)
    times = pulse.times[0] + np.linspace(0.0, model.parameters["pulse_length"], 101)
    thrust = np.empty(len(times))
    for i, t in enumerate(times):
        x[0] = speed * t
        thrust[i] = pulsed.quantities(x, t, pulses=pulse)["thrust"]
    impulse = float(np.trapezoid(thrust, times))
    period = model.parameters["wavelength"] / 2 / speed
    return impulse / period / model.quantities(model.initial_state(surge_rate=speed))["thrust"]


def closed_formula(model: Model, speed: float | Array, delay: float | Array = 0.0) -> Array:
    """The same by formula: cos(ωδ) cos(ωτ/2)/(1 − (ωτ/π)²)."""
    omega = 2 * np.pi / model.parameters["wavelength"] * np.asarray(speed, float)
    phase = omega * model.parameters["pulse_length"] / np.pi
    phase = np.where(np.abs(phase - 1) < 1e-9, 1 + 1e-9, phase)
    return np.cos(omega * delay) * np.cos(np.pi / 2 * phase) / (1 - phase**2)


def run_by_pulses(model: Model, speed: float, duration: float, delay: float = 0.0) -> tuple[Array, Array]:
    """Times (n,) and states (n, 8) of a free run: at each coil the controller sees the speed and times the next pulse
    by it."""
    pulsed = model.with_changes(drive="pulses")
    pitch, tau, current = (model.parameters[k] for k in ("wavelength", "pulse_length", "drive_current"))
    pitch /= 2
    x, t, coil = pulsed.initial_state(surge_rate=speed), 0.0, 0
    fired = [(-tau / 2 + delay, 0)]
    times, states = [t], [x[:8].copy()]
    while t < duration and x[4] > 0.5:
        coil += 1
        passing = t + (coil * pitch - x[0]) / x[4]
        fired = [*fired[-3:], (passing - tau / 2 + delay, coil)]
        n = np.array([c for _, c in fired])
        pulses = Pulses(np.array([s for s, _ in fired]), n, (1.0 - 2.0 * (n % 2)) * current)
        until = min(passing, duration)
        x = pulsed.advance(x, t, until, pulses=pulses)
        t = until
        times.append(t)
        states.append(x[:8].copy())
    return np.array(times), np.array(states)


@dataclass(frozen=True)
class FreeRun:
    """Travel (m) in 1 s from ``speed`` (m/s): averaged, by pulses, and averaged with the effect
    `finite_pulse_width`."""

    speed: float
    averaged: float
    by_pulses: float
    corrected: float


@dataclass(frozen=True)
class DriveTest:
    """Free runs, the speed (m/s) up to which the averaged law is within 1 %, and the mean thrust over it at some
    speeds."""

    runs: list[FreeRun]
    good_to: float
    mean_at: dict[float, float]


def drive_test(model: Model) -> DriveTest:
    """The averaged drive against the pulses."""
    runs = [_free_run(model, speed) for speed in (15.0, 15.5, 16.5, 20.0, 40.0)]
    good_to = float(brentq(lambda v: float(closed_formula(model, v)) - 0.99, 1.0, 60.0))
    return DriveTest(runs, good_to, {v: mean_ratio(model, v) for v in (15.5, 40.0, 80.0)})


def _free_run(model: Model, speed: float) -> FreeRun:
    times, states = run_by_pulses(model, speed, 1.0)
    span = np.array([0.0, times[-1]])
    travels = [
        m.simulate(span, m.initial_state(surge_rate=speed))["surge"][-1]
        for m in (model, model.with_changes(effects=["finite_pulse_width"]))
    ]
    return FreeRun(speed, float(travels[0]), float(states[-1, 0]), float(travels[1]))
