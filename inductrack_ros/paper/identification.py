# SPDX-License-Identifier: Apache-2.0
"""What four travel distances really determine about η and γ: the identification (28), simulated where the answer is
known.

The paper's four measured distances are not available here. So distances are simulated with the published η and γ, noise
is added, and the fit must come back to where it began, within the interval it states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.model import Model
from ..estimation.identify import Fit, Identification, Profile, Valley, valley, verdict
from ..estimation.misfits import TravelMisfit, Travels
from ..workers import Threads

Array = NDArray[np.float64]

FREE = ("eta", "gamma")
SPEEDS = (16.0, 16.5, 17.0, 18.0)  # m/s: about the critical speed; none touches down within 2 s
STD = 0.05  # m
FLAT_SPEEDS, FLAT_STD = (15.0, 15.2, 15.4, 15.6), 1.0  # starts that all stop, measured roughly
CHOICES = ((10.0, 12.0, 14.0, 15.5), FLAT_SPEEDS, SPEEDS, (17.0, 18.0, 19.0, 20.0), (10.0, 15.0, 20.0, 30.0))
SEED = 1
REPLICATES = 100


@dataclass(frozen=True)
class Answer:
    """One identification: the distances, the fit, the profiles, its valley, and the sentence about it."""

    travels: Travels
    fit: Fit
    profiles: list[Profile]
    valley: Valley
    words: str


@dataclass(frozen=True)
class Precision:
    """What four distances from these initial speeds (m/s), each to `STD`, could tell at best: relative std of each of
    `FREE`, and their correlation."""

    speeds: tuple[float, ...]
    travels: Array
    relative_std: Array
    correlation: float
    valley: Valley


def truth(model: Model) -> Array:
    """The model's own η and γ (2,)."""
    return np.array([model.parameters[name] for name in FREE])


def simulated(model: Model, speeds: Sequence[float], std: float, rng: np.random.Generator | None) -> Travels:
    """Distances of 2 s at the model's own parameters, with noise unless ``rng`` is None."""
    travels = Travels.of(speeds, np.zeros(len(speeds)), std=std)
    exact = TravelMisfit(model, FREE, travels).predict(truth(model))
    noise = 0.0 if rng is None else std * rng.standard_normal(len(speeds))
    return replace(travels, travel=exact + noise)


def identify(model: Model, travels: Travels, start: Sequence[float], nelder_mead: bool = True) -> Answer:
    """Fit η and γ from ``start``, by both methods unless told otherwise, with profiles."""
    question = Identification(TravelMisfit(model, FREE, travels), start)
    fit = question.fit(nelder_mead)
    profiles = [question.profile(fit, name) for name in FREE]
    return Answer(travels, fit, profiles, valley(fit), verdict(fit, profiles))


def precision(model: Model, speeds: tuple[float, ...]) -> Precision:
    """Standard errors at the true parameters, from the derivatives of the distances alone."""
    values = truth(model)
    misfit = TravelMisfit(model, FREE, simulated(model, speeds, STD, None))
    columns = []
    for i in range(len(values)):
        step = np.zeros(len(values))
        step[i] = 1e-5 * values[i]
        columns.append((misfit(values + step) - misfit(values - step)) / (2 * step[i]))
    jacobian = np.column_stack(columns)
    covariance = np.linalg.inv(jacobian.T @ jacobian)
    zero = np.zeros(len(speeds))
    fit = Fit(FREE, values, jacobian, covariance, 0.0, 1.0, len(speeds) - 2, True, zero, values)
    return Precision(speeds, misfit.travels.travel, fit.std / values, float(fit.correlation[0, 1]), valley(fit))


def coverage(
    model: Model,
    speeds: Sequence[float] = SPEEDS,
    std: float = STD,
    replicates: int = REPLICATES,
    seed: int = SEED,
    noise_known: bool = True,
) -> tuple[dict[str, int], Array]:
    """How often, out of ``replicates`` simulated identifications, each 95 % interval holds the truth; and all answers
    (n, 2)."""
    values, exact = truth(model), simulated(model, speeds, std, None)
    noises = std * np.random.default_rng(seed).standard_normal((replicates, len(speeds)))

    def once(noise: Array) -> tuple[list[bool], Array]:
        noisy = replace(
            exact, travel=exact.travel + noise, std=exact.std if noise_known else np.full(len(speeds), np.nan)
        )
        question = Identification(TravelMisfit(model, FREE, noisy), values)
        fit = question.fit(nelder_mead=False)
        return [question.covers(fit, name, value) for name, value in zip(FREE, values, strict=True)], fit.values

    results = Threads().map(once, noises)
    held = np.sum([r[0] for r in results], axis=0)
    return dict(zip(FREE, held.tolist(), strict=True)), np.array([r[1] for r in results])
