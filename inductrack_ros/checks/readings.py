# SPDX-License-Identifier: Apache-2.0
"""Data that do not belong to the model's motion as they are written: which unit, sign or clock would make them
belong?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from ..core.model import Model
from ..core.state import COORDINATES, GAPS
from ..data import Campaign
from . import levels
from .apart import of_some
from .balance import SWINGING, WINDOWS, Reading, Windows, bad, misfits, needed_factor, stops, total, windows_of
from .current import against_others, drive, judged, stated_currents
from .finding import IMPOSSIBLE, WARNING, Finding, number, of_a_bag, shared
from .gravity import with_gravity
from .noise_found import Channel
from .room import extent_of, mean_speeds, room_of
from .turned import turned

#: One thing wrong after the other is looked for, so many at most.
MOST = 4
#: A reading is better where it takes off this part of what does not belong.
BETTER = 0.4
#: Two readings are equally good where what they leave differs by less.
TWINS = 0.1
#: Windows of a run that is looked at alone, and channels that may have changed places.
FEWEST_APART = 24
SWAPS = (
    *(("gap_left", "gap_right"), ("gap_top", "gap_right"), ("gap_top", "gap_left")),
    *(("sway", "heave"), ("sway", "roll"), ("heave", "roll")),
)
_LENGTH = ((1e-3, "mm"), (1e-2, "cm"), (0.0254, "inches"), (0.3048, "feet"), (1e3, "km"))
_ANGLE = ((np.pi / 180.0, "degrees"), (1e-3, "mrad"))
#: Looked for where none of the others fits.
_SMALL = ((2.54e-5, "thousandths of an inch"), (1e-6, "µm"))
_TIMES = (
    *((1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns"), (60.0, "min"), (3600.0, "h"), (86400.0, "days")),
    *((0.1, "tenths of a second"), (0.01, "hundredths of a second")),
)
_CURRENTS = ((1e3, "kA"), (1e-3, "mA"))


def readings(campaign: Campaign, channels: Mapping[str, Channel], model: Model) -> list[Finding]:
    """Findings about units, signs and clocks that the model's own motion gives away: of all runs, or of some where the
    others are read rightly."""
    most = max(FEWEST_APART, WINDOWS // len(campaign.runs))

    def alone(one: Campaign) -> list[Finding]:
        return _read(one, channels, model, most)

    found = of_some(campaign, _read(campaign, channels, model), alone, telling=_counts)
    return against_others(campaign, channels, model, most, found)


def _counts(finding: Finding) -> bool:
    """Whether a finding of one run alone counts."""
    return finding.severity == IMPOSSIBLE or finding.kind == "unlike"


def _read(campaign: Campaign, channels: Mapping[str, Channel], model: Model, most: int = WINDOWS) -> list[Finding]:
    """Findings about readings that runs share."""
    windows = windows_of(campaign, channels, most)
    now, found = _by_range(campaign, model, windows)
    found = [_or_counts(f, campaign, windows, model, now) for f in found]
    found += with_gravity(campaign, model)
    unread = any(f.kind == "turned" or f.kind == "zero" and windows and f.channel in windows.values for f in found)
    if windows is None or unread:
        return found or _backwards(campaign, model)
    left = misfits(windows, model, now)
    if not bad(left) and not found:
        return _backwards(campaign, model)
    for _ in range(MOST):
        if not bad(left):
            break
        wanted = needed_factor(windows, model) if bad(left) == ["surge"] and now == Reading() else None
        others = _others(now, windows, left, wanted)
        tried = [(name, reading, misfits(windows, model, reading)) for name, reading in others]
        tried = [t for t in tried if _explains(left, t[2])]
        if not tried:
            break
        among = left.keys() | {c for t in tried for c in t[2]}
        tried.sort(key=lambda t: total(t[2], among))
        _, reading, then = tried[0]
        alike = [name for name, _, f in tried if total(f, among) < total(then, among) + TWINS]
        finding = _finding(campaign, alike, _factor(now, reading), {"off": left, "then": then})
        if finding.kind == "axis_flipped" and finding.size["candidates"] == ["heave"]:
            finding = _or_the_gap(finding, windows, model, now, then)
        chance = finding.size.get("factor") == 0.0 and (wanted is None or abs(wanted) > levels.EXACTLY - 1.0)
        found.append(judged(finding, windows, model) if chance else finding)
        now, left = reading, then
    return found if found else drive(campaign, windows, model, left) or _unlike(left)


def _or_the_gap(finding: Finding, windows: Windows, model: Model, now: Reading, then: Mapping[str, float]) -> Finding:
    """The finding that heave is flipped, which leaves ``then``, or that it is the top gap where that leaves no more:
    both make of 5 mm over the track 5 mm under the middle."""
    gap = model.parameters["nominal_gap"]
    moved = replace(windows, values={**windows.values, "heave": windows.values["heave"] - gap})
    left = misfits(moved, model, now)
    if total(left, then) > total(then, then) + TWINS:
        return finding
    of_gap = f"subtract the nominal gap, {gap:g} m"
    if total(left, then) > total(then, then):
        return replace(finding, remedy=f"{finding.remedy}. Or is it the gap of the top array? Then {of_gap}")
    text = "heave moves as the forces of the model say only from another zero: is it the gap of the top array?"
    remedy = f"heave is 0 where all three gaps are the nominal gap: {of_gap}; if it grows downwards, change its sign"
    return replace(finding, kind="zero", text=text, remedy=remedy, size={**finding.size, "zero": gap})


def _unlike(left: Mapping[str, float]) -> list[Finding]:
    """What has nothing in common with the model's motion, however it is read."""
    names = bad(left)
    if not names:
        return []
    text = (
        f"{shared(names)} {'moves' if len(names) == 1 else 'move'} by other forces than this model's, and no unit, sign"
        " or exchange of channels explains it"
    )
    remedy = "look at the channels, the model's parameters and drive_current: no small effect makes such a difference"
    return [Finding("unlike", WARNING, text, remedy, names[0], size={"channels": names, "off": dict(left)})]


