# SPDX-License-Identifier: Apache-2.0
"""Proposed laws in words: formula with the variable's letter, sizes with their standard deviations, and what on a rig
would do it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from .forms import Form, unit_of

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


def formula(form: Form, variable: str) -> str:
    """A form's formula in the variable's letter."""
    return _in_letters(form.formula, variable)


def _in_letters(text: str, variable: str) -> str:
    return re.sub(r"\bu(?=\b|[₀²³_])", LETTER[variable], text)


def sizes(form: Form, acts_on: str, variable: str, values: Mapping[str, float], deviations: Mapping[str, float]) -> str:
    """``F = −12.0 ± 0.1 N, z₀ = 8.001 ± 0.002 m``."""
    return ", ".join(
        f"{_in_letters(_SYMBOL[p], variable)} ="
        f" {quantity(values[p], deviations.get(p, math.nan), unit_of(form, p, acts_on, variable))}"
        for p in form.names
    )


def reading(
    form: Form, acts_on: str, variable: str, values: Mapping[str, float], deviations: Mapping[str, float]
) -> str:
    """A law in one sentence without its end: what it is, its formula, its sizes, and what would do that."""
    about = form.causes.get(relation(acts_on, variable)) or form.causes.get("other")
    cause = f"; {about.removesuffix(' would do that')} would do that" if about else ""
    return (
        f"{form.title} {_FORCE[acts_on]} on {CALLED[variable]}, {formula(form, variable)},"
        f" {sizes(form, acts_on, variable, values, deviations)}{cause}"
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
