# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the model, declared once: default, unit, range, meaning, source.

ROS descriptors, documentation tables, bounds of fits and the message that refuses a wrong value all come from here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from .errors import InputError, did_you_mean
from .state import CHANNEL, RATE_UNITS

# How a parameter enters a fit: a coordinate u(x) in which the model is close to linear where the effect vanishes.
_TO_FIT = {"x": lambda x: x, "1/x": lambda x: 1.0 / x, "1/x^2": lambda x: 1.0 / x**2, "x^2": lambda x: x * x}
_FROM_FIT = {
    "x": lambda u: u,
    "1/x": lambda u: 1.0 / u if u > 0 else math.inf,
    "1/x^2": lambda u: 1.0 / math.sqrt(u) if u > 0 else math.inf,
    "x^2": lambda u: math.sqrt(u) if u > 0 else 0.0,
}

#: Values of an effect's parameters by name: a float each, a tuple of floats for a table.
Values: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True)
class Parameter:
    """One number of the model.

    ``default`` is what a model uses unless told otherwise; for an effect it is the value at which the effect vanishes,
    where there is one. ``typical`` is a size at which an effect would matter on a rig like the paper's: fits start
    there and take their steps from it. ``fit_as`` names the coordinate of the fit (see ``to_fit``) and ``fit_from`` the
    least value that a fit tries. A ``count`` above one makes it a table of up to so many numbers; the effect's function
    gets an array, filled up with zeros. ``per_channel`` is for a sensor's parameter in its channel's unit: ``typical``
    counts in the channel's ``size`` or ``span`` then."""

    default: float
    unit: str
    low: float
    high: float
    meaning: str
    source: str = ""
    typical: float = 0.0
    starts: tuple[float, ...] = ()
    fit_as: str = "x"
    count: int = 1
    fit_from: float = -math.inf
    per_channel: str = ""

    def for_channel(self, channel: str) -> Parameter:
        """The declaration for one channel's sensor: its unit and typical size are the channel's where they hang on
        it."""
        if not self.per_channel:
            return self
        about = CHANNEL[channel]
        unit = RATE_UNITS[about.unit] if self.unit == "1/s" else about.unit
        return replace(self, unit=unit, typical=self.typical * getattr(about, self.per_channel))

    def check(self, name: str, value: object, where: str = "") -> float | tuple[float, ...]:
        """Return ``value`` as a float (a table as a tuple), or raise `InputError` naming the parameter and its
        range."""
        if self.count > 1:
            entries = value if isinstance(value, (list, tuple)) else [value]
            if not 1 <= len(entries) <= self.count:
                place = f"{where}: " if where else ""
                raise InputError(f"{place}{name} holds {len(entries)} numbers; give 1 to {self.count}")
            return tuple(self.check_one(f"{name}[{i}]", entry, where) for i, entry in enumerate(entries))
        return self.check_one(name, value, where)

    def check_one(self, name: str, value: object, where: str = "") -> float:
        """Return one number as a float, or raise `InputError` naming the parameter and its range."""
        place = f"{where}: " if where else ""
        if isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
            raise InputError(f"{place}{name} = {value!r:.60} is not a number; give one in {self.range_text()}")
        try:
            number = float(value)
        except OverflowError:  # an integer of hundreds of digits
            number = math.inf if value > 0 else -math.inf
        if math.isnan(number) or not self.low <= number <= self.high:
            raise InputError(f"{place}{name} = {number:g} is out of range; it must lie in {self.range_text()}")
        return number

    def entries(self, name: str) -> list[str]:
        """Names of the single numbers it stands for: itself, or ``name[0]``, ``name[1]``, …"""
        return [name] if self.count == 1 else [f"{name}[{i}]" for i in range(self.count)]

    def range_text(self) -> str:
        """The range with its unit, e.g. ``[0, 10] m``."""
        return f"[{self.low:g}, {self.high:g}]" + (f" {self.unit}" if self.unit else "")

    def to_fit(self, x: float) -> float:
        """The coordinate in which fits move this parameter."""
        return _TO_FIT[self.fit_as](x)

    def from_fit(self, u: float) -> float:
        """Inverse of `to_fit`; coordinates past the end of the scale give the vanishing value."""
        return _FROM_FIT[self.fit_as](u)

    def fit_bounds(self) -> tuple[float, float]:
        """Lower and upper bound in the fit's coordinate."""
        if self.fit_as in ("1/x", "1/x^2"):
            return 0.0, self.to_fit(max(self.low, 1e-12))
        if self.fit_as == "x^2":
            return 0.0, self.high**2
        return max(self.low, self.fit_from), self.high


