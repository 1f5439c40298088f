# SPDX-License-Identifier: Apache-2.0
"""Air resistance of the body."""

from . import Parameter, effect


@effect(
    adds="force_surge",
    parameters={"drag_area": Parameter(0.0, "m²", 0.0, 10.0, "C_d A of the body", "textbook", typical=0.01)},
)
def aerodynamic_drag(surge_rate, air_density, drag_area):
    """Air drag, −½ ρ C_dA v|v|."""
    return -0.5 * air_density * drag_area * surge_rate * abs(surge_rate)
