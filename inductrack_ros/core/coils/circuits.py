# SPDX-License-Identifier: Apache-2.0
"""Currents of single coils under a moving field, (3), (4) of Kim and Ge (2012) with neighbours coupled::

    L dI/dt + R I + Σ M dI_j/dt = −dΦ/dt,      F = Σ I ∂Φ/∂q

A step keeps its energy to the last bit: with the mean current Ī of a step (the trapezoidal rule),
(L ΔI + Σ M ΔI_j) + h R Ī = −ΔΦ, so −Σ Ī ΔΦ, the work of the cradle, is the heat h Σ R Ī² and the change of what is
stored, ½ Σ L I² + ½ Σ M I I_j. The step is stable whatever a coil's resistance.

`kernel` puts this text behind `integrator`'s. ``track`` is (table, grid, mutual, faults, factors): the coefficients of
`field.FieldTable`; the numbers of GRID; M of the first neighbour, the second, …; the coils that are not whole, rising;
their resistances over a whole one's. ``window`` is a work space, a row of WINDOW for each coil that is
near the cradle, in their order along the track. ``tail`` is what a state carries of them: the number of the first coil,
then the currents."""

import math

import numpy as np

# Rows of ``window``: current, flux, flux before, ∂Φ/∂z of the coil's place, ∂Φ/∂g of each gap; resistance over that of
# a whole coil; then the equations of `solve_band`.
CURRENT, FLUX, BEFORE, ALONG, ACROSS, FACTOR, MEAN, BAND, WINDOW = 0, 1, 2, 3, 4, 7, 8, 9, 16  # BAND: 1 + 6
# Entries of ``grid``.
PLACE, PLACE_STEP, GAP, GAP_STEP, REACH, PITCH, SPACING, WAVE_NUMBER = 0, 1, 2, 3, 4, 5, 6, 7
# Rows of ``rows``: flux along the track at the present gaps, and its derivative by each gap; then weights of splines.
SUM, BY_GAP, WEIGHTS = 0, 1, 4


