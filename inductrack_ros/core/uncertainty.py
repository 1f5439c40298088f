# SPDX-License-Identifier: Apache-2.0
"""How well a model's parameters are known: a covariance that a parameter file carries beside the model.

It stands under a name of its own, `BLOCK`, which no node has. So nodes, and readers that know nothing of it, pass over
it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .errors import InputError
from .parameter_files import read_blocks

#: The node's name under which a parameter file has the covariance. There is no such node.
BLOCK = "/inductrack/uncertainty"
#: An eigenvalue of the correlations below this is not rounding any more.
ROUNDING = -1e-6


@dataclass(frozen=True)
class Uncertainty:
    """The covariance (p, p) of the parameters ``names`` (p,), full names as in `Kernel.parameters` or of sensors, in
    their SI units squared."""

    names: tuple[str, ...]
    covariance: np.ndarray

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def of(self, names: Sequence[str]) -> Uncertainty:
        """What is known of these of the names alone (the marginal covariance)."""
        rows = [self.names.index(n) for n in names]
        return Uncertainty(tuple(names), self.covariance[np.ix_(rows, rows)])

    def finite(self) -> Uncertainty:
        """The same without parameters that the data leave wholly open."""
        return self.of([n for n, v in zip(self.names, np.diag(self.covariance), strict=True) if np.isfinite(v)])

    def block(self) -> dict[str, object]:
        """The lines of a parameter file, by node; none where nothing is known. ROS 2 has no nested lists: rows follow
        each other."""
        if not self.names:
            return {}
        rows = [float(v) for v in self.covariance.ravel()]
        return {BLOCK: {"ros__parameters": {"parameters": list(self.names), "covariance": rows}}}

    @classmethod
    def load(cls, path: str | Path) -> Uncertainty | None:
        """What the parameter file carries; None where it carries none. Raises `InputError` for one that cannot be a
        covariance."""
        values = next((b.values for b in read_blocks(path) if b.pattern == BLOCK), None)
        if values is None:
            return None
        names, flat = values.get("parameters"), values.get("covariance")
        place = f"{path}: {BLOCK}"
        if (
            not isinstance(names, list)
            or not names
            or any(not isinstance(n, str) for n in names)
            or len(set(names)) < len(names)
        ):
            raise InputError(f"{place}: parameters must be a list of different names")
        if (
            not isinstance(flat, list)
            or any(not isinstance(v, (int, float)) or isinstance(v, bool) for v in flat)
            or len(flat) != len(names) ** 2
        ):
            raise InputError(
                f"{place}: covariance must list {len(names)} × {len(names)} numbers, row after row, for its"
                f" {len(names)} parameters"
            )
        covariance = np.array(flat, float).reshape(len(names), len(names))
        if not _is_covariance(covariance):
            raise InputError(
                f"{place}: covariance is not one: it must be finite, symmetric and not negative; write it anew with fit"
                " or diagnose"
            )
        return cls(tuple(names), covariance)


def _is_covariance(matrix: np.ndarray) -> bool:
    if not np.isfinite(matrix).all() or (np.diag(matrix) < 0).any():
        return False
    std = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(np.where(std > 0, std, 1.0), np.where(std > 0, std, 1.0))
    return bool(np.allclose(scaled, scaled.T, atol=1e-9) and np.linalg.eigvalsh(scaled).min() > ROUNDING)
