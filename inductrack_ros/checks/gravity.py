# SPDX-License-Identifier: Apache-2.0
"""Gravity in an accelerometer's readings, where it does not belong: not taken off, taken off twice, or on the wrong
axis."""

from __future__ import annotations

import numpy as np

from ..core.model import Model
from ..data import Campaign
from . import levels
from .balance import stops
from .finding import IMPOSSIBLE, Finding, number, of_a_bag
from .room import room_of

_ACROSS = ("sway_acceleration", "heave_acceleration")


def with_gravity(campaign: Campaign, model: Model) -> list[Finding]:
    """Findings about accelerometers whose mean is a gravity more or less than no motion: on average no cradle falls or
    climbs like that, nor goes aside."""
    if not (stops(model) and model.parameters["gravity"]):
        return []
    return [f for channel in _ACROSS if (f := _with_gravity(campaign, model, channel)) is not None]


def _with_gravity(campaign: Campaign, model: Model, channel: str) -> Finding | None:
    gravity = model.parameters["gravity"]
    fall = float(np.sqrt(2.0 * room_of(model)["sway"] / gravity))
    runs = [
        run
        for run in campaign.runs
        if channel in run.channels and run.duration > 4 * fall and run.measured[:, run.channels.index(channel)].any()
    ]
    mean = float(np.median([np.nanmean(run[channel]) for run in runs])) if runs else 0.0
    times = round(mean / gravity)
    if not times or abs(mean - times * gravity) > levels.UPRIGHT * gravity:
        return None
    text = f"{channel} is {number(mean)} m/s² on average, which is gravity: the cradle stays between the tracks"
    size = {"offset": mean}
    if not all(map(of_a_bag, runs)):
        off = number(np.copysign(gravity, mean))
        remedy = f"subtract {off} m/s²; {channel} is the acceleration alone, 0 at rest"
    elif channel == "sway_acceleration":
        remedy = "the sensor lies on its side, or its axes are exchanged: x is along the travel, y left, z up"
    elif times == -1:
        shows = mean + gravity
        in_g = " (is it in g?)" if abs(shows - 1.0) < levels.UPRIGHT else ""
        remedy = (
            f"at rest an Imu shows {number(gravity)} m/s² upwards, this one {number(shows)}{in_g}: publish it with"
            " gravity, in m/s²"
        )
    else:
        remedy = (
            f"at rest an Imu shows {number(gravity)} m/s² upwards, this one {number(mean + gravity)}: which way is up?"
        )
    return Finding("zero", IMPOSSIBLE, text, remedy, channel, size=size)
