# SPDX-License-Identifier: Apache-2.0
"""The clock of each run: holes, jumps, a first stamp of 0, jitter, times that no run has. Reads stamps only; allocates
by their number."""

from __future__ import annotations

import numpy as np

from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .clock_steps import stand_still, was_set
from .finding import IMPOSSIBLE, NOTE, SET_ASIDE, Finding, number, place, spot

#: Samples on each side from which the speed at a hole is taken.
BESIDE = 8
#: Holes of a run that are looked at, the longest first.
WORST = 20
#: At most this many samples before a jump are set aside as stamped before the clock was set.
NOT_YET_SET = 3


def clocks(campaign: Campaign) -> list[Finding]:
    """Findings about every run's clock; alike ones of several runs in one."""
    findings: list[Finding] = []
    holes: list[tuple[Run, int, Array]] = []
    for run in campaign.runs:
        steps = np.diff(run.times)
        if not len(steps):
            continue
        usual = float(np.median(steps))
        if usual >= levels.LONGEST_STEP or (
            not run.seconds_stated and len(steps) >= levels.FEW and usual >= levels.SLOW_STEP
        ):
            findings.append(_endless(run, usual))
            continue
        wide = np.flatnonzero(steps > levels.HOLE * usual)
        if (batch := _batched(run, steps, wide, usual)) is not None:
            findings.append(batch)
            continue
        looked_at = wide[np.argsort(-steps[wide], kind="stable")][:WORST]
        broken = {int(i): f for i in np.sort(looked_at) if (f := _broken(run, int(i), usual)) is not None}
        findings += broken.values()
        if len(rest := np.setdiff1d(wide, list(broken))):
            holes.append((run, int(rest[np.argmax(steps[rest])]), steps[rest]))
        if not broken:
            findings += [f for f in (was_set(run), stand_still(run)) if f is not None]
            findings += _jitter(run, steps, usual)
    return _once(findings) + _holes(holes)


def _batched(run: Run, steps: Array, wide: Array, usual: float) -> Finding | None:
    """Samples that share nearly one stamp, and then none for long, again and again."""
    if len(wide) < levels.FEW or len(steps) < 2 * len(wide):
        return None
    each = np.diff(wide)
    between = float(np.median(steps[wide]))
    if np.median(each) < levels.BATCH or float(np.median(each)) * usual > between / levels.HOLE:
        return None
    text = (
        f"the samples of {run.file.name} come {int(np.median(each))} at a time, {number(1e3 * usual)} ms apart, and"
        f" then none for {number(1e3 * between)} ms: their stamps say when they arrived"
    )
    remedy = "write the sensor's own times, or space the samples of each batch evenly"
    size = {"batch": float(np.median(each)), "step": usual, "pause": between}
    return Finding("batches", IMPOSSIBLE, text, remedy, run=run.name, size=size)


def _endless(run: Run, usual: float) -> Finding:
    unit, factor = next(((u, f) for u, f in (("ms", 1e3), ("µs", 1e6)) if usual / f < levels.SLOW_STEP), ("ns", 1e9))
    lasting = f"{run.duration:.6g} s" if run.duration < 120 else f"{run.duration:.6g} s ({_lasting(run.duration)})"
    text = f"{run.file.name}: time is in seconds: this run would last {lasting} with a sample every {usual:.4g} s"
    right = "" if usual >= levels.LONGEST_STEP else "; if it is right, name it 'time [s]'"
    remedy = f"if it was written in {unit}, name its column 'time [{unit}]'{right}"
    if (np.diff(run.stamps) == 1).all():
        remedy = f"does it count the samples? Then multiply it by the seconds from one to the next; {remedy}"
    return Finding(
        "time_unit",
        IMPOSSIBLE,
        text,
        remedy,
        run=run.name,
        size={"step": usual, "duration": run.duration, "factor": factor},
    )


