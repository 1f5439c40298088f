# SPDX-License-Identifier: Apache-2.0
"""From equations and effects to machine code.

One Python module is written for each set of effects. It holds the statements of `equations`, with a call of each
effect behind the statement that computes what the effect changes, and the text of `integrator`. A model with single
coils has a kernel of its own, with the texts of `coils` at the end. numba compiles the module once. The result is kept
on disk under a hash of all its sources, so a changed effect makes a new module. Runs side by side have a module of
their own, see `lane_kernel`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from . import compiled, equations, integrator
from .coils import circuits, flight
from .coils.seam import AVERAGED_ONLY, SEAM, TAKEN
from .compiled import channel_function, mark, place_of
from .effects import FORCES, Effect
from .errors import InputError, did_you_mean
from .parameters import PARAMETERS
from .right_hand_side import MOMENT, QUANTITY_NAMES, Calls, calls_of, pieces, rates, used_by
from .state import CHANNEL, FURTHER, MOTION, STATES

#: Quantities of the equations that `evaluate` hands out besides the derivative; the first six serve the integrator.
_NAMED = (
    "gap_top", "gap_right", "gap_left", "gap_top_rate", "gap_right_rate", "gap_left_rate",
    "repulsion_top", "repulsion_right", "repulsion_left", "normal_top", "normal_right", "normal_left",
    "magnetic_drag", "thrust", "force_surge", "force_sway", "force_heave", "moment_roll",
    "arm_top_x", "arm_right_x", "arm_right_y", "arm_left_x", "arm_left_y", "overlap", "current_lift", "current_drag",
    "eta", "peak_field", "inductance", "resistance", "width_top", "width_right", "width_left",
)  # fmt: skip
#: All that it hands out: behind them what the channels beside the motion see.
QUANTITIES = (*_NAMED, *FURTHER)
#: Longest free step over the field's time scale, and contact step over the contact's: set by the golden trajectories.
FREE_STEP, CONTACT_STEP = 0.14, 0.4

#: What a kernel for single coils has besides.
COIL_FUNCTIONS = ("simulate_coils", "forces_now", "follow_coils")

_FLAGS = ("averaged", "touching_top", "touching_right", "touching_left")


@dataclass(frozen=True)
class Kernel:
    """Compiled functions for one ordered set of effects, and where their numbers stand.

    ``parameters`` names the entries of the parameter vector P, ``states`` those of the state vector, ``effects`` the
    entries of the switch vector ``on``. Where ``dx`` has room behind the rates, `evaluate` writes there where the
    effects' states start. ``simulate_batch``, ``simulate_pieces``, ``linearise_pieces``, ``forced_pieces`` and
    ``evaluate`` are `integrator`'s; the pieces are compiled on their first call.
    ``coils`` are the functions of a track of single coils, where it was built for one: `coils.flight.simulate_coils`
    and `forces_now`, `coils.circuits.follow_coils`, by name."""

    effects: tuple[str, ...]
    parameters: tuple[str, ...]
    states: tuple[str, ...]
    simulate_batch: Callable
    simulate_pieces: Callable
    linearise_pieces: Callable
    forced_pieces: Callable
    evaluate: Callable
    source: str
    coils: Mapping[str, Callable] = field(default_factory=dict)


#: What a state may start on besides a number.
STARTS = sorted({"zero", "time", "travel", *STATES, *PARAMETERS, *QUANTITY_NAMES})


def started_on(effects: Iterable[Effect]) -> list[str | float]:
    """What each state of the effects starts on, in the order in which the kernel carries them."""
    return [0.0 if start == "zero" else start for item in effects for start in item.states.values()]


def _derivative(effects: list[Effect], column: dict[str, int], started_on: Sequence[str | float] = ()) -> str:
    """Text of the right-hand side with the effects' calls in it."""
    calls = calls_of(effects)
    used = used_by(calls) | set(started_on) | {a for name in FURTHER for a in CHANNEL[name].arguments}
    lines = [f"dx[{i}] = 0.0" for i in range(8, 8 + len(started_on))]
    lines += [f"{r} = 0.0" for c in calls if not c.late for r in c.results[: len(c.part.adds)]]
    lines += [f"{name} = touching[{i}]" for i, name in enumerate(MOMENT[4:])]
    lines += [f"{name} = P[{column[name]}]" for name in PARAMETERS if name in used]
    lines += [f"{name} = x[{i}]" for i, name in enumerate(STATES)]
    lines += ["travel = surge - origin"]
    groups = _Groups(len(effects))
    for piece in pieces(calls, column):
        lines += [line for line in piece if isinstance(line, str)]
        lines += groups.ask([call for call in piece if not isinstance(call, str)])
    lines += rates()
    lines += [f"q[{i}] = {name}" for i, name in enumerate(QUANTITIES[:6])]
    lines += ["if detail:", *(f"    {line}" for line in _further(SEAM in effects))]
    lines += [f"    q[{i}] = {name}" for i, name in enumerate(QUANTITIES) if i >= 6]
    if started_on:  # where dx has room for it, behind the rates: where the effects' states start
        lines += ["    if dx.size > N_STATES:"] + [
            f"        dx[N_STATES + {j}] = {start}" for j, start in enumerate(started_on)
        ]
    head = "def derivative(time, x, P, on, groups, moving, touching, origin, averaged, pulse_current, dx, q, detail):"
    return "\n".join([groups.table(), "", head, *(f"    {line}" for line in lines)])


