# SPDX-License-Identifier: Apache-2.0
"""The sensors of sway and heave are turned against the track."""

import math

from . import Parameter, effect


@effect(
    changes=("measured_sway", "measured_heave", "measured_sway_rate", "measured_heave_rate"),
    parameters={
        "angle": Parameter(0.0, "rad", -0.5, 0.5, "angle α by which the sensors are turned", "mounting", typical=1e-3)
    },
)
def sensor_misalignment(measured_sway, measured_heave, measured_sway_rate, measured_heave_rate, angle):
    """Turned sensors, sway′ = sway cos α + heave sin α, heave′ = heave cos α − sway sin α; their rates alike."""
    c, s = math.cos(angle), math.sin(angle)
    return (
        measured_sway * c + measured_heave * s,
        measured_heave * c - measured_sway * s,
        measured_sway_rate * c + measured_heave_rate * s,
        measured_heave_rate * c - measured_sway_rate * s,
    )
