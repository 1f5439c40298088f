# SPDX-License-Identifier: Apache-2.0
"""When to say that a force is missing: a sequential test with a stated rate of false alarms, however long it runs.

If the model is complete, each window's force over its sigma is an independent standard normal z. The alternatives are a
force that stays (z about ±μ) and one that comes and goes (z of variance 1 + τ²). The likelihood ratio of each has mean
1 while the model is complete, so a Shiryaev–Roberts sum R ← (1 + R)·ratio grows by 1 a window on average. Therefore the
mean of R over alternatives and coordinates reaches a threshold A after A windows on average, or later. That is the
alarm rate. (Shin, Ramdas and Rinaldo, E-detectors, 2024.)
"""

from __future__ import annotations

import numpy as np

STEADY = np.array([-2.0, -1.0, -0.5, 0.5, 1.0, 2.0])  # μ
VARYING = np.array([1.0, 3.0, 10.0])  # τ
LARGEST = 1e200


class Detector:
    """Watches the standardised forces of four coordinates; at most one false alarm in ``windows`` on average."""

    def __init__(self, windows: float) -> None:
        self._threshold = windows
        self._sums = np.zeros((4, len(STEADY) + len(VARYING)))

    def add(self, z: np.ndarray) -> np.ndarray:
        """Take one window's z (4,), NaN where nothing is known; returns the coordinates (4,) that raise the alarm."""
        known = np.isfinite(z)
        y = np.clip(np.where(known, z, 0.0), -1e3, 1e3)[:, None]
        steady = STEADY * y - 0.5 * STEADY**2
        wide = 1.0 + VARYING**2
        log_ratio = np.concatenate([steady, 0.5 * (y * y * (1.0 - 1.0 / wide) - np.log(wide))], axis=1)
        with np.errstate(over="ignore"):
            grown = np.minimum((1.0 + self._sums) * np.exp(np.minimum(log_ratio, 300.0)), LARGEST)
        self._sums = np.where(known[:, None], grown, self._sums)
        # A coordinate that takes a quarter of the whole mean's threshold by itself takes the mean's with it.
        alarms = self._sums.mean(axis=1) >= self._threshold * 4
        self._sums[alarms] = 0.0
        return alarms
