# SPDX-License-Identifier: Apache-2.0
"""The side arrays are not alike."""

from . import Parameter, effect


@effect(
    changes=("width_right", "width_left"),
    parameters={
        "relative_difference": Parameter(
            0.0, "", -0.9, 0.9, "relative difference ε of the side arrays", "tolerance", typical=0.005
        )
    },
)
def array_asymmetry(width_right, width_left, relative_difference):
    """Unequal side arrays, w_2 (1 − ε) and w_3 (1 + ε)."""
    return width_right * (1.0 - relative_difference), width_left * (1.0 + relative_difference)
