# SPDX-License-Identifier: Apache-2.0
"""The magnets sit on an elastic frame: two more states."""

import math

from . import Parameter, Part, effect

#: Above this frequency (Hz) the frame gives way by less than 10 nm to 10 g, and counts as rigid.
STIFF = 1e4


def body_on_frame(force_heave, mass, offset, offset_rate, frequency, damping_ratio, mass_ratio):
    """Force that reaches the body, m·μ·s, and the frame's own motion, p̈ = F/(μm) − s."""
    if frequency > STIFF:
        return force_heave, 0.0, 0.0
    omega = 2.0 * math.pi * frequency
    pull = omega * omega * offset + 2.0 * damping_ratio * omega * offset_rate
    return mass * mass_ratio * pull, offset_rate, force_heave / (mass_ratio * mass) - pull


def modes(ranges):
    """Modes from below the heave's to above what sensors of 250 Hz show, about as near to each other as their
    resonances are wide."""
    return [{"frequency": 5.0 * 1.15**i, "damping_ratio": 0.03, "mass_ratio": 0.35} for i in range(24)]


@effect(
    changes=("track_height", "track_height_rate"),
    then=Part(body_on_frame, changes=("force_heave",)),
    states={"offset": 0.0, "offset_rate": 0.0},
    starts=modes,
    parameters={
        "frequency": Parameter(
            math.inf,
            "Hz",
            1.0,
            math.inf,
            "frequency f of the frame on a body that is held",
            "modal survey",
            typical=60.0,
            fit_as="1/x^2",
        ),
        "damping_ratio": Parameter(0.03, "", 0.0, 2.0, "damping ratio ζ", "modal survey", typical=0.01),
        "mass_ratio": Parameter(
            0.3, "", 0.01, 1.0, "part μ of the mass that is on the frame", "weighing", typical=0.05
        ),
    },
)
def flexible_mode(track_height, track_height_rate, offset, offset_rate):
    """Elastic frame of mass μm, gaps use heave + p; with s = (2πf)² p + 2ζ(2πf) ṗ the body has ÿ = μ s, the frame p̈ =
    F/(μm) − s."""
    return track_height - offset, track_height_rate - offset_rate
