"""A sensor reads no further than its range."""

import math

from . import Parameter, effect


@effect(
    changes="measured",
    screened=False,
    parameters={
        "limit": Parameter(
            math.inf, "", 1e-9, math.inf, "largest reading, in the channel's unit", "data sheets", typical=1.0, fit_as="1/x", per_channel="span"
        )
    },
)
def sensor_saturation(measured, limit):
    """Saturated sensor, measured = true clipped to ± limit."""
    return min(max(measured, -limit), limit)