def _factor(before: Reading, after: Reading) -> float:
    """What the second reading multiplies by where the first does not."""
    channels = [after.of(c) / before.of(c) for c in after.channels]
    return float(np.prod([after.time / before.time, after.current / before.current, *channels]))


def _backwards(campaign: Campaign, model: Model) -> list[Finding]:
    """All runs going backwards, where nothing lifts or drives."""
    speeds = mean_speeds(campaign)
    if not stops(model) or not speeds or max(speeds) > -levels.MOVING:
        return []
    text = (
        f"surge runs backwards in all runs, at up to {number(-min(speeds))} m/s, where nothing lifts or drives the"
        " cradle"
    )
    return [
        Finding(
            "axis_flipped",
            IMPOSSIBLE,
            text,
            "change the sign of surge; it grows along the travel",
            "surge",
            size={"candidates": ["surge"]},
        )
    ]


def _by_range(campaign: Campaign, model: Model, windows: Windows | None) -> tuple[Reading, list[Finding]]:
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
        middle, spread = extent_of(campaign, channel)
        at_rest = model.parameters["nominal_gap"] if channel in GAPS else 0.0
        elsewhere = spread < room and abs(middle - at_rest) > levels.ELSEWHERE * room
        if abs(middle) + spread < levels.OUTSIDE * room and not elsewhere:
            continue
        si = "rad" if channel == "roll" else "m"
        text = (
            f"{channel} is about {number(middle)} {si} and spans {number(spread)} {si}, where the track leaves it"
            f" {number(room)} {si}"
        )
        size = {"middle": middle, "spread": spread, "room": room}
        units = _ANGLE if channel == "roll" else (*_LENGTH, *_SMALL)
        fits = [(f, unit) for f, unit in units if f * (abs(middle) + spread) < levels.OUTSIDE / 2 * room]
        fits = [fit for fit in fits if fit not in _SMALL] or fits
        if channel == "roll" and abs(spread - 2 * np.pi) < 0.05:
            remedy = "the angle is wrapped at a full turn; unwrap it, or let it run from −π to π"
            found.append(Finding("unit", IMPOSSIBLE, text, remedy, channel, size=size))
            continue
        if spread < room or not fits:
            remedy = (
                "its zero is where all three gaps are the nominal gap: subtract what it reads there"
                if spread < room
                else "look at its unit"
            )
            if channel == "roll" and abs(abs(middle) - np.pi) < room:
                remedy = "the cradle is not upside down: does z point down (NED)? x is along the travel, y left, z up"
            found.append(Finding("zero" if spread < room else "unit", IMPOSSIBLE, text, remedy, channel, size=size))
            continue
        left = (
            [0.0]
            if windows is None
            else [total(misfits(windows, model, now.times(channel, f)), windows.values) for f, _ in fits]
        )
        factor, unit = fits[int(np.argmin(left))]
        found.append(_unit(campaign, channel, text, factor, unit, size))
        now = now.times(channel, factor)
    return now, found


