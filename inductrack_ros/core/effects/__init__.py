# SPDX-License-Identifier: Apache-2.0
"""Effects the averaged model leaves out: what an effect is, and where the catalogue and a user's own are found.

An effect is a function. Its argument names say what it needs: quantities of `core.equations` (``surge_rate``,
``resistance``, ``normal_force``, …), model parameters, ``time``, its own parameters and states (which hide a
quantity of the same name). Its decorator says where the return value goes::

    @effect(
        adds="force_surge",
        parameters={"drag_area": Parameter(0.0, "m²", 0.0, 10.0, "C_d A of the body", "textbook", typical=0.01)},
    )
    def aerodynamic_drag(surge_rate, air_density, drag_area):
        return -0.5 * air_density * drag_area * surge_rate * abs(surge_rate)

One that adds and changes returns first what it adds. What needs the sum of all forces stands in a second function,
``then=`` (see `flexible_mode`). It must be something numba can compile: arithmetic, ``math`` functions, ``if``. The
same function runs in the node, offline, in fits and in the diagnosis."""

from __future__ import annotations

import functools
import importlib
import inspect
import math
import pkgutil
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import InputError, did_you_mean
from ..parameters import Parameter
from ..state import CHANNELS
from ..user_files import run_file

__all__ = ["Effect", "Parameter", "Part", "catalogue", "effect", "load_effects"]

#: What an effect may add to (paper frame: surge z, sway x, heave y, roll about z).
FORCES = ("force_surge", "force_sway", "force_heave", "moment_roll")
#: What a sensor effect may change: the reading, and the time at which it was true.
READINGS = ("measured", "sample_time")
#: What one of several channels may change: ``measured_heave``, ….
READINGS_OF = tuple(f"measured_{c}" for c in CHANNELS)


