# SPDX-License-Identifier: Apache-2.0
"""Samples of two sources in one run: two publishers on one topic, two rigs or two recordings in one file.

The channels go to and fro between two courses: every step away is followed by one as long back, in several channels
at the same samples. Noise, hum and impacts do not do that; a bad bit or a spike does in one channel.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.state import COORDINATES, GAPS
from ..data import Campaign, Run
from ..data.measurement import Array
from .finding import IMPOSSIBLE, Finding, as_samples, of_a_bag, quantity, shared, spot
from .noise_found import READINGS, Channel

#: The largest steps of a channel are the one that this part of them exceeds; a step away is more than half of it.
LARGEST, AWAY = 0.03, 0.5
#: A step away and the next one cancel to this part of them; so do these parts of a channel's, and of noise a tenth.
CANCEL, MOST = 0.2, 0.8
#: The two courses are this many readings' steps and usual moves over two samples apart.
APART = 3.0
#: Fewest steps away, and the part of all steps: what is rarer is an outlier.
FEWEST, RARE = 12, 0.04
#: The channel of which the report shows a picture, if it is among those: travel would hide what is apart.
SHOWN = ("heave", "sway")
#: Where one channel steps away another does so too, at this part of the samples.
TOGETHER = 0.7


def interleaved(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding where the samples of some run come from two sources."""
    for run in campaign.runs:
        found = _to_and_fro(run, channels)
        if not found:
            continue
        first = min(int(rows[0]) for rows, _ in found.values())
        sizes = [f"{c} by {quantity(c, size)}" for c, (_, size) in found.items()]
        text = (
            f"the samples of {run.file.name} go to and fro between two courses (first behind {spot(run, first)}),"
            f" apart in {shared(sizes)}: they are of two sources"
        )
        remedy = (
            "find the second publisher (`ros2 topic info -v TOPIC`) and record one of them"
            if of_a_bag(run)
            else "make two files of two rigs or recordings"
        )
        size = {"channels": list(found), "apart": {c: s for c, (_, s) in found.items()}}
        channel = next(c for c in (*SHOWN, *found) if c in found)
        other = as_samples({run.name: _other_course(run, channel, found[channel][1])})
        return [Finding("interleaved", IMPOSSIBLE, text, remedy, channel, run.name, other, size)]
    return []


def _to_and_fro(run: Run, channels: Mapping[str, Channel]) -> dict[str, tuple[NDArray[np.intp], float]]:
    """By channel the samples before its steps away and back, and how far apart the two courses are; none for a run of
    one source."""
    tried = {c: _steps(run, c, channels[c]) for c in run.channels if c in (*COORDINATES, *GAPS) and c in channels}
    found = {c: steps for c, steps in tried.items() if steps is not None}
    if len(found) < min(len(tried), 2):
        return {}
    alike = [
        np.isin(rows, others).mean() > TOGETHER
        for c, (rows, _, _) in found.items()
        for o, (_, others, _) in found.items()
        if o != c
    ]
    return {c: (rows, size) for c, (rows, _, size) in found.items()} if any(alike) or len(tried) == 1 else {}


def _steps(run: Run, channel: str, about: Channel) -> tuple[NDArray[np.intp], NDArray[np.intp], float] | None:
    """Samples before a channel's largest steps away and back, those before all that are more than it moves, and how
    large the former are; None where they do not cancel."""
    known = np.flatnonzero(~np.isnan(run[channel]))[:READINGS]
    values = run[channel][known]
    if len(values) < 4 * FEWEST:
        return None
    steps = np.abs(toward := np.diff(values) - (values[-1] - values[0]) / (len(values) - 1))
    away = np.flatnonzero(steps > AWAY * np.quantile(steps, 1.0 - LARGEST))
    if len(away) < max(FEWEST, RARE * len(steps)) or not _cancel(toward[away]):
        return None
    least = APART * max(about.step, _usual(values))
    size = float(np.median(steps[away]))
    if size < least:
        return None
    return known[away], known[np.flatnonzero(steps > least)], size


def _other_course(run: Run, channel: str, size: float) -> NDArray[np.intp]:
    """Samples of a channel on the course on which it does not begin, ``size`` from the other."""
    known = np.flatnonzero(~np.isnan(run[channel]))[:READINGS]
    steps = np.diff(run[channel][known])
    away = np.flatnonzero(np.abs(steps) > AWAY * size)
    there = np.sign(steps[away]) == np.sign(steps[away[0]])
    lasting = np.diff(np.append(away, len(known) - 1))
    return known[away[0] + 1 :][np.repeat(there, lasting)]


def _usual(values: Array) -> float:
    """What a channel moves over the few samples by which one of its own course follows, at the least."""
    return min(float(np.median(np.abs(values[lag:] - values[:-lag]))) for lag in (1, 2, 3))


def _cancel(away: Array) -> bool:
    """Whether nearly every step away has one as long back next to it, behind or before."""
    pairs = np.abs(away[1:] + away[:-1]) < CANCEL * np.abs(away[1:])
    return float(np.mean(np.append(pairs, False) | np.append(False, pairs))) > MOST
