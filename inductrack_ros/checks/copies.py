# SPDX-License-Identifier: Apache-2.0
"""Readings that stand twice in a campaign: a run listed under two names, runs that overlap, a column pasted from
another run or from its neighbour.

Two measurements of one motion differ by their noise. A copy differs by no more than the digits it was written with,
whatever it was multiplied by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

from ..data import Campaign, Run
from ..data.measurement import Array
from ..data.stretches import stretches
from . import levels
from .finding import IMPOSSIBLE, SET_ASIDE, Finding, as_samples, number, place, shared
from .local import deviations, spread
from .noise_found import READINGS, Channel
from .steps import step_of

#: Samples in a row, of which this part is found again in order, before it is called a copy.
COPY, MOST_OF = 48, 0.8
#: Samples of a run that are laid over those of the others, and how many others, behind it in the list, these are.
LAID, OTHERS = 4096, 64
#: What rounding leaves, in steps of the digits: half a step of each, and a little. What is rounded is a whole number of
#: them, to this part of one.
ROUNDING, ROUNDED = 0.6, 1e-3
#: Noise of so many digits tells one measurement from another.
OVER = 2.0
#: Noise beside the rounding, in steps, of which half of all readings of one motion are the same.
BESIDE = 0.5
#: Part of the shorter run that a copy holds from which on that run is left out as a whole.
WHOLE = 0.9


@dataclass(frozen=True)
class _Copy:
    """Sample numbers ``mine`` of a run that are ``theirs`` of an earlier one, in order; multiplied by ``factor``."""

    theirs: NDArray[np.intp]
    mine: NDArray[np.intp]
    factor: float = 1.0


def copies(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings about runs, stretches of runs and single channels that stand twice. Channels at rest tell nothing."""
    moving = [c for c, about in channels.items() if about.spread > levels.MOVES * max(about.noise, about.step)]
    telling = {c for c in moving if _tells(channels[c])}
    found: dict[tuple[int, int], dict[str, _Copy]] = {}
    for channel in moving:
        for pair, copy in _of_other_runs(campaign.runs, channel).items():
            found.setdefault(pair, {})[channel] = copy
    same = _same(campaign.runs)
    for i, j in same:
        rows = np.arange(len(campaign.runs[i].times))
        found[i, j] = {c: _Copy(rows, rows) for c in moving if c in campaign.runs[i].channels}
    findings = [f for run in campaign.runs if (f := _beside_itself(run, moving)) is not None]
    gone: set[str] = set()
    for (i, j), mine in sorted(found.items()):
        one, other = campaign.runs[i], campaign.runs[j]
        if other.name not in gone:
            both = {c for c in moving if c in one.channels and c in other.channels}
            tell = both & telling
            whole = (i, j) in same or bool(tell) and set(mine) >= tell
            some = mine if whole else {c: copy for c, copy in mine.items() if c in telling}
            if some:
                findings.append(_finding(one, other, some, whole))
                gone |= {f.run for f in findings[-1:] if f.run and f.severity == SET_ASIDE}
    return findings


def _same(runs: tuple[Run, ...]) -> set[tuple[int, int]]:
    """Pairs of runs, the earlier first, of which all readings are the same: no two flights are, however coarse."""
    first: dict[tuple[tuple[str, ...], bytes], int] = {}
    pairs = set()
    for j, run in enumerate(runs):
        i = first.setdefault((run.channels, run.values.tobytes()), j)
        pairs |= {(i, j)} if i != j else set()
    return pairs


def _tells(about: Channel) -> bool:
    """Whether a channel's readings tell two measurements of one motion apart.

    Two that are rounded to one step are the same in more than half of all readings where the noise beside the rounding
    is smaller than half a step."""
    return about.noise**2 > about.step**2 * (1.0 / 12.0 + BESIDE**2)


