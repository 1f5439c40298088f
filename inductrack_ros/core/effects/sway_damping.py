# SPDX-License-Identifier: Apache-2.0
"""Linear damping of sway."""

from . import Parameter, effect


@effect(
    adds="force_sway",
    parameters={"coefficient": Parameter(0.0, "N·s/m", 0.0, 1e4, "damping coefficient c", "textbook", typical=2.0)},
)
def sway_damping(sway_rate, coefficient):
    """Damping of sway, −c v."""
    return -coefficient * sway_rate
