# SPDX-License-Identifier: Apache-2.0
"""A stretch of the track where coils are broken or missing."""

import math

from . import Parameter, effect


def places(ranges):
    """Every third of a magnet array along what the runs pass."""
    low, high = ranges["surge"]
    count = max(2, math.ceil((high - low) / 0.2))
    return [{"place": low + (i + 0.5) * (high - low) / count} for i in range(count)]


@effect(
    changes=("repulsion_top", "repulsion_right", "repulsion_left", "magnetic_drag"),
    starts=places,
    parameters={
        "place": Parameter(5.0, "m", -1e4, 1e4, "middle z_d of the stretch", "track survey", typical=0.05),
        "fraction": Parameter(
            0.0, "", 0.0, 1.0, "fraction f of the coils under the arrays that is dead", "track survey", typical=0.02
        ),
    },
)
def dead_coils(repulsion_top, repulsion_right, repulsion_left, magnetic_drag, surge, array_length, place, fraction):
    """Dead coils, lift and drag × (1 − f·½(1 + cos(2π(z − z_d)/ℓ))) for |z − z_d| < ℓ/2, ℓ the arrays' length."""
    away = (surge - place) / array_length
    if abs(away) >= 0.5:
        return repulsion_top, repulsion_right, repulsion_left, magnetic_drag
    left = 1.0 - fraction * 0.5 * (1.0 + math.cos(2.0 * math.pi * away))
    return repulsion_top * left, repulsion_right * left, repulsion_left * left, magnetic_drag * left
