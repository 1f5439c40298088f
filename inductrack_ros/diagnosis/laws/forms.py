# SPDX-License-Identifier: Apache-2.0
"""Closed forms that mechanics and magnetics use for a force in one variable, as data: what a table of an unknown force
is compared with.

A form is a sum of terms, each a size times an expression in the variable ``u`` and the form's shape parameters. The
text of an expression is what the generated effect holds (`code`) and what is evaluated here: one place for both."""

from __future__ import annotations

import math
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from ...core.effects.stand_in import VARIABLES
from ..factor import Factor
from ..settings import FINE

#: No value of an expression is taken for larger than this.
LARGEST = 1e60
#: Waves over the range of the data at the most: the finest table has three intervals to each.
MOST_WAVES = FINE // 3
#: How the variables are grouped by what forms make sense on them.
ALONG = ("surge", "time")
SIGNED = ("sway", "heave", "roll", "sway_rate", "heave_rate", "roll_rate")
SPEED = ("surge_rate",)
DRIVE = ("drive",)
RATES = ("sway_rate", "heave_rate", "roll_rate")
ANY = VARIABLES
#: A form's expression means by ``math``, ``max`` and ``min`` what a compiled effect means by them, for whole arrays.
_NAMES = {
    "math": types.SimpleNamespace(
        exp=np.exp, tanh=np.tanh, sin=np.sin, cos=np.cos, copysign=np.copysign, sqrt=np.sqrt, pi=math.pi, e=math.e
    ),
    "abs": np.abs,
    "max": np.maximum,
    "min": np.minimum,
}


@dataclass(frozen=True)
class Term:
    """One term: its ``size`` (a parameter's name), the power of the variable's unit that the size is per, and the
    ``expression``."""

    size: str
    per: int | str
    expression: str
    meaning: str


@dataclass(frozen=True)
class Shape:
    """A parameter inside an expression, its ``kind`` (which says where it may lie and what unit it has) and its
    meaning."""

    name: str
    kind: str
    meaning: str


