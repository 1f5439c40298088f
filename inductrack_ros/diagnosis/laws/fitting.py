# SPDX-License-Identifier: Apache-2.0
"""Closed forms fitted to the table of an unknown force, with what the data say of the table as weight.

A fitted table is as smooth as its prior makes it. Here stands what the data alone say of it: a Gaussian statement, as
independent numbers of unit noise (`Table`). Every form is fitted to these by
variable projection (Golub and Pereyra 1973): sizes by linear least squares, shapes from a grid of starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from scipy import optimize, stats

from ...core.effects.stand_in import VARIABLES, basis, covered
from ..factor import Factor
from .forms import Form, Range, forms_on

#: A direction of a table of which the data say less than this part of what they say of another is not seen: rounding.
SEEN = 1e-9
#: Points at which forms are laid on a table; starts that are polished; most combinations of starts.
POINTS, POLISHED, MOST_STARTS = 240, 3, 600
#: A column as short as this has no size.
NOTHING = 1e-100
#: Two forms with columns as parallel as this are one over the range of the data.
SAME = 1e-9
#: A form is turned down where its misfit to the data is one that chance reaches in this part of cases.
LEVEL = 0.001


@dataclass(frozen=True)
class Table:
    """What data say of an unknown force over a variable: ``told`` (d,) = ``shown`` (d, n) · force at ``u`` (n,), noise
    of unit variance.

    A constant is not seen of a change of the thrust, for γ does the same (``level``: it is taken out). A force times a
    ``factor`` is per unit of that.
    """

    acts_on: str
    variable: str
    u: np.ndarray
    told: np.ndarray
    shown: np.ndarray
    level: bool = False
    factor: Factor | None = None

    @property
    def range(self) -> Range:
        """What of the variable it covers."""
        return Range(float(self.u[0]), float(self.u[-1]))

    @property
    def seen(self) -> int:
        """How many independent numbers the data give."""
        return len(self.told) - self.level

    @classmethod
    def of(cls, acts_on: str, about: Mapping[str, float], gram: np.ndarray, score: np.ndarray) -> Table:
        """From the parameters ``about`` a stand-in and the normal equations (l, l) and (l,) of its table's values, all
        else projected out."""
        factor, start, step = Factor.of(about), about["start"], about["step"]
        said, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
        seen = said > SEEN * max(said[-1], 1e-300)
        root, directions = np.sqrt(said[seen]), vectors[:, seen].T
        u = np.linspace(*covered(start, step, len(gram)), POINTS)
        laid = np.linalg.pinv(basis(u, start, step, len(gram)), rcond=1e-8)
        shown = root[:, None] * directions @ laid * (factor.size if factor else 1.0)
        variable = VARIABLES[int(about["variable"])]
        return cls(acts_on, variable, u, directions @ score / root, shown, acts_on == "thrust", factor)

    def lay(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n, k) of forces as the data see them, (d, k)."""
        seen = self.shown @ np.nan_to_num(columns, posinf=0.0, neginf=0.0)
        return self._plain(seen)

    @property
    def wanted(self) -> np.ndarray:
        """What a form is to give, (d,)."""
        return self._plain(self.told[:, None])[:, 0]

    def _plain(self, seen: np.ndarray) -> np.ndarray:
        if not self.level:
            return seen
        q = self.shown.sum(axis=1)
        q = q / max(np.linalg.norm(q), 1e-300)
        return seen - np.outer(q, q @ seen)


@dataclass(frozen=True)
class Fitted:
    """A form fitted to a table: its parameters with their standard deviations, the misfit χ² of ``dof`` degrees of
    freedom and its p-value.

    Its cost is χ² and its ``price``: by how much the data have narrowed its parameters, twice the log of the volume
    (Laplace; Kass and Raftery 1995, JASA 90, eq. 3). Of a size as much is known before as one sample tells (Schwarz
    1978), a shape may lie anywhere within its bounds."""

    form: Form
    parameters: Mapping[str, float]
    deviations: Mapping[str, float]
    misfit: float
    dof: int
    price: float

    @property
    def cost(self) -> float:
        """χ² with the price, which ranks."""
        return self.misfit + self.price

    @property
    def p_value(self) -> float:
        """Chance of a misfit as large if the form is true."""
        return float(stats.chi2.sf(self.misfit, self.dof)) if self.dof > 0 else 1.0


def fitted(table: Table, samples: int, forms: Sequence[Form] | None = None) -> list[Fitted]:
    """All forms that make sense on a table's variable, fitted, cheapest first; ``samples`` (n) were measured."""
    found: list[tuple[Fitted, np.ndarray]] = []
    for form in forms_on(table.variable, table.acts_on, table.factor is not None) if forms is None else forms:
        parameters, misfit = _fitted(table, form)
        parameters = _canonical(form, parameters)
        slopes = _slopes(table, form, parameters)
        one = Fitted(
            form,
            parameters,
            _deviations(form, slopes),
            misfit,
            table.seen - form.count,
            _price(table, form, parameters, slopes, samples),
        )
        laid = table.lay(form.value(table.u, parameters)[:, None])[:, 0]
        if not any(f.form.count == form.count and _parallel(laid, other) for f, other in found):
            found.append((one, laid))
    return sorted((f for f, _ in found), key=lambda f: f.cost)


