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

It must be something numba can compile: arithmetic, ``math`` functions, ``if``. The same function runs in the node,
offline, in fits and in the diagnosis.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import InputError, did_you_mean
from ..parameters import Parameter

__all__ = ["Effect", "Parameter", "catalogue", "effect", "load_effects"]

#: What an effect may add to (paper frame: surge z, sway x, heave y, roll about z).
FORCES = ("force_surge", "force_sway", "force_heave", "moment_roll")
#: What a sensor effect may change: the reading, and the time at which it was true.
READINGS = ("measured", "sample_time")


@dataclass(frozen=True)
class Effect:
    """One effect: its function, where its result goes, its parameters and states.

    ``states`` maps each state the effect carries to the quantity whose value (without the effect) it starts on; the
    function then returns, after what it adds or changes, the states' time derivatives. ``max_step`` (s) bounds the
    integration step while the effect is on; ``only`` limits it to the ``averaged`` or the ``pulses`` drive;
    ``of_channel`` marks a sensor effect, used as ``name:channel``.
    """

    name: str
    function: Callable
    targets: tuple[str, ...]
    replaces: bool
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    states: Mapping[str, str] = field(default_factory=dict)
    max_step: float = 1.0
    only: str = ""
    screened: bool = True

    @property
    def of_channel(self) -> bool:
        """Whether this is a sensor's fault, not the cradle's."""
        return self.targets[0] in READINGS

    @property
    def summary(self) -> str:
        """First line of the function's docstring."""
        return (inspect.getdoc(self.function) or self.name).splitlines()[0]

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of what the function needs."""
        return tuple(inspect.signature(self.function).parameters)


def effect(
    *,
    adds: str | tuple[str, ...] = (),
    changes: str | tuple[str, ...] = (),
    parameters: Mapping[str, Parameter] | None = None,
    states: Mapping[str, str] | None = None,
    max_step: float = 1.0,
    only: str = "",
    screened: bool = True,
) -> Callable[[Callable], Effect]:
    """Declare the decorated function an effect that ``adds`` to forces or ``changes`` quantities of the equations.

    ``screened=False`` keeps it out of the diagnosis's ranking. Raises `InputError` where the declaration does not fit.
    """

    def declare(function: Callable) -> Effect:
        name = function.__name__
        if bool(adds) == bool(changes):
            raise InputError(f"effect '{name}': say either adds=… (a force) or changes=… (a quantity)")
        targets = adds or changes
        targets = (targets,) if isinstance(targets, str) else tuple(targets)
        if adds and (wrong := [t for t in targets if t not in FORCES]):
            raise InputError(f"effect '{name}' adds to '{wrong[0]}'; an effect may add to {', '.join(FORCES)}")
        own = dict(parameters or {})
        if unused := [p for p in own if p not in inspect.signature(function).parameters]:
            raise InputError(f"effect '{name}' declares parameter '{unused[0]}' but its function does not take it")
        return Effect(name, function, targets, bool(changes), own, dict(states or {}), max_step, only, screened)

    return declare


def _effects_in(module) -> list[Effect]:
    return [value for value in vars(module).values() if isinstance(value, Effect)]


def catalogue() -> dict[str, Effect]:
    """The effects that ship with the package, by name, in the order of their files' names."""
    found = {}
    for info in sorted(pkgutil.iter_modules(__path__), key=lambda m: m.name):
        for item in _effects_in(importlib.import_module(f"{__name__}.{info.name}")):
            found[item.name] = item
    return found


def load_effects(files: Iterable[str | Path] = ()) -> dict[str, Effect]:
    """The catalogue and the effects of the user's ``files`` (which are run: they are code).

    Raises `InputError` for a file that cannot be read or run, holds no effect, or reuses a name.
    """
    found = catalogue()
    for given in files:
        path = Path(given).expanduser().resolve()
        if not path.is_file():
            raise InputError(f"effect file {given}: no such file; give the path of a Python file with @effect functions")
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
        name = f"inductrack_user_effects_{path.stem}_{digest}"
        if name not in sys.modules:
            spec = importlib.util.spec_from_file_location(name, path)
            if spec is None or spec.loader is None:
                raise InputError(f"effect file {given}: not a Python file; its name must end in .py")
            module = importlib.util.module_from_spec(spec)
            try:
                exec(compile(path.read_bytes(), str(path), "exec"), vars(module))  # never from a stale .pyc
            except InputError:
                raise
            except Exception as error:  # whatever the user's code raises is the user's to read
                line = getattr(error, "lineno", None) or next(
                    (f.lineno for f in reversed(inspect.trace()) if f.filename == str(path)), "?"
                )
                raise InputError(f"effect file {given}, line {line}: {type(error).__name__}: {error}") from error
            sys.modules[name] = module
        items = _effects_in(sys.modules[name])
        if not items:
            raise InputError(f"effect file {given}: no @effect function in it; see docs/effects.md for the ten lines it takes")
        for item in items:
            if item.name in catalogue():
                raise InputError(f"effect file {given}: '{item.name}' is in the catalogue already; rename yours")
            found[item.name] = item
    return found


def split_name(name: str, known: Mapping[str, Effect], channels: Iterable[str], where: str = "") -> tuple[Effect, str]:
    """Effect and channel ('' for one of the cradle) of an effect's full name, e.g. ``sensor_delay:heave``."""
    place = f"{where}: " if where else ""
    base, _, channel = name.partition(":")
    if base not in known:
        raise InputError(f"{place}unknown effect '{base}'{did_you_mean(base, known)}")
    item = known[base]
    if item.of_channel and channel not in channels:
        raise InputError(f"{place}effect '{name}' needs a channel, e.g. '{base}:heave'{did_you_mean(channel, channels)}")
    if channel and not item.of_channel:
        raise InputError(f"{place}effect '{name}': '{base}' is not a sensor's, it takes no channel")
    return item, channel