def _finding(one: Run, other: Run, found: Mapping[str, _Copy], whole: bool) -> Finding:
    """What is said of the channels of a run that are an earlier one's; ``whole``: all that move are."""
    copy = max(found.values(), key=lambda c: len(c.mine))
    files = f"{other.file.name}", f"{one.file.name}"
    if not whole:
        factor = "" if abs(copy.factor - 1.0) < 1e-3 else f", {number(copy.factor)} times as large"
        verb = "is" if len(found) == 1 else "are"
        text = (
            f"{shared(found)} in {files[0]} {verb} that of {files[1]}, reading for reading"
            f" ({len(copy.mine)} samples from {place(other, int(copy.mine[0]))} on{factor})"
        )
        remedy = f"export {shared(found)} of both runs again, or leave {'it' if len(found) == 1 else 'them'} out"
        samples = as_samples({other.name: copy.mine})
        size = {"channels": list(found), "of_run": one.name, "count": len(copy.mine)}
        return Finding("copied", IMPOSSIBLE, text, remedy, next(iter(found)), other.name, samples, size)
    size = {"of_run": one.name, "count": len(copy.mine)}
    if one.drive_current != other.drive_current or one.conditions != other.conditions:
        what = "drive_current" if one.drive_current != other.drive_current else "conditions"
        text = f"{files[0]} holds the same samples as {files[1]}, but campaign.yaml gives the two other {what}"
        remedy = "one of the two files is not that run's: export it again, or list one of them"
        return Finding("copied", IMPOSSIBLE, text, remedy, None, other.name, size=size)
    if len(copy.mine) >= WHOLE * len(other.times):
        text = f"{files[0]} holds the same samples as {files[1]}: what counts twice seems surer than it is"
        return Finding("copied", SET_ASIDE, text, "list one of them", None, other.name, size=size)
    text = (
        f"{len(copy.mine)} samples from {place(other, int(copy.mine[0]))} on are those from"
        f" {place(one, int(copy.theirs[0]))} on: what counts twice seems surer than it is"
    )
    return Finding("copied", SET_ASIDE, text, "", samples=as_samples({other.name: copy.mine}), size=size)


def _beside_itself(run: Run, moving: list[str]) -> Finding | None:
    """A channel that holds another's readings in the same run. The two side gaps are the same where nothing sways or
    rolls."""
    aside = {"sway", "roll"} & set(moving)
    for one, other in combinations([c for c in run.channels if c in moving], 2):
        both = ~np.isnan(run[one]) & ~np.isnan(run[other])
        same = both.sum() >= COPY and np.array_equal(run[one][both], run[other][both])
        if not same or ({one, other} == {"gap_right", "gap_left"} and not aside) or np.ptp(run[one][both]) == 0.0:
            continue
        text = f"{other} in {run.file.name} is {one}, reading for reading"
        remedy = f"export it again, or leave {other} out"
        return Finding("copied", IMPOSSIBLE, text, remedy, other, run.name, size={"channels": [one, other]})
    return None


# ---------------------------------------------------------------- one channel of two runs


def _of_other_runs(runs: tuple[Run, ...], channel: str) -> dict[tuple[int, int], _Copy]:
    """By pair of runs, the earlier first, what of the channel stands in both."""
    parts = {i: _known(run, channel)[:READINGS] for i, run in enumerate(runs) if channel in run.channels}
    parts = {i: rows for i, rows in parts.items() if len(rows) >= COPY}
    values = {i: runs[i][channel][rows] for i, rows in parts.items()}
    found = _digit_for_digit(values)
    waves = {i: _wave(runs[i].times[rows[:LAID]], values[i][:LAID]) for i, rows in parts.items()}
    for i in waves:
        for j in islice((j for j in waves if j > i), OTHERS):
            if (i, j) not in found and (copy := _laid_over(values[i], values[j], waves[i], waves[j])) is not None:
                found[i, j] = copy
    return {(i, j): _Copy(parts[i][c.theirs], parts[j][c.mine], c.factor) for (i, j), c in found.items()}


def _known(run: Run, channel: str) -> NDArray[np.intp]:
    return np.flatnonzero(~np.isnan(run[channel]))


