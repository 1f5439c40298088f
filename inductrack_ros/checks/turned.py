# SPDX-License-Identifier: Apache-2.0
"""Frames that are not the track's: turned by a quarter, a half or a little, about one of its axes.

One axis that is flipped is a sign; two are half a turn about the third."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.model import Model
from ..core.state import ACCELERATIONS
from ..data import Campaign
from . import levels
from .finding import IMPOSSIBLE, Finding, number, shared
from .room import extent_of, room_of

#: What runs along each axis of the track.
_AXES = {"surge": "x", "sway": "y", "heave": "z"}
_REMEDY = "x is along the travel, y left, z up"


def turned(campaign: Campaign, model: Model) -> list[Finding]:
    """Findings about sway or heave that goes on with the travel, out of the room that the track leaves it."""
    room = room_of(model)
    quarter = _travelling(campaign, room)
    return [quarter] if quarter else _askew(campaign, room)


def _travelling(campaign: Campaign, room: Mapping[str, float]) -> Finding | None:
    """Sway or heave that goes on as a travel does, far out of its room, while surge stays within it."""
    for channel in ("sway", "heave"):
        runs = [run.samples(channel) for run in campaign.runs if {channel, "surge"} <= set(run.channels)]
        ends = [(y[-1] - y[0], t[-1] - t[0], np.ptp(y)) for t, y in runs if len(t) > 1]
        far = [s for s in ends if abs(s[0]) > levels.ALIKE * s[2] > levels.OUTSIDE * room[channel]]
        if len(far) < max(len(ends), 1) or extent_of(campaign, "surge")[1] > levels.OUTSIDE * room["sway"]:
            continue
        speed = max(abs(s[0]) / s[1] for s in far)
        if not levels.MOVING < speed < levels.FASTEST:
            continue
        text = (
            f"{channel} goes on at up to {number(speed)} m/s like a travel, while surge spans"
            f" {number(1e3 * extent_of(campaign, 'surge')[1])} mm: the axes are exchanged"
        )
        remedy = f"{_REMEDY}: exchange the channels, or turn the frame they are published in"
        size = {"candidates": [channel, "surge"], "speed": speed}
        return Finding("axis_flipped", IMPOSSIBLE, text, remedy, channel, size=size)
    return None


def _askew(campaign: Campaign, room: Mapping[str, float]) -> list[Finding]:
    """Sway or heave that follows surge in a straight line, the same in all runs, and stays in its room beside it."""
    found = []
    for channel in ("sway", "heave"):
        slopes, far = [], True
        for run in campaign.runs:
            if not {channel, "surge"} <= set(run.channels):
                continue
            both = ~np.isnan(run["surge"]) & ~np.isnan(run[channel])
            x, y = run["surge"][both], run[channel][both]
            if len(x) < levels.FEW or np.ptp(x) == 0.0:
                continue
            slope = float(np.polyfit(x - x[0], y, 1)[0])
            beside = float(np.ptp(y - slope * x))
            drift = abs(slope) * float(np.ptp(x))
            stays = beside < room[channel]  # else it is in another unit
            far = far and stays and drift > max(0.5 * levels.OUTSIDE * room[channel], beside)
            slopes.append(slope)
        middle = float(np.median(slopes)) if slopes else 0.0
        if not slopes or not far or max(abs(s - middle) for s in slopes) > (1.0 - levels.ALIKE) * abs(middle):
            continue
        about = "z" if channel == "sway" else "y"
        text = (
            f"{channel} grows by {number(1e3 * middle)} mm in each metre of surge, far out of the room that the track"
            f" leaves it: the frame is turned by {number(np.degrees(np.arctan(middle)))}° about {about}"
        )
        remedy = f"turn the frame that the poses are published in: {_REMEDY}"
        found.append(Finding("turned", IMPOSSIBLE, text, remedy, channel, size={"slope": middle}))
    return found


def half_turns(findings: list[Finding]) -> list[Finding]:
    """The findings with one about a frame in the place of two about axes that are flipped."""
    return _half_turn(_half_turn(findings, False), True)


def _half_turn(findings: list[Finding], sensed: bool) -> list[Finding]:
    """The same of the poses, or of what an accelerometer has ``sensed``."""
    flipped: dict[str, Finding] = {}
    for f in findings:
        about = (f.channel,) if sensed and f.kind == "sign" and f.channel in ACCELERATIONS else ()
        about = f.size.get("candidates", ()) if not sensed and f.kind == "axis_flipped" else about
        names = [str(c).removesuffix("_acceleration") for c in about]
        if "runs" not in f.size and len(hit := [c for c in names if c in _AXES]) == 1 and "swapped" not in f.text:
            flipped[hit[0]] = f
    if len(flipped) != 2:
        return findings
    (axis,) = [a for c, a in _AXES.items() if c not in flipped]
    names = [f"{c}_acceleration" if sensed else c for c in flipped]
    what = "accelerometer" if sensed else "frame of the poses"
    text = f"{shared(names)} are both flipped: the {what} is turned by half a turn about {axis}"
    down = " (z points down, as in NED)" if axis == "x" else ""
    remedy = f"{_REMEDY}{down}; turn it, or change both signs"
    one = Finding("turned", IMPOSSIBLE, text, remedy, names[0], size={"candidates": names})
    upside_down = sensed and "heave" in flipped  # gravity is, too
    explained = [f for f in findings if upside_down and f.kind == "zero" and f.channel == "heave_acceleration"]
    kept = [f for f in findings if f not in flipped.values() and f not in explained]
    return [*kept, one]
