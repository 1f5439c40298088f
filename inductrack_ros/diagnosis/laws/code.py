# SPDX-License-Identifier: Apache-2.0
"""Proposed laws as the text of a Python module with an `@effect` function each: what a refit runs and what a user
edits."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.parameters import Parameter
from ..factor import Factor
from .forms import Form, Range, meaning_of, unit_of

#: The name by which an effect asks for a variable, where it is not the variable's own.
_ARGUMENT = {"drive": "drive_current"}
#: What an effect on a coordinate adds to.
_ADDS = {"surge": "force_surge", "sway": "force_sway", "heave": "force_heave", "roll": "moment_roll"}
#: A size may be fitted up to so many times the one found; a shape's typical change is this part of its range.
WIDE, STEP = 100.0, 0.02
#: The file that a diagnosis writes.
FILE = "proposed_effects.py"


@dataclass(frozen=True)
class Written:
    """A law to be written: its form, what it acts on and depends on, its values, the range of the data and what its
    docstring says. ``factor`` is what it is multiplied by, without its scale."""

    form: Form
    acts_on: str
    variable: str
    values: Mapping[str, float]
    covered: Range
    words: str = ""
    factor: Factor | None = None

    @property
    def name(self) -> str:
        """Name of the effect."""
        times = f"_times_{self.factor.label}" if self.factor else ""
        return f"proposed_{self.form.name}_{self.acts_on}_on_{self.variable}{times}"

    def force(self, u: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        """The law at u (n,) with these parameters, its factor at its scale."""
        return self.form.value(u, values) * (self.factor.size if self.factor else 1.0)

    def unit(self, parameter: str) -> str:
        """Unit of one of its parameters."""
        return unit_of(self.form, parameter, self.acts_on, self.variable, self.factor)


def module_text(laws: Sequence[Written], header: str = "") -> str:
    """The module with these laws."""
    used = "import math\n\n" if any("math." in t.expression for law in laws for t in law.form.terms) else ""
    top = f'"""{header}"""\n\n' if header else ""
    return f"{top}{used}from inductrack_ros.core.effects import Parameter, effect\n\n\n" + "\n\n".join(
        _effect_text(law) for law in laws
    )


def _effect_text(law: Written) -> str:
    argument = _ARGUMENT.get(law.variable, law.variable)
    total = " + ".join(_product(t.size, t.expression) for t in law.form.terms)
    total = re.sub(r"\bu\b", argument, total)
    arguments = [argument]
    if law.factor is not None:
        other = _ARGUMENT.get(law.factor.variable, law.factor.variable)
        arguments.append(other)
        total = f"{' * '.join([other] * law.factor.power)} * ({total})"
    names = ", ".join([*arguments, *law.form.names])
    if law.acts_on == "thrust":
        names, total, target = f"thrust, {names}", f"thrust * (1.0 + {total})", 'changes="thrust"'
    else:
        target = f'adds="{_ADDS[law.acts_on]}"'
    declared = "".join(f"        {_declaration(law, p)},\n" for p in law.form.names)
    words = f'    """{law.words}"""\n' if law.words else ""
    return (
        f"@effect(\n    {target},\n    parameters={{\n{declared}    }},\n)\ndef {law.name}({names}):\n{words}    return"
        f" {total}\n"
    )


def _product(size: str, expression: str) -> str:
    return size if expression == "1.0" else f"{size} * ({expression})"


def _declaration(law: Written, parameter: str) -> str:
    """A line of the parameters' declaration."""
    p = declaration(law, parameter)
    return (
        f'"{parameter}": Parameter({p.default!r}, "{p.unit}", {p.low!r}, {p.high!r}, "{p.meaning}", "{p.source}",'
        f" typical={p.typical!r})"
    )


def declaration(law: Written, parameter: str) -> Parameter:
    """The declaration of a law's parameter: a size vanishes by default, a shape is where it was found."""
    value, unit = law.values[parameter], law.unit(parameter)
    kind = next((s.kind for s in law.form.shapes if s.name == parameter), "")
    if kind:
        low, high = law.covered.bounds(kind)
        default = _rounded(value, 5)
        typical = {"power": 0.05, "phase": 0.1}.get(kind) or STEP * min(high - low, law.covered.length)
        low, high = min(_rounded(low, 3), default), max(_rounded(high, 3), default)
    else:
        default, high, typical = 0.0, _rounded(WIDE * abs(value) or 1.0, 1), abs(value) / 10 or 1.0
        low = -high
    return Parameter(
        default, unit, low, high, meaning_of(law.form, parameter), "proposed by a diagnosis", _rounded(typical, 2)
    )


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
