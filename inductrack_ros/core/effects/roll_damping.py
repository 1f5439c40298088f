# SPDX-License-Identifier: Apache-2.0
"""Linear damping of roll."""

from . import Parameter, effect


@effect(
    adds="moment_roll",
    parameters={
        "coefficient": Parameter(0.0, "N·m·s/rad", 0.0, 100.0, "damping coefficient c", "textbook", typical=0.02)
    },
)
def roll_damping(roll_rate, coefficient):
    """Damping of roll, −c θ̇."""
    return -coefficient * roll_rate
