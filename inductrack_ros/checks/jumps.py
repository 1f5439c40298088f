# SPDX-License-Identifier: Apache-2.0
"""Places and gaps that jump from one sample to the next and stay: no cradle moves so. Counts were lost, a zero was
moved, or an angle is wrapped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.state import COORDINATES, GAPS
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import IMPOSSIBLE, SET_ASIDE, Finding, as_samples, place, quantity
from .noise_found import Channel
from .units import units_of

#: Samples beside a jump that say where the channel was and where it is then.
BESIDE = 5
#: A step counts as part of a jump from this part of the largest one beside it on; what is left of it in the end, too.
PART, LEFT = 0.3, 0.5
#: A jump is this many times as far as the samples beside it would go in its time, and this many times their noise,
#: which may be more there than elsewhere.
CLEAR, OVER_NOISE = 6.0, 10.0
#: Median size of the second differences of white noise over its standard deviation.
_BEND = 0.6745 * np.sqrt(6.0)
#: Jumps that differ by less than this part are of one length, that of a counter's range.
ALIKE = 0.2
#: Samples within which a channel that jumps back was lost for a while.
SOON = 64


def jumps(campaign: Campaign, channels: Mapping[str, Channel], off: list[Finding]) -> list[Finding]:
    """Findings about every place and gap that jumps, among the samples that `outliers` found off; one that jumps back
    soon was lost in between."""
    findings = []
    for finding in off:
        channel = finding.channel
        if finding.kind != "outliers" or channel not in (*COORDINATES, *GAPS) or channel not in channels:
            continue
        stay: list[tuple[Run, int, float]] = []
        lost: dict[str, NDArray[np.intp]] = {}
        for run in campaign.runs:
            rows = np.unique(np.array(finding.samples.get(run.name, ()), np.intp))
            there, between = _back(list(_jumps(run, channel, rows, channels[channel])) if len(rows) else [])
            stay += [(run, i, size) for i, size in there]
            if len(between):
                lost[run.name] = between
        if stay:
            findings.append(_jump(channel, stay, channels))
        elif lost:
            run = next(r for r in campaign.runs if r.name in lost)
            count = sum(map(len, lost.values()))
            text = (
                f"{channel} jumps away for {count} samples and back (first behind {place(run, int(lost[run.name][0]))})"
            )
            size = {"count": count, "share": count / channels[channel].count}
            findings.append(Finding("lost", SET_ASIDE, text, "", channel, samples=as_samples(lost), size=size))
    return findings


def wraps(campaign: Campaign) -> list[Finding]:
    """A finding where a run's travel begins again and again: it counts within one length only."""
    for run in campaign.runs:
        if "surge" not in run.channels:
            continue
        known = np.flatnonzero(~np.isnan(run["surge"]))
        steps = np.diff(run["surge"][known])
        if len(steps) < levels.FEW:
            continue
        again = np.flatnonzero(-steps * np.sign(np.median(steps)) > PART * np.ptp(run["surge"][known]))
        back = steps[again]
        if len(again) < 2 or np.ptp(back) > 0.1 * np.abs(back).min() or np.diff(again).min() < BESIDE:
            continue
        length = float(np.abs(back - np.median(steps)).mean())
        text = (
            f"surge begins again {len(again)} times, each time {quantity('surge', length)} back (first behind"
            f" {place(run, int(known[again[0]]))}): it counts within one length only"
        )
        remedy = f"add {length:.4g} m to all that follows, at each of these places"
        size = {"jump": -length, "count": len(again)}
        behind = as_samples({run.name: known[again + 1]})
        return [Finding("value_jump", IMPOSSIBLE, text, remedy, "surge", run.name, behind, size)]
    return []


def _back(found: list[tuple[int, float]]) -> tuple[list[tuple[int, float]], NDArray[np.intp]]:
    """Jumps that stay, and the samples between those that jump and back again soon."""
    stay: list[tuple[int, float]] = []
    between = [np.empty(0, np.intp)]
    for i, size in found:
        if stay and i - stay[-1][0] <= SOON and abs(stay[-1][1] + size) < LEFT * abs(size):
            between.append(np.arange(stay.pop()[0] + 1, i + 1))
        else:
            stay.append((i, size))
    return stay, np.concatenate(between)


