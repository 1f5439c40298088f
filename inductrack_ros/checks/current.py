# SPDX-License-Identifier: Apache-2.0
"""The drive current against what accelerates the cradle: by which factor are the two apart?

The thrust is proportional to the current, so that the factor is solved for and not tried: a sign, a slip by ten, √2
between effective value and amplitude, the current of another run. A factor that all runs share may be γ, of which the
thrust is a multiple too; one that a run has alone is its current's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from ..core.model import Model
from ..data import Campaign
from ..data.measurement import Array
from . import levels
from .balance import SURE, bad, middle, misfits, needed_currents, needed_factor
from .finding import IMPOSSIBLE, WARNING, Finding, number, shared
from .noise_found import Channel
from .units import CURRENTS
from .windows import FEWEST, Reading, Windows, windows_of

#: A current that was measured at less than this part of the largest of any run is none: a sensor has its zero.
IDLE = 0.01
#: The factor is √2 where it is this near to it.
_NEAR = 1.1


def drive(campaign: Campaign, windows: Windows, model: Model, left: Mapping[str, float]) -> list[Finding]:
    """A finding where another current brings surge, which alone is off, to where the model has it; ``left`` is how far
    channels are off with the current as stated."""
    if bad(left) != ["surge"] or windows.pulsed:
        return []
    coasting = not windows.current.any()
    if coasting:  # the factor of one ampere is the current
        windows = replace(windows, current=np.ones_like(windows.current))
    factor = needed_factor(windows, model)
    if factor is None:
        return []
    then = misfits(windows, model, Reading(current=factor))
    if bad(then) or not then.get("surge", 2.0) < levels.GOOD:
        return []
    size = {"off": dict(left), "then": dict(then), "factor": factor, "explains": ["surge"]}
    if coasting:
        text = f"drive_current is 0, where the cradle is accelerated as by {number(factor)} A"
        found = Finding("unlike", IMPOSSIBLE, text, "was the drive on?", "drive_current", size=size)
        return [judged(found, replace(windows, current=np.zeros_like(windows.current)), model)]
    return [judged(_finding(stated_currents(campaign), size, model), windows, model)]


def judged(finding: Finding, windows: Windows, model: Model) -> Finding:
    """The finding about the drive current as a warning, where a steep track and a magnetic drag that is some times the
    model's push as much as the current that is lacked."""
    stated = float(np.median(windows.current[windows.current != 0.0])) if windows.current.any() else 0.0
    lacked = (finding.size["factor"] - 1.0) * stated if stated else finding.size["factor"]
    state = model.initial_state(surge_rate=abs(float(np.median(_speeds(windows)))))
    driven, coasts = (model.quantities(state, drive_current=c) for c in (lacked, 0.0))
    push = abs(driven["surge_acceleration"] - coasts["surge_acceleration"])
    drag = coasts["magnetic_drag"] / model.parameters["mass"]
    possible = (1.0 - 1.0 / levels.UNIT) * drag + levels.STEEP * model.parameters["gravity"]
    by_chance = not _named(finding.size["factor"])
    return replace(finding, kind="unlike", severity=WARNING) if push < possible and by_chance else finding


def _named(factor: float) -> tuple[float, str] | None:
    """The unit of a current that a factor is exactly, with its size."""
    return next((c for c in CURRENTS if 1 / levels.EXACTLY < factor / c[0] < levels.EXACTLY), None)


def stated_currents(campaign: Campaign) -> str:
    """The drive currents of the runs that are driven, in words."""
    return f"drive_current ({shared([f'{run.drive_current:g}' for run in campaign.runs if run.drive_current])} A)"


def _speeds(windows: Windows) -> Array:
    """(w,) Speed (m/s) in each window."""
    if "surge" not in windows.values:
        return np.median(windows.values["surge_rate"], axis=1)
    travel, times = windows.values["surge"], windows.times
    return (travel[:, -1] - travel[:, 0]) / (times[:, -1] - times[:, 0])


@dataclass(frozen=True)
class _Moved:
    """A run's stated current (A), and in windows of it the current that moves it and its speed (m/s), (w,) each."""

    stated: float
    currents: Array
    speeds: Array

    @property
    def needed(self) -> float:
        """Median of the currents."""
        return float(np.median(self.currents))

    def would(self, stated: float) -> list[tuple[float, float]]:
        """What another run of a ``stated`` current needs if it lacks what this one does, with standard errors: if that
        is a force; if it is a part of the drive."""
        needed, error = middle(self.currents)
        lacked = stated + needed - self.stated, error
        if self.stated == 0.0:
            return [lacked]
        part = stated / self.stated
        return [lacked, (part * needed, abs(part) * error)]


