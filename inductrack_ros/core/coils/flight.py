# SPDX-License-Identifier: Apache-2.0
"""Cradle and coils together, in steps short against the wavelength and the coils' own time.

In a step the coils see the cradle where its present motion takes it, which is exact to 1e-9 m: it is heavy. Then the
cradle goes the same step under the mean of the coils' forces at both ends, by `integrator.integrate`, so contact,
pulses, effects and their states are as on the averaged track. Both halves are of second order.

`kernel` puts this text behind `circuits`'. ``SEAM`` is where the forces stand in P,
``Q_…`` where quantities stand in q."""

# ruff: noqa: F821
# pyright: reportUndefinedVariable=false
import math

import numpy as np

# Longest step: travel over the wavelength, and time over L/R; the shortest one (s). A cradle so fast that it needs
# shorter ones, 1000 m/s on the paper's track, has left all bounds.
STEP_TRAVEL, STEP_TIME, SHORTEST_COIL_STEP = 1.0 / 100.0, 0.1, 1e-6


def coil_step_size(P, speed, q):
    """Longest step (s) at this speed (m/s)."""
    step = max(STEP_TIME * q[Q_INDUCTANCE] / q[Q_RESISTANCE], SHORTEST_COIL_STEP)
    if abs(speed) * step > STEP_TRAVEL * P[WAVELENGTH]:
        step = STEP_TRAVEL * P[WAVELENGTH] / abs(speed)
    return step


def coil_surroundings(q, gaps, widths):
    """Gaps and widths out of the quantities ``q``; returns the field's amplitude (T) and (L, R).

    The shape factor η stands in the averaged flux (35) alone. Here the field itself has √η, in the flux and in the
    force: their product is the averaged law's, and what drag takes is what the coils turn into heat.
    """
    for i in range(3):
        gaps[i] = q[i]
    widths[0], widths[1], widths[2] = q[Q_WIDTH_TOP], q[Q_WIDTH_RIGHT], q[Q_WIDTH_LEFT]
    return math.sqrt(q[Q_ETA]) * q[Q_PEAK_FIELD], (q[Q_INDUCTANCE], q[Q_RESISTANCE])


def simulate_coils(times, t, state, tail, P, on, moving, origin, averaged, pt, pp, pc, longest, track, out):
    """Carry ``state`` (N_STATES,) and ``tail`` (see `circuits`) from time t through ``times``; `state.OUTPUTS` at each
    go into ``out`` (n, 15 or all). P is this run's own: the coils' forces are written into it."""
    rows, window = np.empty((WEIGHTS + 2, track[0].shape[1])), np.zeros((WINDOW, tail.size - 1))
    work, touching = np.zeros((10, max(PADDED, N_QUANTITIES))), np.zeros(3, np.bool_)
    x, dx, q = np.empty(N_STATES), np.zeros(N_STATES), np.zeros(N_QUANTITIES)
    gaps, widths, before, after = np.empty(3), np.empty(3), np.empty(4), np.empty(4)
    end, row_out = np.empty(1), np.empty((1, MOTION))

    evaluate(t, state, P, on, moving, origin, averaged, pt, pp, pc, dx, q)
    amplitude, circuit = coil_surroundings(q, gaps, widths)
    first = enter(state[0], gaps, widths, amplitude, track, tail, rows, window)
    coil_forces(window, after)
    for row in range(times.size):
        while True:
            for i in range(4):
                before[i] = P[SEAM + i] = after[i]
            evaluate(t, state, P, on, moving, origin, averaged, pt, pp, pc, dx, q)
            if not t < times[row]:
                break
            remaining, limit = times[row] - t, coil_step_size(P, state[4], q)
            if not limit >= SHORTEST_COIL_STEP:
                state[0] = np.nan
            h = remaining / max(math.ceil(remaining / min(limit, longest) - 1e-9), 1)
            end[0] = times[row] if h == remaining else t + h
            for i in range(N_STATES):
                x[i] = state[i] + h * dx[i] + (0.5 * h * h * dx[4 + i] if i < 4 else 0.0)
            evaluate(end[0], x, P, on, moving, origin, averaged, pt, pp, pc, dx, q)
            amplitude, circuit = coil_surroundings(q, gaps, widths)
            first = step_coils(h, first, x[0], gaps, widths, amplitude, circuit, track, rows, window)
            coil_forces(window, after)
            for i in range(4):
                P[SEAM + i] = 0.5 * (before[i] + after[i])
            integrate(end, t, state, P, on, moving, origin, averaged, pt, pp, pc, longest, work, touching, row_out)
            t = end[0]
            if not math.isfinite(state[0] + state[2] + state[4]):
                for later in range(row, times.size):
                    for i in range(out.shape[1]):
                        out[later, i] = np.nan
                return
        for i in range(8):
            out[row, i] = state[i]
        for i in range(3):
            out[row, 8 + i] = q[i]
        for i in range(4):
            out[row, 11 + i] = dx[4 + i]
        for i in range(out.shape[1] - MOTION):
            out[row, MOTION + i] = q[FURTHER + i]
    leave(first, window, tail)


def forces_now(surge, q, track, tail, forces):
    """Repulsions and drag (N) of the currents in ``tail`` with the cradle at ``surge`` and the gaps in ``q``."""
    rows, window = np.empty((WEIGHTS + 2, track[0].shape[1])), np.zeros((WINDOW, tail.size - 1))
    gaps, widths = np.empty(3), np.empty(3)
    amplitude, circuit = coil_surroundings(q, gaps, widths)
    enter(surge, gaps, widths, amplitude, track, tail, rows, window)
    coil_forces(window, forces)
