# SPDX-License-Identifier: Apache-2.0
"""Current crowds to the conductor's skin at high frequency."""

import math

from . import Parameter, effect


@effect(
    changes="resistance",
    parameters={
        "corner_frequency": Parameter(
            math.inf,
            "Hz",
            1.0,
            math.inf,
            "frequency f_s at which the resistance doubles",
            "textbook",
            typical=1500.0,
            fit_as="1/x^2",
        )
    },
)
def skin_effect(resistance, surge_rate, wavelength, corner_frequency):
    """Skin effect, R (1 + (f/f_s)²) with f = k v/2π."""
    return resistance * (1.0 + (surge_rate / (wavelength * corner_frequency)) ** 2)
