# SPDX-License-Identifier: Apache-2.0
"""From equations and effects to machine code.

One Python module is written for each set of effects. It holds the statements of `equations`, with a call of each
effect behind the statement that computes what the effect changes, and the text of `integrator`. Then follow the
statements alone and the text of `lanes`. A model with single coils has a kernel of its own, with the texts of `coils`
at the end. numba compiles the module once. The result is kept on disk under a hash of all its sources, so a changed
effect makes a new module.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from . import compiled, equations, integrator, lanes
from .coils import circuits, flight
from .coils.seam import AVERAGED_ONLY, SEAM, TAKEN
from .compiled import channel_function, function_name, mark, place_of
from .effects import FORCES, Effect, Part
from .errors import InputError, did_you_mean
from .parameters import PARAMETERS
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
_MOMENT = ("time", "travel", "pulse_current", "averaged", "touching_top", "touching_right", "touching_left")


@dataclass(frozen=True)
class Kernel:
    """Compiled functions for one ordered set of effects, and where their numbers stand.

    ``parameters`` names the entries of the parameter vector P, ``states`` those of the state vector, ``effects`` the
    entries of the switch vector ``on``. Where ``dx`` has room behind the rates, `evaluate` writes there where the
    effects' states start. ``simulate_batch``, ``simulate_pieces``, ``linearise_pieces``, ``forced_pieces`` and
    ``evaluate`` are `integrator`'s, ``fly`` is `lanes`'s; the pieces and ``fly`` are compiled on their first call.
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
    fly: Callable
    source: str
    coils: Mapping[str, Callable] = field(default_factory=dict)


