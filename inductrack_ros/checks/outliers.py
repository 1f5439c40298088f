# SPDX-License-Identifier: Apache-2.0
"""Samples that are none of their channel's: fillers written where nothing was measured, spikes, a single bad cell.

What a cradle can do is not set aside, however odd it looks. It may swing in one run and lie still in all others. Where
it may touch the track a sample can be anything that `touch.Touch` bounds. A drive's pulse is a spike of
surge_acceleration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ..core.state import JUMPING, RATES
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .edges import at_the_ends, floor_of
from .finding import IMPOSSIBLE, SET_ASIDE, Finding, as_samples, number, place, quantity
from .local import MARGIN, REACHES, blocks, deviations, misses, predictions, spread
from .noise_found import Channel
from .touch import Touch

#: Times that the search is done again without what was found, so that neighbours of a bad sample are seen too.
ROUNDS = 4
#: Different values that one instrument writes for no reading, to either side: an overload, and that it has none.
KINDS = 2

Rows = dict[str, NDArray[np.intp]]


def fillers(campaign: Campaign, touch: Touch | None) -> list[Finding]:
    """Values that no channel takes by itself: well-known fillers, and what lies far outside of all the rest."""
    findings = []
    for channel in campaign.channels:
        rows, seen = _absurd(campaign, channel, touch)
        if rows:
            findings.append(_filler(campaign, channel, rows, seen))
    return findings


def outliers(campaign: Campaign, channels: Mapping[str, Channel], touch: Touch | None) -> list[Finding]:
    """Samples that leave what their neighbours on both sides agree on, further than the cradle could throw them."""
    findings = []
    threshold = levels.sigmas(sum(c.count for c in channels.values()))
    near = {run.name: None if touch is None else touch.near(run) for run in campaign.runs}
    for channel, about in channels.items():
        if channel == "surge_acceleration" or (touch is None and channel in JUMPING):
            continue
        rows: Rows = {}
        sizes = []
        for run in campaign.runs:
            if channel in run.channels:
                found, off = _off(run, channel, about, threshold)
                ends, size = _ends(run, channel, about, found, touch)
                # A blow is a step of what an accelerometer reads, and of what hangs on forces.
                if touch is not None and channel in JUMPING and len(found):
                    kept = ~near[run.name][found] | (off > touch.reach(channel, np.gradient(run.times)[found]))
                    found, off = found[kept], off[kept]
                rows[run.name] = np.append(found, ends)
                sizes += [off, size]
        rows = {name: numbers for name, numbers in rows.items() if len(numbers)}
        if rows:
            findings.append(_outlier(campaign, channel, rows, np.concatenate(sizes), about))
    return findings


# ---------------------------------------------------------------- fillers


def _absurd(campaign: Campaign, channel: str, touch: Touch | None) -> tuple[Rows, list[float]]:
    """Sample numbers by run, and the values that stand there."""
    runs = [run for run in campaign.runs if channel in run.channels]
    parts = [run.samples(channel)[1] for run in runs]
    usual = np.concatenate([y[:: max(len(y) // 20_000, 1)] for y in parts])
    usual = usual[~np.isin(usual, _apart(usual))]
    if not len(usual):
        return {}, []
    low, middle, high = np.quantile(usual, [0.05, 0.5, 0.95])
    width = float(high - low)
    rows: Rows = {}
    values: list[float] = []
    for run in runs:
        column = run[channel]
        with np.errstate(invalid="ignore", over="ignore"):
            away = np.flatnonzero((np.abs(column - middle) > width) & (width > 0))
            far = away[np.abs(column[away] - middle) > levels.ABSURD * width]
        filler = away[np.isin(column[away], levels.FILLERS)]
        mine = np.union1d(far if touch is None else _torn(run, channel, np.union1d(far, filler), touch), filler)
        if len(mine):
            rows[run.name] = mine
            values += column[mine].tolist()
    return rows, values


def _apart(readings: Array) -> Array:
    """Values that are written again and again and lie absurdly far outside of all other readings, at most `KINDS` to
    either side: overloads, and fillers whatever their digits.

    Each value counts once, however often it is written, so that many fillers do not pass for the channel's range. The
    readings of a channel that moves come near each other everywhere, those of one in another unit are many."""
    values, counts = np.unique(readings, return_counts=True)
    last = len(values) - 1
    low, middle, high = (values[k] for k in (-(-last // 4), last // 2, 3 * last // 4))
    found = [values[:0]]
    if not low < high:
        return found[0]
    for side in (1.0, -1.0):
        away = side * (values - middle)
        order = np.argsort(away)[-KINDS - 1 :]
        inner = np.maximum(away[order[:-1]], high - low)
        torn = np.flatnonzero(away[order[1:]] / levels.ABSURD > inner)
        if len(torn) and counts[order[1 + torn[0] :]].max() > 1:
            found.append(values[order[1 + torn[0] :]])
    return np.concatenate(found)


def _torn(run: Run, channel: str, rows: NDArray[np.intp], touch: Touch) -> NDArray[np.intp]:
    """Those of the rows whose stretch no cradle could have entered or left from one sample to the next."""
    known = np.flatnonzero(~np.isnan(run[channel]))
    stretches = np.split(rows, np.flatnonzero(np.diff(np.searchsorted(known, rows)) > 1) + 1)
    return np.concatenate([s for s in stretches if len(s) and _jumps(run, channel, known, s, touch)] or [rows[:0]])


def _jumps(run: Run, channel: str, known: NDArray[np.intp], rows: NDArray[np.intp], touch: Touch) -> bool:
    """Whether a stretch of rows stands apart from the known sample before it and from that behind it; False where there
    is neither."""
    first, last = np.searchsorted(known, rows[[0, -1]])
    sides = [(known[first - 1], rows[0])] if first else []
    sides += [(rows[-1], known[last + 1])] if last + 1 < len(known) else []
    t, y = run.times, run[channel]
    return bool(sides) and all(abs(y[b] - y[a]) > touch.reach(channel, t[[b]] - t[[a]])[0] for a, b in sides)


def _filler(campaign: Campaign, channel: str, rows: Rows, seen: list[float]) -> Finding:
    value, times = Counter(seen).most_common(1)[0]
    count, first = len(seen), _first(campaign, rows)
    same = len(set(seen)) == 1
    what = (
        f"{number(value, 6)} {count} times"
        if same and count > 1
        else number(value, 6)
        if count == 1
        else f"{count} values such as {number(value, 6)}"
    )
    filler = times > 1 or value in levels.FILLERS
    kind = "fillers" if filler else "outliers"
    named = value in levels.FILLERS
    reads = f"a filler for what was not measured{'' if named else ', or an overload'}"
    reads = reads if filler else "far outside of all the rest"
    total = sum(len(run.samples(channel)[1]) for run in campaign.runs if channel in run.channels)
    return Finding(
        kind,
        SET_ASIDE,
        f"{channel} is {what} (first in {first}), {reads}",
        "leave such cells empty",
        channel=channel,
        samples=as_samples(rows),
        size={"count": count, "share": count / total, "value": value},
    )


# ---------------------------------------------------------------- outliers


def _off(run: Run, channel: str, about: Channel, threshold: float) -> tuple[NDArray[np.intp], Array]:
    """Sample numbers (in the run, in their order) that are off, and by how much.

    A run all of whose samples are noisier than those of the others, for its unit is another, is held to its own."""
    column = run[channel]
    number_of = np.flatnonzero(~np.isnan(column))
    least = max(levels.SMALLEST * about.spread, threshold * about.step / np.sqrt(12.0))
    floors = np.maximum(threshold * np.array(_by_reach(run, channel, about)), least)[:, None]
    found: list[NDArray[np.intp]] = []
    sizes: list[Array] = []
    for _ in range(ROUNDS):
        off, size = _leave(run.times[number_of], column[number_of], floors, steps=channel in (*RATES, *JUMPING))
        if not len(off):
            break
        found.append(number_of[off])
        sizes.append(size)
        number_of = np.delete(number_of, off)
    if not found:
        return np.empty(0, np.intp), np.empty(0)
    rows, order = np.unique(np.concatenate(found), return_index=True)
    return rows, np.concatenate(sizes)[order]


def _by_reach(run: Run, channel: str, about: Channel) -> Sequence[float]:
    """What the cubics of each reach miss typically: in all runs, or in this one where half of its samples say that it
    is noisier."""
    times, values = run.samples(channel)
    left = deviations(times, values)
    if not len(left) or np.median(np.abs(left)) / stats.norm.ppf(0.75) <= levels.NOISE_DIFFERS * about.noise:
        return about.by_reach
    return [max(pair) for pair in zip(about.by_reach, map(spread, misses(times, values)), strict=True)]


def _ends(
    run: Run, channel: str, about: Channel, found: NDArray[np.intp], touch: Touch | None
) -> tuple[NDArray[np.intp], Array]:
    """The same for the first and last samples: only what no blow does, for neighbours on one side do not tell a blow
    from a bad sample. A rate or an acceleration may step at any blow, and says nothing there."""
    if channel in (*RATES, *JUMPING):
        return np.empty(0, np.intp), np.empty(0)
    measured = ~np.isnan(run[channel])
    measured[found] = False
    known = np.flatnonzero(measured)
    rows, sizes = at_the_ends(run, channel, floor_of(about.noise, about.step, about.count), known)
    if touch is None or not len(rows):
        return rows, sizes
    far = sizes > touch.reach(channel, np.gradient(run.times)[rows])
    return rows[far], sizes[far]


def _leave(times: Array, values: Array, floors: Array, steps: bool) -> tuple[NDArray[np.intp], Array]:
    """Numbers and sizes of the samples that each prediction misses by more than its floor, (p, 1), and all by `KINK`
    times what two of the predictions differ by. ``steps``: the channel may step, so that only what stands out to one
    side counts."""
    numbers, sizes = [np.empty(0, np.intp)], [np.empty(0)]
    for part in blocks(len(times)):
        t, y = times[part], values[part]
        nearest, _ = predictions(t, y, REACHES[:1])
        at = np.flatnonzero(np.abs(y[MARGIN : len(y) - MARGIN] - nearest[0]) > floors[0]) + MARGIN
        if not len(at):
            continue
        predicted, _ = predictions(t, y, at=at)  # of these few by all that can be
        away = np.abs(y[at] - predicted)
        a, b, c = predicted
        agree = np.minimum(np.minimum(np.abs(a - b), np.abs(a - c)), np.abs(b - c))
        off = (away > floors).all(axis=0) & (away.min(axis=0) > levels.KINK * agree)
        if steps:
            around = np.stack([y[at + k] for k in (-2, -1, 1, 2)])
            off &= (y[at] > around.max(axis=0) + floors[0]) | (y[at] < around.min(axis=0) - floors[0])
        numbers.append(at[off] + part.start)
        sizes.append(away.min(axis=0)[off])
    return np.concatenate(numbers), np.concatenate(sizes)


def _outlier(campaign: Campaign, channel: str, rows: Rows, sizes: Array, about: Channel) -> Finding:
    count = len(sizes)
    share = count / about.count
    size = {"count": count, "share": share, "largest": float(sizes.max())}
    first = _first(campaign, rows)
    if share > levels.MOST_SET_ASIDE:
        text = f"{100 * share:.0f} % of {channel} jump away from their neighbours and back (first in {first})"
        return Finding(
            "outliers",
            IMPOSSIBLE,
            text,
            "look at the sensor and its cable, or leave the channel out",
            channel,
            samples=as_samples(rows),
            size=size,
        )
    if count == 1:
        text = f"{channel} in {first} is off by {quantity(channel, sizes[0])} from what its neighbours say"
    else:
        text = (
            f"{channel} has {count} outliers ({100 * share:.2g} %), off by up to {quantity(channel, sizes.max())}"
            f" (first in {first})"
        )
    return Finding("outliers", SET_ASIDE, text, "", channel, samples=as_samples(rows), size=size)


def _first(campaign: Campaign, rows: Rows) -> str:
    run = next(r for r in campaign.runs if r.name in rows)
    return place(run, int(rows[run.name][0]))
