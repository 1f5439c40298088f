# SPDX-License-Identifier: Apache-2.0
"""Units as loggers write them in a header, and their factors to SI."""

from __future__ import annotations

import math
import re

from ..core.state import CHANNELS, UNITS

_PREFIXES = {"": 1.0, "k": 1e3, "d": 1e-1, "c": 1e-2, "m": 1e-3, "µ": 1e-6, "u": 1e-6, "n": 1e-9}
_LENGTHS = {f"{p}m": f for p, f in _PREFIXES.items()} | {
    "in": 0.0254,
    "inch": 0.0254,
    "ft": 0.3048,
    "meter": 1.0,
    "metre": 1.0,
    "micron": 1e-6,
    "mil": 2.54e-5,
    "thou": 2.54e-5,
}
_ANGLES = {f"{p}rad": _PREFIXES[p] for p in ("", "m", "µ", "u")} | dict.fromkeys(
    ("deg", "°", "degree", "º"), math.pi / 180
)
_TIMES = {f"{p}s": _PREFIXES[p] for p in ("", "m", "µ", "u", "n")}
_TIMES |= dict.fromkeys(("sec", "second"), 1.0) | {"msec": 1e-3, "usec": 1e-6, "nsec": 1e-9, "min": 60.0, "h": 3600.0}
_TIMES |= dict.fromkeys(("d", "day"), 86400.0)
_CURRENTS = {f"{p}A": _PREFIXES[p] for p in ("", "k", "m")}
_TABLES = {"m": _LENGTHS, "rad": _ANGLES, "s": _TIMES, "A": _CURRENTS}
_SPECIAL = {
    "m/s": {"kph": 1 / 3.6, "kmh": 1 / 3.6, "mps": 1.0, "mph": 0.44704},
    "rad/s": {"rpm": math.pi / 30},
    "m/s²": {"g": 9.80665, "mg": 9.80665e-3, "m/s/s": 1.0},
}
#: Unit of every column that a run may have.
SI = {"time": "s", "drive_current": "A"} | {c: UNITS[c] for c in CHANNELS}
#: Units that are known by their parts; any other is a word, with or without a prefix.
_KNOWN = (*_TABLES, *(f"{top}/{bottom}" for top in ("m", "rad") for bottom in ("s", "s²")))
_SCALES = _PREFIXES | {"M": 1e6, "G": 1e9}
_SHARES = {"": 1.0, "1": 1.0, "-": 1.0, "%": 1e-2, "‰": 1e-3, "ppm": 1e-6}


def factor(unit: str, si: str) -> float | None:
    """What a number in ``unit`` is multiplied with to be in ``si`` (m, rad, s, A, m/s, rad/s, m/s², or what a channel
    is in); None for a unit of something else."""
    unit = unit.strip().replace("μ", "µ")  # the Greek letter and the sign
    for spelling in (unit, unit.lower()):
        value = _factor(spelling, si)
        if value is not None:
            return value
    return None


def any_factor(unit: str) -> float | None:
    """The same for whatever ``unit`` measures."""
    every = dict.fromkeys((*_KNOWN, *SI.values()))
    return next((f for si in every if (f := factor(unit, si)) is not None), None)


def _factor(unit: str, si: str) -> float | None:
    if unit in _SPECIAL.get(si, {}):
        return _SPECIAL[si][unit]
    if si not in _KNOWN:
        return _of_a_word(unit, si)
    above, _, below = si.partition("/")
    if not below:
        singular = unit[:-1] if unit.endswith("s") and len(unit) > 3 else unit
        return _TABLES[above].get(unit, _TABLES[above].get(singular))
    power = 2 if below == "s²" else 1
    match = re.fullmatch(r"(.+?)(?:/|_per_| per |·|\*|_| )\s*\(?([a-zA-Zµ]+?)(\^|\*\*)?(-?[12²]|⁻¹|⁻²)?\)?", unit)
    if match is None:
        return None
    top, bottom = _factor(match[1].strip(), above), _TABLES["s"].get(match[2])
    exponent = {None: 1, "1": 1, "-1": 1, "⁻¹": 1, "2": 2, "²": 2, "-2": 2, "⁻²": 2}[match[4]]
    if top is None or bottom is None or exponent != power:
        return None
    return top / bottom**power


def _of_a_word(unit: str, si: str) -> float | None:
    """The same where ``si`` is a word such as N, V, °C or N·m, or empty for a share."""
    if not si:
        return _SHARES.get(unit)
    word, bare = (re.sub(r"[·*. ⋅]", "", text) for text in (si, unit))
    return next((scale for prefix, scale in _SCALES.items() if bare == prefix + word), None)