def _assigned(statement: ast.stmt) -> set[str]:
    return {n.id for n in ast.walk(statement) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


@dataclass(frozen=True)
class _Call:
    """One function of effect ``index``: ``late`` where it is called when all forces are known."""

    index: int
    item: Effect
    number: int
    late: bool

    @property
    def part(self) -> Part:
        return self.item.parts[self.number]

    @property
    def last(self) -> bool:
        """Whether it returns the rates of the effect's states."""
        return self.number == len(self.item.parts) - 1

    @property
    def results(self) -> list[str]:
        """Names of what it returns, but for rates."""
        return [f"r{self.index}_{self.number}_{k}" for k in range(len(self.part.targets))]

    def lines(self, known: set[str], column: dict[str, int]) -> list[str]:
        """The call, its changes and, when it is late, what it adds. Raises `InputError` for what it asks for in
        vain."""
        rates = [f"dx[{column[f'{self.item.name}.{s}']}]" for s in self.item.states] if self.last else []
        lines = [
            f"{', '.join(self.results + rates)} ="
            f" {function_name(self.index, self.number)}({', '.join(self._arguments(known, column))})"
        ]
        adds = len(self.part.adds)
        lines += [f"{target} = {result}" for target, result in zip(self.part.changes, self.results[adds:], strict=True)]
        return [f"if on[{self.index}]:", *(f"    {line}" for line in lines + (self.additions() if self.late else []))]

    def additions(self) -> list[str]:
        """The lines that add what was returned."""
        return [f"{target} += {result}" for target, result in zip(self.part.adds, self.results, strict=False)]

    def _arguments(self, known: set[str], column: dict[str, int]) -> list[str]:
        item, found = self.item, []
        for name in self.part.arguments:
            if name in item.parameters:
                first, count = column[f"{item.name}.{name}"], item.parameters[name].count
                found.append(f"P[{first}]" if count == 1 else f"P[{first}:{first + count}]")
            elif name in item.states:
                found.append(f"x[{column[f'{item.name}.{name}']}]")
            elif name in item.conditions:
                found.append(f"P[{column[name]}]")
            elif name in known:
                found.append(name)
            else:
                late = name in _QUANTITY_NAMES
                decided = (self.part.changes or self.part.adds)[0]
                remedy = (
                    f"; it is not known yet where {decided} is decided" if late else did_you_mean(name, sorted(known))
                )
                raise InputError(f"{place_of(item)} asks for '{name}', which is not there{remedy}")
        return found


def _calls(effects: list[Effect]) -> list[_Call]:
    """Every function of the effects. Raises `InputError` for one that acts on what is not there, or on what has been
    decided by then."""
    calls = []
    for index, item in enumerate(effects):
        for number, part in enumerate(item.parts):
            for target in part.targets:
                if target not in _QUANTITY_NAMES | set(PARAMETERS):
                    raise InputError(
                        f"{place_of(item)} changes '{target}', which is not"
                        f" there{did_you_mean(target, _QUANTITY_NAMES | set(PARAMETERS))}"
                    )
            early = [t for t in part.changes if t not in FORCES]
            if early and number:
                raise InputError(
                    f"{place_of(item)} changes '{early[0]}' in its second function, when all forces are known; there it"
                    f" may act on {', '.join(FORCES)}"
                )
            if early and len(early) < len(part.changes):
                raise InputError(
                    f"{place_of(item)} changes '{early[0]}' and a force; change the force in a second function,"
                    " then=Part(…)"
                )
            calls.append(_Call(index, item, number, not early))
    return calls


_EQUATIONS = ast.parse(inspect.getsource(equations.equations)).body[0]
assert isinstance(_EQUATIONS, ast.FunctionDef)
_BODY = _EQUATIONS.body[1:-1]  # without docstring and return
_QUANTITY_NAMES = set().union(*map(_assigned, _BODY))
#: What a state may start on besides a number.
STARTS = sorted({"zero", "time", "travel", *STATES, *PARAMETERS, *_QUANTITY_NAMES})


def started_on(effects: Iterable[Effect]) -> list[str | float]:
    """What each state of the effects starts on, in the order in which the kernel carries them."""
    return [0.0 if start == "zero" else start for item in effects for start in item.states.values()]


def _derivative(effects: list[Effect], column: dict[str, int], started_on: Sequence[str | float] = ()) -> str:
    """Text of the right-hand side with the effects' calls in it."""
    calls = _calls(effects)
    used = {"mass", "roll_inertia"} | {n.id for s in _BODY for n in ast.walk(s) if isinstance(n, ast.Name)}
    used |= {a for c in calls for a in (*c.part.arguments, *c.part.targets)} | set(started_on)
    used |= {a for name in FURTHER for a in CHANNEL[name].arguments}
    lines = [f"dx[{i}] = 0.0" for i in range(8, 8 + len(started_on))]
    lines += [f"{r} = 0.0" for c in calls if not c.late for r in c.results[: len(c.part.adds)]]
    lines += [f"{name} = touching[{i}]" for i, name in enumerate(_MOMENT[4:])]
    lines += [f"{name} = P[{column[name]}]" for name in PARAMETERS if name in used]
    lines += [f"{name} = x[{i}]" for i, name in enumerate(STATES)]
    lines += ["travel = surge - origin"]
    groups = _Groups(len(effects))
    known = {*STATES, *PARAMETERS, *_MOMENT}
    remaining = [_assigned(s) for s in _BODY]
    waiting = [c for c in calls if not c.late]
    for position in range(-1, len(_BODY)):  # −1: a parameter may be changed before the first equation
        if position >= 0:
            lines += ast.unparse(_BODY[position]).splitlines()
            known |= remaining[position]
        later = set().union(*remaining[position + 1 :])
        due = [c for c in waiting if not later & set(c.part.changes) and known >= set(c.part.changes)]
        waiting = [c for c in waiting if c not in due]
        lines += groups.ask([(c.index, c.lines(known, column)) for c in due])
    # All is added before the sum is changed.
    late = sorted((c for c in calls if c.late), key=lambda c: (bool(c.part.changes), c.number))
    added = [
        (c.index, [f"if on[{c.index}]:", *(f"    {line}" for line in c.additions())])
        for c in calls
        if not c.late and c.part.adds
    ]
    lines += groups.ask(added + [(c.index, c.lines(known, column)) for c in late])
    lines += [f"dx[{i}] = x[{4 + i}] * moving[{i}]" for i in range(4)]
    lines[-4] = "dx[0] = x[4]"  # a held speed still travels
    for i, force in enumerate(FORCES):
        lines.append(f"dx[{4 + i}] = {force} / {'mass' if i < 3 else 'roll_inertia'} * moving[{i}]")
    lines += [f"q[{i}] = {name}" for i, name in enumerate(QUANTITIES[:6])]
    lines += ["if detail:", *(f"    {line}" for line in _further(known, SEAM in effects))]
    lines += [f"    q[{i}] = {name}" for i, name in enumerate(QUANTITIES) if i >= 6]
    if started_on:  # where dx has room for it, behind the rates: where the effects' states start
        lines += ["    if dx.size > N_STATES:"] + [
            f"        dx[N_STATES + {j}] = {start}" for j, start in enumerate(started_on)
        ]
    head = "def derivative(time, x, P, on, groups, moving, touching, origin, averaged, pulse_current, dx, q, detail):"
    return "\n".join([groups.table(), "", head, *(f"    {line}" for line in lines)])


def _further(known: set[str], single_coils: bool) -> list[str]:
    """The lines that compute what the channels beside the motion see. Raises `InputError` for one that asks for what is
    not there."""
    lines = []
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

    def ask(self, calls: Sequence[tuple[int, list[str]]]) -> list[str]:
        """The lines of these effects' calls behind a question whether any of them is on."""
        if not calls:
            return []
        bit = 1 << self._asked
        self._asked += 1
        for index, _ in calls:
            self._bits[index] |= bit
        return [f"if groups & {bit}:", *(f"    {line}" for _, lines in calls for line in lines)]

    def table(self) -> str:
        """The groups of each effect, a bit each."""
        return f"GROUPS = np.array({self._bits}, dtype=np.int64)"


def _module_text(effects: list[Effect], column: dict[str, int], n_states: int) -> str:
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
    jitted = [
        "pulse_sum",
        "current",
        "until_pulse_edge",
        "groups_on",
        "touches",
        "switches_contact",
        "lowest_moment",
        "step_sizes",
        "slope",
        "observe",
        "see_further",
        "step",
        "carried_error",
        "sticks",
        "integrate",
    ]
    text = mark(inspect.getsource(integrator), "_nrt=False", *jitted)
    text = mark(
        text, "cache=True", "simulate_batch", "simulate_pieces", "linearise_pieces", "forced_pieces", "evaluate"
    )
    head = [
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
        mark("\n" + _derivative(effects, column, started_on(effects)), "_nrt=False, forceinline=True", "derivative"),
        "",
        "",
        text,
        "",
        _lanes_text(),
    ]
    return "\n".join(head)


def _lanes_text() -> str:
    """Text of `lanes` behind the right-hand side without effects, its numbers those of one lane."""
    column = {n: i for i, n in enumerate(PARAMETERS)}
    places, end = {}, 0
    for name, count in {"P": len(column), "STAGE": 8, "SLOPE": 8, "GAPS": len(QUANTITIES), **lanes.ROWS}.items():
        places[name], end = end, end + count * lanes.LANES
    first = {"P": 0, "x": places["STAGE"], "dx": places["SLOPE"], "q": places["GAPS"]}
    body = _derivative([], column).partition("):\n")[2]
    body = re.sub(r"\b(P|x|dx|q)\[(\d+)\]", lambda m: f"work[{first[m[1]] + int(m[2]) * lanes.LANES} + lane]", body)
    body = re.sub(r"\b(exp|sin|cos)\(", r"lane_\1(", body)
    lines = [
        "def slopes(work, moving):",
        "    moving = (moving[0], moving[1], moving[2], moving[3])  # four numbers: an array might overlap with `work`",
        "    time = origin = pulse_current = 0.0; averaged = True; detail = False; touching = (False, False, False)",
        # no call in it but of what is inlined: a loop of calls is unrolled before that.
        "    for lane in range(LANES):",
        *(f"    {line}" for line in body.splitlines()),
        "",
        "",
        inspect.getsource(lanes),
    ]
    text = mark(
        "\n".join(["", *lines]), "_nrt=False, forceinline=True", "lane_exp", "lane_sine", "lane_sin", "lane_cos"
    )
    text = mark(text, "_nrt=False", "slopes", "lane_steps", "leaves")
    constants = [f"{name} = {place}" for name, place in (*places.items(), ("WORK", end)) if name != "P"]
    return "\n".join([*constants, mark(text, "cache=True", "fly")])


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


def _build(items: list[Effect], announce: Callable[[str], None] | None) -> Kernel:
    names = [*PARAMETERS] + [n for e in items for p, d in e.parameters.items() for n in d.entries(f"{e.name}.{p}")]
    names += list(dict.fromkeys(c for e in items for c in e.conditions if c not in PARAMETERS))
    carried = [f"{e.name}.{s}" for e in items for s in e.states]
    column = {n.removesuffix("[0]"): i for i, n in enumerate(names)} | {n: 8 + i for i, n in enumerate(carried)}
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
            module.evaluate, module.fly, text,
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
