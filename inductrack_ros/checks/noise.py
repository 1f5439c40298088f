# SPDX-License-Identifier: Apache-2.0
"""The noise: as stated or not, white or coloured, with a hum in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ..core.state import UNITS
from ..data import Campaign
from . import levels, spectrum
from .finding import IMPOSSIBLE, WARNING, Finding, number
from .noise_found import Channel

#: What a factor between stated and found noise may come from.
FACTORS = (
    (1e3, "mm, mrad or mm/s instead of SI units"),
    (180.0 / np.pi, "degrees instead of radians"),
    (100.0, "cm instead of m"),
    (1e6, "millionths instead of SI units"),
)
#: Channels in which every drive pulse shows: it is over between two samples, and comes back with every coil.
PUSHED = ("surge", "surge_rate", "surge_acceleration")
#: The same of an acceleration.
IN_G = ((1e3 / 9.80665, "mg instead of m/s²"), (1e3, "mm/s² instead of m/s²"))
#: The noise found scatters by this over the root of the number of samples; of fewer samples by more.
SCATTER, FEWEST = 1.2, 60


def noises(calm: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings about every channel's noise; ``calm`` is the campaign without impacts, in which colour is looked for."""
    findings: list[Finding] = []
    pulsed = any(run.pulses is not None and len(run.pulses.times) for run in calm.runs)
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
    found = max(about.noise, about.step / np.sqrt(12.0)) if about.step else about.noise
    ratio = found / stated
    if ratio > 1.0 and (moving or not about.resolved):  # what is found is motion between the samples as well
        return []
    size = {"ratio": ratio, "found": found, "stated": stated}
    unit = UNITS[channel]
    text = (
        f"the noise of {channel} is {number(found)} {unit}, {number(ratio)} of the noise_std stated, {number(stated)}"
        f" {unit}"
    )
    if not 1 / levels.NOISE_IMPOSSIBLE < ratio < levels.NOISE_IMPOSSIBLE:
        fitting = FACTORS if unit.startswith("m") else [f for f in FACTORS if not f[1].startswith("cm")]
        hint = meant(ratio, IN_G if unit == "m/s²" else fitting)
        remedy = (
            f"is one of the two in {hint}?"
            if hint
            else "noise_std is in SI units; correct it, or leave it out to have it estimated"
        )
        if meant(stated / found**2, ((1.0, "its square"),)):
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


def meant(ratio: float, factors: Iterable[tuple[float, str]]) -> str:
    """The unit that a ratio near one of the factors, or its inverse, comes from; empty for none."""
    for factor, name in factors:
        if abs(abs(np.log(ratio)) - np.log(factor)) < np.log(levels.NEAR):
            return name
    return ""
