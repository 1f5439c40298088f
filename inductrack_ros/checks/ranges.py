# SPDX-License-Identifier: Apache-2.0
"""What is outside of the room that the track leaves, by far, or faster than anything: which unit brings it back?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.model import Model
from ..core.state import GAPS
from ..data import Campaign
from . import levels
from .balance import misfits, stops, total
from .finding import IMPOSSIBLE, Finding, number, of_a_bag
from .room import extent_of, mean_speeds, room_of
from .saying import unit_finding
from .turned import turned
from .units import ANGLES, LENGTHS, SMALL_LENGTHS, TIMES, si_unit
from .windows import Reading, Windows


def by_range(campaign: Campaign, model: Model, windows: Windows | None) -> tuple[Reading, list[Finding]]:
    """What is outside of the room the track leaves, by far: in another unit, or measured from another zero. And speeds
    that nothing has."""
    now, found = Reading(), []
    if not stops(model):
        return now, found
    speed = max(map(abs, mean_speeds(campaign)), default=0.0)
    if speed > levels.FASTEST:
        now, finding = _too_fast(campaign, speed, windows, model)
        found.append(finding)
    if found_turned := turned(campaign, model):
        return now, [*found, *found_turned]
    for channel, room in room_of(model).items():
        if channel in GAPS:
            found += _negative(campaign, channel, model)
        now, outside = _outside(campaign, channel, room, model, windows, now)
        found += outside
    return (now, found) if windows is None else _in_one_unit(campaign, windows, model, now, found)


def _in_one_unit(
    campaign: Campaign, windows: Windows, model: Model, now: Reading, found: list[Finding]
) -> tuple[Reading, list[Finding]]:
    """The same with one unit for all lengths that are out of their range, where they then belong better. Each was read
    while the others were still wrong."""
    wrong = {f.channel: f for f in found if f.kind == "unit" and f.channel not in (None, "roll") and "factor" in f.size}
    if len(wrong) < 2:
        return now, found

    def read(factor: float) -> Reading:
        return replace(now, channels={**now.channels, **dict.fromkeys(wrong, factor)})

    left = {unit: total(misfits(windows, model, read(factor)), windows.values) for factor, unit in LENGTHS}
    factor, unit = min(LENGTHS, key=lambda way: left[way[1]])
    if left[unit] >= total(misfits(windows, model, now), windows.values):
        return now, found
    again = {c: unit_finding(campaign, c, f.text, factor, unit, f.size) for c, f in wrong.items()}
    return read(factor), [again.get(f.channel, f) for f in found]


def _outside(
    campaign: Campaign, channel: str, room: float, model: Model, windows: Windows | None, now: Reading
) -> tuple[Reading, list[Finding]]:
    """A channel that is out of its ``room``, and how it is to be read."""
    middle, spread = extent_of(campaign, channel)
    at_rest = model.parameters["nominal_gap"] if channel in GAPS else 0.0
    elsewhere = spread < room and abs(middle - at_rest) > levels.ELSEWHERE * room
    if abs(middle) + spread < levels.OUTSIDE * room and not elsewhere:
        return now, []
    si = si_unit(channel)
    text = (
        f"{channel} is about {number(middle)} {si} and spans {number(spread)} {si}, where the track leaves it"
        f" {number(room)} {si}"
    )
    size = {"middle": middle, "spread": spread, "room": room}
    units = ANGLES if channel == "roll" else (*LENGTHS, *SMALL_LENGTHS)
    fits = [(f, unit) for f, unit in units if f * (abs(middle) + spread) < levels.OUTSIDE / 2 * room]
    fits = [fit for fit in fits if fit not in SMALL_LENGTHS] or fits
    if channel == "roll" and abs(spread - 2 * np.pi) < 0.05:
        remedy = "the angle is wrapped at a full turn; unwrap it, or let it run from −π to π"
        return now, [Finding("unit", IMPOSSIBLE, text, remedy, channel, size=size)]
    if spread < room or not fits:
        remedy = (
            "its zero is where all three gaps are the nominal gap: subtract what it reads there; if that is 0, its gain"
            " is wrong"
            if spread < room
            else "look at its unit"
        )
        if channel == "roll" and abs(abs(middle) - np.pi) < room:
            remedy = "the cradle is not upside down: does z point down (NED)? x is along the travel, y left, z up"
        return now, [Finding("zero" if spread < room else "unit", IMPOSSIBLE, text, remedy, channel, size=size)]
    left = (
        [0.0]
        if windows is None
        else [
            min(total(misfits(windows, model, now.times(channel, sign * f)), windows.values) for sign in (1.0, -1.0))
            for f, _ in fits  # its sign may be wrong as well, which is looked for once the unit is right
        ]
    )
    factor, unit = fits[int(np.argmin(left))]
    return now.times(channel, factor), [unit_finding(campaign, channel, text, factor, unit, size)]


def or_counts(finding: Finding, campaign: Campaign, windows: Windows | None, model: Model, now: Reading) -> Finding:
    """The finding about a unit, which is none where the readings are whole numbers that no unit brings to where the
    forces are: then they are a converter's or an encoder's."""
    channel = finding.channel
    if finding.kind not in ("unit", "zero") or channel is None or not _whole_numbers(campaign, channel):
        return finding
    if (
        windows is not None
        and "factor" in finding.size
        and misfits(windows, model, now).get(channel, 2.0) < levels.GOOD
    ):
        return finding
    remedy = (
        "the readings are whole numbers, and no unit makes them move as the forces say: are they raw counts? Subtract"
        f" their zero, and multiply by what one count is in {si_unit(channel)}"
    )
    return replace(finding, remedy=remedy, size={k: v for k, v in finding.size.items() if k != "factor"})


def _whole_numbers(campaign: Campaign, channel: str) -> bool:
    """Whether every reading of a channel is a whole number, and not all are 0."""
    parts = [run.samples(channel)[1] for run in campaign.runs if channel in run.channels]
    return all(bool((y == np.rint(y)).all()) for y in parts) and any(y.any() for y in parts)


def _too_fast(campaign: Campaign, speed: float, windows: Windows | None, model: Model) -> tuple[Reading, Finding]:
    """Which unit of surge or of time makes a speed that nothing has one that a cradle has, and the finding."""
    text, size = f"surge runs at {number(speed)} m/s", {"speed": speed}
    ways = [(f, unit, Reading().times("surge", f)) for f, unit in LENGTHS if f < 0.1]
    ways += [(1 / f, unit, Reading(time=f)) for f, unit in TIMES if f > 1.0]
    ways = [way for way in ways if levels.FASTEST > speed * way[0] > levels.MOVING]
    if not ways:
        remedy = "look at the units of surge and of time"
        return Reading(), Finding("unit", IMPOSSIBLE, text, remedy, "surge", size=size)
    if windows is None:
        units = [f"{'time' if way[2].time != 1.0 else 'surge'} in {way[1]}" for way in ways]
        remedy = f"look at the units: {' or '.join(units)} would make it {number(speed * ways[0][0])} m/s"
        return ways[0][2], Finding("unit", IMPOSSIBLE, text, remedy, "surge", size={**size, "factor": ways[0][0]})
    among = windows.values.keys()
    factor, unit, reading = min(ways, key=lambda way: total(misfits(windows, model, way[2]), among))
    if reading.time == 1.0:
        return reading, unit_finding(campaign, "surge", text, factor, unit, size)
    remedy = f"time seems to be in {unit}; name its column 'time [{unit}]', or multiply it by {reading.time:g}"
    if all(map(of_a_bag, campaign.runs)):
        remedy = "look at the header stamps: does nanosec hold microseconds or milliseconds?"
    size = {**size, "factor": factor, "channels": ["surge"]}
    return reading, Finding("time_unit", IMPOSSIBLE, text, remedy, size=size)


def _negative(campaign: Campaign, gap: str, model: Model) -> list[Finding]:
    """A gap that is less than nothing: measured from its nominal size, or closing where it should open."""
    middle, _ = extent_of(campaign, gap)
    if not middle < -levels.TOUCHING * model.parameters["nominal_gap"]:
        return []
    text = f"{gap} is about {number(middle)} m: a gap is never less than 0"
    remedy = f"{gap} is the distance to the track; add what it reads where they touch, or change its sign"
    return [Finding("zero", IMPOSSIBLE, text, remedy, gap, size={"middle": middle})]
