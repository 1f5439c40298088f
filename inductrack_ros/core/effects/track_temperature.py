# SPDX-License-Identifier: Apache-2.0
"""The track's coils are warmer in one run than in another."""

from . import Parameter, effect


@effect(
    changes="resistance",
    conditions={"track_temperature": 20.0},
    parameters={
        "coefficient": Parameter(
            0.0,
            "1/K",
            -0.05,
            0.05,
            "temperature coefficient α of the resistance",
            "copper 3.9e-3, aluminium 4.0e-3",
            typical=1e-3,
        )
    },
)
def track_temperature(resistance, track_temperature, coefficient):
    """A warm track, R (1 + α(T − 20)), T the run's condition track_temperature (°C)."""
    return resistance * (1.0 + coefficient * (track_temperature - 20.0))
