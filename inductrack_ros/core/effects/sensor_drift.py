# SPDX-License-Identifier: Apache-2.0
"""A sensor's zero wanders."""

from . import Parameter, effect


@effect(
    changes="measured",
    parameters={
        "rate": Parameter(
            0.0,
            "1/s",
            -1e3,
            1e3,
            "drift of the reading, in the channel's unit per second",
            "warming up",
            typical=1.0,
            per_channel="size",
        )
    },
)
def sensor_drift(measured, time, rate):
    """Drifting sensor, measured = true + rate·t, t from the run's start."""
    return measured + rate * time