def _or_counts(finding: Finding, campaign: Campaign, windows: Windows | None, model: Model, now: Reading) -> Finding:
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
        f" their zero, and multiply by what one count is in {'rad' if channel == 'roll' else 'm'}"
    )
    return replace(finding, remedy=remedy, size={k: v for k, v in finding.size.items() if k != "factor"})


def _whole_numbers(campaign: Campaign, channel: str) -> bool:
    """Whether every reading of a channel is a whole number, and not all are 0."""
    parts = [run.samples(channel)[1] for run in campaign.runs if channel in run.channels]
    return all(bool((y == np.rint(y)).all()) for y in parts) and any(y.any() for y in parts)


def _too_fast(campaign: Campaign, speed: float, windows: Windows | None, model: Model) -> tuple[Reading, Finding]:
    """Which unit of surge or of time makes a speed that nothing has one that a cradle has, and the finding."""
    text, size = f"surge runs at {number(speed)} m/s", {"speed": speed}
    ways = [(f, unit, Reading().times("surge", f)) for f, unit in _LENGTH if f < 0.1]
    ways += [(1 / f, unit, Reading(time=f)) for f, unit in _TIMES if f > 1.0]
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
        return reading, _unit(campaign, "surge", text, factor, unit, size)
    remedy = f"time seems to be in {unit}; name its column 'time [{unit}]', or multiply it by {reading.time:g}"
    return reading, Finding("time_unit", IMPOSSIBLE, text, remedy, size={**size, "factor": factor})


def _negative(campaign: Campaign, gap: str, model: Model) -> list[Finding]:
    """A gap that is less than nothing: measured from its nominal size, or closing where it should open."""
    middle, _ = extent_of(campaign, gap)
    if not middle < -levels.TOUCHING * model.parameters["nominal_gap"]:
        return []
    text = f"{gap} is about {number(middle)} m: a gap is never less than 0"
    remedy = f"{gap} is the distance to the track; add what it reads where they touch, or change its sign"
    return [Finding("zero", IMPOSSIBLE, text, remedy, gap, size={"middle": middle})]


def _unit(campaign: Campaign, channel: str, text: str, factor: float, unit: str, size: Mapping[str, float]) -> Finding:
    si = "rad" if channel == "roll" else "m"
    short = {"degrees": "deg", "inches": "in", "feet": "ft", "thousandths of an inch": "mil"}.get(unit, unit)
    where = "publish it so" if all(map(of_a_bag, campaign.runs)) else f"write '{channel} [{short}]' in the header"
    remedy = f"it seems to be in {unit}; {channel} is in {si}: multiply it by {factor:.4g}, or {where}"
    return Finding("unit", IMPOSSIBLE, text, remedy, channel, size={**size, "factor": factor})


def _others(
    now: Reading, windows: Windows, left: Mapping[str, float], wanted: float | None
) -> Iterator[tuple[str, Reading]]:
    """Readings that change one thing, but no channel that belongs as it is; ``left`` is how far each is off. One of
    sway and roll is off where the other is flipped. The current has no other unit, and was not off, where what is
    ``wanted`` of it is not so far off."""

    def fits(channel: str) -> bool:
        twins = SWINGING if channel in SWINGING else (channel,)
        return all(left.get(c, np.inf) < levels.GOOD for c in twins)

    if now.time == 1.0:
        for factor, unit in _TIMES:
            yield f"time in {unit}", replace(now, time=factor)
    if now.current == 1.0 and windows.current.any() and not windows.pulsed:
        for factor, unit in _CURRENTS:
            if wanted is None or not 1 / levels.UNIT < wanted < levels.UNIT:
                yield f"drive_current in {unit}", replace(now, current=factor)
        if wanted is None or not 1 / levels.UNIT < wanted < levels.UNIT:
            yield "drive_current off", replace(now, current=0.0)
    for channel in windows.values:
        if channel in now.channels or channel not in (*COORDINATES, *GAPS) or fits(channel):
            continue
        yield f"{channel} flipped", now.times(channel, -1.0)
        for factor, unit in _ANGLE if channel == "roll" else _LENGTH:
            if channel != "surge" or factor * _speed(windows) < levels.FASTEST:
                yield f"{channel} in {unit}", now.times(channel, factor)
    for pair in () if now.swapped else SWAPS:
        if set(pair) <= windows.values.keys() and not all(map(fits, pair)):
            yield f"{pair[0]} and {pair[1]} swapped", replace(now, swapped=pair)


