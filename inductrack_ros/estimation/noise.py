# SPDX-License-Identifier: Apache-2.0
"""Noise of each channel from what a fit leaves over: neighbours differ by noise, a misfit is smooth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..data.campaign import Campaign
from .problem import Problem

#: Outliers (impacts) beyond this many standard deviations are left out.
CLIP = 4.0
#: The spread of the residuals themselves is the better estimate where it exceeds that of neighbours by less than this.
AGREE = 1.04


def second_differences(t: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Deviation of each sample from the line through its neighbours, scaled to the noise's standard deviation."""
    if t.size < 3:
        return np.empty(0)
    a, b = t[1:-1] - t[:-2], t[2:] - t[1:-1]
    left, right = b / (a + b), a / (a + b)
    return (r[1:-1] - left * r[:-2] - right * r[2:]) / np.sqrt(1 + left**2 + right**2)


def spread(values: np.ndarray) -> float:
    """Standard deviation with outliers clipped, started from the median."""
    if values.size == 0:
        return np.nan
    s = 1.4826 * float(np.median(np.abs(values)))
    for _ in range(20):
        inside = np.abs(values) < CLIP * s
        new = float(np.sqrt(np.mean(values[inside] ** 2))) if inside.any() else s
        if abs(new - s) <= 1e-6 * s:
            break
        s = new
    return s


def from_samples(campaign: Campaign) -> dict[str, float]:
    """A first, generous guess for every channel from the raw samples."""
    guess = {}
    for channel in campaign.channels:
        differences = [second_differences(*run.samples(channel)) for run in campaign.runs if channel in run.channels]
        guess[channel] = spread(np.concatenate(differences)) if differences else np.nan
    return guess


def from_residuals(problem: Problem, residuals: Sequence[np.ndarray], given: Mapping[str, float]) -> np.ndarray:
    """Noise by channel (c,): as given where it is, else from the residuals over noise of a fit."""
    sigma = problem.sigma.copy()
    for c, channel in enumerate(problem.channels):
        if channel in given:
            sigma[c] = given[channel]
            continue
        differences, all_ = [], []
        for data, r in zip(problem.runs, residuals, strict=True):
            mine = (data.channel == c) & np.isfinite(r)
            differences.append(second_differences(data.time[mine], r[mine]))
            all_.append(r[mine])
        rough, whole = spread(np.concatenate(differences)), spread(np.concatenate(all_))
        if np.isfinite(rough) and rough > 0:
            sigma[c] *= whole if whole < AGREE * rough else rough
    return sigma
