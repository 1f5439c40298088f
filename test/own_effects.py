# SPDX-License-Identifier: Apache-2.0
"""Effects of a user, for several tests: a model is compiled once for each set of files, which takes 15 s."""

import math

from inductrack_ros.core.effects import Parameter, effect


@effect(adds="force_heave", parameters={"size": Parameter(20.0, "N", 0.0, 100.0, "pull", "test")})
def patch(surge, size):
    """A magnetised patch 5 m along the track."""
    return -size * math.exp(-(((surge - 5.0) / 0.4) ** 2))


@effect(changes="thrust", states={"built_up": "thrust"})
def slow_drive(thrust, built_up):
    """A thrust that follows the averaged law with a lag of 0.5 s: what it starts on shows for long."""
    return built_up, 2.0 * (thrust - built_up)


@effect(
    changes="resistance",
    parameters={"coefficient": Parameter(0.004, "1/K", -1.0, 1.0, "change", "guess", typical=1e-3)},
    conditions={"track_temperature": 20.0},
)
def warm_track(resistance, coefficient, track_temperature):
    """Resistance of a warm track."""
    return resistance * (1.0 + coefficient * (track_temperature - 20.0))
