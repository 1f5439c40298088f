# SPDX-License-Identifier: Apache-2.0
"""Names and order of the state and of what a rig can measure; channels beside the motion are declared in `channels`.

Vehicle-dynamics words, which need no frame: surge is the travel (paper z), sway the slip (paper x, left positive),
heave the lift (paper y, up), roll the angle about the travel. SI and radians.
"""

from __future__ import annotations

from typing import TypeAlias

from .channels import Channel, Instrument, declared, instruments

COORDINATES = ("surge", "sway", "heave", "roll")
RATES = tuple(f"{c}_rate" for c in COORDINATES)
STATES = COORDINATES + RATES
GAPS = ("gap_top", "gap_right", "gap_left")
ACCELERATIONS = tuple(f"{c}_acceleration" for c in COORDINATES)

#: Columns of every simulated run.
MOTION = STATES + GAPS + ACCELERATIONS
_DECLARED = declared((*MOTION, "pose", "twist", "imu", "pulses", "time", "drive_current"))
#: Channels beside the motion, each declared in a file of its own, see `channels`.
FURTHER = tuple(_DECLARED)
#: Columns that a simulated run may have; all but the roll's acceleration can stand in a measured file.
OUTPUTS = MOTION + FURTHER
CHANNELS = tuple(name for name in OUTPUTS if name != "roll_acceleration")
INDEX = {name: i for i, name in enumerate(OUTPUTS)}
#: What may jump where the cradle touches the track.
JUMPING = ACCELERATIONS + FURTHER


def _channel(unit: str, noise: float, size: float, span: float, title: str, thousandths: bool = False) -> Channel:
    return Channel(unit, noise, size, span, title, (1e3, f"m{unit}") if thousandths else (1.0, unit))


_OF_MOTION: dict[str, Channel] = {
    "surge": _channel("m", 5e-4, 1e-4, 10.0, "Travel (surge)"),
    "sway": _channel("m", 3e-5, 1e-4, 0.01, "Sway", thousandths=True),
    "heave": _channel("m", 3e-5, 1e-4, 0.01, "Heave", thousandths=True),
    "roll": _channel("rad", 1e-4, 1e-3, 0.1, "Roll", thousandths=True),
    "surge_rate": _channel("m/s", 0.02, 1e-2, 10.0, "Surge speed"),
    "sway_rate": _channel("m/s", 2e-3, 1e-2, 0.5, "Sway speed", thousandths=True),
    "heave_rate": _channel("m/s", 2e-3, 1e-2, 0.5, "Heave speed", thousandths=True),
    "roll_rate": _channel("rad/s", 5e-3, 1e-2, 5.0, "Roll speed", thousandths=True),
    **{
        f"gap_{side}": _channel("m", 3e-5, 1e-4, 0.01, f"{side.capitalize()} gap", thousandths=True)
        for side in ("top", "right", "left")
    },
    **{
        a: _channel("m/s²", 0.05, 0.1, 10.0, f"{c.capitalize()} acceleration")
        for c, a in zip(COORDINATES[:3], ACCELERATIONS, strict=False)
    },
    "roll_acceleration": _channel("rad/s²", 0.5, 0.1, 100.0, "Roll acceleration"),
}
#: Every column of `OUTPUTS`, declared once: here, or where a further channel is.
CHANNEL: dict[str, Channel] = _OF_MOTION | _DECLARED
UNITS = {name: channel.unit for name, channel in CHANNEL.items()}
#: Unit of a channel's change per second, by the channel's own.
RATE_UNITS = {"m": "m/s", "rad": "rad/s", "m/s": "m/s²", "rad/s": "rad/s²", "m/s²": "m/s³", "rad/s²": "rad/s³"}
RATE_UNITS |= {
    CHANNEL[name].unit: f"{CHANNEL[name].unit}/s" for name in FURTHER if CHANNEL[name].unit not in RATE_UNITS
}


#: The rig's sensors by the name that their topics and parameters bear, declared once.
INSTRUMENTS: dict[str, Instrument] = {
    "pose": Instrument(COORDINATES, "geometry_msgs/msg/PoseStamped", 500.0),
    "twist": Instrument(RATES, "geometry_msgs/msg/TwistStamped", 500.0),
    "imu": Instrument(ACCELERATIONS[:3], "sensor_msgs/msg/Imu", 100.0),
    **{gap: Instrument((gap,), "sensor_msgs/msg/Range", 100.0) for gap in GAPS},
} | instruments(_DECLARED)
#: The sensors that deliver further channels.
FURTHER_SENSORS = tuple(instruments(_DECLARED))


#: What moves: a number of degrees of freedom, or names of coordinates.
Dof: TypeAlias = int | tuple[str, ...]


#: Coordinates that move for each number of degrees of freedom; the others are held (1: the speed is held too).
class _Moving(dict[Dof, tuple[str, ...]]):
    """By number of degrees of freedom, or by the names themselves."""

    def __missing__(self, names: Dof) -> tuple[str, ...]:
        if not isinstance(names, tuple):
            raise KeyError(names)
        return names


MOVING = _Moving({1: ("heave",), 2: ("surge", "heave"), 4: COORDINATES})


def as_dof(value: object) -> Dof | None:
    """What moves as `Model.dof` has it: 1, 2, 4 or names in canonical order; None for anything else.

    ``value``: 1, 2, 4 or a list of different coordinates; a list that is one of those numbers becomes it.
    """
    if isinstance(value, (list, tuple)):
        if not value or any(v not in COORDINATES for v in value) or len(set(value)) < len(value):
            return None
        names = tuple(c for c in COORDINATES if c in value)
        return next((number for number in tuple(MOVING) if MOVING[number] == names), names)
    return value if type(value) is int and value in MOVING else None
