# SPDX-License-Identifier: Apache-2.0
"""A Halbach array of blocks has a fifth harmonic."""

import math

from . import Parameter, effect


@effect(
    changes=("overlap_top", "overlap_right", "overlap_left"),
    parameters={
        "relative_amplitude": Parameter(
            0.0, "", -1.0, 1.0, "relative amplitude ε of the harmonic", "Halbach (1980)", typical=0.005
        )
    },
)
def halbach_fifth_harmonic(
    overlap_top, overlap_right, overlap_left, gap_top, gap_right, gap_left, wave_number, relative_amplitude
):
    """Fifth harmonic of the field, e_i (1 + ε exp(−4 k g_i))."""
    steep = -4.0 * wave_number
    return (
        overlap_top * (1.0 + relative_amplitude * math.exp(steep * gap_top)),
        overlap_right * (1.0 + relative_amplitude * math.exp(steep * gap_right)),
        overlap_left * (1.0 + relative_amplitude * math.exp(steep * gap_left)),
    )
