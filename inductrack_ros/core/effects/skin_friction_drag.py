# SPDX-License-Identifier: Apache-2.0
"""Friction of a turbulent boundary layer on the body, the paper's aerodynamic part."""

import math

from . import Parameter, effect

LENGTH = 0.65  # m, body length l of (16)
VISCOSITY = 1.862e-5  # Pa·s, μ of (16)


@effect(
    adds="force_surge",
    parameters={
        "wetted_area": Parameter(
            0.0, "m²", 0.0, 1000.0, "area S the air rubs on", "Kim and Ge (2012), (14)–(16)", typical=1.0
        )
    },
)
def skin_friction_drag(surge_rate, air_density, wetted_area):
    """Skin friction, −C_F ½ρv² S with C_F = 0.455/(log10 Re)^2.58."""
    speed = abs(surge_rate)
    reynolds = air_density * speed * LENGTH / VISCOSITY
    if reynolds < 10.0:  # no turbulent layer at a standstill, and the logarithm must stay positive
        return 0.0
    friction = 0.455 / math.log10(reynolds) ** 2.58
    return -friction * 0.5 * air_density * surge_rate * speed * wetted_area
