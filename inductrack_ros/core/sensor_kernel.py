# SPDX-License-Identifier: Apache-2.0
"""From the effects of sensors to machine code, as `kernel` does it for those of the cradle.

One module is written for a set of effects: a function for each thing an effect may do, which asks for the effect by
its number and calls it, and the text of `sensor_loop`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from types import ModuleType

import numpy as np

from . import compiled, sensor_loop
from .compiled import place_of
from .effects import Effect
from .errors import InputError, did_you_mean
from .parameters import PARAMETERS
from .state import INDEX, OUTPUTS

#: Where a state of a sensor may start, besides a channel's true value: on what it is given to read, or at zero.
STARTS = {"measured": "measured", "zero": "0.0"}


def build(items: Sequence[Effect], announce: Callable[[str], None] | None = None) -> ModuleType:
    """The compiled module for these sensor effects, numbered as they stand; its ``read`` is `sensor_loop.read`.

    Raises `InputError` for an effect that asks for what is not there or that numba cannot compile.
    """
    text = "\n".join(
        [
            "from math import *",
            "import numpy as np",
            "from numba import njit",
            *_function("shifted", "i, p, a, s, t, P", "return s", [_shift(i, e) for i, e in enumerate(items)]),
            *_function("mixed", "i, p, a, s, row, seen, P", "return", [_mix(i, e) for i, e in enumerate(items)]),
            *_function("started", "i, x, b, measured, row", "return", [_start(i, e) for i, e in enumerate(items)]),
            *_function(
                "altered",
                "i, p, a, x, b, t, measured, row, P, dx",
                "return measured",
                [_alter(i, e) for i, e in enumerate(items)],
            ),
            inspect.getsource(sensor_loop),
        ]
    )
    inner = [
        "shifted",
        "mixed",
        "started",
        "altered",
        "interval",
        "true_value",
        "reading",
        "phi",
        "phi_sum",
        "multiply",
        "follow",
    ]
    text = compiled.mark(compiled.mark(text, "_nrt=False", *inner), "cache=True", "read")
    return compiled.load(text, items, _warm_up, announce=announce)


def columns_of(item: Effect) -> list[int]:
    """Columns of `state.OUTPUTS` that an effect of a sensor asks for."""
    names = [a.removeprefix("measured_") for a in item.arguments if a not in item.parameters and a not in item.states]
    return [INDEX[n] for n in names if n in OUTPUTS]


def _function(name: str, arguments: str, otherwise: str, cases: Sequence[list[str]]) -> list[str]:
    lines = ["", "", f"def {name}({arguments}):"]
    for number, body in enumerate(cases):
        if body:
            lines += [f"    if i == {number}:", *(f"        {line}" for line in body)]
    return [*lines, f"    {otherwise}"]


def _arguments(item: Effect, known: dict[str, str]) -> str:
    """The arguments of an effect's call; ``known`` is what it may ask for, by name."""
    where, place = {}, 0
    for name, declared in item.parameters.items():
        where[name] = f"p[a + {place}]" if declared.count == 1 else f"p[a + {place}:a + {place + declared.count}]"
        place += declared.count
    where |= {name: f"x[b + {j}]" for j, name in enumerate(item.states)}
    parameters = {name: f"P[{j}]" for j, name in enumerate(PARAMETERS)}
    found = []
    for name in item.arguments:
        place = where.get(name) or known.get(name) or parameters.get(name)
        if place is None:
            raise InputError(
                f"{place_of(item)} asks for '{name}', which a sensor does not"
                f" know{did_you_mean(name, [*known, *parameters])}"
            )
        found.append(place)
    return ", ".join(found)


def _shift(i: int, item: Effect) -> list[str]:
    if item.targets != ("sample_time",):
        return []
    return [f"return effect_{i}({_arguments(item, {'sample_time': 's', 'time': 't'})})"]


def _mix(i: int, item: Effect) -> list[str]:
    if item.of_channel:
        return []
    known = (
        {"time": "s"}
        | {c: f"row[{k}]" for c, k in INDEX.items()}
        | {f"measured_{c}": f"seen[{k}]" for c, k in INDEX.items()}
    )
    targets = ", ".join(f"seen[{INDEX[c]}]" for c in item.channels)
    return [f"{targets} = effect_{i}({_arguments(item, known)})"]


def _start(i: int, item: Effect) -> list[str]:
    lines = []
    for j, (name, quantity) in enumerate(item.states.items()):
        if quantity not in STARTS and quantity not in INDEX:
            raise InputError(
                f"{place_of(item)}: the state '{name}' starts on '{quantity}', which is not"
                f" there{did_you_mean(str(quantity), [*STARTS, *INDEX])}"
            )
        lines.append(f"x[b + {j}] = {STARTS.get(quantity) or f'row[{INDEX[quantity]}]'}")
    return lines


def _alter(i: int, item: Effect) -> list[str]:
    if item.targets != ("measured",):
        return []
    known = {"measured": "measured", "time": "t"} | {c: f"row[{k}]" for c, k in INDEX.items()}
    results = ", ".join(["measured", *(f"dx[b + {j}]" for j in range(len(item.states)))])
    return [f"{results} = effect_{i}({_arguments(item, known)})", "return measured"]


def _warm_up(module: ModuleType) -> None:
    """Compile, or load from the cache, what every run needs."""
    none, one = np.zeros((1, 0)), np.zeros(1)
    runs, whole = np.zeros((1, 1, len(OUTPUTS))), np.zeros(1, np.int64)
    module.read(
        one, one, runs, whole, none, np.zeros((1, len(PARAMETERS))), np.zeros((0, 4), np.int64), whole, 0, np.nan, none,
        0.0, False, np.zeros((1, 1)),
    )  # fmt: skip
