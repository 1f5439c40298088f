# SPDX-License-Identifier: Apache-2.0
"""A law in the place of a table, to be refitted in full: the table's values follow from the law's parameters, which are
free.

The model's own stand-in carries the law as a table of `KNOTS` entries, so nothing is compiled; what is written for the
user (`code`) is the law itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ...core.effects.stand_in import TABLE, basis
from ...core.model import Model
from ...core.parameters import Parameter
from ...estimation.structure import Structure
from .code import Written, declaration

#: Entries of the table that carries a law, and how far beyond the range of the data it goes on, as part of that.
KNOTS, BEYOND = TABLE, 0.05
#: Points at which a law is laid on it, for each entry.
POINTS = 4


@dataclass(frozen=True)
class LawStructure(Structure):
    """A structure whose stand-in ``carrier`` is a law: its free parameters are called as those of the law's effect."""

    law: Written = field(kw_only=True)
    carrier: str = field(kw_only=True)

    @classmethod
    def of(cls, structure: Structure, carrier: str, law: Written) -> LawStructure:
        """The structure with the law in the place of its stand-in's table."""
        r = law.covered
        low, high = r.low - BEYOND * r.length, r.high + BEYOND * r.length
        plain = structure.minus(carrier)
        table = {
            "variable": structure.model.effects[carrier]["variable"],
            "start": low,
            "step": (high - low) / (KNOTS - 1),
            "knots": float(KNOTS),
            "values": (0.0,) * KNOTS,
            **(law.factor.parameters if law.factor else {}),
        }
        model = plain.model.with_changes(effects={**plain.model.effects, carrier: table})
        free = plain.free + tuple(f"{law.name}.{p}" for p in law.form.names)
        return cls(model, free, plain.smoothness, None, law=law, carrier=carrier)

    def declared(self, name: str) -> Parameter:
        """Declaration of a free parameter."""
        return declaration(self.law, self._own(name)) if self._own(name) else super().declared(name)

    def value(self, name: str) -> float:
        """Where a parameter starts."""
        return self.law.values[self._own(name)] if self._own(name) else super().value(name)

    def _own(self, name: str) -> str:
        """The law's parameter of this name, or none."""
        return name.removeprefix(f"{self.law.name}.") if name.startswith(f"{self.law.name}.") else ""

    @cached_property
    def columns(self) -> tuple[int | None, ...]:
        """Column of each free parameter in the kernel's vector; of the law's that of the table's first entry."""
        names = self.model.kernel.parameters
        places = [n if not self._own(n) else f"{self.carrier}.values[0]" for n in self.free]
        return tuple(names.index(n) if n in names else None for n in places)

    def vectors(self, thetas: np.ndarray) -> np.ndarray:
        """Kernel parameter vectors (j, p) for each row of ``thetas`` (j, g)."""
        P = super().vectors(thetas)
        first = self.model.kernel.parameters.index(f"{self.carrier}.values[0]")
        mine = [k for k, n in enumerate(self.free) if self._own(n)]
        known: dict[bytes, np.ndarray] = {}
        for row, theta in zip(P, thetas, strict=True):
            key = theta[mine].tobytes()
            if key not in known:
                known[key] = self._table(self.decode(theta))
            row[first : first + KNOTS] = known[key]
        return P

    def with_theta(self, theta: np.ndarray) -> Model:
        """The model with the free parameters at theta, the law as a table."""
        values = self.decode(theta)
        plain = replace(self._plain, model=self.model)
        model = plain.with_theta(plain.encode([values[n] for n in plain.free]))
        table = {**self.model.effects[self.carrier], "values": tuple(self._table(values).tolist())}
        return model.with_changes(effects={**model.effects, self.carrier: table})

    def written(self, theta: np.ndarray) -> Mapping[str, float]:
        """The law's parameters by their own names."""
        return {self._own(n): v for n, v in self.decode(theta).items() if self._own(n)}

    @property
    def _plain(self) -> Structure:
        return Structure(self.model, tuple(n for n in self.free if not self._own(n)))

    @cached_property
    def _laid(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (n,) and what turns a force there into the table's values, (knots, n)."""
        table = self.model.effects[self.carrier]
        return _points(table["start"], table["step"])

    def _table(self, values: Mapping[str, float]) -> np.ndarray:
        """The table's values (knots,) at named parameter values."""
        u, laid = self._laid
        return laid @ self.law.force(u, {self._own(n): v for n, v in values.items() if self._own(n)})


def laid(law: Written) -> dict[str, float | tuple[float, ...]]:
    """A law with its values as a stand-in's table over the range that it covers."""
    step = law.covered.length / (KNOTS - 1)
    u, onto = _points(law.covered.low, step)
    values = tuple((onto @ law.force(u, law.values)).tolist())
    return {"start": law.covered.low, "step": step, "knots": float(KNOTS), "values": values}


def _points(start: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n,) and what turns a force there into a table's values, (knots, n)."""
    u = start + np.linspace(0.0, KNOTS - 1.0, POINTS * KNOTS) * step
    return u, np.linalg.pinv(basis(u, start, step, KNOTS), rcond=1e-6)