def spline_weights(u, weights, slopes):
    """Weights of four neighbouring cubic B-splines at 0 ≤ u ≤ 1 between the middle two, and their derivatives by u."""
    v = 1.0 - u
    weights[0], weights[3] = v * v * v / 6.0, u * u * u / 6.0
    weights[1], weights[2] = (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0, (4.0 - 6.0 * v * v + 3.0 * v * v * v) / 6.0
    slopes[0], slopes[3] = -0.5 * v * v, 0.5 * u * u
    slopes[1], slopes[2] = -2.0 * u + 1.5 * u * u, 2.0 * v - 1.5 * v * v


def field_rows(gaps, widths, amplitude, track, rows):
    """Fill ``rows``: the flux Φ(z) through a coil under one set, and ∂Φ/∂g of each gap, as coefficients along z."""
    table, grid = track[0], track[1]
    weights, slopes = rows[WEIGHTS], rows[WEIGHTS + 1]
    for m in range(table.shape[1]):
        rows[SUM, m] = 0.0
    for i in range(3):
        steps = (gaps[i] - grid[GAP]) / grid[GAP_STEP]
        inside = min(max(steps, 0.0), table.shape[0] - 3.0)
        j = min(int(inside), table.shape[0] - 4)
        spline_weights(inside - j, weights, slopes)
        beyond = (steps - inside) * grid[GAP_STEP]
        size = widths[i] * amplitude * math.exp(min(-grid[WAVE_NUMBER] * beyond, 700.0))
        for m in range(table.shape[1]):
            value = slope = 0.0
            for a in range(4):
                value += weights[a] * table[j + a, m]
                slope += slopes[a] * table[j + a, m]
            rows[SUM, m] += size * value
            rows[BY_GAP + i, m] = size * (-grid[WAVE_NUMBER] * value if beyond != 0.0 else slope / grid[GAP_STEP])


def see_field(surge, first, track, rows, window):
    """Fluxes of the coils of the window and their derivatives, the cradle being at ``surge``: both sets add up."""
    grid = track[1]
    last = rows.shape[1] - 4
    weights, slopes = rows[WEIGHTS], rows[WEIGHTS + 1]
    for n in range(window.shape[1]):
        flux = along = top = right = left = 0.0
        for side in (-0.5, 0.5):
            steps = ((first + n) * grid[PITCH] - surge - side * grid[SPACING] - grid[PLACE]) / grid[PLACE_STEP]
            if not 0.0 <= steps < last + 1:
                continue
            j = min(int(steps), last)
            spline_weights(steps - j, weights, slopes)
            for a in range(4):
                flux += weights[a] * rows[SUM, j + a]
                along += slopes[a] * rows[SUM, j + a]
                top += weights[a] * rows[BY_GAP, j + a]
                right += weights[a] * rows[BY_GAP + 1, j + a]
                left += weights[a] * rows[BY_GAP + 2, j + a]
        window[FLUX, n], window[ALONG, n] = flux, along / grid[PLACE_STEP]
        window[ACROSS, n], window[ACROSS + 1, n], window[ACROSS + 2, n] = top, right, left


def first_coil(surge, track):
    """Number of the first coil that the field reaches."""
    grid = track[1]
    return math.ceil((surge - 0.5 * grid[SPACING] - grid[REACH]) / grid[PITCH])


def move_window(first, to, track, window):
    """Move currents and fluxes of the window that begins at ``first`` to one from ``to`` on; new coils carry none."""
    count, faults, factors = window.shape[1], track[3], track[4]
    by = int(min(max(to - first, -float(count)), float(count)))
    for r in (CURRENT, FLUX):
        for k in range(count):
            n = k if by >= 0 else count - 1 - k
            window[r, n] = window[r, n + by] if 0 <= n + by < count else 0.0
    for n in range(count):
        window[FACTOR, n] = 1.0
    for f in range(faults.size):
        if to <= faults[f] < to + count:
            window[FACTOR, int(faults[f] - to)] = factors[f]


def coil_equations(h, inductance, resistance, track, window):
    """Write the circuits of a step of ``h`` (s), in which the fluxes went from BEFORE to FLUX, into BAND and MEAN.

    With the mean Ī = I + ΔI/2 they are (L + h/2 R) Ī + Σ M Ī_j = (L I + Σ M I_j) − ½ ΔΦ. Row BAND holds the diagonal,
    row BAND + d what couples coil n with n − d; MEAN the right-hand side.
    """
    mutual, count = track[2], window.shape[1]
    for n in range(count):
        window[BAND, n] = inductance + 0.5 * h * resistance * window[FACTOR, n]
        right = inductance * window[CURRENT, n] - 0.5 * (window[FLUX, n] - window[BEFORE, n])
        for d in range(1, mutual.size + 1):
            window[BAND + d, n] = mutual[d - 1]
            if n - d >= 0:
                right += mutual[d - 1] * window[CURRENT, n - d]
            if n + d < count:
                right += mutual[d - 1] * window[CURRENT, n + d]
        window[MEAN, n] = right


def solve_band(width, window):
    """Solve these symmetric equations of ``width`` neighbours in place, as L D Lᵀ: MEAN ends as the mean currents (A),
    row BAND as 1/D and the rows after it as L."""
    count = window.shape[1]
    for n in range(count):
        near = min(width, n)
        for d in range(near, 0, -1):  # L D of this row, from the farthest neighbour
            for c in range(d + 1, near + 1):
                window[BAND + d, n] -= window[BAND + c, n] * window[BAND + c - d, n - d]
        for d in range(1, near + 1):
            part = window[BAND + d, n] * window[BAND, n - d]
            window[BAND, n] -= part * window[BAND + d, n]
            window[MEAN, n] -= part * window[MEAN, n - d]
            window[BAND + d, n] = part
        window[BAND, n] = 1.0 / window[BAND, n]
    for n in range(count - 1, -1, -1):
        window[MEAN, n] *= window[BAND, n]
        for d in range(1, min(width, count - 1 - n) + 1):
            window[MEAN, n] -= window[BAND + d, n + d] * window[MEAN, n + d]


def coil_forces(window, forces):
    """Repulsion of the top, right and left array and drag (N): I ∂Φ/∂g, and I ∂Φ/∂z of the coils' places."""
    for i in range(4):
        forces[i] = 0.0
    for n in range(window.shape[1]):
        for i in range(3):
            forces[i] += window[CURRENT, n] * window[ACROSS + i, n]
        forces[3] += window[CURRENT, n] * window[ALONG, n]


def stored_energy(inductance, track, window):
    """½ Σ L I² + ½ Σ M I I_j (J) of the coils in the window."""
    mutual, total = track[2], 0.0
    for n in range(window.shape[1]):
        total += 0.5 * inductance * window[CURRENT, n] * window[CURRENT, n]
        for b in range(min(mutual.size, n)):
            total += mutual[b] * window[CURRENT, n] * window[CURRENT, n - b - 1]
    return total


def heat_and_work(h, resistance, window, ledger):
    """Add to ``ledger`` what a step of ``h`` turned into heat, and what the cradle did on the coils (J)."""
    for n in range(window.shape[1]):
        mean = window[MEAN, n]
        ledger[0] += h * resistance * window[FACTOR, n] * mean * mean
        ledger[1] -= mean * (window[FLUX, n] - window[BEFORE, n])


def enter(surge, gaps, widths, amplitude, track, tail, rows, window):
    """Fill the window from ``tail`` with the cradle at this pose; returns the number of the first coil."""
    to = first_coil(surge, track)
    for n in range(window.shape[1]):
        window[CURRENT, n], window[FLUX, n] = tail[1 + n], 0.0
    move_window(tail[0], to, track, window)
    field_rows(gaps, widths, amplitude, track, rows)
    see_field(surge, to, track, rows, window)
    return to


def leave(first, window, tail):
    """Write the window's currents into ``tail``."""
    tail[0] = first
    for n in range(window.shape[1]):
        tail[1 + n] = window[CURRENT, n]


def step_coils(h, first, surge, gaps, widths, amplitude, circuit, track, rows, window):
    """Carry the currents through a step of ``h`` that ends at this pose; returns the number of the first coil then.

    ``circuit`` is (L, R)."""
    to = first_coil(surge, track)
    if to != first:
        move_window(first, to, track, window)
    for n in range(window.shape[1]):
        window[BEFORE, n] = window[FLUX, n]
    field_rows(gaps, widths, amplitude, track, rows)
    see_field(surge, to, track, rows, window)
    coil_equations(h, circuit[0], circuit[1], track, window)
    solve_band(track[2].size, window)
    for n in range(window.shape[1]):
        window[CURRENT, n] = 2.0 * window[MEAN, n] - window[CURRENT, n]
    return to


def follow_coils(times, surges, gaps, widths, amplitude, circuit, track, tail, out, ledger):
    """Currents under a given path, ``surges`` (n,) and ``gaps`` (n, 3) at ``times`` (n,), a step from each to the next.

    ``tail`` goes from the first to the last; ``out`` (n, 4) gets repulsions and drag; ``ledger`` (n, 3) heat and work
    on the coils so far, and what is stored (J)."""
    rows, window = np.empty((WEIGHTS + 2, track[0].shape[1])), np.zeros((WINDOW, tail.size - 1))
    first = enter(surges[0], gaps[0], widths, amplitude, track, tail, rows, window)
    for k in range(times.size):
        if k == 0:
            ledger[0, 0] = ledger[0, 1] = 0.0
        else:
            h = times[k] - times[k - 1]
            first = step_coils(h, first, surges[k], gaps[k], widths, amplitude, circuit, track, rows, window)
            ledger[k, 0], ledger[k, 1] = ledger[k - 1, 0], ledger[k - 1, 1]
            heat_and_work(h, circuit[1], window, ledger[k])
        ledger[k, 2] = stored_energy(circuit[0], track, window)
        coil_forces(window, out[k])
    leave(first, window, tail)