def against_others(
    campaign: Campaign, channels: Mapping[str, Channel], model: Model, most: int, findings: list[Finding]
) -> list[Finding]:
    """The findings about some runs' drive current, held against what the other runs need.

    A factor or a force that all lack is said once. What no other run of that speed lacks is no property of the rig."""
    mine = [f for f in findings if f.channel == "drive_current" and (f.severity == WARNING or "runs" in f.size)]
    if len(campaign.runs) == 1 or not mine and any(f.severity == IMPOSSIBLE for f in findings):
        return findings
    moved = _moved(campaign, channels, model, most)
    rest = [f for f in findings if f not in mine]
    if exchanged := _exchanged({name: m for name, m in moved.items() if m.stated > 0.0}):
        return [*rest, exchanged]
    said_off = {run.name for run in campaign.runs if run.drive_current == 0.0}
    named = {name for f in mine for name in f.size.get("runs", ())}
    if not said_off & named:
        largest = max((abs(m.stated) for m in moved.values()), default=0.0)
        driven = {name: m for name, m in moved.items() if name in named or abs(m.stated) > IDLE * largest}
        found = _of_all(campaign, driven, mine[0].size if mine else {}, model)
        if found and (mine or found.severity == IMPOSSIBLE):
            return [*rest, found]
    return [*rest, *(_apart(f, moved) for f in mine)] if mine else [*rest, *_coasting(moved)]


def _of_all(campaign: Campaign, driven: Mapping[str, _Moved], size: Mapping[str, Any], model: Model) -> Finding | None:
    """What all runs lack: the same part of their current, the same force, or something in one direction; None where
    they lack nothing in common. ``size`` is that of a finding of some."""
    factors = [m.needed / m.stated for m in driven.values()]
    if not factors:
        return None
    size = {**size, "factor": float(np.median(factors)), "runs": list(driven)}
    found = _finding(stated_currents(campaign), size, model)
    if _alike(factors, levels.ONE_CURRENT) and min(factors) > 0.0:
        # Of different currents no force is the same part.
        one_current = _alike([m.stated for m in driven.values()], levels.SCALE)
        return replace(found, severity=WARNING) if one_current and not _named(size["factor"]) else found
    lacks = [m.needed - m.stated for m in driven.values()]
    if _alike(lacks, levels.SCALE):
        return _force(float(np.median(lacks)), list(driven))
    if not _alike(lacks, levels.UNIT) and not _alike([f - 1.0 for f in factors], levels.UNIT):
        return None
    if found.kind == "axis_flipped":
        return found
    if found.severity == IMPOSSIBLE:
        return replace(found, remedy=f"{found.remedy}, or look at the model's parameters: gamma for one")
    how = "more" if size["factor"] > 1.0 else "less"
    least, largest = (number(f(factors)) for f in (min, max))
    text = f"in every run the cradle is accelerated {how} than its drive_current says, as by {least} to {largest} of it"
    remedy = "a drag or a slope that the model lacks, other magnets or coils, or a wrong drive_current"
    return Finding("unlike", WARNING, text, remedy, "surge", size=size)


def _exchanged(driven: Mapping[str, _Moved]) -> Finding | None:
    """Two runs with each other's current: once it is exchanged every run moves as its current says."""
    for (one, a), (other, b) in combinations(driven.items(), 2):
        stated = {name: m.stated for name, m in driven.items()} | {one: b.stated, other: a.stated}
        fit = all(_alike([m.needed, stated[name]], levels.ONE_CURRENT) for name, m in driven.items())
        if not fit or _alike([a.stated, b.stated], levels.SCALE):
            continue
        text = (
            f"{one} moves as the {number(b.stated, 4)} A of {other} would move it, and {other} as the"
            f" {number(a.stated, 4)} A of {one}"
        )
        size = {"runs": [one, other], "factor": b.stated / a.stated}
        remedy = "exchange drive_current of the two in campaign.yaml"
        return Finding("unit", IMPOSSIBLE, text, remedy, "drive_current", size=size)
    return None


def _alike(values: list[float], most: float) -> bool:
    """Whether several values are one to the factor ``most``."""
    sizes = np.abs(values)
    return len(values) > 1 and abs(sum(np.sign(values))) == len(values) and sizes.max() < most * sizes.min()


def _force(lacked: float, runs: list[str]) -> Finding:
    """A force like that of ``lacked`` A, whatever the currents are."""
    where = "forwards" if lacked > 0.0 else "backwards"
    text = (
        f"at each of the currents the cradle is pushed {where} besides, about as hard as {number(abs(lacked))} A would"
        " push"
    )
    remedy = "a drag or a slope that the model lacks, or other magnets or coils, rather than a wrong drive_current"
    return Finding("unlike", WARNING, text, remedy, "surge", size={"lacked_current": lacked, "runs": runs})


