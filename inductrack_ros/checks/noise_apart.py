# SPDX-License-Identifier: Apache-2.0
"""The noise of a channel in each run against its noise in the others: a unit that is another one in some runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from ..core.state import ACCELERATIONS, UNITS
from ..data import Campaign
from . import levels
from .finding import IMPOSSIBLE, WARNING, Finding, number, quantity
from .noise import FEWEST, meant
from .noise_found import Channel, channels_of

#: Noises that differ by this factor are told apart in every run.
CLEARLY = 2.0


def noises_apart(calm: Campaign) -> list[Finding]:
    """Findings about channels whose noise in one run is another than in the others by far; ``calm`` is the campaign
    without impacts.

    An acceleration jumps with every pulse, as noise does: beside pulses its noise is that of the drive."""
    pulsed = any(run.pulsed for run in calm.runs)
    channels = [c for c in calm.channels if not (pulsed and c in ACCELERATIONS)]
    apart = {
        run.name: {c: _noise(about) for c, about in channels_of(replace(calm, runs=(run,))).items()}
        for run in calm.runs
    }
    found = [finding for channel in channels if (finding := _odd(channel, apart)) is not None]
    return found + [f for pair in combinations(channels, 2) for f in _exchanged(*pair, apart)]


def _exchanged(one: str, other: str, apart: Mapping[str, Mapping[str, float]]) -> list[Finding]:
    """Two channels of which each has in one run the noise that the other has in the rest."""
    noise = {run: (sizes.get(one, 0.0), sizes.get(other, 0.0)) for run, sizes in apart.items()}
    noise = {run: pair for run, pair in noise.items() if min(pair) > 0.0}
    for run, pair in noise.items():
        others = np.array([there for name, there in noise.items() if name != run])
        if len(others) < 2:
            continue
        usual = np.median(others, axis=0)
        alike = abs(np.log(usual[0] / usual[1])) < np.log(CLEARLY)
        if alike or np.abs(np.log(np.array(pair) / usual[::-1])).max() > np.log(levels.NEAR):
            continue
        text = f"{one} and {other} seem to be swapped in {run}: each has there the noise that the other has elsewhere"
        size = {"candidates": [one, other]}
        return [Finding("axis_flipped", IMPOSSIBLE, text, "exchange the two channels of that run", one, run, size=size)]
    return []


def _odd(channel: str, apart: Mapping[str, Mapping[str, float]]) -> Finding | None:
    """The run of which a channel's noise is furthest from that of the others, if it is as far as units are."""
    noise = {run: sizes[channel] for run, sizes in apart.items() if sizes.get(channel, 0.0) > 0.0}
    if len(noise) < 2:
        return None
    others = {run: float(np.median([size for other, size in noise.items() if other != run])) for run in noise}
    run = max(noise, key=lambda r: abs(np.log(noise[r] / others[r])))
    ratio, unit = noise[run] / others[run], UNITS[channel]
    if 1 / levels.NOISE_IMPOSSIBLE < ratio < levels.NOISE_IMPOSSIBLE:
        return None
    text = (
        f"the noise of {channel} in {run} is {quantity(channel, noise[run])}, {number(ratio)} times that in the other"
        f" runs, {quantity(channel, others[run])}"
    )
    size = {"ratio": ratio, "found": noise[run], "others": others[run]}
    if hint := meant(ratio, unit):
        return Finding(
            "noise_differs", IMPOSSIBLE, text, f"is {channel} in {hint} in {run} alone?", channel, run, size=size
        )
    if hint := meant(1 / ratio, unit):
        remedy = f"is {channel} in {hint} in all runs but {run}?"
        return Finding("noise_differs", IMPOSSIBLE, text, remedy, channel, run, size=size)
    return Finding("noise_differs", WARNING, text, "were they recorded with one sensor?", channel, run, size=size)


def _noise(about: Channel) -> float:
    """The noise of a channel in a run; 0 where too few samples tell it, or motion between them hides it."""
    if about.count < FEWEST or not about.resolved or about.spread == 0.0:
        return 0.0
    return about.scatter
