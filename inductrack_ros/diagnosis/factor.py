# SPDX-License-Identifier: Apache-2.0
"""What a force of any shape is multiplied by, where it depends on two variables."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.effects.stand_in import VARIABLES

#: What any force may be multiplied by, with its power; its own coordinate and rate come to these.
FACTORS = (("surge_rate", 1), ("surge_rate", 2), ("time", 1), ("sway", 1), ("roll", 1))


@dataclass(frozen=True)
class Factor:
    """(w/scale)^power with a ``variable`` w; the ``scale`` (in its unit) is how large it usually is."""

    variable: str
    power: int
    scale: float

    @classmethod
    def over(cls, variable: str, power: int, histories: Sequence[np.ndarray]) -> Factor:
        """The factor with the root mean square of its variable over runs as its scale."""
        size = float(np.sqrt(np.nanmean(np.concatenate(histories) ** 2)))
        return cls(variable, power, float(f"{max(size, 1e-9):.3g}"))

    @classmethod
    def of(cls, values: Mapping[str, float]) -> Factor | None:
        """The factor that a stand-in's parameters say; None where it is none."""
        power = int(values.get("power", 0.0))
        return cls(VARIABLES[int(values["times"])], power, values["scale"]) if power else None

    @property
    def parameters(self) -> dict[str, float]:
        """As a stand-in has it."""
        return {"times": float(VARIABLES.index(self.variable)), "power": float(self.power), "scale": self.scale}

    @property
    def size(self) -> float:
        """The scale to the power: what turns a force where w is the scale into one per unit of w^power."""
        return self.scale**self.power

    @property
    def label(self) -> str:
        """As names of laws have it."""
        return self.variable + {1: "", 2: "_squared"}.get(self.power, f"_to_{self.power}")

    def at(self, histories: Mapping[str, np.ndarray]) -> np.ndarray:
        """The factor along histories (n,) of all variables."""
        return (histories[self.variable] / self.scale) ** self.power


def factors_of(on: str, runs: Sequence[Mapping[str, np.ndarray]], moved: Container[str]) -> list[Factor]:
    """What a force in a coordinate may be multiplied by, of the variables that moved; ``runs`` are their histories."""
    own = () if on == "surge" else ((on, 1), (f"{on}_rate", 1))
    return [Factor.over(v, p, [r[v] for r in runs]) for v, p in dict.fromkeys((*FACTORS, *own)) if v in moved]
