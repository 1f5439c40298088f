# SPDX-License-Identifier: Apache-2.0
"""Channels that a rig measures beside its motion: what a channel is, and where those of the package and a user's are
found.

A channel is one function and its declaration. The argument names say what the function needs: states, quantities of
`core.equations` (``current_lift``, ``gap_top``, …), model parameters. It returns what a perfect sensor reads::

    @channel(unit="N", noise=0.2, span=200.0, title="Load on the top array", rate=200.0)
    def top_load(repulsion_top, normal_top):
        return repulsion_top + normal_top

All else reads the declaration: CSV columns and units, the topic and its message, the sensor's parameters, the look at
the data, fits, the diagnosis, the monitor, reports. The package's channels are the files of this folder, a user's those
that the environment variable `VARIABLE` names."""

from __future__ import annotations

import importlib
import inspect
import math
import os
import pkgutil
import re
import sys
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..user_files import run_file

__all__ = ["Channel", "Instrument", "channel", "declared", "instruments", "user_files"]

#: Names files of a user's channels, with ``:`` between them. They are Python code, which is run.
VARIABLE = "INDUCTRACK_CHANNELS"


@dataclass(frozen=True)
class Channel:
    """What is known of a measured channel before any measurement.

    - ``unit`` SI; ``noise`` the standard deviation of a good sensor of its kind; ``size`` an error of the reading that
      would matter; ``span`` how far the channel goes on a rig like the paper's, all in ``unit``.
    - ``title`` is how people say it, ``shown`` the factor and the unit in which reports show it.

    Of a channel that is declared by `channel`, and not a state, a gap or an acceleration, also:

    - ``function`` gives what a perfect sensor reads.
    - ``columns`` are further names of its column in a CSV.
    - ``sensor`` is the rig's sensor that delivers it ``rate`` times a second (Hz; 0: off unless a rig says otherwise),
      as ``field`` of a ``message``."""

    unit: str
    noise: float
    size: float
    span: float
    title: str
    shown: tuple[float, str]
    function: Callable | None = None
    columns: tuple[str, ...] = ()
    sensor: str = ""
    message: str = ""
    field: str = ""
    rate: float = 0.0

    @property
    def arguments(self) -> tuple[str, ...]:
        """Names of what its function needs."""
        return tuple(inspect.signature(self.function).parameters) if self.function else ()

    @property
    def name(self) -> str:
        """The function's name, which is the channel's."""
        return self.function.__name__ if self.function else ""

    @property
    def place(self) -> str:
        """Who is at fault, at the head of a message."""
        code = self.function.__code__ if self.function else None
        return f"{code.co_filename}, line {code.co_firstlineno}: channel '{self.name}'" if code else "channel"


@dataclass(frozen=True)
class Instrument:
    """A sensor of the rig: the ``channels`` that it delivers in one ``message`` (a ROS type), and its usual ``rate``
    (Hz)."""

    channels: tuple[str, ...]
    message: str
    rate: float


def channel(
    *,
    unit: str,
    noise: float,
    span: float,
    title: str = "",
    size: float | None = None,
    shown: tuple[float, str] | None = None,
    columns: str | Iterable[str] = (),
    sensor: str = "",
    message: str = "geometry_msgs/msg/PointStamped",
    field: str = "point.x",
    rate: float = 100.0,
) -> Callable[[Callable], Channel]:
    """Declare the decorated function a channel; see `Channel` for the fields.

    ``size`` is three times the noise unless given, ``title`` the name in words, ``sensor`` a sensor of the channel's
    name. Channels of one ``sensor`` share message and rate, and each has a ``field`` of its own. The message has a
    header. Raises `InputError` where the declaration does not fit."""

    def declare(function: Callable) -> Channel:
        name = function.__name__
        item = Channel(
            unit, noise, 3.0 * noise if size is None else size, span, title or name.replace("_", " ").capitalize(),
            shown or (1.0, unit), function, (columns,) if isinstance(columns, str) else tuple(columns), sensor or name,
            message, field, rate,
        )  # fmt: skip
        for what, value in (("noise", item.noise), ("size", item.size), ("span", item.span)):
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value < math.inf:
                raise InputError(f"channel '{name}': {what} = {value!r}; give a number above 0")
        if not 0.0 <= item.rate <= 1000.0:
            raise InputError(f"channel '{name}': rate = {item.rate!r}; give 0 to 1000 Hz")
        if not re.fullmatch(r"\w+/msg/\w+", item.message) or not re.fullmatch(r"\w+(\.\w+)*", item.field):
            raise InputError(
                f"channel '{name}': message = '{item.message}', field = '{item.field}'; give a type such as"
                " sensor_msgs/msg/Temperature and a number in it such as temperature"
            )
        parameters = inspect.signature(function).parameters.values()
        if odd := [a.name for a in parameters if a.kind is not a.POSITIONAL_OR_KEYWORD]:
            raise InputError(f"channel '{name}': '{odd[0]}' is not a plain argument; name each quantity it needs")
        return item

    return declare


def user_files() -> tuple[str, ...]:
    """The files of a user's channels, by the environment."""
    return tuple(f for f in os.environ.get(VARIABLE, "").split(os.pathsep) if f)


def declared(taken: Iterable[str]) -> dict[str, Channel]:
    """The channels of the package and the user's, by name, in the order of their files; ``taken`` are names that no
    channel and no sensor may have.

    The names of all channels are fixed when the package is imported. A wrong file ends the program there, with one line
    and exit status 2."""
    modules = [importlib.import_module(f"{__name__}.{m.name}") for m in _files()]
    found = {name: item for module in modules for name, item in _in(module).items()}
    try:
        for given in user_files():
            items = _in(run_file(given, "channel"))
            if not items:
                raise InputError(f"channel file {given}: no @channel function in it; CONTRIBUTING.md has an example")
            names = {name for name, item in items.items() for name in (name, item.sensor)}
            if twice := sorted(names & {*found, *taken}):
                raise InputError(f"channel file {given}: '{twice[0]}' is the name of another channel; rename yours")
            found |= items
        instruments(found)
    except InputError as error:
        print(f"error: {VARIABLE}: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    return found


def instruments(found: dict[str, Channel]) -> dict[str, Instrument]:
    """The sensors that deliver these channels. Raises `InputError` where channels of one sensor do not fit together."""
    sensors: dict[str, Instrument] = {}
    for name, item in found.items():
        first = sensors.get(item.sensor)
        names = (*first.channels, name) if first else (name,)
        if first and (first.message, first.rate) != (item.message, item.rate):
            raise InputError(f"{item.place}: message and rate differ from {first.channels[0]}'s, of the same sensor")
        if len({found[n].field for n in names}) < len(names):
            raise InputError(f"{item.place}: field '{item.field}' is another channel's of the same sensor")
        sensors[item.sensor] = Instrument(names, item.message, item.rate)
    return sensors


def _files() -> list[pkgutil.ModuleInfo]:
    return sorted(pkgutil.iter_modules([str(Path(__file__).parent)]), key=lambda m: m.name)


def _in(module: types.ModuleType) -> dict[str, Channel]:
    return {value.name: value for value in vars(module).values() if isinstance(value, Channel) and value.function}
