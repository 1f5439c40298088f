# SPDX-License-Identifier: Apache-2.0
"""A sensor reads too high."""

from . import Parameter, effect


@effect(
    changes="measured",
    parameters={
        "bias": Parameter(
            0.0,
            "",
            -1e3,
            1e3,
            "bias of the reading, in the channel's unit",
            "calibration",
            typical=1.0,
            per_channel="size",
        )
    },
)
def sensor_bias(measured, bias):
    """Biased sensor, measured = true + bias: the sensor, not the cradle."""
    return measured + bias
