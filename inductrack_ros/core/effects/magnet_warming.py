# SPDX-License-Identifier: Apache-2.0
"""The magnets lose strength as they warm."""

from . import Parameter, effect


@effect(
    changes="peak_field",
    parameters={
        "rate": Parameter(
            0.0, "1/s", -1.0, 1.0, "relative loss per time β", "remanence falls with temperature", typical=0.005
        )
    },
)
def magnet_warming(peak_field, time, rate):
    """Warming magnets, B0 (1 − β t), t from the run's start."""
    return peak_field * (1.0 - rate * time)
