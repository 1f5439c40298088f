# SPDX-License-Identifier: Apache-2.0
"""Monte Carlo: parameters drawn from what a fit left open about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.effects import split_name
from ..core.errors import InputError
from ..core.model import Model
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import CHANNELS
from ..core.uncertainty import Uncertainty

#: Draws outside a parameter's range are drawn again so many times before the covariance is refused.
PATIENCE = 200


@dataclass(frozen=True)
class Draws:
    """Values (samples, p) of the parameters ``names``; ``std`` (p,) as the covariance has them, ``again`` the part of
    draws that a range refused."""

    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    again: float = 0.0

    @classmethod
    def none(cls) -> Draws:
        """No draws at all: the model's own values."""
        return cls((), np.zeros((0, 0)), np.zeros(0))


def draw(known: Uncertainty, model: Model, fixed: Sequence[str], samples: int, seed: int) -> Draws:
    """``samples`` sets of the parameters that change a run and are not ``fixed``: normal about the model's values,
    within their ranges.

    The same for every point of a map, so that neighbours differ by their place alone. Raises `InputError`.
    """
    names = tuple(n for n in known.names if n in model.kernel.parameters and _is_on(n, model) and n not in fixed)
    if not names:
        raise InputError(
            f"--samples: nothing is left to draw; the covariance is of {', '.join(known.names)}, of which the runs of"
            " this sweep depend on none"
        )
    part = known.of(names)
    centre = np.array([model.vector[model.kernel.parameters.index(n)] for n in names])
    ranges = np.array([(p.low, p.high) for p in (_declared(n, model) for n in names)])
    root = _root(part.covariance)
    rng = np.random.default_rng(seed)
    found, tried = np.empty((0, len(names))), 0
    for _ in range(PATIENCE):
        more = centre + rng.standard_normal((samples, len(names))) @ root.T
        inside = ((more >= ranges[:, 0]) & (more <= ranges[:, 1])).all(axis=1)
        found, tried = np.vstack([found, more[inside]]), tried + samples
        if len(found) >= samples:
            std = np.sqrt(np.diag(part.covariance))
            return Draws(names, found[:samples], std, 1.0 - len(found) / tried)
    widest = max(names, key=lambda n: part.std[n] / max(abs(centre[names.index(n)]), 1e-300))
    raise InputError(
        f"--samples: {widest} is known so badly ({part.std[widest]:.3g} about {centre[names.index(widest)]:.3g}) that"
        " draws hardly ever fall within its range; fit it to more data first"
    )


def _root(covariance: np.ndarray) -> np.ndarray:
    """A matrix whose product with its transpose is the covariance, which may be singular; parameters of any size count
    alike."""
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _is_on(name: str, model: Model) -> bool:
    effect, dot, _ = name.rpartition(".")
    return not dot or effect in model.effects


def _declared(name: str, model: Model) -> Parameter:
    effect, dot, parameter = name.rpartition(".")
    return (
        split_name(effect, model.known_effects, CHANNELS)[0].parameters[parameter.partition("[")[0]]
        if dot
        else PARAMETERS[name]
    )
