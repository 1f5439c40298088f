# SPDX-License-Identifier: Apache-2.0
"""The drive's capacitor empties pulse by pulse."""

from . import Parameter, effect


@effect(
    changes="thrust",
    parameters={
        "fraction_per_pulse": Parameter(
            0.0, "", 0.0, 0.5, "fraction δ of the thrust lost with each pulse", "supply of limited charge", typical=2e-4
        )
    },
)
def drive_droop(thrust, travel, wavelength, fraction_per_pulse):
    """Drooping drive, F_drive (1 − δ)^n after n = 2·travel/λ pulses."""
    return thrust * (1.0 - fraction_per_pulse) ** (2.0 * travel / wavelength)
