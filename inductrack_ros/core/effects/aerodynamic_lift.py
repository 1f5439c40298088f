# SPDX-License-Identifier: Apache-2.0
"""Lift or downforce of the air."""

from . import Parameter, effect


@effect(
    adds="force_heave",
    parameters={
        "lift_area": Parameter(0.0, "m²", -10.0, 10.0, "C_L A; negative is downforce", "textbook", typical=0.01)
    },
)
def aerodynamic_lift(surge_rate, air_density, lift_area):
    """Aerodynamic lift, +½ ρ C_LA v²."""
    return 0.5 * air_density * lift_area * surge_rate * surge_rate
