# SPDX-License-Identifier: Apache-2.0
"""How far a prediction is open: by what is known of the parameters, and by the initial state that was fitted to noise.

To first order. With other parameters each run's initial state would have been fitted to other values, so only what
this does not take up is left of a parameter's change. The two parts are independent; their variances are added."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..core.model import Model
from ..core.uncertainty import Uncertainty
from .problem import Linearisation, Problem
from .structure import Structure

Array = NDArray[np.float64]

#: Share of a parameter's standard deviation by which its coordinate in the fit is differenced.
STEP = 1e-3
#: A parameter of the model that is known to no more than this share of itself: what it does is not of first order.
KNOWN = 0.3


def of_the_model(known: Uncertainty, model: Model) -> Uncertainty:
    """What is known of the parameters that the model has: its own, and those of effects that are on."""
    free = [n for n in known.names if "." not in n or n.rpartition(".")[0] in model.effects]
    return known.of(free)


def hardly_known(known: Uncertainty, model: Model) -> tuple[str, ...]:
    """Parameters that are known too badly for bands to first order."""
    sizes = {n: abs(model.parameters[n]) for n in known.names if n in model.parameters}
    return tuple(n for n, size in sizes.items() if known.std[n] > KNOWN * size)


def bands(
    problem: Problem, known: Uncertainty, states: Sequence[Array], fitted: Sequence[NDArray[np.bool_]], model: Model
) -> list[Array]:
    """Standard deviation (m,) over noise of each prediction of every run in ``problem``, at initial ``states`` (8,).

    ``fitted`` (m,) says which of a run's samples its initial state was fitted to; ``known`` is of parameters that the
    model has (`of_the_model`). NaN where nothing is predicted."""
    structure = Structure(model, known.names)
    root = _in_coordinates(structure, known)
    near = problem.linearise(structure, structure.start, states)
    return [_band(linear, used, root) for linear, used in zip(near, fitted, strict=True)]


def _in_coordinates(structure: Structure, known: Uncertainty) -> Array:
    """A matrix (g, p) whose product with its transpose is the covariance of theta."""
    values = [structure.value(name) for name in known.names]
    slopes = np.zeros(len(values))
    for k, (value, std) in enumerate(zip(values, np.sqrt(np.diag(known.covariance)).tolist(), strict=True)):
        if std > 0.0:
            above, below = (
                structure.encode([*values[:k], value + side * STEP * std, *values[k + 1 :]]) for side in (1.0, -1.0)
            )
            slopes[k] = (above[k] - below[k]) / (2.0 * STEP * std)
    covariance = slopes[:, None] * known.covariance * slopes
    sizes, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(sizes, 0.0))


def _band(linear: Linearisation, used: NDArray[np.bool_], root: Array) -> Array:
    """The standard deviation (m,) of one run's predictions over noise; ``root`` is of theta's covariance."""
    by_theta, by_state = linear.by_theta @ root, linear.by_state
    there = np.logical_and(np.isfinite(by_theta).all(axis=1), np.isfinite(by_state).all(axis=1))
    rows = there & used
    if by_state.shape[1] and rows.any():
        scale = np.linalg.norm(by_state[rows], axis=0)
        scale = np.where(scale > 0.0, scale, 1.0)
        take_up = np.linalg.pinv(by_state[rows] / scale, rcond=1e-10) / scale[:, None]
        by_theta = by_theta - by_state @ (take_up @ by_theta[rows])
        of_noise = by_state @ take_up
    else:
        of_noise = np.zeros((len(used), 0))
    variance = (by_theta**2).sum(axis=1) + (of_noise**2).sum(axis=1)
    return np.where(there, np.sqrt(variance), np.nan)