def _speed(windows: Windows) -> float:
    """The largest mean speed (m/s) of surge over a window, as it is written."""
    ends = [0, -1]
    moved = np.diff(windows.values["surge"][:, ends], axis=1) / np.diff(windows.times[:, ends], axis=1)
    return float(np.abs(moved).max())


def _explains(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether a reading brings something that was off to where it belongs, and nothing out of where it belonged."""
    mended = [c for c in bad(before) if after.get(c, 2.0) < levels.GOOD]
    spoiled = [c for c in bad(after) if c not in bad(before) and c in before]
    return bool(mended) and not spoiled and total(after, before) < (1 - BETTER) * total(before, before)


def _finding(campaign: Campaign, names: list[str], factor: float, size: Mapping[str, object]) -> Finding:
    """What is said of the readings ``names`` that explain equally well, best first; the best multiplies by
    ``factor``."""
    what, _, unit = names[0].partition(" in ")
    if names[0].endswith(" flipped"):
        return _flipped([c for c in (*COORDINATES, *GAPS) if f"{c} flipped" in names], size)
    if names[0].endswith(" swapped"):
        pair = names[0].removesuffix(" swapped")
        remedy = "exchange the two channels; x is along the travel, y left, z up, and left is seen along the travel"
        return Finding(
            "axis_flipped",
            IMPOSSIBLE,
            f"{pair} are swapped",
            remedy,
            pair.split()[0],
            size={**size, "candidates": pair.split(" and ")},
        )
    if "drive_current off" in names:
        text = f"{stated_currents(campaign)} does nothing: the cradle coasts as measured"
        remedy = "was the drive off? Then drive_current is 0; or is it another run's?"
        return Finding("unit", IMPOSSIBLE, text, remedy, "drive_current", size={**size, "factor": 0.0})
    if what == "time":
        step = float(np.median(np.diff(campaign.runs[0].times)))
        text = f"time is in {unit}: with a sample every {number(step)} s nothing would fly as it does"
        named = "" if " " in unit else f"name its column 'time [{unit}]', or "
        remedy = f"time is in seconds; {named}divide it by {1 / factor:g}"
        return Finding("time_unit", IMPOSSIBLE, text, remedy, size={**size, "factor": 1 / factor})
    if what == "drive_current":
        text = (
            f"{stated_currents(campaign)} is {number(1 / factor)} times what accelerates the cradle as measured: it"
            f" seems to be in {unit}"
        )
        return Finding(
            "unit",
            IMPOSSIBLE,
            text,
            f"drive_current is in A; multiply it by {factor:g} in campaign.yaml",
            what,
            size={**size, "factor": factor},
        )
    return _unit(campaign, what, f"as it is written {what} does not belong to the model's motion", factor, unit, size)


def _flipped(channels: list[str], size: Mapping[str, object]) -> Finding:
    """One of the channels has its sign changed."""
    either = " or ".join(channels)
    if len(channels) > 1:
        text = (
            f"{shared(channels)} do not fit each other: the axis of one of them is flipped; the mirror image looks the"
            " same, so these data cannot tell which"
        )
    else:
        text = f"the axis of {either} is flipped: only with its sign changed it moves as the forces of the model say"
    sensors = " or ".join(f"sensor_scale:{c}" for c in channels)
    remedy = f"change the sign of {either} (a {sensors} of −1 would say the same); x is along the travel, y left, z up"
    return Finding("axis_flipped", IMPOSSIBLE, text, remedy, channels[0], size={**size, "candidates": channels})
