"""Names and order of the state and of what a rig can measure.

Vehicle-dynamics words, which need no frame: surge is the travel (paper z), sway the slip (paper x, left positive),
heave the lift (paper y, up), roll the angle about the travel. SI and radians.
"""

from __future__ import annotations

from dataclasses import dataclass

COORDINATES = ("surge", "sway", "heave", "roll")
RATES = tuple(f"{c}_rate" for c in COORDINATES)
STATES = COORDINATES + RATES
GAPS = ("gap_top", "gap_right", "gap_left")
ACCELERATIONS = tuple(f"{c}_acceleration" for c in COORDINATES)

#: Columns of the simulator's output; all but the last can stand in a measured file.
OUTPUTS = STATES + GAPS + ACCELERATIONS
CHANNELS = OUTPUTS[:-1]
INDEX = {name: i for i, name in enumerate(OUTPUTS)}


@dataclass(frozen=True)
class Channel:
    """What is known of a measured channel before any measurement.

    ``unit`` SI; ``noise`` the standard deviation of a good sensor of its kind; ``size`` an error of the reading that
    would matter; ``span`` how far the channel goes on a rig like the paper's, both in ``unit``.
    """

    unit: str
    noise: float
    size: float
    span: float


#: Every column of `OUTPUTS`, declared once.
CHANNEL: dict[str, Channel] = {
    "surge": Channel("m", 5e-4, 1e-4, 10.0),
    "sway": Channel("m", 3e-5, 1e-4, 0.01),
    "heave": Channel("m", 3e-5, 1e-4, 0.01),
    "roll": Channel("rad", 1e-4, 1e-3, 0.1),
    "surge_rate": Channel("m/s", 0.02, 1e-2, 10.0),
    "sway_rate": Channel("m/s", 2e-3, 1e-2, 0.5),
    "heave_rate": Channel("m/s", 2e-3, 1e-2, 0.5),
    "roll_rate": Channel("rad/s", 5e-3, 1e-2, 5.0),
    **dict.fromkeys(GAPS, Channel("m", 3e-5, 1e-4, 0.01)),
    **dict.fromkeys(ACCELERATIONS[:3], Channel("m/s²", 0.05, 0.1, 10.0)),
    "roll_acceleration": Channel("rad/s²", 0.5, 0.1, 100.0),
}
UNITS = {name: channel.unit for name, channel in CHANNEL.items()}
#: Unit of a channel's change per second, by the channel's own.
RATE_UNITS = {"m": "m/s", "rad": "rad/s", "m/s": "m/s²", "rad/s": "rad/s²", "m/s²": "m/s³", "rad/s²": "rad/s³"}

#: Coordinates that move for each number of degrees of freedom; the others are held (1: the speed is held too).
class _Moving(dict[int | tuple[str, ...], tuple[str, ...]]):
    """By number of degrees of freedom, or by the names themselves."""

    def __missing__(self, names: int | tuple[str, ...]) -> tuple[str, ...]:
        if not isinstance(names, tuple):
            raise KeyError(names)
        return names


MOVING = _Moving({1: ("heave",), 2: ("surge", "heave"), 4: COORDINATES})


def as_dof(value: object) -> int | tuple[str, ...] | None:
    """What moves as `Model.dof` has it: 1, 2, 4 or names in canonical order; None for anything else.

    ``value``: 1, 2, 4 or a list of different coordinates; a list that is one of those numbers becomes it.
    """
    if isinstance(value, (list, tuple)):
        if not value or any(v not in COORDINATES for v in value) or len(set(value)) < len(value):
            return None
        names = tuple(c for c in COORDINATES if c in value)
        return next((number for number in tuple(MOVING) if MOVING[number] == names), names)
    return value if type(value) is int and value in MOVING else None

