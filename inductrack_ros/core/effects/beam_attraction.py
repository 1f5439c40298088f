# SPDX-License-Identifier: Apache-2.0
"""Steel under the track pulls the magnets down."""

import math

from . import Parameter, effect


@effect(
    adds="force_heave",
    parameters={
        "force": Parameter(0.0, "N", 0.0, 1e5, "pull F_0 at zero gap", "image force of a magnet array", typical=2.0)
    },
)
def beam_attraction(gap_top, wave_number, force):
    """Attraction by a steel beam, F_y −= F_0 exp(−2 k g_1)."""
    return -force * math.exp(-2.0 * wave_number * gap_top)
