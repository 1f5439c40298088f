# SPDX-License-Identifier: Apache-2.0
"""The moving magnets' voltage opposes the drive."""

import math

from . import Parameter, effect


@effect(
    changes="thrust",
    parameters={
        "cutoff_speed": Parameter(
            math.inf,
            "m/s",
            1.0,
            math.inf,
            "speed v_b at which no thrust is left",
            "supply of limited voltage",
            typical=300.0,
            fit_as="1/x",
        )
    },
)
def drive_back_emf(thrust, surge_rate, cutoff_speed):
    """Back-EMF of the drive, F_drive max(1 − v/v_b, 0)."""
    return thrust * max(1.0 - surge_rate / cutoff_speed, 0.0)