def _coasting(moved: Mapping[str, _Moved]) -> list[Finding]:
    """Runs that are said to be driven and coast, where every other run moves as its current says.

    A drive that is weak beside the drag leaves surge much as it should be, so that no other look finds these."""
    found = []
    for name, odd in moved.items():
        others = [m for other, m in moved.items() if other != name]
        if odd.stated <= 0.0 or abs(odd.needed) > (1.0 - 1.0 / levels.ONE_CURRENT) * odd.stated or not others:
            continue
        right = all(abs(m.needed - m.stated) < (1.0 - 1.0 / levels.SCALE) * odd.stated for m in others)
        if right and _unexplained(odd, others):
            text = (
                f"in {name} alone of {len(moved)} runs drive_current ({odd.stated:g} A) does nothing: the cradle coasts"
                " as measured"
            )
            remedy = "was the drive off? Then drive_current is 0; or is it another run's?"
            size = {"factor": 0.0, "needed": odd.needed, "runs": [name]}
            found.append(Finding("unit", IMPOSSIBLE, text, remedy, "drive_current", name, size=size))
    return found


def _moved(campaign: Campaign, channels: Mapping[str, Channel], model: Model, most: int) -> dict[str, _Moved]:
    """What is known of the current that moves each run, also of those that coast."""
    found = {}
    for run in campaign.runs:
        windows = windows_of(replace(campaign, runs=(run,)), channels, most)
        currents = None if windows is None or windows.pulsed else needed_currents(windows, model)
        if windows is None or currents is None:
            continue
        known = ~np.isnan(currents)
        if known.sum() >= FEWEST:
            found[run.name] = _Moved(float(np.median(windows.current)), currents[known], _speeds(windows)[known])
    return found


def _apart(finding: Finding, moved: Mapping[str, _Moved]) -> Finding:
    """The finding as one that cannot be so, where nothing that the other runs lack explains it: no force and no part of
    the drive, nor one that grows or falls with the speed."""
    runs = finding.size.get("runs", ())
    odd = [moved[name] for name in runs if name in moved]
    others = [m for name, m in moved.items() if name not in runs]
    if not odd or not all(_unexplained(m, others) for m in odd):
        return finding
    remedy = finding.remedy.partition(" (")[0] + "; the other runs move as theirs says"
    return replace(finding, severity=IMPOSSIBLE, remedy=remedy)


def _unexplained(odd: _Moved, others: list[_Moved]) -> bool:
    """Whether a run surely needs another current than if it lacked what any of the others lacks, by more than a
    sensor's scale may be off. Only what it does at speeds that the others have counts."""
    speeds = np.concatenate([m.speeds for m in others] or [np.empty(0)])
    reach = (min(speeds, default=np.inf), max(speeds, default=-np.inf))
    as_fast = (odd.speeds > reach[0] / levels.ONE_CURRENT) & (odd.speeds < reach[1] * levels.ONE_CURRENT)
    if as_fast.sum() < FEWEST:
        return False
    needed, uncertain = middle(odd.currents[as_fast])
    explained = [e for m in others for e in m.would(odd.stated)]
    apart = [needed - current for current, _ in explained]
    return (min(apart) > 0.0 or max(apart) < 0.0) and all(
        abs(needed - current)
        > max(
            SURE * np.hypot(uncertain, error), (1.0 - 1.0 / levels.SCALE) * max(abs(current), abs(needed), odd.stated)
        )
        for current, error in explained
    )


def _finding(stated: str, size: Mapping[str, Any], model: Model) -> Finding:
    """What is said of the ``factor`` that the current lacks: more than any effect makes of it cannot be so."""
    factor = size["factor"]
    if factor < 0.0:
        text = f"{stated} acts against what accelerates the cradle as measured"
        remedy = "change its sign in campaign.yaml: a positive current drives along surge"
        return Finding("axis_flipped", IMPOSSIBLE, text, remedy, "drive_current", size=size)
    text = f"{stated} is {number(1 / factor)} times what accelerates the cradle as measured"
    if not 1 / levels.UNIT < factor < levels.UNIT:
        remedy = "drive_current is in A; correct it in campaign.yaml"
        if named := _named(factor):
            text = f"{text}: it seems to be in {named[1]}"
            remedy = f"drive_current is in A; multiply it by {named[0]:g} in campaign.yaml"
        return Finding("unit", IMPOSSIBLE, text, remedy, "drive_current", size=size)
    remedy = "look at drive_current"
    if 1 / _NEAR < max(factor, 1 / factor) / np.sqrt(2.0) < _NEAR:
        remedy = "is it an effective value where the model takes an amplitude, or the other way round?"
    taken_up = number(factor * model.parameters["gamma"])
    remedy += f" (a fit that may move gamma takes {taken_up} for it, and says nothing more of the current)"
    return Finding("unlike", WARNING, text, remedy, "drive_current", size=size)
