# SPDX-License-Identifier: Apache-2.0
"""What users of other tools would make of the table of an unknown force: a formula.

Each peer takes a `Statement`, which is what the package's own choice of forms takes, and returns a `Formula`. Neither
uses the package's list of forms or its choice among them."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from inductrack_ros.diagnosis.laws.fitting import Table
from inductrack_ros.diagnosis.laws.forms import Form, Term

#: The peers: each a module here with a `propose` of its own, and what the tables call it.
LAW_PEERS = {"law_sindy": "PySINDy", "law_expressions": "expression search"}


@dataclass(frozen=True)
class Statement:
    """What data say of a force over a variable: the ``table`` of independent numbers of unit noise, and the smooth
    curve that the diagnosis draws through them.

    The curve is ``force`` (p,) at ``at`` (p,) with standard deviations ``std`` (p,), per unit of a second variable's
    power where there is one. ``samples`` were measured."""

    table: Table
    at: np.ndarray
    force: np.ndarray
    std: np.ndarray
    samples: int

    def misfit(self, columns: np.ndarray, sizes: np.ndarray) -> float:
        """χ² of columns (d, k), as the table lays them, with these sizes (k,)."""
        rest = self.table.wanted - columns @ sizes
        return float(rest @ rest)


@dataclass(frozen=True)
class Formula:
    """A sum of ``terms``, each a size and an expression in u, as the package writes them."""

    terms: tuple[tuple[float, str], ...]

    @property
    def form(self) -> Form:
        """The formula as a form whose sizes are free: what a refit needs."""
        terms = tuple(Term(f"size_{k}", 0, text, "size of a term") for k, (_, text) in enumerate(self.terms))
        return Form("formula", "a formula", self.text, terms)

    @property
    def sizes(self) -> dict[str, float]:
        """The form's parameters."""
        return {f"size_{k}": size for k, (size, _) in enumerate(self.terms)}

    @property
    def text(self) -> str:
        """The formula in words of Python."""
        return " + ".join(f"{size:.4g}" if text == "1.0" else f"{size:.4g} * {text}" for size, text in self.terms)

    def __call__(self, u: np.ndarray) -> np.ndarray:
        """The force at u (n,)."""
        return self.form.value(u, self.sizes)


def ask(name: str, statement: Statement) -> Formula:
    """A peer's formula. Raises `ImportError` where what it builds on is not installed."""
    with threadpool_limits(1, "blas"):
        return importlib.import_module(f"{__package__}.{name}").propose(statement)
