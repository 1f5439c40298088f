# SPDX-License-Identifier: Apache-2.0
"""How far channels go, and how far the track lets them."""

from __future__ import annotations

import numpy as np

from ..core.model import Model
from ..core.state import GAPS
from ..data import Campaign
from .noise_found import READINGS


def extent_of(campaign: Campaign, channel: str) -> tuple[float, float]:
    """Median and span of a channel's samples, of which 98 % count; zeros where there are none."""
    parts = [run.samples(channel)[1] for run in campaign.runs if channel in run.channels]
    values = np.concatenate([y[:: max(len(y) // READINGS, 1)] for y in parts] or [np.empty(0)])
    if not len(values):
        return 0.0, 0.0
    low, middle, high = np.quantile(values, [0.01, 0.5, 0.99])
    return float(middle), float(high - low)


def room_of(model: Model) -> dict[str, float]:
    """How far from its zero the track lets each coordinate and gap go at most, about: the gaps of the three arrays stay
    positive."""
    gap = model.parameters["nominal_gap"]
    root = np.sqrt(2.0)
    aside = (1 + root) * gap
    lever = np.sqrt(0.5) * max(model.parameters["magnet_side_offset"], 1e-3)
    return {"heave": root * gap, "sway": aside, "roll": aside / lever, **dict.fromkeys(GAPS, (1 + root) * gap)}


def mean_speeds(campaign: Campaign) -> list[float]:
    """Mean speed of each run whose surge is measured."""
    runs = [run.samples("surge") for run in campaign.runs if "surge" in run.channels]
    return [float((y[-1] - y[0]) / (t[-1] - t[0])) for t, y in runs if len(t) > 1]
