# SPDX-License-Identifier: Apache-2.0
"""The field turns while a pulse lasts."""

import math

from . import effect


@effect(changes="thrust", only="averaged")
def finite_pulse_width(thrust, omega, pulse_length):
    """Pulse of finite length, F_drive cos(ωτ/2)/(1 − (ωτ/π)²)."""
    phase = omega * pulse_length / math.pi
    if abs(phase - 1.0) < 1e-6:  # the limit, where numerator and denominator both vanish
        return thrust * math.pi / 4.0
    return thrust * math.cos(0.5 * omega * pulse_length) / (1.0 - phase * phase)
