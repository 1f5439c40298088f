# SPDX-License-Identifier: Apache-2.0
"""Numbers and names as reports show them: the one place where a unit is scaled (metres to millimetres)."""

from __future__ import annotations

import math

from ..core.state import CHANNEL

#: Parameters that have a letter of their own in the paper.
SYMBOL = {"eta": "η", "gamma": "γ"}


def shown(channel: str) -> tuple[float, str]:
    """Factor from SI and unit in which a channel is shown."""
    return CHANNEL[channel].shown if channel in CHANNEL else (1.0, "")


def title(channel: str) -> str:
    """A channel's name as people say it."""
    return CHANNEL[channel].title if channel in CHANNEL else channel.replace("_", " ").capitalize()


def number(value: float | None, digits: int = 3) -> str:
    """A number with significant digits, in plain notation where that is readable."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e6:
        text = f"{value if abs(value) < 1e4 else float(text):.0f}"
    if "e" in text:
        mantissa, _, exponent = text.partition("e")
        text = f"{mantissa}·10{_superscript(int(exponent))}"
    return text.replace("-", "−")


def ratio(value: float | None) -> str:
    """Error over noise: two decimals near one, fewer above."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    return f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:,.0f}".replace(",", "\u202f")


def counted(value: float | None) -> str:
    """A statistic: whole from a hundred up, its thousands apart."""
    if value is None or not math.isfinite(value) or abs(value) < 100:
        return number(value, 3)
    return f"{value:,.0f}".replace(",", "\u202f").replace("-", "−")


def sized(value: float, std: float | None, unit: str = "") -> str:
    """``0.0312 ± 0.0004 m²``: the value to the digits its standard deviation leaves."""
    tail = f" {unit}" if unit else ""
    if std is None or not math.isfinite(std) or std <= 0 or not math.isfinite(value):
        return f"{number(value, 4)}{tail}"
    place = math.floor(math.log10(std)) - (1 if std / 10 ** math.floor(math.log10(std)) < 2.95 else 0)
    size = max(abs(value), std)
    if size < 1e-3 or size >= 1e6:
        power = math.floor(math.log10(size))
        decimals = max(power - place, 0)
        scale = 10.0**power
        text = f"({value / scale:.{decimals}f} ± {std / scale:.{decimals}f})·10{_superscript(power)}{tail}"
    else:
        decimals = max(-place, 0)
        text = f"{value:.{decimals}f} ± {std:.{decimals}f}{tail}"
    return text.replace("-", "−")


def in_channel(channel: str, value: float, digits: int = 3) -> str:
    """A value of a channel in the unit it is shown in."""
    factor, unit = shown(channel)
    return f"{number(value * factor, digits)} {unit}"


def listed(names: list[str] | tuple[str, ...], joint: str = "and") -> str:
    """``a, b and c``."""
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {joint} {names[-1]}" if names else ""


def effect_name(name: str) -> str:
    """``sensor_delay:heave`` → ``delay of the heave sensor``."""
    if name.startswith("stand_in_"):
        return f"stand-in for the unknown in {name.removeprefix('stand_in_')}"
    base, _, channel = name.partition(":")
    words = base.replace("_", " ")
    return f"{words.removeprefix('sensor ')} of the {channel.replace('_', ' ')} sensor" if channel else words


def _superscript(power: int) -> str:
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
