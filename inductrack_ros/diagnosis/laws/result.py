# SPDX-License-Identifier: Apache-2.0
"""What became of an unknown force: the laws that describe it as well as the table, or that none does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...core.model import Model
from ...estimation.shooting import Fit
from .code import FILE

#: The model with the best law, beside ``model.yaml``, which has the table.
MODEL_FILE = "model_proposed.yaml"


@dataclass(frozen=True)
class ProposedLaw:
    """A closed form refitted in full in the table's place.

    ``parameters`` are value, standard deviation and unit by name; ``evidence`` is twice the log evidence over the table
    (Schwarz, forms counted): positive where the law is the better description; ``p_value`` is the chance of a misfit as
    much larger than the table's if the law is true; ``force`` (n,) is its curve at the unknown's ``at``.
    ``heldout_nrmse`` is its error on runs left out, of the best one."""

    name: str
    title: str
    formula: str
    parameters: Mapping[str, tuple[float, float, str]]
    words: str
    evidence: float
    p_value: float
    force: np.ndarray
    reduced_chi2: float = float("nan")
    heldout_nrmse: float = float("nan")

    def to_json(self) -> dict[str, Any]:
        """As ``diagnosis.json`` has it."""
        return {
            "name": self.name,
            "formula": self.formula,
            "evidence": self.evidence,
            "p_value": self.p_value,
            "in_words": self.words,
            "parameters": {n: {"value": v, "std": s, "unit": u} for n, (v, s, u) in self.parameters.items()},
            "reduced_chi2": self.reduced_chi2,
            "heldout_nrmse": self.heldout_nrmse,
        }


@dataclass(frozen=True)
class Laws:
    """The laws ``proposed``, best first, which these data cannot tell apart; else none, and the ``nearest`` with what
    speaks against it.

    ``tried``: how many forms were compared; ``model``: with the best law in the table's place; ``code``: the text of
        `FILE`; ``fit``: the best law's fit."""

    tried: int
    proposed: tuple[ProposedLaw, ...] = ()
    nearest: ProposedLaw | None = None
    settles: str = ""
    model: Model | None = field(default=None, repr=False)
    code: str = field(default="", repr=False)
    fit: Fit | None = field(default=None, repr=False)

    @property
    def sentence(self) -> str:
        """The outcome in one or two sentences."""
        if not self.proposed:
            near = (
                f" The nearest is {self.nearest.title}, {self.nearest.formula}, and the data turn it down (p ="
                f" {self.nearest.p_value:.1g})."
                if self.nearest
                else ""
            )
            return f"None of the {self.tried} forms tried describes it as well as the table.{near}"
        best = self.proposed[0]
        if len(self.proposed) == 1:
            return f"Of {self.tried} forms tried one describes it as well as the table: {best.words}."
        others = ", ".join(f"{law.title} ({law.formula})" for law in self.proposed[1:])
        return (
            f"Of {self.tried} forms tried {len(self.proposed)} describe it as well as the table. The best is"
            f" {best.words}. These data cannot tell it from {others}.{f' {self.settles}' if self.settles else ''}"
        )

    def write(self, folder: Path, comment: str) -> None:
        """Write `FILE` and `MODEL_FILE` where there is a law to propose."""
        if self.proposed and self.model is not None:
            (folder / FILE).write_text(self.code, encoding="utf-8")
            self.model.save(folder / MODEL_FILE, comment)