@dataclass(frozen=True)
class Part:
    """One function of an effect: what it ``adds`` to and what it ``changes``, of which it returns so many numbers in
    this order."""

    function: Callable
    adds: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()

    @property
    def targets(self) -> tuple[str, ...]:
        """What it acts on, in the order in which it returns it."""
        return self.adds + self.changes

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of what the function needs."""
        return tuple(inspect.signature(self.function).parameters)


@dataclass(frozen=True)
class Effect:
    """One effect: its functions, where their results go, its parameters and states.

    - ``parts``: one function, or two if the second needs what is known only after the first has acted.
    - ``states``: what each state starts on, a number or the quantity whose value (without such effects) it takes. The
      last function returns the states' time derivatives behind what it adds or changes.
    - ``max_step`` (s) bounds the integration step while the effect is on. ``max_travel`` names the parameter (m) over
      which the effect repeats; a tenth of it bounds the travel in a step.
    - ``only`` limits the effect to the ``averaged`` or the ``pulses`` drive.
    - ``canonical`` picks one of several parameter sets that do the same.
    - ``starts`` gives values where a search for the parameters may begin, for an effect that shows nothing of its other
      parameters where it vanishes. For a sensor's effect it gets the readings (n,), for one of the cradle the range
      (low, high) that each variable of the runs covers (`stand_in.VARIABLES` and the gaps).
    - ``conditions``: numbers of a run that the function takes, each with its value where no run gives one.
    - ``of_sensor`` marks the effect of a sensor, ``of_channel`` that of one channel, used as ``name:channel``."""

    name: str
    parts: tuple[Part, ...]
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    states: Mapping[str, str | float] = field(default_factory=dict)
    max_step: float = 1.0
    max_travel: str = ""
    only: str = ""
    screened: bool = True
    canonical: Callable[[Mapping[str, float]], Mapping[str, float]] | None = None
    starts: Callable[[Any], list[dict[str, float]]] | None = None
    conditions: Mapping[str, float] = field(default_factory=dict)

    @property
    def function(self) -> Callable:
        """The first function, the one that bears the effect's name."""
        return self.parts[0].function

    @property
    def targets(self) -> tuple[str, ...]:
        """Everything it acts on."""
        return tuple(t for part in self.parts for t in part.targets)

    @property
    def replaces(self) -> bool:
        """Whether it does nothing but change quantities."""
        return not any(part.adds for part in self.parts)

    @property
    def of_channel(self) -> bool:
        """Whether this is the fault of one channel's sensor, not the cradle's."""
        return self.targets[0] in READINGS

    @property
    def of_sensor(self) -> bool:
        """Whether this is a sensor's fault, of one channel or of several."""
        return self.of_channel or self.targets[0] in READINGS_OF

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that it changes itself; none for an effect of the cradle, or of one channel."""
        return tuple(t.removeprefix("measured_") for t in self.targets) if self.targets[0] in READINGS_OF else ()

    @property
    def summary(self) -> str:
        """First paragraph of the function's docstring, in one line."""
        return " ".join((inspect.getdoc(self.function) or self.name).split("\n\n")[0].split())

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of what its functions need."""
        return tuple(dict.fromkeys(a for part in self.parts for a in part.arguments))


def effect(
    *,
    adds: str | tuple[str, ...] = (),
    changes: str | tuple[str, ...] = (),
    parameters: Mapping[str, Parameter] | None = None,
    states: Mapping[str, str | float] | None = None,
    then: Part | None = None,
    **further: Any,
) -> Callable[[Callable], Effect]:
    """Declare the decorated function an effect that ``adds`` to forces and ``changes`` quantities of the equations.

    It returns what it adds, what it changes and the rates of its ``states``, in this order; with ``then``, a function
    that is called when all forces are known, that one returns the rates. ``further`` are the other fields of `Effect`:
    ``max_step``, ``max_travel``, ``only``, ``screened`` (False keeps it out of the diagnosis's ranking), ``canonical``,
    ``starts``, ``conditions``. Raises `InputError` where the declaration does not fit."""

    def declare(function: Callable) -> Effect:
        name = function.__name__
        if unknown := [k for k in further if k not in _FURTHER]:
            raise InputError(f"effect '{name}': @effect takes no '{unknown[0]}'{did_you_mean(unknown[0], _FURTHER)}")
        parts = (Part(function, _names(adds), _names(changes)), *([then] if then else []))
        item = Effect(
            name,
            parts,
            dict(parameters or {}),
            dict(states or {}),
            **{k: v for k, v in further.items() if v is not None},
        )
        for part in parts:
            _check_part(name, part)
        _check_sensor(item)
        _check_declared(item)
        return item

    return declare


_FURTHER = ("max_step", "max_travel", "only", "screened", "canonical", "starts", "conditions")


def _names(given: str | Iterable[str]) -> tuple[str, ...]:
    return (given,) if isinstance(given, str) else tuple(given)


def _check_part(name: str, part: Part) -> None:
    if not part.targets:
        raise InputError(f"effect '{name}': say adds=… (a force), changes=… (a quantity) or both")
    if wrong := [t for t in part.adds if t not in FORCES]:
        raise InputError(f"effect '{name}' adds to '{wrong[0]}'; an effect may add to {', '.join(FORCES)}")
    arguments = inspect.signature(part.function).parameters
    if odd := [a.name for a in arguments.values() if a.kind is not a.POSITIONAL_OR_KEYWORD]:
        raise InputError(f"effect '{name}': '{odd[0]}' is not a plain argument; name each quantity it needs")


def _check_declared(item: Effect) -> None:
    name = item.name
    if odd := [p for p, declared in item.parameters.items() if not isinstance(declared, Parameter)]:
        raise InputError(
            f"effect '{name}': declare '{odd[0]}' as Parameter(default, unit, low, high, meaning), not"
            f" {item.parameters[odd[0]]!r}"
        )
    for kind, names in (("parameter", item.parameters), ("state", item.states), ("condition", item.conditions)):
        if unused := [n for n in names if n not in item.arguments]:
            raise InputError(f"effect '{name}' declares {kind} '{unused[0]}' but its function does not take it")
    for state, start in item.states.items():
        if not isinstance(start, str) and (
            isinstance(start, bool) or not isinstance(start, (int, float)) or not math.isfinite(start)
        ):
            raise InputError(
                f"effect '{name}': the state '{state}' starts on {start!r}; give a number or the name of a quantity"
            )
    if item.max_travel and item.max_travel not in item.parameters:
        raise InputError(f"effect '{name}': max_travel = '{item.max_travel}' is not one of its parameters")


def _check_sensor(item: Effect) -> None:
    """Raise `InputError` where an effect of a sensor does what those may not."""
    name, targets, states = item.name, item.targets, item.states
    if not any(t in (*READINGS, *READINGS_OF) for t in targets):
        return
    several = all(t in READINGS_OF for t in targets)
    if not several and len(targets) > 1:
        raise InputError(
            f"effect '{name}': a sensor effect changes {' or '.join(READINGS)} and nothing else, or measured_<channel>"
            " of several"
        )
    if states and targets != ("measured",):
        raise InputError(
            f"effect '{name}': of the effects of sensors only one that changes 'measured' may carry states"
        )


def _effects_in(module: types.ModuleType) -> list[Effect]:
    return [value for value in vars(module).values() if isinstance(value, Effect)]


@functools.cache
def _catalogue() -> dict[str, Effect]:
    found = {}
    for info in sorted(pkgutil.iter_modules(__path__), key=lambda m: m.name):
        for item in _effects_in(importlib.import_module(f"{__name__}.{info.name}")):
            found[item.name] = item
    return found


def catalogue() -> dict[str, Effect]:
    """The effects that ship with the package, by name, in the order of their files' names."""
    return dict(_catalogue())


def load_effects(files: Iterable[str | Path] = ()) -> dict[str, Effect]:
    """The catalogue and the effects of the user's ``files`` (which are run: they are code).

    Raises `InputError` for a file that cannot be read or run, holds no effect, or reuses a name.
    """
    found = catalogue()
    for given in files:
        items = [item for item in _effects_in(run_file(given)) if item is not _catalogue().get(item.name)]
        if not items:
            raise InputError(
                f"effect file {given}: no @effect function in it; see docs/effects.md for the ten lines it takes"
            )
        for item in items:
            if found.setdefault(item.name, item) is not item:
                owner = "the catalogue" if item.name in _catalogue() else "another effect file"
                raise InputError(f"effect file {given}: '{item.name}' is in {owner} already; rename yours")
    return found


def split_name(name: str, known: Mapping[str, Effect], channels: Iterable[str], where: str = "") -> tuple[Effect, str]:
    """Effect and channel ('' for one of the cradle) of an effect's full name, e.g. ``sensor_delay:heave``."""
    place = f"{where}: " if where else ""
    base, _, channel = name.partition(":")
    if base not in known:
        raise InputError(f"{place}unknown effect '{base}'{did_you_mean(base, known)}")
    item = known[base]
    if item.of_channel and channel not in channels:
        raise InputError(
            f"{place}effect '{name}' needs a channel, e.g. '{base}:heave'{did_you_mean(channel, channels)}"
        )
    if channel and not item.of_channel:
        raise InputError(f"{place}effect '{name}': '{base}' is not a sensor's, it takes no channel")
    return item, channel
