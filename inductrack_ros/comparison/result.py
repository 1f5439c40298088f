# SPDX-License-Identifier: Apache-2.0
"""What `compare` found: runs with their predictions, stretches of all runs, and their errors over noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..checks import Finding
from ..core.model import Model
from ..data import Campaign, Run
from ..data.measurement import Array

if TYPE_CHECKING:
    from .outstanding import Outstanding


def rms(values: Array) -> float:
    """Root mean square of what is measured; infinite where a prediction left all bounds."""
    present = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(present**2))) if present.size else math.nan


@dataclass(frozen=True)
class RunComparison:
    """One run and its prediction.

    - predicted: (n, c) as ``run.values``, given at every time
    - sigmas: (n, c) (measured − predicted) / noise, NaN where not measured
    - restarted: (n, c) the same where every window starts from a state fitted to it
    - conditions: speed, gap, place, contact, each (n,)
    - band: (n, c) standard deviation of ``predicted`` over noise, by what is known of parameters and initial state;
      None where nobody says how well the parameters are known
    """

    run: Run
    initial_state: Mapping[str, float]
    estimated: tuple[str, ...]
    predicted: Array
    sigmas: Array
    restarted: Array | None
    conditions: Mapping[str, Array]
    holds_for: float | None
    band: Array | None = None

    @property
    def error(self) -> float:
        """Error over noise of the whole run."""
        return rms(self.sigmas)

    @property
    def errors(self) -> dict[str, float]:
        """Error over noise by channel."""
        return {c: rms(self.sigmas[:, i]) for i, c in enumerate(self.run.channels)}

    @property
    def beyond_band(self) -> dict[str, float]:
        """Error by channel over noise and band together: about 1 where the band explains it."""
        if self.band is None:
            return {}
        ratio = self.sigmas / np.sqrt(1.0 + self.band**2)
        return {c: rms(ratio[:, i]) for i, c in enumerate(self.run.channels)}

    @property
    def rmse(self) -> dict[str, float]:
        """RMS error by channel, SI."""
        return {c: rms(self.run.values[:, i] - self.predicted[:, i]) for i, c in enumerate(self.run.channels)}


@dataclass(frozen=True)
class Stretch:
    """All samples of all runs with ``by`` between ``low`` and ``high``."""

    by: str
    unit: str
    low: float
    high: float
    samples: int
    error: float
    errors: Mapping[str, float]
    restarted: float | None
    restarted_errors: Mapping[str, float]


@dataclass(frozen=True)
class Comparison:
    """What `compare` found; ``noise`` by channel in SI, ``noise_given`` the channels whose noise was stated;
    ``outstanding`` is where most goes wrong, ``findings`` are those of the look at the data before."""

    campaign: Campaign
    model: Model
    noise: Mapping[str, float]
    noise_given: frozenset[str]
    runs: tuple[RunComparison, ...]
    stretches: tuple[Stretch, ...]
    outstanding: Outstanding | None = None
    findings: tuple[Finding, ...] = ()
    known: tuple[str, ...] = ()  # parameters of which the bands take the uncertainty
    hardly_known: tuple[str, ...] = ()  # those that are known too badly for bands, which there are none of then

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that any run has."""
        return self.campaign.channels

    @property
    def error(self) -> float:
        """Error over noise of the whole campaign."""
        return rms(np.concatenate([r.sigmas.ravel() for r in self.runs]))

    @property
    def errors(self) -> dict[str, float]:
        """Error over noise by channel over all runs."""
        return {c: rms(np.concatenate([column(r, r.sigmas, c) for r in self.runs])) for c in self.channels}

    @property
    def beyond_bands(self) -> float:
        """Error of the whole campaign over noise and band together; NaN without bands."""
        ratios = [r.sigmas / np.sqrt(1.0 + r.band**2) for r in self.runs if r.band is not None]
        return rms(np.concatenate([r.ravel() for r in ratios])) if ratios else math.nan

    @property
    def worst_run(self) -> RunComparison:
        """The run with the largest error over noise."""
        return max(self.runs, key=lambda r: _rank(r.error))

    @property
    def worst_channel(self) -> str:
        """The channel with the largest error over noise."""
        errors = self.errors
        return max(errors, key=lambda c: _rank(errors[c]))


def column(r: RunComparison, table: Array, channel: str) -> Array:
    """A channel's column, all NaN where the run has none."""
    return table[:, r.run.channels.index(channel)] if channel in r.run.channels else np.full(len(table), np.nan)


def _rank(error: float) -> float:
    return -1.0 if math.isnan(error) else error
