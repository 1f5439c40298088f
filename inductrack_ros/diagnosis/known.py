# SPDX-License-Identifier: Apache-2.0
"""How well a fit knows the parameters of its model, as a covariance that ``model.yaml`` carries."""

from __future__ import annotations

import numpy as np

from ..core.uncertainty import Uncertainty
from ..estimation.structure import Fitted, Structure


def uncertainty_of(fit: Fitted) -> Uncertainty:
    """The covariance of the parameter values to first order: theta's correlations, and the deviations that the
    diagnosis tells.

    Without parameters that are held, and without those of which the data say nothing.
    """
    structure, theta = fit.structure, fit.theta
    of_theta = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    std = np.array([fit.deviations[n] for n in structure.free])
    held = [k in structure.held for k in range(len(theta))]
    known = np.flatnonzero(np.isfinite(std) & (of_theta > 0) & ~np.array(held, bool))
    signs = np.array([_sign(structure, theta, k, float(of_theta[k])) for k in known.tolist()])
    scale = signs * std[known] / of_theta[known]
    covariance = fit.covariance[np.ix_(known, known)] * np.outer(scale, scale)
    return Uncertainty(tuple(structure.free[k] for k in known), 0.5 * (covariance + covariance.T))


def _sign(structure: Structure, theta: np.ndarray, k: int, deviation: float) -> float:
    """Whether parameter k rises or falls with its theta: a fit of 1/x falls, and one of several alike may be turned
    over."""
    step = np.zeros_like(theta)
    step[k] = 1e-3 * deviation
    name = structure.free[k]
    rise = structure.decode(theta + step)[name] - structure.decode(theta - step)[name]
    return -1.0 if rise < 0 else 1.0
