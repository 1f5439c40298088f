# SPDX-License-Identifier: Apache-2.0
"""The equations in pieces: their statements in order, and between these the calls of the effects.

The call of an effect stands right behind the statement that gives what the effect changes. `kernel` and `lane_kernel`
write their right-hand sides from these pieces."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from . import equations
from .compiled import function_name, place_of
from .effects import FORCES, Effect, Part
from .errors import InputError, did_you_mean
from .parameters import PARAMETERS
from .state import STATES

#: What of a moment the equations take besides state and parameters.
MOMENT = ("time", "travel", "pulse_current", "averaged", "touching_top", "touching_right", "touching_left")


def _assigned(statement: ast.stmt) -> set[str]:
    return {n.id for n in ast.walk(statement) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}


_EQUATIONS = ast.parse(inspect.getsource(equations.equations)).body[0]
assert isinstance(_EQUATIONS, ast.FunctionDef)
BODY = _EQUATIONS.body[1:-1]  # without docstring and return
#: All names that the equations assign.
QUANTITY_NAMES = set().union(*map(_assigned, BODY))


@dataclass(frozen=True)
class Call:
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

    def lines(self, known: set[str], column: Mapping[str, int], write: Writer) -> list[str]:
        """The call as ``write`` writes it, its changes and, when it is late, what it adds. Raises `InputError` for what
        it asks for in vain."""
        rates = [f"dx[{column[f'{self.item.name}.{s}']}]" for s in self.item.states] if self.last else []
        lines = write(self, self._arguments(known, column), self.results + rates)
        adds = len(self.part.adds)
        lines += [f"{target} = {result}" for target, result in zip(self.part.changes, self.results[adds:], strict=True)]
        return lines + (self.additions() if self.late else [])

    def additions(self) -> list[str]:
        """The lines that add what was returned."""
        return [f"{target} += {result}" for target, result in zip(self.part.adds, self.results, strict=False)]

    def _arguments(self, known: set[str], column: Mapping[str, int]) -> list[str]:
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
                late = name in QUANTITY_NAMES
                decided = (self.part.changes or self.part.adds)[0]
                remedy = (
                    f"; it is not known yet where {decided} is decided" if late else did_you_mean(name, sorted(known))
                )
                raise InputError(f"{place_of(item)} asks for '{name}', which is not there{remedy}")
        return found


def calls_of(effects: list[Effect]) -> list[Call]:
    """Every function of the effects. Raises `InputError` for one that acts on what is not there, or on what has been
    decided by then."""
    found = []
    for index, item in enumerate(effects):
        for number, part in enumerate(item.parts):
            for target in part.targets:
                if target not in QUANTITY_NAMES | set(PARAMETERS):
                    raise InputError(
                        f"{place_of(item)} changes '{target}', which is not"
                        f" there{did_you_mean(target, QUANTITY_NAMES | set(PARAMETERS))}"
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
            found.append(Call(index, item, number, not early))
    return found


#: The lines of a call with these arguments that assign what it returns to these names.
Writer = Callable[[Call, Sequence[str], Sequence[str]], list[str]]


def called(call: Call, arguments: Sequence[str], results: Sequence[str]) -> list[str]:
    """The call as a call."""
    return [f"{', '.join(results)} = {function_name(call.index, call.number)}({', '.join(arguments)})"]


#: Neighbouring calls, each with the index of its effect and its lines.
Calls = list[tuple[int, list[str]]]


def pieces(found: Sequence[Call], column: Mapping[str, int], write: Writer = called) -> list[list[str] | Calls]:
    """The equations with the calls ``found`` in them, in order: lines of statements, or neighbouring calls as ``write``
    writes them; ``column`` says where parameters and states stand.

    Raises `InputError` for a call that asks for what is not there."""
    result: list[list[str] | Calls] = []
    known = {*STATES, *PARAMETERS, *MOMENT}
    assigned = [_assigned(s) for s in BODY]
    waiting = [c for c in found if not c.late]
    for position in range(-1, len(BODY)):  # −1: a parameter may be changed before the first equation
        if position >= 0:
            result.append(ast.unparse(BODY[position]).splitlines())
            known |= assigned[position]
        later = set().union(*assigned[position + 1 :])
        due = [c for c in waiting if not later & set(c.part.changes) and known >= set(c.part.changes)]
        waiting = [c for c in waiting if c not in due]
        result.append([(c.index, c.lines(known, column, write)) for c in due])
    # All is added before the sum is changed.
    late = sorted((c for c in found if c.late), key=lambda c: (bool(c.part.changes), c.number))
    added = [(c.index, c.additions()) for c in found if not c.late and c.part.adds]
    result.append(added + [(c.index, c.lines(known, column, write)) for c in late])
    return [piece for piece in result if piece]


def used_by(found: Sequence[Call]) -> set[str]:
    """All names that the equations and the calls read or change."""
    names = {"mass", "roll_inertia"} | {n.id for s in BODY for n in ast.walk(s) if isinstance(n, ast.Name)}
    return names | {a for c in found for a in (*c.part.arguments, *c.part.targets)}


def rates() -> list[str]:
    """The lines that make rates of the motion of the forces."""
    lines = [f"dx[{i}] = x[{4 + i}] * moving[{i}]" for i in range(4)]
    lines[0] = "dx[0] = x[4]"  # a held speed still travels
    for i, force in enumerate(FORCES):
        lines.append(f"dx[{4 + i}] = {force} / {'mass' if i < 3 else 'roll_inertia'} * moving[{i}]")
    return lines
