# SPDX-License-Identifier: Apache-2.0
"""A user's own effect: a magnetised patch under the track, as the diagnosis of an unknown misfit suggested it."""

import math

from inductrack_ros.core.effects import Parameter, effect


@effect(
    adds="force_heave",
    parameters={
        "force": Parameter(0.0, "N", -1000.0, 1000.0, "pull at the patch's middle", typical=5.0),
        "place": Parameter(8.0, "m", 0.0, 100.0, "the patch's middle along the track", typical=0.1),
        "width": Parameter(0.5, "m", 0.05, 10.0, "where the pull has fallen to 1/e", typical=0.05),
    },
)
def magnetised_patch(surge, force, place, width):
    """Magnetised patch, −F exp(−((z − z0)/w)²)."""
    return -force * math.exp(-(((surge - place) / width) ** 2))
