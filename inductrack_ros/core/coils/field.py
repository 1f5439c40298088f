# SPDX-License-Identifier: Apache-2.0
"""The field of a finite Halbach array, as a table of the flux that it sends through a coil.

Kim and Ge's (1), (2) are those of an endless array: B = B0 e^{−kg} at the gap g. One of length ℓ whose magnetisation
turns once in a wavelength has the flux per width, in the plane along the track (z from the array's middle, g its gap)::

    A(z, g) = 1/k Re ∫₀^∞ T(κ)/T(k) · W(κ − k) e^{iκz − κg} dκ,    T(κ) = (1 − e^{−κd})/κ,  W(q) = sin(qℓ/2)/(πq)

W is the window that cuts the array off and T the sum over its thickness d. With ℓ → ∞ this is (B0/k) e^{−kg} cos kz,
for B0 = 1 T. Both A and its derivatives, the field, obey Maxwell's equations in the air. The legs of neighbouring coils
touch, so a coil takes the mean over one pitch (normalised at k, where B0 is defined).

The table holds coefficients of cubic B-splines in z and g. Forces are the derivatives of the same splines, so that no
energy is lost to interpolation."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Thickness of the magnets over the wavelength: four magnets in a wavelength, as high as they are long.
THICKNESS = 0.25
#: How far the table reaches past the array's ends, and the last part of it in which the flux is led to zero, over the
#: wavelength. What is cut off is 1 % of the flux in the middle, and 5e-4 of forces.
MARGIN, FADE = 2.0, 1.0
#: Knots of the table: to a wavelength along the track, and across it from FIRST_GAP over GAPS steps of GAP_STEP (over
#: the wavelength). Outside of these gaps the field goes on as e^{−kg}.
KNOTS, FIRST_GAP, GAP_STEP, GAPS = 40, -0.01, 0.01, 33
#: Highest wave number of the integral over k, and its steps in 2π over the table's length.
HIGHEST, FINENESS = 20.0, 12


@dataclass(frozen=True)
class FieldTable:
    """B-spline coefficients of A (m, for a field of 1 T), (gaps, places), and where its knots stand.

    The flux at place z is made of coefficients j … j+3 with j = floor((z − first_place)/place_step), likewise across.
    ``reach`` is where it ends, from the array's middle (m).
    """

    coefficients: Array
    first_place: float
    place_step: float
    first_gap: float
    gap_step: float
    reach: float


def flux_per_width(
    places: np.ndarray, gaps: np.ndarray, wavelength: float, wavelengths: float, pitch: float, power: int = 0
) -> Array:
    """A (m) for a field of 1 T at ``places`` (n,) from the array's middle and ``gaps`` (m,), both in m: (n, m).

    ``power`` 1 gives −∂A/∂g instead, 2 the second derivative. The coils' legs are one ``pitch`` (m) wide.
    """
    k, length = 2.0 * np.pi / wavelength, wavelengths * wavelength
    step = 2.0 * np.pi / (FINENESS * (length + 2.0 * MARGIN * wavelength))
    kappa = (np.arange(round(HIGHEST * k / step)) + 0.5) * step

    def thickness(wave_number: np.ndarray | float) -> np.ndarray | float:
        return (1.0 - np.exp(-wave_number * THICKNESS * wavelength)) / wave_number

    def leg(wave_number: np.ndarray | float) -> np.ndarray | float:
        return np.sinc(wave_number * pitch / (2.0 * np.pi))

    window = length / (2.0 * np.pi) * np.sinc((kappa - k) * length / (2.0 * np.pi))
    density = thickness(kappa) / thickness(k) * leg(kappa) / leg(k) * window * step / k
    across = np.exp(-kappa[:, None] * np.asarray(gaps)[None]) * (density * kappa**power)[:, None]
    return np.cos(np.asarray(places)[:, None] * kappa[None]) @ across


@functools.lru_cache(maxsize=8)
def field_table(wavelength: float, wavelengths: float, pitch: float) -> FieldTable:
    """The table of one set of arrays. A pure function of three numbers: what it returns cannot be written to."""
    half = 0.5 * wavelengths * wavelength
    count = int(np.ceil((half + MARGIN * wavelength) * KNOTS / wavelength))
    step = wavelength / KNOTS
    places = step * np.arange(-count, count + 1)
    gap_step, first = GAP_STEP * wavelength, FIRST_GAP * wavelength
    gaps = first + gap_step * np.arange(GAPS + 1)
    beyond = np.clip((np.abs(places) - (count * step - FADE * wavelength)) / (FADE * wavelength), 0.0, 1.0)
    fade = 1.0 - beyond**3 * (10.0 - 15.0 * beyond + 6.0 * beyond**2)
    values = fade[:, None] * flux_per_width(places, gaps, wavelength, wavelengths, pitch)
    ends = fade[:, None] * flux_per_width(places, gaps[[0, -1]], wavelength, wavelengths, pitch, power=2)
    along = np.linalg.solve(_spline_matrix(len(places)), values)  # zero beyond both ends
    ends = np.linalg.solve(_spline_matrix(len(places)), ends)
    system = np.zeros((GAPS + 3, GAPS + 3))
    system[1:-1, :-2] += np.eye(GAPS + 1) / 6.0
    system[1:-1, 1:-1] += np.eye(GAPS + 1) * (2.0 / 3.0)
    system[1:-1, 2:] += np.eye(GAPS + 1) / 6.0
    system[0, :3] = system[-1, -3:] = np.array([1.0, -2.0, 1.0]) / gap_step**2
    right = np.vstack([ends[:, 0], along.T, ends[:, 1]])
    inner = np.linalg.solve(system, right)
    coefficients = np.zeros((GAPS + 3, len(places) + 6))
    coefficients[:, 3:-3] = inner
    coefficients.flags.writeable = False
    # Three zeros at each end: a spline reaches two knots past the last place.
    return FieldTable(coefficients, places[0] - 2.0 * step, step, first, gap_step, places[-1] + 2.0 * step)


def _spline_matrix(n: int) -> Array:
    """Values at n knots from as many coefficients of cubic B-splines."""
    return np.eye(n) * (2.0 / 3.0) + (np.eye(n, k=1) + np.eye(n, k=-1)) / 6.0