@dataclass(frozen=True)
class Form:
    """A closed form: its terms, shape parameters, the variables that it is tried on, its formula in u, and what it is
    called.

    ``causes`` say what on a rig would do it, by how the variable stands to the force (`words.relation`).
    """

    name: str
    title: str
    formula: str
    terms: tuple[Term, ...]
    shapes: tuple[Shape, ...] = ()
    on: tuple[str, ...] = ANY
    causes: Mapping[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """How many parameters it has."""
        return len(self.terms) + len(self.shapes)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its parameters, sizes first."""
        return tuple(t.size for t in self.terms) + tuple(s.name for s in self.shapes)

    def columns(self, u: np.ndarray, shape: Sequence[float] | np.ndarray) -> list[np.ndarray]:
        """Its terms at u (n,) without their sizes, each (n,); with an array (k, q) of shapes each (n, k)."""
        shape = np.asarray(shape, float)
        at = u if shape.ndim < 2 else u[:, None]
        values = dict(zip((s.name for s in self.shapes), shape.T, strict=True))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = [
                eval(_compiled(t.expression), {"__builtins__": {}}, {**_NAMES, **values, "u": at}) for t in self.terms
            ]
        return [
            np.clip(np.nan_to_num(np.broadcast_to(f, u.shape + shape.shape[:-1])), -LARGEST, LARGEST) for f in found
        ]

    def value(self, u: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
        """The form at u (n,) with all its parameters."""
        columns = self.columns(u, [parameters[s.name] for s in self.shapes])
        return np.sum([parameters[t.size] * c for t, c in zip(self.terms, columns, strict=True)], axis=0)


@cache
def _compiled(expression: str) -> types.CodeType:
    return compile(expression, "<form>", "eval")


def _force(expression: str, meaning: str = "size of the force") -> Term:
    return Term("force", 0, expression, meaning)


_PLACE = Shape("place", "place", "where it is")
_WIDTH = Shape("width", "width", "how wide it is")
_KNEE = Shape("threshold", "place", "where it begins")
_GAP = Shape("clearance", "gap", "free play to either side")

#: All forms that are tried, plain ones first: of two that are one over the range of the data only the first is named.
FORMS: tuple[Form, ...] = (
    Form("constant", "a constant force", "F", (_force("1.0"),), causes={"other": "a bias, a slope or a steady wind"}),
    Form(
        "linear",
        "a force in proportion",
        "a u",
        (Term("slope", 1, "u", "force per unit"),),
        on=(*SIGNED, *SPEED, *DRIVE, "time"),
        causes={
            "own": "a spring",
            "own_rate": "a viscous damper, or an eddy-current brake",
            "speed": "viscous or eddy-current drag",
        },
    ),
    Form(
        "line",
        "a straight line",
        "F + a u",
        (_force("1.0", "force at zero"), Term("slope", 1, "u", "force per unit")),
        causes={
            "own": "a spring with preload",
            "own_rate": "a damper and a steady force",
            "speed": "rolling resistance and viscous drag",
        },
    ),
    Form(
        "square",
        "a square",
        "a u²",
        (Term("coefficient", 2, "u * u", "force per unit squared"),),
        on=(*SIGNED, *DRIVE, "time"),
        causes={"own": "an even field gradient", "other": "a coupling that is the same to either side"},
    ),
    Form(
        "quadratic",
        "a square with the sign of its variable",
        "a u|u|",
        (Term("coefficient", 2, "u * abs(u)", "force per unit squared"),),
        on=(*SIGNED, *SPEED),
        causes={"own_rate": "air that is pushed aside", "speed": "dynamic pressure of the air"},
    ),
    Form(
        "cubic",
        "a cube",
        "a u³",
        (Term("coefficient", 3, "u * u * u", "force per unit cubed"),),
        on=(*SIGNED, *SPEED),
        causes={
            "own": "a hardening spring without linear part; a lateral stop or guide would do that",
            "other": "a guide that turns one motion into the other",
        },
    ),
    Form(
        "hardening_spring",
        "a hardening or softening spring",
        "a u + b u³",
        (
            Term("stiffness", 1, "u", "force per unit, for small motion"),
            Term("hardening", 3, "u * u * u", "force per unit cubed"),
        ),
        on=SIGNED,
        causes={"own": "a spring or guide that stiffens with travel", "own_rate": "a damper that stiffens with speed"},
    ),
    Form(
        "cubic_about",
        "a cube about a centre",
        "a (u − c)³",
        (Term("coefficient", 3, "(u - centre) * (u - centre) * (u - centre)", "force per unit cubed"),),
        (Shape("centre", "place", "where it vanishes"),),
        on=("sway", "heave", "roll"),
        causes={"own": "a hardening spring about a centre; a stop or guide would do that"},
    ),
    Form(
        "power",
        "a power law",
        "a sgn(u)|u|^p",
        (Term("coefficient", "^p", "math.copysign(abs(u) ** power, u)", "force at one unit"),),
        (Shape("power", "power", "exponent"),),
        on=(*SIGNED, *SPEED),
        causes={"speed": "drag between viscous and dynamic pressure", "own": "a progressive spring"},
    ),
    Form(
        "eddy",
        "drag that peaks at a speed",
        "a u/(1 + (u/u_p)²)",
        (Term("slope", 1, "u / (1.0 + (u / peak) ** 2)", "force per unit, for slow motion"),),
        (Shape("peak", "length", "where it is largest"),),
        on=(*SPEED, *RATES),
        causes={"other": "eddy currents in a conductor nearby"},
    ),
    Form(
        "exponential",
        "an exponential",
        "F exp(−u/b)",
        (_force("math.exp(-u / length)", "force at zero"),),
        (Shape("length", "signed length", "over which it falls to 1/e"),),
        causes={
            "own": "the field of a magnet array, which falls with the gap",
            "time": "something that dies away",
            "speed": "friction that falls with speed",
        },
    ),
    Form(
        "falling",
        "a constant and an exponential",
        "F + G exp(−u/b)",
        (_force("1.0", "force far off"), Term("extra", 0, "math.exp(-u / length)", "force more at zero")),
        (Shape("length", "length", "over which it falls to 1/e"),),
        on=(*SPEED, "time"),
        causes={"speed": "friction of Stribeck's kind", "time": "something that settles, as a temperature"},
    ),
    Form(
        "bump",
        "a bump at one place",
        "F exp(−((u − u₀)/w)²)",
        (_force("math.exp(-(((u - place) / width) ** 2))", "force in the middle"),),
        (_PLACE, _WIDTH),
        causes={
            "place": "a magnet, a magnetised patch or a piece of iron at the track",
            "time": "a gust or a push",
            "other": "a resonance",
        },
    ),
    Form(
        "raised_cosine",
        "a bump with sharp ends",
        "F ½(1 + cos(π (u − u₀)/w)) within w of u₀",
        (_force("0.5 * (1.0 + math.cos(math.pi * min(abs(u - place) / width, 1.0)))", "force in the middle"),),
        (_PLACE, Shape("width", "width", "half its whole width")),
        on=ALONG,
        causes={"place": "a patch that the arrays pass over, as long as they are", "time": "a gust or a push"},
    ),
    Form(
        "stretch",
        "a force over a stretch",
        "F ½(tanh((u − u₀ + w)/e) − tanh((u − u₀ − w)/e))",
        (
            _force(
                "0.5 * (math.tanh((u - place + width) / edge) - math.tanh((u - place - width) / edge))",
                "force in the middle",
            ),
        ),
        (_PLACE, Shape("width", "width", "half its whole width"), Shape("edge", "width", "over which it rises")),
        on=ALONG,
        causes={"place": "a stretch of another kind of track", "time": "something that is switched on and off again"},
    ),
    Form(
        "pull_and_push",
        "a force one way and then the other",
        "F 2.33 ((u − u₀)/w) exp(−((u − u₀)/w)²)",
        (
            _force(
                "math.sqrt(2.0 * math.e) * (u - place) / width * math.exp(-(((u - place) / width) ** 2))",
                "largest force",
            ),
        ),
        (_PLACE, _WIDTH),
        on=ALONG,
        causes={
            "place": "a magnet or a piece of iron that attracts from both sides, or a bend of the track",
            "time": "a knock",
        },
    ),
    Form(
        "sine",
        "a sine",
        "F sin(2π u/Λ + φ)",
        (_force("math.sin(2.0 * math.pi * u / wavelength + phase)", "amplitude"),),
        (Shape("wavelength", "wavelength", "wavelength or period"), Shape("phase", "phase", "phase")),
        on=ALONG,
        causes={
            "place": "something that repeats along the track, as supports or joints",
            "time": "a machine that turns or shakes nearby",
        },
    ),
    Form(
        "ringing",
        "a vibration that dies away",
        "F exp(−u/b) sin(2π u/Λ + φ)",
        (_force("math.exp(-u / length) * math.sin(2.0 * math.pi * u / wavelength + phase)", "amplitude at zero"),),
        (
            Shape("length", "length", "over which it falls to 1/e"),
            Shape("wavelength", "wavelength", "wavelength or period"),
            Shape("phase", "phase", "phase"),
        ),
        on=("time",),
        causes={"time": "something that rings after the start"},
    ),
    Form(
        "step",
        "a step",
        "F ½(1 + tanh((u − u₀)/w))",
        (_force("0.5 * (1.0 + math.tanh((u - place) / width))", "force beyond"),),
        (_PLACE, Shape("width", "width", "over which it rises")),
        on=(*ALONG, *SIGNED, *SPEED),
        causes={
            "place": "another kind of track from there on",
            "time": "something that is switched on",
            "speed": "something that sets in at a speed",
            "own": "a magnet or catch that lets go",
        },
    ),
    Form(
        "ramp",
        "a ramp that begins at a threshold",
        "a max(u − u₀, 0)",
        (Term("slope", 1, "max(u - threshold, 0.0)", "force per unit beyond"),),
        (_KNEE,),
        causes={
            "own": "a one-sided spring or stop",
            "place": "a force that grows from there on",
            "speed": "something that sets in at a speed",
            "time": "something that grows from then on",
        },
    ),
    Form(
        "ramp_below",
        "a ramp that ends at a threshold",
        "a max(u₀ − u, 0)",
        (Term("slope", 1, "max(threshold - u, 0.0)", "force per unit below"),),
        (Shape("threshold", "place", "where it ends"),),
        causes={
            "own": "a one-sided spring or stop",
            "place": "a bungee or a spring at the start",
            "speed": "something that ceases at a speed",
        },
    ),
    Form(
        "dead_zone",
        "a spring with free play",
        "a (u beyond ±c)",
        (Term("slope", 1, "max(u - clearance, 0.0) - max(-u - clearance, 0.0)", "force per unit beyond"),),
        (_GAP,),
        on=SIGNED,
        causes={"own": "stops to either side with clearance", "own_rate": "a damper with play"},
    ),
    Form(
        "stop",
        "a hardening stop with free play",
        "a (u beyond ±c)³",
        (
            Term(
                "coefficient",
                3,
                "max(u - clearance, 0.0) ** 3 - max(-u - clearance, 0.0) ** 3",
                "force per unit cubed beyond",
            ),
        ),
        (_GAP,),
        on=("sway", "heave", "roll"),
        causes={"own": "rubber stops to either side"},
    ),
    Form(
        "saturation",
        "a force that saturates",
        "F tanh(u/w)",
        (_force("math.tanh(u / width)", "force far off"),),
        (Shape("width", "width", "over which it builds up"),),
        on=SIGNED,
        causes={"own": "a spring or magnet that yields", "own_rate": "dry friction (Coulomb)"},
    ),
    Form(
        "stribeck",
        "dry friction that falls with speed",
        "(F + G exp(−(u/u_s)²)) tanh(u/w)",
        (
            _force("math.tanh(u / width)", "friction at speed"),
            Term("extra", 0, "math.tanh(u / width) * math.exp(-((u / speed) ** 2))", "friction more when slow"),
        ),
        (Shape("width", "width", "over which it builds up"), Shape("speed", "length", "Stribeck speed")),
        on=RATES,
        causes={"own_rate": "lubricated or mixed friction (Stribeck)"},
    ),
)


def forms_on(variable: str, acts_on: str, multiplied: bool = False) -> tuple[Form, ...]:
    """The forms that are tried on a variable; a change of the thrust that is constant is γ's, and a constant that is
    multiplied by another variable is a form on that one."""
    left_out = ("constant", "line", "falling") if acts_on == "thrust" else ("constant",) if multiplied else ()
    return tuple(f for f in FORMS if variable in f.on and f.name not in left_out)


@dataclass(frozen=True)
class Range:
    """Where the shape parameters of each kind may lie on a variable that covers [low, high], and where they are
    sought."""

    low: float
    high: float

    @property
    def length(self) -> float:
        """How much of the variable it covers."""
        return self.high - self.low

    @property
    def far(self) -> float:
        """The largest magnitude of the variable."""
        return max(abs(self.low), abs(self.high))

    def bounds(self, kind: str) -> tuple[float, float]:
        """Least and greatest value of a parameter."""
        L = self.length
        return {
            "place": (self.low - 0.5 * L, self.high + 0.5 * L),
            "width": (L / 300, 3 * L),
            "gap": (0.0, self.far),
            "power": (0.05, 8.0),
            "length": (max(L / 30, self.far / 60), 10 * self.far),
            "signed length": (-10 * self.far, 10 * self.far),
            "wavelength": (L / MOST_WAVES, 4 * L),
            "phase": (-10.0, 10.0),
        }[kind]

    def spread(self, kind: str, value: float) -> float:
        """Standard deviation of a parameter before the data, as far as a step from ``value`` sees it: it may lie
        anywhere within its bounds, a length or a power at any magnitude of them."""
        low, high = self.bounds(kind)
        if kind in ("width", "length", "wavelength", "power"):
            return abs(value) * float(np.log(high / low)) / np.sqrt(12.0)
        return (2.0 * np.pi if kind == "phase" else high - low) / np.sqrt(12.0)

    def starts(self, kind: str) -> np.ndarray:
        """Values from which it is sought."""
        L = self.length
        lengths = np.geomspace(max(L / 15, self.far / 30), 3 * self.far, 9)
        return {
            "place": np.linspace(self.low, self.high, 17)[1:-1],
            "width": np.geomspace(L / 60, L, 9),
            "gap": self.far * np.linspace(0.1, 0.8, 8),
            "power": np.array([0.3, 0.6, 1.3, 1.7, 2.4, 3.5, 5.0]),
            "length": lengths,
            "signed length": np.concatenate([-lengths[::-1], lengths]),
            "wavelength": L / np.linspace(1 / 3, MOST_WAVES, 3 * MOST_WAVES),
            "phase": np.pi * np.array([0.0, 1 / 3, 2 / 3]),  # the size has both signs
        }[kind]


# ---------------------------------------------------------------- units


#: Unit of each variable.
UNITS: dict[str, str] = dict(
    zip(VARIABLES, ("m", "m", "m", "rad", "m/s", "m/s", "m/s", "rad/s", "s", "A"), strict=True)
)


def unit_of_force(acts_on: str) -> str:
    """Unit of a force, a moment, or a share of the thrust."""
    return {"roll": "N·m", "thrust": ""}.get(acts_on, "N")


def unit_of(form: Form, parameter: str, acts_on: str, variable: str, factor: Factor | None = None) -> str:
    """Unit of one of a form's parameters, where the form may be multiplied by a factor (without its scale)."""
    unit, force = UNITS[variable], unit_of_force(acts_on)
    if factor is not None:
        force = _per(force, UNITS[factor.variable], factor.power)
    for term in form.terms:
        if term.size == parameter:
            return force if term.per == 0 else _per(force, unit, term.per)
    kind = next(s.kind for s in form.shapes if s.name == parameter)
    return {"power": "", "phase": "rad"}.get(kind, unit)


def _per(force: str, unit: str, power: int | str) -> str:
    raised = {1: "", 2: "²", 3: "³"}.get(power, power) if isinstance(power, int) else power
    force = force or "1"
    if "/" not in unit:
        return f"{force}/{unit}{raised}"
    top, bottom = unit.split("/")
    return f"{force}·{bottom}/{top}" if power == 1 and "/" not in force else f"{force}/({unit}){raised}"


def meaning_of(form: Form, parameter: str) -> str:
    """Meaning of one of a form's parameters."""
    return {t.size: t.meaning for t in form.terms}.get(parameter) or next(
        s.meaning for s in form.shapes if s.name == parameter
    )