_PAPER = "Kim and Ge (2012), Table 1"
_FITTED = "Kim and Ge (2012), Table 2"
#: Source of what the paper leaves open.
OURS = "assumption of this project, not in the paper"

#: The model's own parameters, in the order of the compiled kernel's parameter vector.
PARAMETERS: dict[str, Parameter] = {
    "eta": Parameter(0.7295, "", 0.01, 10.0, "shape factor η of the Halbach field", _FITTED, 0.01),
    "gamma": Parameter(3.9298, "", 0.0, 100.0, "thrust factor γ of the drive", _FITTED, 0.1),
    "peak_field": Parameter(0.52, "T", 0.0, 3.0, "peak field B0 of the Halbach array; 0: no magnets", _PAPER, 0.01),
    "wavelength": Parameter(0.1, "m", 0.001, 10.0, "wavelength λ of the Halbach array", _PAPER, 0.001),
    "inductance": Parameter(1.8e-6, "H", 1e-9, 1e-2, "inductance L of one track circuit", _PAPER, 5e-8),
    "resistance": Parameter(1.5e-3, "Ω", 1e-6, 10.0, "resistance R of one track circuit", _PAPER, 5e-5),
    "mass": Parameter(9.3, "kg", 1e-3, 1e5, "mass m of the cradle", _PAPER, 0.1),
    "pulse_length": Parameter(
        600e-6, "s", 1e-6, 0.1, "length τ of a drive pulse", _PAPER + " (the text's 600 ms is a typo)", 2e-5
    ),
    "drive_current": Parameter(7000.0, "A", 0.0, 1e5, "drive current I_D (amplitude of the half sine)", _PAPER, 100.0),
    "coils_per_wavelength": Parameter(13.0, "", 1.0, 1000.0, "lifting coils N_c under one wavelength", _PAPER, 0.5),
    "width_top": Parameter(0.12, "m", 0.0, 10.0, "width of the top array", _PAPER, 0.002),
    "width_side": Parameter(0.08, "m", 0.0, 10.0, "width of each side array", _PAPER, 0.002),
    "gravity": Parameter(9.81, "m/s²", 0.0, 100.0, "acceleration of gravity a_g", _PAPER, 0.05),
    "nominal_gap": Parameter(
        0.010, "m", 0.0, 1.0, "gap g0 of all three arrays in the zero pose", "Kim and Ge (2012)", 1e-4
    ),
    "contact_stiffness": Parameter(
        9.1e6,
        "N/m",
        0.0,
        1e9,
        "stiffness k_c of the contact; 0: no contact",
        OURS + "; sinks 0.01 mm at rest, section 3.3",
        3e5,
    ),
    "contact_damping": Parameter(5e3, "N·s/m", 0.0, 1e6, "damping b_c of the contact", OURS, 3e2),
    "roll_inertia": Parameter(0.091, "kg·m²", 1e-6, 1e6, "moment of inertia I_zz about the travel", OURS, 1e-3),
    "magnet_top_height": Parameter(
        0.040, "m", -5.0, 5.0, "height of the top array's centre over the centre of mass", OURS, 1e-3
    ),
    "magnet_side_offset": Parameter(
        0.105, "m", 0.0, 5.0, "lateral distance of the side arrays' centres from the centre of mass", OURS, 1e-3
    ),
    "magnet_side_height": Parameter(
        -0.035, "m", -5.0, 5.0, "height of the side arrays' centres over the centre of mass", OURS, 1e-3
    ),
    "air_density": Parameter(1.29, "kg/m³", 0.0, 100.0, "density of air ρ", "Kim and Ge (2012), (14)", 0.05),
    "array_length": Parameter(
        0.65,
        "m",
        0.01,
        100.0,
        "length over which the cradle's magnets feel a drive coil",
        OURS + "; the body length l of (16)",
        0.1,
    ),
}

#: Parameters a fit may move although only their ratio shows (see `shared` note in the docs): free by default.
DEFAULT_FREE = ("eta", "gamma")


def check_parameters(values: Mapping[str, object], where: str = "") -> dict[str, float]:
    """Return all of `PARAMETERS`, ``values`` in place of defaults. Raises `InputError` for an unknown name or a value
    out of range."""
    place = f"{where}: " if where else ""
    for name in values:
        if name not in PARAMETERS:
            raise InputError(f"{place}unknown parameter '{name}'{did_you_mean(name, PARAMETERS)}")
    return {n: p.check_one(n, values.get(n, p.default), where) for n, p in PARAMETERS.items()}
