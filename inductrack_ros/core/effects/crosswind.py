# SPDX-License-Identifier: Apache-2.0
"""A steady push from the side."""

from . import Parameter, effect


@effect(
    adds="force_sway",
    parameters={"force": Parameter(0.0, "N", -1e4, 1e4, "side force, left positive", "weather", typical=0.5)},
)
def crosswind(force):
    """Crosswind, F_x += F."""
    return force
