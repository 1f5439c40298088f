# SPDX-License-Identifier: Apache-2.0
"""The pulses that a perfect controller would fire: every coil as the cradle's centre passes it."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from .model import Model, Pulses
from .state import INDEX

#: Below this speed (m/s) a cradle is not driven: the next coil would be out of reach for seconds.
SLOWEST = 0.5


def pulses_of(model: Model, x: np.ndarray, duration: float, current: float) -> Pulses:
    """Pulses of ``current`` (A) for a run of ``duration`` (s) from ``x`` (8 + effect states,) at time 0.

    Coil n stands at n λ/2 and pushes hardest where its half sine peaks as the centre passes (Kim and Ge 2012, section
    2.2), with the sign (−1)ⁿ. Each passage is predicted from the speed at most a pulse before.
    """
    spacing, length = 0.5 * model.parameters["wavelength"], model.parameters["pulse_length"]
    surge, rate = INDEX["surge"], INDEX["surge_rate"]
    origin, time, x = float(x[surge]), 0.0, np.array(x, dtype=float)
    coil = int(np.ceil((x[surge] + 0.5 * length * x[rate]) / spacing))
    times, coils, currents = [], [], []
    while x[rate] > SLOWEST and np.isfinite(x).all():
        wait = (coil * spacing - x[surge]) / x[rate] - 0.5 * length
        if time + wait >= duration:
            break
        if wait > 0.0:
            burning = slice(bisect_left(times, time - length), None)
            recent = Pulses(np.array(times[burning]), np.array(coils[burning]), np.array(currents[burning]))
            until = time + (wait if wait < length else 0.5 * wait)
            x, time = model.advance(x, time, until, 0.0, recent, origin), until
            if wait >= length:
                continue
        times.append(time)
        coils.append(coil)
        currents.append(current if coil % 2 == 0 else -current)
        coil += 1
    return Pulses(np.array(times), np.array(coils, dtype=float), np.array(currents))
