# SPDX-License-Identifier: Apache-2.0
"""Linear damping of heave."""

from . import Parameter, effect


@effect(
    adds="force_heave",
    parameters={"coefficient": Parameter(0.0, "N·s/m", 0.0, 1e4, "damping coefficient c", "textbook", typical=2.0)},
)
def heave_damping(heave_rate, coefficient):
    """Damping of heave, −c v."""
    return -coefficient * heave_rate
