# SPDX-License-Identifier: Apache-2.0
"""Machine code for runs side by side: one module for each set of effects that are on.

It holds the equations as a loop over the lanes of one array, with the text of the effects in it, and the text of
`lanes`. An effect whose text has no place there (`inlining`) is called in a loop of its own between two of equations,
which so become vector instructions whatever it does. Quantities that a later loop needs have a row in the array, as
parameters and states have."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from . import compiled, integrator, lanes
from .compiled import mark
from .effects import Effect
from .inlining import inlined
from .kernel import QUANTITIES, heading, layout
from .parameters import PARAMETERS
from .right_hand_side import MOMENT, Call, called, calls_of, pieces, rates, used_by
from .state import MOTION, STATES

#: What a run in a lane has of `MOMENT` besides the time: the averaged drive, and no contact.
_CALL = re.compile(r"\beffect_\d+")
_FLYING = {"pulse_current": "0.0", "averaged": "True", **{name: "False" for name in MOMENT if "touching" in name}}


@dataclass(frozen=True)
class LaneKernel:
    """`lanes.fly` for a set of effects, all of them on; ``parameters`` and ``states`` name the entries of the vectors
    that it takes."""

    parameters: tuple[str, ...]
    states: tuple[str, ...]
    fly: Callable


#: by identity of the effects, which it keeps alive
_built: dict[tuple[int, ...], tuple[Sequence[Effect], LaneKernel]] = {}


def build(effects: Sequence[Effect]) -> LaneKernel:
    """The kernel for these effects (none of a sensor). Compiles on first use, five seconds and more; later starts load
    machine code from the cache. Raises `InputError` for an effect that numba cannot compile."""
    identity = tuple(map(id, effects))
    if identity not in _built:
        _built[identity] = effects, _build(effects)
    return _built[identity][1]


def _build(effects: Sequence[Effect]) -> LaneKernel:
    names, carried, column = layout(effects)
    states = (*STATES, *carried)

    def warm_up(module: ModuleType) -> None:
        x, P = np.zeros((1, len(states))), np.ones((1, len(names)))
        P[0, : len(PARAMETERS)] = [p.default for p in PARAMETERS.values()]
        module.fly(np.zeros(1), 0.0, x, P, np.ones(4), np.zeros((1, 1, len(MOTION))), np.zeros(1, np.int64))

    text = "\n".join([*heading(effects, column, len(states)), _text(effects, column, len(names), len(states))])
    module = compiled.load(text, effects, warm_up, inlined=True)
    return LaneKernel(tuple(names), states, module.fly)


def _text(effects: Sequence[Effect], column: Mapping[str, int], parameters: int, n_states: int) -> str:
    """Text of the right-hand side, of what `lanes` takes of `integrator`, and of `lanes`."""
    loops, kept = _loops(effects, column)
    places, end = {}, 0
    counts = {"P": parameters, "GAPS": 3} | {name: n_states for name in lanes.STATE_ROWS}
    for name, count in {**counts, **{name: 1 for name in lanes.ROWS}, "KEPT": len(kept)}.items():
        places[name], end = end, end + count * lanes.LANES
    lines = [
        "def slopes(work, own, moving):",
        "    moving = (moving[0], moving[1], moving[2], moving[3])  # four numbers: an array might overlap with `work`",
        *(f"    {line}" for loop in loops for line in ["for lane in range(LANES):", *(f"    {x}" for x in loop)]),
    ]
    text = "\n".join(["", *lines, "", "", inspect.getsource(integrator), "", inspect.getsource(lanes)])
    text = mark(text, "_nrt=False, forceinline=True", "lane_exp", "lane_sine", "lane_sin", "lane_cos")
    text = mark(text, "_nrt=False", "slopes", "lane_steps", "leaves", "step_sizes")
    constants = [f"{name} = {place}" for name, place in (*places.items(), ("WORK", end))]
    return "\n".join([*constants, mark(text, "cache=True", "fly")])


def _loops(effects: Sequence[Effect], column: Mapping[str, int]) -> tuple[list[list[str]], list[str]]:
    """The bodies of the loops over the lanes, and the quantities that have a row because a later loop needs them."""
    calls = calls_of(list(effects))
    used = used_by(calls)
    sources = {name: f"P[{column[name]}]" for name in PARAMETERS if name in used} | _FLYING
    sources |= {name: f"x[{i}]" for i, name in enumerate(STATES)}
    sources |= {"time": "work[WHEN + lane]", "travel": "x[0] - work[BEGAN + lane]"}
    bodies: list[list[str]] = [[]]
    for piece in pieces(calls, column, _written):
        for part in piece:
            if isinstance(part, str):
                bodies[-1].append(part)
            elif _CALL.search(part[1][0]):
                bodies += [part[1], []]
            else:
                bodies[-1] += part[1]
    bodies[-1] += [*rates(), *(f"work[GAPS + {i} * LANES + lane] = {name}" for i, name in enumerate(QUANTITIES[:3]))]
    bodies = [body for body in bodies if body]
    names = [_names(body) for body in bodies]
    kept: list[str] = []
    loops = []
    for k, body in enumerate(bodies):
        reads, writes = names[k]
        lines = [f"{name} = {sources[name]}" for name in sorted(reads & set(sources))] + body
        for name in sorted(writes & set().union(*(later for later, _ in names[k + 1 :]))):
            kept += [name] if name not in kept else []
            sources[name] = f"work[KEPT + {kept.index(name)} * LANES + lane]"
            lines.append(f"{sources[name]} = {name}")
        loops.append([_in_lanes(line) for line in lines])
    return loops, kept


def _written(call: Call, arguments: Sequence[str], results: Sequence[str]) -> list[str]:
    """An effect's text in the place of its call where that can be, else the call."""
    prefix = f"e{call.index}_{call.number}_"
    found = None if ":" in "".join(arguments) else inlined(call.part.function, arguments, results, prefix)
    return called(call, arguments, results) if found is None else found


def _names(lines: Sequence[str]) -> tuple[set[str], set[str]]:
    """The names that some lines read without having assigned them in a line before, and those that they assign."""
    reads, writes = set[str](), set[str]()
    for statement in ast.parse("\n".join(lines)).body:
        found = [n for n in ast.walk(statement) if isinstance(n, ast.Name)]
        stored = {n.id for n in found if isinstance(n.ctx, ast.Store)}
        reads |= {n.id for n in found if isinstance(n.ctx, ast.Load)} - writes
        if isinstance(statement, ast.AugAssign):
            reads |= stored - writes
        writes |= stored
    return reads, writes


def _in_lanes(line: str) -> str:
    """A line with the entries of a lane for those of parameters, state and rates.

    All but tables is in one array: the compiler would have to fear that two overlap."""
    rows = {"P": "P", "x": "STAGE", "dx": "SLOPE"}
    line = re.sub(r"\bP\[(\d+):(\d+)\]", r"own[lane, \1:\2]", line)
    line = re.sub(r"\b(P|x|dx)\[(\d+)\]", lambda m: f"work[{rows[m[1]]} + {m[2]} * LANES + lane]", line)
    return re.sub(r"\b(exp|sin|cos)\(", r"lane_\1(", line)
