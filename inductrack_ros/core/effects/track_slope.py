# SPDX-License-Identifier: Apache-2.0
"""The track climbs."""

import math

from . import Parameter, effect


@effect(
    adds=("force_surge", "force_heave"),
    parameters={"angle": Parameter(0.0, "rad", -0.5, 0.5, "slope α, up positive", "geometry", typical=0.002)},
)
def track_slope(mass, gravity, angle):
    """A sloping track, F_z −= m a_g sin α, and the weight becomes m a_g cos α."""
    weight = mass * gravity
    return -weight * math.sin(angle), weight * (1.0 - math.cos(angle))
