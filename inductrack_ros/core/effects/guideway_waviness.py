# SPDX-License-Identifier: Apache-2.0
"""The track undulates along its length."""

import math

from . import Parameter, effect


def upright(values):
    """The same wave with an amplitude that is not negative and a phase within half a turn."""
    turn = values["phase"] + (math.pi if values["amplitude"] < 0 else 0.0)
    return {**values, "amplitude": abs(values["amplitude"]), "phase": math.remainder(turn, 2 * math.pi)}


@effect(
    changes=("track_height", "track_height_rate"),
    max_travel="wavelength",
    canonical=upright,
    parameters={
        "amplitude": Parameter(0.0, "m", -0.01, 0.01, "amplitude a", "guideway survey", typical=5e-5),
        "wavelength": Parameter(1.0, "m", 0.02, 100.0, "wavelength Λ", "guideway survey", typical=0.05, fit_from=0.1),
        "phase": Parameter(0.0, "rad", -10.0, 10.0, "phase φ", "guideway survey", typical=0.1),
    },
)
def guideway_waviness(track_height, track_height_rate, surge, surge_rate, amplitude, wavelength, phase):
    """A wavy guideway, the track's height is a·sin(2πz/Λ + φ)."""
    k = 2.0 * math.pi / wavelength
    return (
        track_height + amplitude * math.sin(k * surge + phase),
        track_height_rate + amplitude * k * math.cos(k * surge + phase) * surge_rate,
    )