def _further(single_coils: bool) -> list[str]:
    """The lines that compute what the channels beside the motion see. Raises `InputError` for one that asks for what is
    not there."""
    lines, known = [], {*STATES, *PARAMETERS, *MOMENT, *QUANTITY_NAMES}
    for name in FURTHER:
        item = CHANNEL[name]
        if name in known:
            raise InputError(f"{item.place}: this is the name of a quantity of the model; rename the channel")
        if sums := [a for a in item.arguments if a in FORCES]:
            raise InputError(f"{item.place} asks for {sums[0]}, the sum of all forces: measure an acceleration instead")
        if odd := [a for a in item.arguments if a not in known]:
            raise InputError(
                f"{item.place} asks for '{odd[0]}', which is not there{did_you_mean(odd[0], sorted(known))}"
            )
        blind = single_coils and AVERAGED_ONLY & set(item.arguments)  # coils have no such quantity: not measured
        lines.append(f"{name} = " + ("nan" if blind else f"{channel_function(name)}({', '.join(item.arguments)})"))
    return lines


class _Groups:
    """Neighbouring calls behind one question, for most effects are off; see `integrator.groups_on`."""

    def __init__(self, effects: int) -> None:
        self._bits, self._asked = [0] * effects, 0

    def ask(self, calls: Calls) -> list[str]:
        """The lines of these effects' calls behind a question whether any of them is on."""
        if not calls:
            return []
        bit = 1 << self._asked
        self._asked += 1
        for index, _ in calls:
            self._bits[index] |= bit
        asked = [(f"if on[{index}]:", *(f"    {line}" for line in lines)) for index, lines in calls]
        return [f"if groups & {bit}:", *(f"    {line}" for lines in asked for line in lines)]

    def table(self) -> str:
        """The groups of each effect, a bit each."""
        return f"GROUPS = np.array({self._bits}, dtype=np.int64)"


def _module_text(effects: list[Effect], column: dict[str, int], n_states: int) -> str:
    jitted = [
        "pulse_sum",
        "current",
        "until_pulse_edge",
        "first_unburnt",
        "groups_on",
        "touches",
        "switches_contact",
        "lowest_moment",
        "step_sizes",
        "slope",
        "observe",
        "see_further",
        "observe_touching",
        "step",
        "carried_error",
        "sticks",
        "integrate",
    ]
    text = mark(inspect.getsource(integrator), "_nrt=False", *jitted)
    text = mark(
        text, "cache=True", "simulate_batch", "simulate_pieces", "linearise_pieces", "forced_pieces", "evaluate"
    )
    derivative = _derivative(effects, column, started_on(effects))
    derivative = mark("\n" + derivative, "_nrt=False, forceinline=True", "derivative")
    return "\n".join([*heading(effects, column, n_states), derivative, "", "", text])


def heading(effects: Sequence[Effect], column: Mapping[str, int], n_states: int) -> list[str]:
    """The first lines of a module: what it imports, and its constants."""
    constants = {name.upper(): column[name] for name in PARAMETERS}
    constants |= {
        "N_STATES": n_states,
        "PADDED": (n_states + 3) // 4 * 4,
        "N_QUANTITIES": len(QUANTITIES),
        "MOTION": len(MOTION),
        "FURTHER": len(_NAMED),  # where in q what further channels see begins
        "FREE_STEP": FREE_STEP,
        "CONTACT_STEP": CONTACT_STEP,
    }
    return [
        "from math import cos, exp, nan, pi, sin, sqrt",
        "import numpy as np",
        "from numba import njit",
        f"SQRT_HALF = {equations.SQRT_HALF!r}",
        f"MAX_STEPS = np.array([{', '.join(repr(e.max_step) for e in effects)}], dtype=np.float64)",
        (
            f"MAX_TRAVELS = np.array([{', '.join(str(column.get(f'{e.name}.{e.max_travel}', -1)) for e in effects)}],"
            " dtype=np.int64)"
        ),
        *(f"{name} = {value!r}" for name, value in constants.items()),
    ]


