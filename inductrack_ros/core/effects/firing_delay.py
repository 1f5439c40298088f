# SPDX-License-Identifier: Apache-2.0
"""The drive fires late."""

import math

from . import Parameter, effect


@effect(
    changes="thrust",
    only="averaged",
    parameters={
        "delay": Parameter(0.0, "s", 0.0, 0.01, "delay δ of each pulse", "geometry of (39)", typical=2e-4, fit_as="x^2")
    },
)
def firing_delay(thrust, omega, delay):
    """Late firing, F_drive cos(ωδ)."""
    return thrust * math.cos(omega * delay)
