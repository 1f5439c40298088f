# SPDX-License-Identifier: Apache-2.0
"""What is said of data that are to be read otherwise: the finding about a `Change`, with cause and remedy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..core.state import COORDINATES, GAPS
from ..data import Campaign
from . import levels
from .changes import Change
from .current import stated_currents
from .finding import IMPOSSIBLE, Finding, number, of_a_bag, shared
from .units import SHORT, si_unit
from .windows import Windows

_GAP = "the gap of the top array"
_COUNTS = (
    "does its encoder count edges (2 or 4 for each line) where lines are meant, or the other way round? A known"
    " distance along the track settles it"
)


def finding_of(campaign: Campaign, alike: list[Change], factor: float, size: Mapping[str, object]) -> Finding:
    """What is said of changes that explain equally well, best first; the best multiplies by ``factor``."""
    best = alike[0]
    if best.kind == "flipped":
        either = {c.about[0] for c in alike if c.kind == "flipped"}
        also = next((f". Or is it {_GAP}? Then {_above(c)}" for c in alike if c.kind == "gap"), "")
        return _flipped([c for c in (*COORDINATES, *GAPS) if c in either], also, size)
    if best.kind == "gap":
        return _gap(best, factor, size)
    if best.kind == "swapped":
        remedy = "exchange the two channels; x is along the travel, y left, z up, and left is seen along the travel"
        text, size = f"{' and '.join(best.about)} are swapped", {**size, "candidates": list(best.about)}
        return Finding("axis_flipped", IMPOSSIBLE, text, remedy, best.about[0], size=size)
    if any(c.kind == "off" for c in alike):
        text = f"{stated_currents(campaign)} does nothing: the cradle coasts as measured"
        remedy = "was the drive off? Then drive_current is 0; or is it another run's?"
        return Finding("unit", IMPOSSIBLE, text, remedy, "drive_current", size={**size, "factor": 0.0})
    (what,) = best.about
    if best.kind == "counted":
        text = f"{what} is {number(1 / factor)} times the travel that moves as the model's forces say"
        return Finding("unit", IMPOSSIBLE, text, _COUNTS, what, size={**size, "factor": factor})
    if what == "time":
        return _clock(campaign, best.unit, factor, {**size, "factor": 1 / factor})
    if what == "drive_current":
        text = (
            f"{stated_currents(campaign)} is {number(1 / factor)} times what accelerates the cradle as measured: it"
            f" seems to be in {best.unit}"
        )
        remedy = f"drive_current is in A; multiply it by {factor:g} in campaign.yaml"
        return Finding("unit", IMPOSSIBLE, text, remedy, what, size={**size, "factor": factor})
    text = f"as it is written {what} does not belong to the model's motion"
    return unit_finding(campaign, what, text, factor, best.unit, size)


def counted(finding: Finding, factor: float, windows: Windows, current: list[Finding]) -> Finding:
    """The finding about a travel that is to be multiplied by ``factor``, with what surge's measured rate says of it.

    Where a ``current`` would explain the same these data cannot tell, and both are named."""
    if current:
        first = current[0]
        text = f"{first.text}; or is it that surge is {number(1 / factor)} times the true travel"
        remedy = f"{_COUNTS}. If that is right, {first.remedy}"
        return replace(first, text=text, remedy=remedy, size={**first.size, "candidates": ["surge"]})
    if "surge_rate" not in windows.values:
        return finding
    travelled = np.diff(windows.values["surge"][:, [0, -1]]) / np.diff(windows.times[:, [0, -1]])
    ratio = float(np.median(np.median(windows.values["surge_rate"], axis=1) / travelled[:, 0]))
    if abs(np.log(ratio / factor)) < np.log(levels.SCALE):
        return replace(finding, text=f"{finding.text}, and that surge_rate says")
    if abs(np.log(ratio)) < np.log(levels.SCALE):
        return replace(finding, text=f"{finding.text}, and so is surge_rate: do both come from one encoder?")
    return finding


def _clock(campaign: Campaign, unit: str, factor: float, size: Mapping[str, object]) -> Finding:
    """A time that is to be multiplied by ``factor``, of a unit or at another rate."""
    step = float(np.median(np.diff(campaign.runs[0].times)))
    if not unit:
        how = "fast" if factor > 1.0 else "slowly"
        text = (
            f"everything runs about {number(max(factor, 1 / factor), 2)} times too {how} for the model's forces: all"
            f" channels belong to its motion with a sample every {number(factor * step, 2)} s instead of every"
            f" {number(step)} s"
        )
        remedy = (
            f"look at the time column, and at the sampling rate that it was made of: multiply it by {number(factor, 2)}"
        )
        return Finding("time_unit", IMPOSSIBLE, text, remedy, size=size)
    text = f"time is in {unit}: with a sample every {number(step)} s nothing would fly as it does"
    named = "" if " " in unit else f"name its column 'time [{unit}]', or "
    return Finding("time_unit", IMPOSSIBLE, text, f"time is in seconds; {named}divide it by {1 / factor:g}", size=size)


def unit_finding(
    campaign: Campaign, channel: str, text: str, factor: float, unit: str, size: Mapping[str, object]
) -> Finding:
    """A channel that is in another unit, and is to be multiplied by ``factor``."""
    stated = {run.converted[channel] for run in campaign.runs if channel in run.converted}
    if stated:
        remedy = (
            f"the header says '{' or '.join(sorted(stated))}', from which it was converted: are the numbers in another"
            f" unit? Converted, they are {number(1 / factor)} times as large as they should be"
        )
        return Finding("unit", IMPOSSIBLE, text, remedy, channel, size={**size, "factor": factor})
    header = f"write '{channel} [{SHORT.get(unit, unit)}]' in the header"
    where = "publish it so" if all(map(of_a_bag, campaign.runs)) else header
    remedy = f"it seems to be in {unit}; {channel} is in {si_unit(channel)}: multiply it by {factor:.4g}, or {where}"
    return Finding("unit", IMPOSSIBLE, text, remedy, channel, size={**size, "factor": factor})


def _gap(change: Change, factor: float, size: Mapping[str, object]) -> Finding:
    """Heave whose zero is that of the gap above, whose sign ``factor`` has."""
    text = "heave moves as the forces of the model say only from another zero"
    remedy = "heave is 0 where all three gaps are the nominal gap"
    if factor > 0.0:
        text, remedy = f"{text}: is it {_GAP}?", f"{remedy}: {_above(change)}; if it grows downwards, change its sign"
    else:
        text = f"{text} and with its sign changed: is it minus {_GAP}?"
        remedy = f"{remedy}: change its sign, then {_above(change)}"
        size = {**size, "candidates": ["heave"]}
    return Finding("zero", IMPOSSIBLE, text, remedy, "heave", size={**size, "zero": -change.reading.zeros["heave"]})


def _above(change: Change) -> str:
    """How heave is had from the gap above."""
    return f"subtract the nominal gap, {-change.reading.zeros['heave']:g} m"


def _flipped(channels: list[str], also: str, size: Mapping[str, object]) -> Finding:
    """One of the channels has its sign changed; ``also`` says what else it may be."""
    either = " or ".join(channels)
    if len(channels) > 1:
        text = (
            f"{shared(channels)} do not fit each other: the axis of one of them is flipped; the mirror image looks the"
            " same, so these data cannot tell which"
        )
    else:
        text = f"the axis of {either} is flipped: only with its sign changed it moves as the forces of the model say"
    sensors = " or ".join(f"sensor_scale:{c}" for c in channels)
    remedy = (
        f"change the sign of {either} (a {sensors} of −1 would say the same); x is along the travel, y left, z up{also}"
    )
    return Finding("axis_flipped", IMPOSSIBLE, text, remedy, channels[0], size={**size, "candidates": channels})
