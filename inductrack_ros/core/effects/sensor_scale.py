# SPDX-License-Identifier: Apache-2.0
"""A sensor's scale is wrong."""

from . import Parameter, effect


@effect(
    changes="measured",
    parameters={"scale": Parameter(1.0, "", -10.0, 10.0, "reading per true value", "calibration", typical=0.01)},
)
def sensor_scale(measured, scale):
    """Wrong scale of a sensor, measured = scale · true."""
    return scale * measured