def _coils_text(column: dict[str, int]) -> str:
    """Text of single coils, to stand behind `integrator`'s."""
    constants = {"SEAM": column[f"{SEAM.name}.{next(iter(SEAM.parameters))}"]}
    constants |= {f"Q_{name.upper()}": QUANTITIES.index(name) for name in TAKEN}
    inner = (
        "spline_weights", "field_rows", "see_field", "first_coil", "move_window", "coil_equations", "solve_band",
        "coil_forces", "stored_energy", "heat_and_work", "enter", "leave", "step_coils", "coil_step_size",
        "coil_surroundings",
    )  # fmt: skip
    text = "\n".join(["", inspect.getsource(circuits), "", inspect.getsource(flight)])
    text = mark(mark(text, "_nrt=False", *inner), "cache=True", *COIL_FUNCTIONS)
    return "\n".join([*(f"{name} = {value}" for name, value in constants.items()), text])


#: by identity of the effects, which it keeps alive
_built: dict[tuple[int, ...], tuple[list[Effect], Kernel]] = {}


def build(
    effects: Mapping[str, Effect], announce: Callable[[str], None] | None = None, single_coils: bool = False
) -> Kernel:
    """The kernel for these effects (sensor effects have no place in it and are passed over), with ``single_coils`` one
    for a track of those.

    Compiles on first use and tells ``announce`` so; later starts load machine code from the cache. Raises
    `InputError` for an effect that asks for what is not there or that numba cannot compile.
    """
    items = [e for e in effects.values() if not e.of_sensor] + ([SEAM] if single_coils else [])
    identity = tuple(map(id, items))
    if identity not in _built:
        _built[identity] = items, _build(items, announce)
    return _built[identity][1]


def layout(items: Sequence[Effect]) -> tuple[list[str], list[str], dict[str, int]]:
    """Names of the entries of the parameter vector and of the effects' states, and where each of both stands."""
    names = [*PARAMETERS] + [n for e in items for p, d in e.parameters.items() for n in d.entries(f"{e.name}.{p}")]
    names += list(dict.fromkeys(c for e in items for c in e.conditions if c not in PARAMETERS))
    carried = [f"{e.name}.{s}" for e in items for s in e.states]
    return (
        names,
        carried,
        {n.removesuffix("[0]"): i for i, n in enumerate(names)} | {n: 8 + i for i, n in enumerate(carried)},
    )


def _build(items: list[Effect], announce: Callable[[str], None] | None) -> Kernel:
    names, carried, column = layout(items)
    for item in items:
        for start in item.states.values():
            if isinstance(start, str) and start not in STARTS:
                raise InputError(
                    f"{place_of(item)}: a state starts on '{start}', which is not there{did_you_mean(start, STARTS)}"
                )
    with_coils = SEAM in items
    text = _module_text(items, column, 8 + len(carried)) + (_coils_text(column) if with_coils else "")

    def kernel(module: ModuleType) -> Kernel:
        return Kernel(
            tuple(e.name for e in items), tuple(names), STATES + tuple(carried),
            module.simulate_batch, module.simulate_pieces, module.linearise_pieces, module.forced_pieces,
            module.evaluate, text,
            {name: getattr(module, name) for name in COIL_FUNCTIONS} if with_coils else {},
        )  # fmt: skip

    seen = {name: CHANNEL[name] for name in FURTHER}
    return kernel(compiled.load(text, items, lambda module: _warm_up(kernel(module)), _FLAGS, announce, seen))


def _warm_up(kernel: Kernel) -> None:
    """Compile, or load from the cache, now rather than in the middle of a run."""
    n = len(kernel.states)
    P = np.array([PARAMETERS[p].default if p in PARAMETERS else 1.0 for p in kernel.parameters])
    on, moving, none = np.zeros((1, len(kernel.effects)), np.bool_), np.ones(4), np.empty(0)
    dx, q = np.zeros(n), np.zeros(len(QUANTITIES))
    kernel.evaluate(0.0, np.zeros(n), P, on[0], moving, 0.0, True, none, none, none, dx, q)
    if kernel.coils:
        _warm_up_coils(kernel, P, (on[0], moving, 0.0, True, none, none, none, 1.0), q)
        return
    start, out = np.zeros((1, n)), np.zeros((1, 1, len(MOTION)))
    kernel.simulate_batch(np.zeros(1), 0.0, start, P[None], on, moving, np.zeros(1), True, none, none, none, 1.0, out)


def _warm_up_coils(kernel: Kernel, P: np.ndarray, arguments: tuple, q: np.ndarray) -> None:
    """The same for the functions of single coils, on two coils that no field reaches."""
    time, gaps, tail, none = np.zeros(1), np.zeros((1, 3)), np.zeros(3), np.empty(0)
    track = np.zeros((4, 4)), np.ones(8), none, none, none
    state, out = np.zeros(len(kernel.states)), np.zeros((1, len(MOTION)))
    kernel.coils["simulate_coils"](time, 0.0, state, tail, P, *arguments, track, out)
    kernel.coils["forces_now"](0.0, q, track, tail, np.zeros(4))
    kernel.coils["follow_coils"](
        time, time, gaps, np.ones(3), 1.0, (1.0, 1.0), track, tail, np.zeros((1, 4)), np.zeros((1, 3))
    )
