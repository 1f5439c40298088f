# SPDX-License-Identifier: Apache-2.0
"""A sensor reads no further than its range."""

import math

import numpy as np

from . import Parameter, effect


def _piled_up(readings):
    """Where the largest readings lie, half of the largest fiftieth on either side."""
    size = np.sort(np.abs(readings))
    return [{"limit": float(np.median(size[-max(len(size) // 50, 1) :]))}]


@effect(
    changes="measured",
    starts=_piled_up,
    parameters={
        "limit": Parameter(
            math.inf,
            "",
            1e-9,
            math.inf,
            "largest reading, in the channel's unit",
            "data sheets",
            typical=1.0,
            fit_as="1/x",
            per_channel="span",
        )
    },
)
def sensor_saturation(measured, limit):
    """Saturated sensor, measured = true clipped to ± limit."""
    return min(max(measured, -limit), limit)
