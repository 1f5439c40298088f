# SPDX-License-Identifier: Apache-2.0
"""PySINDy's sparse regression over a library of the usual functions, on the table of an unknown force.

The functions are PySINDy's `CustomLibrary`: 1, u, u², u³, |u|, u|u|, sgn u, exp(±u/b) with a few b, sine and cosine of
a few wavelengths. They are regressed on what the data say of the table, as independent numbers of unit noise, which is
weighting by its full covariance.

What helps it: besides the few b and wavelengths of any library, those that explain most of this table are offered (for
one parameter more each). `STLSQ` runs on the whole library and on smaller ones, at many thresholds and ridges. `SSR`
and `FROLS` run too. Of all sets of terms that any of them goes through BIC chooses, with sizes by plain least squares.
What hurts it: a library has no bump, step, corner or free power, so such a force is a sum of what there is."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable

import numpy as np
from pysindy.feature_library import CustomLibrary
from pysindy.optimizers import FROLS, SSR, STLSQ

from inductrack_ros.diagnosis.laws.fitting import Table
from inductrack_ros.diagnosis.laws.forms import Form, Term

from .laws import Formula, Statement

#: Lengths b and wavelengths of the library, in parts of the range.
LENGTHS, WAVELENGTHS = (0.1, 0.3, 1.0), (2.0, 1.0, 0.5, 0.25)
#: Those among which the one that explains most is sought.
FINE_LENGTHS, FINE_WAVELENGTHS = np.geomspace(0.03, 3.0, 60), 1.0 / np.linspace(0.25, 20.0, 400)
#: Thresholds (sizes of terms over noise) and ridges of STLSQ.
THRESHOLDS, RIDGES = np.geomspace(0.5, 200.0, 25), (1e-8, 1e-5, 1e-3, 1e-1)
#: Most terms that may enter.
MOST = 8
#: A column is another's twin, or nothing, where so little of it is left.
NOTHING = 1e-6

#: Expressions and how many parameters each costs.
Library = dict[str, int]


def propose(statement: Statement) -> Formula:
    """The set of terms with the lowest BIC."""
    table = statement.table
    library = library_of(table)
    names, X, scale = laid(table, library)
    y, best = table.wanted, (np.inf, ())
    for chosen in set().union(*(supports(X, y, part) for part in parts(names))):
        sizes = np.linalg.lstsq(X[:, chosen], y, rcond=1e-10)[0]
        price = sum(library[names[k]] for k in chosen) * np.log(statement.samples)
        cost = statement.misfit(X[:, chosen], sizes) + price
        if cost < best[0]:
            best = cost, tuple(zip((sizes / scale[list(chosen)]).tolist(), (names[k] for k in chosen), strict=True))
    return Formula(best[1] or ((0.0, "1.0"),))


def library_of(table: Table) -> Library:
    """The usual functions, and the exponential and the wave that explain most."""
    L, low = table.range.length, table.range.low
    plain = ["1.0", "u", "u * u", "u * u * u", "abs(u)", "u * abs(u)", "math.copysign(1.0, u)"]
    found = dict.fromkeys([*plain, *(e for b in LENGTHS for e in _exponentials(b * L, low))], 1)
    found |= dict.fromkeys([e for w in WAVELENGTHS for e in _waves(w * L)], 1)
    exponential = max(((e,) for b in FINE_LENGTHS for e in _exponentials(b * L, low)), key=lambda e: _told(table, e))
    waves = max((_waves(w * L) for w in FINE_WAVELENGTHS), key=lambda e: _told(table, e))
    return found | dict.fromkeys(exponential, 2) | dict(zip(waves, (2, 1), strict=True))


def _exponentials(length: float, low: float) -> tuple[str, str]:
    return tuple(f"math.exp({sign} * (u - {low:.8g}) / {length:.8g})" for sign in ("-1.0", "1.0"))  # type: ignore


def _waves(wavelength: float) -> tuple[str, str]:
    return tuple(f"math.{wave}(2.0 * math.pi * u / {wavelength:.8g})" for wave in ("sin", "cos"))  # type: ignore


def _told(table: Table, expressions: Iterable[str]) -> float:
    """How much of χ² the expressions and a straight line explain."""
    X = table.lay(np.column_stack([_column(e, table.u) for e in ("1.0", "u", *expressions)]))
    q = np.linalg.qr(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300))[0]
    return float(np.sum((q.T @ table.wanted) ** 2))


def _column(expression: str, u: np.ndarray) -> np.ndarray:
    return Form("", "", "", (Term("size", 0, expression, ""),)).columns(u, [])[0]


def laid(table: Table, library: Library) -> tuple[list[str], np.ndarray, np.ndarray]:
    """The library's columns (d, k) as the data see them, each of unit length, with names and lengths; twins and those
    that vanish are left out."""
    functions = CustomLibrary(
        library_functions=[_function(e) for e in library], function_names=[_name(e) for e in library]
    )
    columns = np.asarray(functions.fit_transform(table.u[:, None]))
    names = functions.get_feature_names()
    X = table.lay(columns)
    length, whole = np.linalg.norm(X, axis=0), np.linalg.norm(table.shown @ columns, axis=0)
    kept: list[int] = []
    for k in np.flatnonzero(length > NOTHING * whole):
        if all(1.0 - abs(X[:, k] @ X[:, j]) / (length[k] * length[j]) > NOTHING for j in kept):
            kept.append(int(k))
    return [names[k] for k in kept], X[:, kept] / length[kept], length[kept]


def _function(expression: str) -> Callable:
    return lambda u: _column(expression, np.asarray(u))


def _name(expression: str) -> Callable:
    return lambda _: expression


def parts(names: list[str]) -> list[list[int]]:
    """The columns of plain functions alone, with exponentials, with waves, and all: a careful user tries the small
    libraries too."""
    exponential, wave = (["math.exp" in n for n in names], ["math.sin" in n or "math.cos" in n for n in names])
    without = ((True, True), (False, True), (True, False), (False, False))
    return [
        [k for k in range(len(names)) if not (no_exp and exponential[k]) and not (no_wave and wave[k])]
        for no_exp, no_wave in without
    ]


def supports(X: np.ndarray, y: np.ndarray, part: list[int]) -> set[tuple[int, ...]]:
    """Sets of columns (d, k), of a part of them, that PySINDy's optimisers choose or go through."""
    found: set[tuple[int, ...]] = {(), *((k,) for k in part)}
    most = min(MOST, len(part) - 1, len(y) - 1)
    if most < 1:
        return found
    optimisers = [STLSQ(threshold=t, alpha=a, max_iter=50) for t in THRESHOLDS for a in RIDGES]
    optimisers += [FROLS(alpha=1e-8, max_iter=most), SSR(alpha=1e-8, max_iter=len(part) - 1)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of near-twins, and of thresholds that leave nothing
        for optimiser in optimisers:
            optimiser.fit(X[:, part], y)
            for coefficients in optimiser.history_:
                chosen = tuple(part[k] for k in np.flatnonzero(np.ravel(coefficients)))
                if len(chosen) <= most:
                    found.add(chosen)
    return found
