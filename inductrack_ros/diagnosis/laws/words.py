# SPDX-License-Identifier: Apache-2.0
"""Proposed laws in words: formula with the variable's letter, sizes with their standard deviations, and what on a rig
would do it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from .code import Written

#: Letter of each variable, and what it is called.
LETTER = {
    "surge": "z",
    "sway": "x",
    "heave": "y",
    "roll": "θ",
    "surge_rate": "v",
    "sway_rate": "v_x",
    "heave_rate": "v_y",
    "roll_rate": "ω",
    "time": "t",
    "drive": "I",
}
CALLED = {
    "surge": "the place along the track",
    "sway": "sway",
    "heave": "heave",
    "roll": "roll",
    "surge_rate": "speed",
    "sway_rate": "the sway rate",
    "heave_rate": "the heave rate",
    "roll_rate": "the roll rate",
    "time": "time",
    "drive": "the drive current",
}
_FORCE = {
    "surge": "along the track",
    "sway": "in sway",
    "heave": "in heave",
    "roll": "in roll",
    "thrust": "as a share of the thrust",
}
#: Letter of each parameter in a form's formula.
_SYMBOL = {
    "force": "F",
    "extra": "G",
    "slope": "a",
    "coefficient": "a",
    "stiffness": "a",
    "hardening": "b",
    "place": "u₀",
    "threshold": "u₀",
    "centre": "c",
    "clearance": "c",
    "width": "w",
    "edge": "e",
    "wavelength": "Λ",
    "phase": "φ",
    "power": "p",
    "length": "b",
    "peak": "u_p",
    "speed": "u_s",
}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def relation(acts_on: str, variable: str) -> str:
    """How a variable stands to a force: its ``own`` coordinate, ``own_rate``, ``place``, ``speed``, ``time`` or
    ``other``."""
    plain = {"surge": "place", "time": "time", "surge_rate": "speed"}.get(variable)
    return plain or ("own" if variable == acts_on else "own_rate" if variable == f"{acts_on}_rate" else "other")


def formula(law: Written) -> str:
    """A law's formula in its variables' letters."""
    own = _in_letters(law.form.formula, law.variable)
    if law.factor is None:
        return own
    raised = {1: "", 2: "²", 3: "³"}.get(law.factor.power, f"^{law.factor.power}")
    other = f"{LETTER[law.factor.variable]}{raised}"
    return f"({own}) {other}" if " + " in own else f"{own} · {other}"


def _in_letters(text: str, variable: str) -> str:
    return re.sub(r"\bu(?=\b|[₀²³_])", LETTER[variable], text)


def sizes(law: Written, values: Mapping[str, float], deviations: Mapping[str, float]) -> str:
    """``F = −12.0 ± 0.1 N, z₀ = 8.001 ± 0.002 m``."""
    return ", ".join(
        f"{_in_letters(_SYMBOL[p], law.variable)} = {quantity(values[p], deviations.get(p, math.nan), law.unit(p))}"
        for p in law.form.names
    )


def reading(law: Written, values: Mapping[str, float], deviations: Mapping[str, float]) -> str:
    """A law in one sentence without its end: what it is, its formula, its sizes, and what would do that."""
    form = law.form
    stands = relation(law.acts_on, law.variable)
    about = form.causes.get(stands) or form.causes.get("other")
    cause = f"; {about.removesuffix(' would do that')} would do that" if about else ""
    times = ""
    if law.factor is not None:
        other = f"{'the square of ' if law.factor.power == 2 else ''}{CALLED[law.factor.variable]}"
        times = f", times {other}"
        cause = f"{cause} if it grew with {other}" if cause and stands in ("own", "own_rate", "place") else ""
    return (
        f"{form.title} {_FORCE[law.acts_on]} on {CALLED[law.variable]}{times}, {formula(law)},"
        f" {sizes(law, values, deviations)}{cause}"
    )


def quantity(value: float, std: float, unit: str) -> str:
    """``(2.03 ± 0.04)·10⁸ N/m³``: a value to the digits that its standard deviation leaves."""
    tail = f" {unit}" if unit else ""
    if not (math.isfinite(std) and std > 0 and math.isfinite(value)):
        return _signed(f"{value:.4g}") + tail
    size = max(abs(value), std)
    power = math.floor(math.log10(size))
    shift = power if power >= 5 or power <= -4 else 0
    digits = max(0, shift - math.floor(math.log10(std)) + (1 if std / 10 ** math.floor(math.log10(std)) < 2.95 else 0))
    pair = f"{_signed(f'{value / 10**shift:.{digits}f}')} ± {std / 10**shift:.{digits}f}"
    return f"({pair})·10{str(shift).translate(_RAISED)}{tail}" if shift else f"{pair}{tail}"


def _signed(text: str) -> str:
    return text.replace("-", "−")
