# SPDX-License-Identifier: Apache-2.0
"""Where a model fails, in words, and only where the windows show it: failing ones on one side, sound ones on the
other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc


@dataclass(frozen=True)
class Feature:
    """Something a failure may depend on: how wide its bins are, and how its limits read."""

    name: str
    width: float
    scale: float
    unit: str
    words: tuple[str, str, str]  # above, below, between


FEATURES = (
    Feature("speed", 1.0, 1.0, "m/s", ("above {}", "below {}", "between {} and {}")),
    Feature("gap", 5e-4, 1e3, "mm", ("at gaps above {}", "at gaps below {}", "at gaps between {} and {}")),
    Feature("place", 0.5, 1.0, "m", ("beyond {} of the track", "before {} of the track", "from {} to {} of the track")),
)
#: A bin fails below this probability (shared among the bins), and is sound above the second one.
FAILING, SOUND = 1e-3, 0.01
#: χ² that the failing bins' typical force would make in a bin, from which on its silence says something.
TELLING = 25.0


def regions(z: np.ndarray, sigma: np.ndarray, features: dict[str, np.ndarray]) -> list[str]:
    """Regions outside of which one coordinate's force vanishes, most readable first; empty where nothing is shown.

    z (n,) forces over sigma (n,); ``features`` are (n, 3) by the names of `FEATURES`: at the
    windows' begin, middle and end. A window is sorted by its middle; a region is no narrower than the windows in it.
    """
    found = [_region(feature, z, sigma, features[feature.name]) for feature in FEATURES]
    return [words for words in found if words]


def _region(feature: Feature, z: np.ndarray, sigma: np.ndarray, at: np.ndarray) -> str:
    names, index = np.unique(np.floor(at[:, 1] / feature.width).astype(np.int64), return_inverse=True)
    count = np.bincount(index)
    probability = chdtrc(count, np.bincount(index, z**2))  # chi²; scipy.stats takes longer to import than all else
    failing = probability < FAILING / len(names)
    if not failing.any():
        return ""
    size = np.median(np.abs(z * sigma)[failing[index]])
    telling = np.bincount(index, (size / sigma) ** 2) > TELLING
    sound = names[(probability > SOUND) & telling]
    first, last = names[failing][[0, -1]]
    if ((sound > first) & (sound < last)).any():
        return ""
    above, below, between = feature.words
    covered = np.round(at[failing[index]] / feature.width)
    limits = covered.min(), max(covered.max(), covered.min() + 1)
    low, high = (f"{n * feature.width * feature.scale:g} {feature.unit}" for n in limits)
    if (sound < first).any():
        return between.format(low, high) if (sound > last).any() else above.format(low)
    return below.format(high) if (sound > last).any() else ""
