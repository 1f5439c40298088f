# SPDX-License-Identifier: Apache-2.0
"""What a sweep goes over: ``NAME=FROM:TO:COUNT`` as users write it, checked against the model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.effects import split_name
from ..core.errors import InputError, did_you_mean
from ..core.model import Model
from ..core.named_values import assigned
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import CHANNELS, STATES, UNITS

EXAMPLE = "surge_rate=10:40:61"
FORMS = "FROM:TO:COUNT, FROM:TO:COUNT:log or a list a,b,c"
#: A map of more points along one axis shows nothing more.
MOST_POINTS = 5000


@dataclass(frozen=True)
class Axis:
    """One axis: the full ``name`` of a state, a parameter or a condition, its rising ``values`` (n,), and how it is
    shown."""

    name: str
    values: np.ndarray
    unit: str
    meaning: str
    logarithmic: bool = False

    @property
    def of_state(self) -> bool:
        """Whether it is of the initial state."""
        return self.name in STATES

    @property
    def title(self) -> str:
        """Name and unit, for a plot."""
        words = self.name.replace("_", " ")
        return f"{words} ({self.unit})" if self.unit else words


def read_axes(given: Sequence[str], model: Model) -> tuple[Model, tuple[Axis, ...]]:
    """The axes, and the model with every effect on that an axis goes over. Raises `InputError`."""
    if not 1 <= len(given) <= 2:
        raise InputError(f"--over is given {len(given)} times; a map has one axis or two")
    found: list[Axis] = []
    for text in given:
        name, wanted = assigned(text)
        if not name:
            raise InputError(f"--over {text}: is not NAME={FORMS}, e.g. {EXAMPLE}")
        if any(axis.name == name for axis in found):
            raise InputError(f"--over: '{name}' is given twice")
        model, declared = _declared(name, model)
        values, logarithmic = _values(name, wanted)
        for value in (values[0], values[-1]):
            declared.check(name, float(value), f"--over {text}")
        found.append(Axis(name, values, declared.unit, declared.meaning, logarithmic))
    return model, tuple(found)


def _declared(name: str, model: Model) -> tuple[Model, Parameter]:
    """What is declared of a name, and the model with its effect on. Raises `InputError` for a name that changes no
    run."""
    if name in PARAMETERS:
        return model, PARAMETERS[name]
    if name in STATES:
        return model, Parameter(0.0, UNITS[name], -math.inf, math.inf, "at the start")
    effect, dot, parameter = name.rpartition(".")
    if not dot:
        return model, _condition(name, model)
    item, _ = split_name(effect, model.known_effects, CHANNELS, "--over")
    plain = parameter.partition("[")[0]
    if plain not in item.parameters:
        raise InputError(
            f"--over: effect '{effect}' has no parameter '{parameter}'{did_you_mean(parameter, item.parameters)}"
        )
    if item.of_sensor:
        raise InputError(
            f"--over {name}: that is a sensor's, which changes no run; sweep over an effect of the cradle, the track or"
            " the drive"
        )
    if effect not in model.effects:
        model = model.with_changes(effects={**model.effects, effect: {}})
    if name not in model.kernel.parameters:
        raise InputError(
            f"--over {name}: holds a table; name one entry of it, e.g. {item.parameters[plain].entries(name)[0]}"
        )
    return model, item.parameters[plain]


def _condition(name: str, model: Model) -> Parameter:
    """The declaration of a condition that an effect asks for."""
    known = {c: e for e, item in model.known_effects.items() for c in item.conditions}
    if name not in known:
        raise InputError(f"--over: unknown name '{name}'{did_you_mean(name, [*STATES, *PARAMETERS, *known])}")
    if not any(name in item.conditions for e, item in model.known_effects.items() if e in model.effects):
        raise InputError(
            f"--over {name}: no effect of the model asks for it; give a --model with effects: [{known[name]}]"
        )
    return Parameter(0.0, "", -math.inf, math.inf, "condition of the run")


def _values(name: str, wanted: str) -> tuple[np.ndarray, bool]:
    """Rising values (n,), and whether they stand at equal ratios."""
    place = f"--over {name}={wanted}"
    try:
        if ":" not in wanted:
            values = np.array([float(part) for part in wanted.split(",") if part.strip()])
            return _checked(np.sort(values), place), False
        low, high, count, *rest = wanted.split(":")
        first, last, points = float(low), float(high), int(count)
        if rest not in ([], ["log"]):
            raise ValueError
    except ValueError:
        raise InputError(f"{place}: is not {FORMS}, e.g. {EXAMPLE}") from None
    if not (math.isfinite(first) and math.isfinite(last)):
        raise InputError(f"{place}: FROM and TO must be finite numbers")
    if points < 2:
        raise InputError(
            f"{place}: an axis of {points} point{'s' * (points != 1)} is no axis; give COUNT 2 or more, or set the one"
            " value in --initial or MODEL.yaml"
        )
    if points > MOST_POINTS:
        raise InputError(f"{place}: at most {MOST_POINTS} points to an axis")
    if not first < last:
        raise InputError(f"{place}: FROM must lie below TO")
    if rest and not first > 0:
        raise InputError(f"{place}: a logarithmic axis must lie above 0")
    return _checked(np.geomspace(first, last, points) if rest else np.linspace(first, last, points), place), bool(rest)


def _checked(values: np.ndarray, place: str) -> np.ndarray:
    if values.size < 2:
        raise InputError(
            f"{place}: an axis of {values.size} point{'s' * (values.size != 1)} is no axis; give two values or more, or"
            " set the one in --initial or MODEL.yaml"
        )
    if values.size > MOST_POINTS:
        raise InputError(f"{place}: at most {MOST_POINTS} points to an axis")
    if not np.isfinite(values).all():
        raise InputError(f"{place}: every value must be a finite number")
    if not (np.diff(values) > 0).all():
        raise InputError(f"{place}: a value stands there twice")
    return values
