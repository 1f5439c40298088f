# SPDX-License-Identifier: Apache-2.0
"""Drag proportional to speed."""

from . import Parameter, effect


@effect(
    adds="force_surge",
    parameters={"coefficient": Parameter(0.0, "N·s/m", 0.0, 1000.0, "drag per speed c", "textbook", typical=0.1)},
)
def viscous_drag(surge_rate, coefficient):
    """Viscous drag, −c v."""
    return -coefficient * surge_rate