def _jumps(run: Run, channel: str, rows: NDArray[np.intp], about: Channel) -> Iterator[tuple[int, float]]:
    """Sample before each jump, and its size. Steps in a burst of noise are as large, but do not stand over what
    is beside them, or end where they began."""
    known = np.flatnonzero(~np.isnan(run[channel]))
    at = np.searchsorted(known, rows)
    for cluster in np.split(at, np.flatnonzero(np.diff(at) > 2) + 1):
        first, last = max(cluster[0] - 1, 0), min(cluster[-1] + 1, len(known) - 1)
        before, behind = known[max(first - BESIDE, 0) : first + 1], known[last : last + BESIDE + 1]
        if first == last or min(len(before), len(behind)) <= BESIDE:
            continue
        steps = np.diff(run[channel][known[first : last + 1]])
        large = np.abs(steps) > PART * np.abs(steps).max()
        jump, lasting = float(steps[large].sum()), float(np.diff(run.times[known[first : last + 1]])[large].sum())
        beside = [np.diff(run[channel][some]) / np.diff(run.times[some]) for some in (before, behind)]
        usual = float(np.median(np.abs(np.concatenate(beside))))
        bends = [np.median(np.abs(np.diff(run[channel][some], 2))) for some in (before, behind)]
        noise = max(about.noise, about.step, float(max(bends)) / _BEND)
        least = max(CLEAR * usual * lasting, OVER_NOISE * noise, levels.SMALLEST * about.spread)
        went = float(np.median(np.concatenate(beside))) * float(run.times[behind[0]] - run.times[before[-1]])
        stayed = np.sign(jump) * (run[channel][behind[0]] - run[channel][before[-1]] - went)
        if abs(jump) > max(LEFT * np.abs(steps).max(), least) and stayed > LEFT * abs(jump):
            yield int(known[first + int(np.argmax(np.abs(steps)))]), jump


def _jump(channel: str, found: list[tuple[Run, int, float]], channels: Mapping[str, Channel]) -> Finding:
    run, i, size = found[0]
    again = "" if len(found) == 1 else f" ({len(found) - 1} more such)"
    text = (
        f"{channel} jumps by {quantity(channel, size)} behind {place(run, i)}, and goes on from there{again}: no cradle"
        " moves so"
    )
    remedy = "its zero was moved or counts were lost: correct the later samples, or make two runs of it"
    if (goes_on := _goes_on_as(run, channel, i, channels)) is not None:
        remedy = f"it goes on where {goes_on} was: were the cells of these rows moved to other columns? Move them back"
    elif (how := _written(run, channel, i)) is not None:
        remedy = (
            f"from there on it reads as if {how}, or its zero was moved or counts were lost: correct the later samples"
        )
    sizes = np.abs([s for _, _, s in found])
    if channel == "roll" and abs(abs(size) - 2 * np.pi) < 0.1:
        remedy = "the angle is wrapped at a full turn; unwrap it, or choose a range with its rest in the middle"
    elif len(found) > 1 and np.ptp(sizes) < ALIKE * sizes.min():
        length = quantity(channel, float(np.median(sizes)))
        remedy = f"a counter or converter that wraps at {length}? Add or take off its range at each of these places"
    behind = as_samples({run.name: np.arange(i + 1, min(i + 1 + BESIDE, len(run.times)))})
    size_of = {"jump": size, "count": len(found)}
    return Finding("value_jump", IMPOSSIBLE, text, remedy, channel, run.name, behind, size_of)


def _beside(run: Run, channel: str, i: int) -> tuple[Array, Array]:
    """A channel's samples before and behind sample i, at most `BESIDE` each."""
    known = np.flatnonzero(~np.isnan(run[channel]))
    at = int(np.searchsorted(known, i, side="right"))
    return run[channel][known[max(at - BESIDE, 0) : at]], run[channel][known[at : at + BESIDE]]


def _goes_on_as(run: Run, channel: str, i: int, channels: Mapping[str, Channel]) -> str | None:
    """Other channels that the samples behind sample i continue, and that do not go on themselves; None where there are
    none."""
    behind = _beside(run, channel, i)[1]

    def continues(other: str, samples: Array) -> bool:
        before = _beside(run, other, i)[0]
        if len(before) < BESIDE or not len(samples):
            return False
        moves = float(np.abs(np.diff(before)).max()) + OVER_NOISE * channels[other].scatter
        return abs(samples[0] - before[-1]) < moves and abs(samples[-1] - before[-1]) < BESIDE * moves

    others = [c for c in run.channels if c in channels and c in (*COORDINATES, *GAPS) and c != channel]
    fits = [c for c in others if continues(c, behind) and not continues(c, _beside(run, c, i)[1])]
    return " or ".join(fits) or None


def _written(run: Run, channel: str, i: int) -> str | None:
    """What a channel's samples behind sample i are multiplied by to go on from those before, in words: its sign, or a
    unit; None where it is neither."""
    before, behind = _beside(run, channel, i)
    if min(map(len, (before, behind))) < 2 or not before[-1]:
        return None
    ratio = float(behind[0] / before[-1])
    moved = max(
        float(np.abs(np.diff(before)).max() / abs(before[-1])), float(np.abs(np.diff(behind)).max() / abs(behind[0]))
    )
    near = 2.0 * moved + levels.EXACTLY - 1.0
    if near > 0.5:
        return None
    if abs(ratio + 1.0) < near:
        return "its sign were changed"
    for factor, unit in units_of(channel):
        for then in (1.0 / factor, factor):
            if abs(ratio / then - 1.0) < near:
                return (
                    f"it were in {unit}" if then > 1.0 > factor or then < 1.0 < factor else f"it were no more in {unit}"
                )
    return None
