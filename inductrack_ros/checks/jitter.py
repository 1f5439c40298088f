# SPDX-License-Identifier: Apache-2.0
"""Stamps that are off by chance: a sample is then off by its speed times that, in all channels at once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.state import COORDINATES
from ..data import Campaign, Run
from ..data.measurement import Array
from .finding import WARNING, Finding, number
from .local import MARGIN, deviations
from .noise_found import Channel

#: Samples of each run that are looked at.
MOST = 60_000
#: What one channel says of the stamps shows in the others with this slope, so many standard deviations off none.
SLOPE, SURE = (0.5, 1.5), 4.0


def jitter(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding where what surge's noise says of the stamps is what the other coordinates say."""
    others = [c for c in COORDINATES[1:] if c in channels and channels[c].noise > 0.0]
    if "surge" not in channels or not others or channels["surge"].noise <= channels["surge"].step:
        return []  # what is rounded by half a step is off by no more than one from what its neighbours say
    parts = [
        p for run in campaign.runs if {"surge", *others} <= set(run.channels) and (p := _late(run, others)) is not None
    ]
    if not parts:
        return []
    late, speed = (np.concatenate([p[k] for p in parts]) for k in (0, 1))
    clip = np.abs(late) < 5 * np.median(np.abs(late)) / 0.67
    above = below = 0.0
    for k, channel in enumerate(others):
        off, rate = (np.concatenate([p[j][k] for p in parts]) for j in (2, 3))
        weight = channels[channel].noise ** -2
        kept = clip & (np.abs(off) < 5 * channels[channel].noise)
        above += weight * float(np.sum((off * rate * late)[kept]))
        below += weight * float(np.sum((rate * late)[kept] ** 2))
    if below <= 0.0 or above / np.sqrt(below) < SURE or not SLOPE[0] < above / below < SLOPE[1]:
        return []
    own = campaign.noise_std.get("surge", 0.0) / float(np.median(np.abs(speed)))
    size = float(np.sqrt(max(np.var(late[clip]) - own**2, 0.0)))
    text = (
        f"the stamps are off by {number(1e3 * size, 2)} ms from sample to sample (standard deviation), in all channels"
        " at once"
    )
    return (
        [
            Finding(
                "time_jitter", WARNING, text, "stamp a sample when it is taken, not when it arrives", size={"std": size}
            )
        ]
        if size > 0.0
        else []
    )


def _late(run: Run, others: list[str]) -> tuple[Array, Array, Array, Array] | None:
    """How late each inner sample is by its surge (s), the speed, and of the other channels how far they are off and
    their rates."""
    rows = np.flatnonzero(~np.isnan(np.stack([run[c] for c in ("surge", *others)])).any(axis=0))[:MOST]
    if len(rows) < 4 * MARGIN:
        return None
    t = run.times[rows]
    speed = _rate(t, run["surge"][rows])
    moving = np.abs(speed) > 0.2 * np.max(np.abs(speed))
    with np.errstate(divide="ignore", invalid="ignore"):
        late = np.where(moving, deviations(t, run["surge"][rows]) / speed, 0.0)
    off = np.stack([deviations(t, run[c][rows]) for c in others])
    return late, speed, off, np.stack([_rate(t, run[c][rows]) for c in others])


def _rate(times: Array, values: Array) -> Array:
    """Rate at the inner samples, over `MARGIN` samples to both sides."""
    return (values[2 * MARGIN :] - values[: -2 * MARGIN]) / (times[2 * MARGIN :] - times[: -2 * MARGIN])
