# SPDX-License-Identifier: Apache-2.0
"""A sensor lags."""

from . import Parameter, effect


@effect(
    changes="sample_time",
    parameters={
        "delay": Parameter(0.0, "s", -0.05, 0.05, "how late the reading is", "filters and buses", typical=1e-3)
    },
)
def sensor_delay(sample_time, delay):
    """Late sensor, measured(t) = true(t − delay)."""
    return sample_time - delay