def _broken(run: Run, i: int, usual: float) -> Finding | None:
    """What is wrong with the clock between samples i and i + 1; None where it is a hole that can be lived with."""
    hole = float(run.times[i + 1] - run.times[i])
    size = {"jump": hole, "sample": i + 1}
    if i < NOT_YET_SET and hole > levels.SPLIT * usual:
        zero = float(run.stamps[0]) == 0.0
        what = "stamped 0, the clock was not running yet" if zero else "stamped long before the rest"
        text = (
            f"the first {f'{i + 1} samples' if i else 'sample'} of {run.file.name} {'are' if i else 'is'} {what}"
            f" ({_lasting(hole)} earlier)"
        )
        rows = {run.name: tuple(range(i + 1))}
        return Finding(
            "first_stamp",
            SET_ASIDE,
            text,
            "start recording when the clock runs (use_sim_time: wait for /clock)",
            run=run.name,
            samples=rows,
            size=size,
        )
    if hole > levels.HOLE * usual and _went_on(run, i, hole, usual):
        text = (
            f"the clock of {run.file.name} jumps ahead by {_lasting(hole)} at {spot(run, i + 1)}, while the cradle went"
            " on as from one sample to the next"
        )
        return Finding(
            "clock_jump",
            IMPOSSIBLE,
            text,
            "take the jump out of the later stamps, or record with a clock that is not set meanwhile",
            run=run.name,
            size=size,
        )
    if (hole > levels.SPLIT * usual and hole > run.duration - hole) or (
        hole > levels.PAUSE and hole > levels.PAUSE_STEPS * usual
    ):
        text = f"{run.file.name} has a hole of {_lasting(hole)} before {spot(run, i + 1)}"
        return Finding(
            "hole",
            IMPOSSIBLE,
            text,
            "correct the stamps, or split it into two runs at the hole",
            run=run.name,
            size=size,
        )
    return None


def _went_on(run: Run, i: int, hole: float, usual: float) -> bool:
    """Whether the travel over a hole is that of a few usual steps although by its speed it should be that of the
    hole."""
    if "surge" not in run.channels:
        return False
    near = slice(max(i - BESIDE, 0), min(i + 2 + BESIDE, len(run.times)))
    times, travel = run.times[near], run["surge"][near]
    middle = i - near.start
    speeds = np.concatenate([np.diff(travel[: middle + 1]), np.diff(travel[middle + 1 :])]) / np.concatenate(
        [np.diff(times[: middle + 1]), np.diff(times[middle + 1 :])]
    )
    speeds = speeds[np.isfinite(speeds)]
    step = float(travel[middle + 1] - travel[middle])
    if len(speeds) < 3 or not np.isfinite(step):
        return False
    speed, scatter = float(np.median(speeds)), float(np.std(speeds))
    moving = abs(speed) > 5.0 * scatter / np.sqrt(len(speeds))
    return (
        moving
        and abs(step) < abs(speed) * levels.WENT_ON * usual
        and abs(speed) * hole > 2.0 * abs(step)
        and hole > 2 * levels.WENT_ON * usual
    )


def _jitter(run: Run, steps: Array, usual: float) -> list[Finding]:
    """Stamps that scatter about an even clock, told from rows that are missing by their steps being no whole ones."""
    whole = np.maximum(np.rint(steps / usual), 1.0)
    near = whole <= levels.HOLE
    left = steps[near] / whole[near] - usual
    size = float(1.4826 * np.median(np.abs(left)))
    if size <= levels.JITTER * usual or usual * 1e-6 > size:
        return []
    text = (
        f"the stamps of {run.file.name} are uneven: steps of {number(1e3 * usual)} ms that vary by"
        f" {number(1e3 * size)} ms"
    )
    return [Finding("uneven_stamps", NOTE, text, "", run=run.name, size={"step": usual, "std": size})]


def _holes(holes: list[tuple[Run, int, Array]]) -> list[Finding]:
    """One finding for the holes of all runs."""
    if not holes:
        return []
    longest = max(holes, key=lambda h: h[2].max())
    run, i, steps = longest
    count = sum(len(h[2]) for h in holes)
    where = place(run, i)
    text = f"{count} hole{'' if count == 1 else 's'} in time, the longest {number(1e3 * steps.max())} ms after {where}"
    return [Finding("hole", NOTE, text, "", size={"count": count, "longest": float(steps.max())})]


def _once(findings: list[Finding]) -> list[Finding]:
    """Alike findings of several runs that only need saying once: the first, with the number of runs."""
    result: list[Finding] = []
    for kind in dict.fromkeys(f.kind for f in findings):
        mine = [f for f in findings if f.kind == kind]
        if len(mine) == 1 or mine[0].severity in (SET_ASIDE,):
            result += mine
            continue
        first = mine[0]
        text = f"{first.text} ({len(mine) - 1} more such in the campaign)"
        result.append(
            Finding(kind, first.severity, text, first.remedy, run=first.run, size={**first.size, "count": len(mine)})
        )
    return result


def _lasting(seconds: float) -> str:
    """A time in the unit people say it in."""
    for size, name in ((3.156e7, "years"), (86400.0, "days"), (3600.0, "hours"), (60.0, "minutes"), (1.0, "s")):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {name}"
    return f"{seconds:.3g} s"
