# SPDX-License-Identifier: Apache-2.0
"""Single coils against a second implementation: scipy integrates the circuits, the field is a sum of line charges.

Idea: the package takes the field from an integral over wave numbers, keeps it in a table and steps the circuits by the
trapezoidal rule in a moving window. Here a finite Halbach array is thin sheets of dipoles in space, every coil of a
short track is integrated from beginning to end by an adaptive method, and coupling is a full matrix.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from inductrack_ros.core.coils.averages import level
from inductrack_ros.core.model import Model

WAVELENGTH, PITCH, B0, ETA = 0.1, 0.1 / 13.0, 0.52, 0.7295
K = 2.0 * math.pi / WAVELENGTH
L, R, WIDTHS = 1.8e-6, 1.5e-3, np.array([0.12, 0.08, 0.08])
SPEED, GAPS, SPACING = 17.0, np.array([0.0055, 0.0131, 0.0135]), 0.15
COILS = np.arange(400)
COUPLING = [4e-7, 1e-7]
FAILED, DAMAGED, FACTOR = 180, 200, 4.0


def dipole_flux(z, gap):
    """A (m) of a field of 1 T: dipoles of constant size that turn once in a wavelength, in sheets of a magnet a quarter
    wavelength thick, and the mean over a coil's leg. z (n,) from the middle of an array one wavelength long."""
    z = np.asarray(z)
    along = (np.arange(200) + 0.5) / 200 * WAVELENGTH - WAVELENGTH / 2.0
    depth, weight = np.polynomial.legendre.leggauss(5)
    depth, weight = (depth + 1.0) * WAVELENGTH / 8.0, weight * WAVELENGTH / 8.0
    legs, share = np.polynomial.legendre.leggauss(4)
    total = np.zeros(z.shape)
    for leg, part in zip(legs * PITCH / 2.0, share / 2.0, strict=True):
        for d, w in zip(depth, weight, strict=True):
            place = (z + leg)[:, None] - along + 1j * (gap + d)
            # ∫ e^{iκζ} e^{−iκz'} dκ = i/(ζ − z'): the potential of a dipole at z'
            potential = np.exp(1j * K * along) * 1j / place
            total += part * w * (potential.sum(axis=1) * (along[1] - along[0])).real
    thickness = (1.0 - math.exp(-K * WAVELENGTH / 4.0)) / K
    leg_at_k = math.sin(K * PITCH / 2.0) / (K * PITCH / 2.0)
    return total / (2.0 * math.pi) / thickness / leg_at_k / K


@pytest.fixture(scope="module")
def fluxes():
    """Φ and ∂Φ/∂z, ∂Φ/∂g of the three arrays, by the distance from the middle of the cradle: grid and columns."""
    z, h = np.linspace(-0.5, 0.5, 1601), 1e-5
    grid = z[:, None] + np.array([-0.5, 0.5]) * SPACING
    size = math.sqrt(ETA) * B0

    def sets(gap):
        return size * sum(dipole_flux(grid[:, i], gap) for i in (0, 1))

    flux = sum(w * sets(g) for w, g in zip(WIDTHS, GAPS, strict=True))
    by_gap = [w * (sets(g + h) - sets(g - h)) / (2.0 * h) for w, g in zip(WIDTHS, GAPS, strict=True)]
    return z, np.column_stack([flux, np.gradient(flux, z), *by_gap])


def of(fluxes, where):
    """Columns of ``fluxes`` at distances ``where`` (n,); nothing beyond the grid."""
    z, columns = fluxes
    return np.column_stack([np.interp(where, z, c, left=0.0, right=0.0) for c in columns.T])


def test_forces_are_those_of_circuits_integrated_by_scipy(fluxes):
    inductances = np.eye(COILS.size) * L
    for j, m in enumerate(COUPLING):
        inductances += m * (np.eye(COILS.size, k=j + 1) + np.eye(COILS.size, k=-j - 1))
    whole = COILS != FAILED
    inductances, resistances = inductances[np.ix_(whole, whole)], np.where(COILS == DAMAGED, FACTOR * R, R)[whole]
    inverse, places = np.linalg.inv(inductances), COILS[whole] * PITCH
    times = np.linspace(0.0, 0.06, 241)
    z, slope = fluxes[0], np.ascontiguousarray(fluxes[1][:, 1])
    start = 1.0

    def rates(t, currents):
        # dΦ/dt of a coil over which the cradle moves forward
        induced = -SPEED * np.interp(places - start - SPEED * t, z, slope, left=0.0, right=0.0)
        return inverse @ (-induced - resistances * currents)

    flown = solve_ivp(rates, times[[0, -1]], np.zeros(places.size), t_eval=times, rtol=1e-6, atol=1e-3, max_step=1e-4)
    expected = []
    for t, currents in zip(times, flown.y.T, strict=True):
        columns = of(fluxes, places - start - SPEED * t)
        expected.append([*(currents @ columns[:, 2:]), currents @ columns[:, 1]])
    expected = np.array(expected)

    options = {"array_spacing": SPACING, "mutual_inductance": COUPLING, "failed_coils": [FAILED]}
    options |= {"damaged_coils": [DAMAGED], "damage_factor": FACTOR}
    model = Model.create(track="coils", coil_options=options)
    q = level(model, SPEED, 0.0)
    q[:3] = GAPS
    fine = np.linspace(0.0, 0.06, 60 * 240 // 5 + 1)
    path = model.coils.follow(fine, start + SPEED * fine, np.tile(GAPS, (fine.size, 1)), q)
    found = path.forces[:: (fine.size - 1) // 240]
    assert found.shape == expected.shape
    print(
        np.abs(found - expected).max(axis=0) / np.abs(expected).max(),
        found[60:].mean(axis=0) / expected[60:].mean(axis=0),
    )
    assert np.abs(found - expected).max(axis=0) == pytest.approx(0.0, abs=0.02 * np.abs(expected).max())
    late = slice(60, None)
    assert found[late].mean(axis=0) == pytest.approx(expected[late].mean(axis=0), rel=0.01)
    assert np.ptp(expected[late, 0]) > 0.1 * expected[late, 0].mean()  # the failed coil is seen