def likely(fits: Sequence[Fitted], within: float) -> list[Fitted]:
    """The forms that the data do not turn down and cannot tell from the best of these: none costs ``within`` more."""
    left = [f for f in fits if f.p_value > LEVEL]
    return [f for f in left if f.cost < left[0].cost + within]


def _slopes(table: Table, form: Form, parameters: Mapping[str, float]) -> np.ndarray:
    """Derivatives (d, p) of what the data see of a form by its parameters."""
    slopes = []
    for name in form.names:
        step = 1e-5 * max(
            abs(parameters[name]), 1e-3 * table.range.length if name in (s.name for s in form.shapes) else 1e-12
        )
        ahead, behind = (form.value(table.u, {**parameters, name: parameters[name] + h}) for h in (step, -step))
        slopes.append((ahead - behind) / (2.0 * step))
    return table.lay(np.column_stack(slopes))


def _deviations(form: Form, slopes: np.ndarray) -> dict[str, float]:
    """Standard deviations of a form's parameters, to first order."""
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    covariance = np.linalg.pinv((slopes / scale).T @ (slopes / scale), rcond=1e-12, hermitian=True)
    return dict(zip(form.names, (np.sqrt(np.diag(covariance)) / scale).tolist(), strict=True))


def _price(table: Table, form: Form, parameters: Mapping[str, float], slopes: np.ndarray, samples: int) -> float:
    """Twice the log of how much wider a form's parameters lay before the data than after."""
    sizes = np.sqrt(max(samples, 2)) / np.maximum(np.linalg.norm(slopes[:, : len(form.terms)], axis=0), 1e-300)
    shapes = [table.range.spread(s.kind, parameters[s.name]) for s in form.shapes]
    wide = slopes * np.concatenate([sizes, shapes])
    return float(np.linalg.slogdet(np.eye(form.count) + wide.T @ wide)[1])


def _parallel(a: np.ndarray, b: np.ndarray) -> bool:
    size = float((a @ a) * (b @ b))
    return size > 0 and 1.0 - float(a @ b) ** 2 / size < SAME


def _fitted(table: Table, form: Form) -> tuple[dict[str, float], float]:
    """Parameters and χ² of one form."""
    wanted = table.wanted
    if not form.shapes:
        sizes, misfit = _sizes(table, form, [], wanted)
        return dict(zip(form.names, sizes.tolist(), strict=True)), misfit
    grid = _starts(table, form)
    low, high = np.array([table.range.bounds(s.kind) for s in form.shapes]).T
    scale = np.array([max(abs(h - lo), 1e-300) for lo, h in zip(low, high, strict=True)])

    def left(shape: np.ndarray) -> np.ndarray:
        columns = table.lay(np.column_stack(form.columns(table.u, shape * scale)))
        return wanted - columns @ _solved(columns, wanted)

    def polished(start: np.ndarray) -> Any:
        begin = np.clip(start, low + 1e-9 * scale, high - 1e-9 * scale) / scale
        return optimize.least_squares(left, begin, bounds=(low / scale, high / scale), x_scale="jac", max_nfev=30)

    promising = sorted(grid, key=lambda s: s[1])[:POLISHED]
    best = min((polished(start[0]) for start in promising), key=lambda done: done.cost)
    sizes, misfit = _sizes(table, form, best.x * scale, wanted)
    return dict(zip(form.names, [*sizes.tolist(), *(best.x * scale).tolist()], strict=True)), misfit


def _canonical(form: Form, parameters: dict[str, float]) -> dict[str, float]:
    """One of the parameter sets that do the same: a sine has a positive amplitude and a phase within π of none."""
    if not any(s.kind == "phase" for s in form.shapes):
        return parameters
    turned = parameters["phase"] + (np.pi if parameters["force"] < 0 else 0.0)
    return {**parameters, "force": abs(parameters["force"]), "phase": float((turned + np.pi) % (2 * np.pi) - np.pi)}


def starts_of(table: Table, form: Form) -> int:
    """From how many shapes a form is sought."""
    return len(_grid(table, form))


def _grid(table: Table, form: Form) -> np.ndarray:
    grid = np.array(list(product(*(table.range.starts(s.kind) for s in form.shapes))))
    return grid[:: len(grid) // MOST_STARTS + 1] if len(grid) > MOST_STARTS else grid


def _starts(table: Table, form: Form) -> list[tuple[np.ndarray, float]]:
    """Shapes from a grid with the χ² of each."""
    grid = _grid(table, form)
    columns = [table.lay(c) for c in form.columns(table.u, grid)]
    wanted = table.wanted
    found = []
    for k, shape in enumerate(grid):
        mine = np.column_stack([c[:, k] for c in columns])
        rest = wanted - mine @ _solved(mine, wanted)
        found.append((shape, float(rest @ rest)))
    return found


def _solved(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Sizes (t,) by least squares of columns (d, t) of any scale; 0 of one that vanishes."""
    length = np.linalg.norm(columns, axis=0)
    scale = np.where(length > NOTHING, length, 1.0)
    return np.linalg.lstsq(columns / scale, wanted, rcond=1e-10)[0] / scale


def _sizes(table: Table, form: Form, shape: Sequence[float], wanted: np.ndarray) -> tuple[np.ndarray, float]:
    columns = table.lay(np.column_stack(form.columns(table.u, shape)))
    sizes = _solved(columns, wanted)
    rest = wanted - columns @ sizes
    return sizes, float(rest @ rest)
