# SPDX-License-Identifier: Apache-2.0
"""The units in which people write lengths, angles, times and currents: what one of each is in SI, and its name."""

from __future__ import annotations

from collections.abc import Mapping

from numpy import pi

LENGTHS = ((1e-3, "mm"), (1e-2, "cm"), (0.0254, "inches"), (0.3048, "feet"), (1e3, "km"))
#: Looked for where none of the others fits.
SMALL_LENGTHS = ((2.54e-5, "thousandths of an inch"), (1e-6, "µm"))
ANGLES = ((pi / 180.0, "degrees"), (1e-3, "mrad"))
TIMES = (
    *((1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"), (60.0, "min"), (3600.0, "h"), (86400.0, "days")),
    *((0.1, "tenths of a second"), (0.01, "hundredths of a second")),
)
CURRENTS = ((1e3, "kA"), (1e-3, "mA"))
#: Units in which a channel of this SI unit may be written.
WRITTEN_IN: Mapping[str, tuple[tuple[float, str], ...]] = {
    "m": tuple(length for length in (*LENGTHS, *SMALL_LENGTHS) if length[0] < 0.1),  # as small as noise is
    "rad": ANGLES,
    "m/s": (
        *((1e-3, "mm/s"), (1 / 3.6, "km/h"), (1e-2, "cm/s"), (1 / 60, "m/min"), (0.44704, "mph"), (0.51444, "knots")),
        *((0.0254, "in/s"), (0.3048, "ft/s")),
    ),
    "rad/s": ((pi / 180.0, "degrees/s"), (1e-3, "mrad/s"), (pi / 30.0, "rpm")),
    "m/s²": ((9.80665, "g"), (9.80665e-3, "mg"), (1e-3, "mm/s²")),
}
#: A travel is counted by an encoder, so many times too often where edges are taken for lines, or the other way round.
COUNTED = (2.0, 4.0, 0.5, 0.25)
#: How a header calls those that it does not call by their name.
SHORT = {"degrees": "deg", "inches": "in", "feet": "ft", "thousandths of an inch": "mil"}


def units_of(channel: str) -> tuple[tuple[float, str], ...]:
    """The units in which a coordinate or a gap may be written."""
    return ANGLES if channel == "roll" else LENGTHS


def si_unit(channel: str) -> str:
    """The SI unit of a coordinate or a gap."""
    return "rad" if channel == "roll" else "m"
