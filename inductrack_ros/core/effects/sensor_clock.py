# SPDX-License-Identifier: Apache-2.0
"""A sensor's clock is fast or slow."""

from . import Parameter, effect


@effect(
    changes="sample_time",
    parameters={
        "rate": Parameter(0.0, "", -0.1, 0.1, "relative error ε of the sensor's clock", "oscillators", typical=1e-4)
    },
)
def sensor_clock(sample_time, rate):
    """Wrong clock of a sensor, measured(t) = true((1 + ε)t), t from the run's start."""
    return (1.0 + rate) * sample_time
