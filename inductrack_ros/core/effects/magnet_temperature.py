# SPDX-License-Identifier: Apache-2.0
"""The magnets are warmer in one run than in another."""

from . import Parameter, effect


@effect(
    changes="peak_field",
    conditions={"magnet_temperature": 20.0},
    parameters={
        "coefficient": Parameter(
            0.0, "1/K", -0.05, 0.05, "temperature coefficient α of the remanence", "NdFeB about −1.1e-3", typical=2e-4
        )
    },
)
def magnet_temperature(peak_field, magnet_temperature, coefficient):
    """Warm magnets, B0 (1 + α(T − 20)), T the run's condition magnet_temperature (°C)."""
    return peak_field * (1.0 + coefficient * (magnet_temperature - 20.0))
