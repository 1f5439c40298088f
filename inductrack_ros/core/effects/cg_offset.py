# SPDX-License-Identifier: Apache-2.0
"""The centre of mass is off the middle."""

import math

from . import Parameter, effect


@effect(
    adds="moment_roll",
    parameters={
        "offset": Parameter(
            0.0, "m", -0.1, 0.1, "offset x_cg of the centre of mass, left positive", "loading", typical=2e-4
        )
    },
)
def cg_offset(roll, mass, gravity, offset):
    """Offset centre of mass, M_z −= m a_g x_cg cos θ."""
    return -mass * gravity * offset * math.cos(roll)