def _digit_for_digit(values: Mapping[int, Array]) -> dict[tuple[int, int], _Copy]:
    """Pairs of series that share readings in order, also where one has lost samples of the other. Readings that a
    series holds more than once tell nothing."""
    singles = {i: np.unique(y, return_index=True, return_counts=True) for i, y in values.items()}
    readings = np.concatenate([y[n == 1] for y, _, n in singles.values()] or [np.empty(0)])
    places = np.concatenate([at[n == 1] for _, at, n in singles.values()] or [np.empty(0, np.intp)])
    of = np.concatenate([np.full(int((n == 1).sum()), i) for i, (_, _, n) in singles.items()] or [places])
    order = np.lexsort((of, readings))
    again = np.flatnonzero(readings[order[1:]] == readings[order[:-1]])
    first, second = order[again], order[again + 1]
    found = {}
    for i, j in {(int(a), int(b)) for a, b in zip(of[first], of[second], strict=True)}:
        mine = (of[first] == i) & (of[second] == j)
        theirs, own = places[first[mine]], places[second[mine]]
        order_of_own = np.argsort(own)
        copy = _in_order(theirs[order_of_own], own[order_of_own], len(values[j]))
        if copy is not None:
            found[i, j] = copy
    return found


def _in_order(theirs: NDArray[np.intp], mine: NDArray[np.intp], count: int) -> _Copy | None:
    """The longest stretch of ``count`` samples of which most are matched in order; None where there is none."""
    if len(mine) < COPY:
        return None
    matched = np.zeros(count)
    matched[mine[np.flatnonzero(np.diff(theirs, prepend=-1) > 0)]] = 1.0
    dense = np.convolve(matched, np.ones(COPY), "valid") >= MOST_OF * COPY
    found = stretches(dense)
    if not found:
        return None
    first, behind = max(found, key=lambda ends: ends[1] - ends[0])
    inside = (mine >= first) & (mine < behind + COPY - 1)
    return _Copy(theirs[inside], mine[inside])


def _wave(times: Array, values: Array) -> NDArray[np.complex128]:
    """The phases of a series' noise: where two series hold the same, they turn evenly. A hum is one of them only."""
    noise = deviations(times, values)
    noise = np.clip(noise, *np.array([-4.0, 4.0]) * max(float(np.std(noise)), 1e-300)) if len(noise) else noise
    wave = np.fft.rfft(noise, 2 * LAID)
    return wave / np.maximum(np.abs(wave), 1e-300)


def _laid_over(
    theirs: Array, mine: Array, their_wave: NDArray[np.complex128], my_wave: NDArray[np.complex128]
) -> _Copy | None:
    """One series laid over another where their noise is most alike: a copy, if a factor and a zero make them the same
    to their digits."""
    alike = np.fft.irfft(np.conj(their_wave) * my_wave)
    shift = int(np.argmax(np.abs(alike)))
    shift -= len(alike) if shift > len(alike) // 2 else 0
    first = max(0, -shift)
    count = min(len(theirs) - first, len(mine) - first - shift, LAID)
    if count < COPY:
        return None
    a, b = theirs[first : first + count], mine[first + shift : first + shift + count]
    spans = np.ptp(a), np.ptp(b)
    if min(spans) == 0.0:
        return None
    line = np.stack([a - a.mean(), np.ones(count)], axis=1)
    factor, zero = np.linalg.lstsq(line, b, rcond=None)[0]
    digits = abs(factor) * _digits(a) + _digits(b) + 1e-9 * spans[1]
    noise = abs(factor) * spread(deviations(np.arange(count, dtype=float), a))
    if np.abs(b - line @ (factor, zero)).max() > ROUNDING * digits or not noise > OVER * digits:
        return None  # what is smooth to its digits is alike by its physics
    rows = np.arange(first, first + count)
    return _Copy(rows, rows + shift, float(factor))


def _digits(values: Array) -> float:
    """What a series was rounded to: a power of ten, or its step; 0 where neither shows."""
    for step in 10.0 ** -np.arange(10):
        if np.abs(values / step - np.rint(values / step)).max() < ROUNDED:
            return float(step)
    return step_of(values)
