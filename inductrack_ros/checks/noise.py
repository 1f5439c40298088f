# SPDX-License-Identifier: Apache-2.0
"""The noise: as stated or not, white or coloured, with a hum in it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.state import UNITS
from ..data import Campaign
from . import levels, spectrum
from .finding import IMPOSSIBLE, WARNING, Finding, number, quantity
from .noise_found import Channel
from .units import WRITTEN_IN

#: Channels in which every drive pulse shows: it is over between two samples, and comes back with every coil.
PUSHED = ("surge", "surge_rate", "surge_acceleration")
#: The noise found scatters by this over the root of the number of samples; of fewer samples by more.
SCATTER, FEWEST = 1.2, 60


def noises(calm: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings about every channel's noise; ``calm`` is the campaign without impacts, in which colour is looked for."""
    findings: list[Finding] = []
    pulsed = any(run.pulsed for run in calm.runs)
    for channel, about in channels.items():
        pushed = pulsed and channel in PUSHED
        spectral = [] if pushed else spectrum.look(calm, channel, about)
        findings += spectral
        stated = calm.noise_std.get(channel)
        if (
            stated
            and about.spread > 0.0
            and about.noise > 0.0
            and not any(f.kind == "coloured_noise" for f in spectral)
        ):
            quiet = sum(len(run.samples(channel)[1]) for run in calm.runs if channel in run.channels)
            findings += _differs(channel, stated, about, moving=pushed or _hit(channel, quiet / about.count))
    return findings


def _hit(channel: str, quiet: float) -> bool:
    """Whether impacts show in a channel; ``quiet`` is the part of it in which nothing hits the track."""
    return quiet < 0.5 and channel != "surge"


def _differs(channel: str, stated: float, about: Channel, moving: bool) -> list[Finding]:
    """A finding where the noise is not as stated; ``moving``: something moves the channel between its samples."""
    found = about.scatter
    ratio = found / stated
    if ratio > 1.0 and (moving or not about.resolved):  # what is found is motion between the samples as well
        return []
    if ratio > 1.0 and about.noise < about.step:  # what is found are steps, which noise_std may leave out
        return []
    size = {"ratio": ratio, "found": found, "stated": stated}
    unit = UNITS[channel]
    text = (
        f"the noise of {channel} is {quantity(channel, found)}, {number(ratio)} {'of' if ratio < 1 else 'times'} the"
        f" noise_std stated, {quantity(channel, stated)}"
    )
    if not 1 / levels.NOISE_IMPOSSIBLE < ratio < levels.NOISE_IMPOSSIBLE:
        hint = meant(ratio, unit) or meant(1 / ratio, unit)
        remedy = (
            f"is one of the two in {hint} instead of {'radians' if unit == 'rad' else unit}?"
            if hint
            else "noise_std is in SI units; correct it, or leave it out to have it estimated"
        )
        if abs(np.log(stated / found**2)) < np.log(levels.NEAR):
            remedy = f"noise_std is the standard deviation, not its square: {number(found)}"
        return [Finding("noise_differs", IMPOSSIBLE, text, remedy, channel, size=size)]
    sure = levels.sigmas(1) * SCATTER / np.sqrt(about.count)
    if about.count < FEWEST or abs(np.log(ratio)) < max(np.log(levels.NOISE_DIFFERS), sure) or about.step:
        return []
    return [
        Finding(
            "noise_differs",
            WARNING,
            text,
            f"correct noise_std: {{{channel}: …}}, or leave it out to have it estimated",
            channel,
            size=size,
        )
    ]


def meant(ratio: float, unit: str, near_to: float = levels.NEAR) -> str:
    """The unit in which a channel, whose SI unit is ``unit``, is written where it is ``ratio`` times as large as it
    should be, to the factor ``near_to``; empty where there is none such."""
    near = [(abs(np.log(ratio * factor)), name) for factor, name in WRITTEN_IN.get(unit, ())]
    off, name = min(near, default=(np.inf, ""))
    return name if off < np.log(near_to) else ""
