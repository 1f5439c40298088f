# SPDX-License-Identifier: Apache-2.0
"""A sensor follows what it measures slowly."""

from . import Parameter, effect


@effect(
    changes="measured",
    parameters={
        "time_constant": Parameter(0.0, "s", 0.0, 1.0, "time constant τ of the reading", "filters", typical=1e-3)
    },
    states={"reading": "measured"},
)
def sensor_lag(measured, reading, time_constant):
    """Sensor with a lag, the reading r follows τ dr/dt = true − r; settled at the run's start."""
    if time_constant <= 0.0:
        return measured, 0.0
    return reading, (measured - reading) / time_constant
