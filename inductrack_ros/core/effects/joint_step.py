# SPDX-License-Identifier: Apache-2.0
"""Two pieces of the track that do not meet at one height."""

import math

from . import Parameter, effect

#: Half the length (m) over which the height changes.
LENGTH = 0.05


def places(ranges):
    """Every fifth of a metre of what the runs pass."""
    low, high = ranges["surge"]
    count = max(2, math.ceil((high - low) / 0.2))
    return [{"place": low + (i + 0.5) * (high - low) / count} for i in range(count)]


@effect(
    changes=("track_height", "track_height_rate"),
    starts=places,
    parameters={
        "height": Parameter(0.0, "m", -0.01, 0.01, "height h that the track gains", "track survey", typical=5e-5),
        "place": Parameter(5.0, "m", -1e4, 1e4, "where the joint is, z_j", "track survey", typical=0.05),
    },
)
def joint_step(track_height, track_height_rate, surge, surge_rate, height, place):
    """A step at a joint, the track's height gains h·½(1 + tanh((z − z_j)/0.05 m))."""
    shape = math.tanh((surge - place) / LENGTH)
    slope = height * 0.5 * (1.0 - shape * shape) / LENGTH
    return track_height + height * 0.5 * (1.0 + shape), track_height_rate + slope * surge_rate
