# SPDX-License-Identifier: Apache-2.0
"""Each sensor by itself: constant, stuck, saturated, coarse."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.model import Model
from ..core.state import COORDINATES, GAPS
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import IMPOSSIBLE, SET_ASIDE, WARNING, Finding, as_samples, number, place, quantity, shared
from .hangs import flat_stretches
from .noise_found import READINGS, Channel


def sensors(campaign: Campaign, calm: Campaign, channels: Mapping[str, Channel], model: Model | None) -> list[Finding]:
    """Findings about every channel's readings; ``calm`` is the campaign without samples at which the cradle may rest on
    the track."""
    findings: list[Finding] = []
    for channel, about in channels.items():
        moves = model is None or _moves(channel, model)
        if dead := _constant(campaign, channel, about, _beside(channel, campaign, channels, model), moves):
            findings += dead
        else:
            findings += _flat(calm, channel, about) or _clipped(campaign, channel, about)
        findings += _coarse(campaign, channel, about)
    return findings


def _beside(channel: str, campaign: Campaign, channels: Mapping[str, Channel], model: Model | None) -> str:
    """What shows that a channel is not at rest: its coordinate, rate or acceleration moves, or the drive pushes it."""
    coordinate = channel.removesuffix("_rate").removesuffix("_acceleration")
    if coordinate not in (*COORDINATES, *GAPS):
        return ""
    derived = ("heave", *GAPS) if channel in GAPS else (coordinate, f"{coordinate}_rate", f"{coordinate}_acceleration")
    for other in derived:
        about = channels.get(other)
        if other != channel and about and about.spread > levels.MOVES * max(about.noise, about.step) > 0.0:
            return f"{other} moves"
    driven = any(run.drive_current for run in campaign.runs) and model is not None and model.moving[0]
    return "the drive pushes" if channel == "surge" and driven else ""


def _moves(channel: str, model: Model) -> bool:
    """Whether the model lets a channel move; a rate does where its coordinate does."""
    coordinate = channel.removesuffix("_rate").removesuffix("_acceleration")
    return coordinate not in COORDINATES or bool(model.moving[COORDINATES.index(coordinate)])


def _nearly_all(values: Array) -> Array:
    """The ends of what all but a hundredth of the samples lie between, at either side."""
    return np.quantile(values[:: max(len(values) // READINGS, 1)], [levels.RARE, 1.0 - levels.RARE], method="nearest")


def _dead(campaign: Campaign, channel: str, runs: list[Run], beside: str, moves: bool) -> Finding:
    """A channel that stands still in all runs though its noise, where one is stated, would move it."""
    values = np.concatenate([run.samples(channel)[1] for run in runs])
    value, others = float(np.median(runs[0].samples(channel)[1])) + 0.0, 0
    for run in runs:
        others += int((run.samples(channel)[1] != np.median(run.samples(channel)[1])).sum())
    samples = f"all but {others} of its {len(values)} samples" if others else "every sample"
    while_ = f" while {beside}" if beside else ""
    stated = campaign.noise_std.get(channel)
    if stated and moves and not beside:
        while_ = f", where the noise_std stated, {quantity(channel, stated)}, would show"
    text = f"{channel} is {number(value)} in {samples}{while_}: the sensor is dead or the column wrong"
    remedy = "leave the channel out"
    if channel == "roll" and abs(abs(value) - np.pi) < 1e-3:
        text = f"roll is {number(value)} in {samples}: upside down"
        remedy = "is the quaternion written w first? A message has it as x, y, z, w"
    rest = "" if beside else f"; if it is truly at rest, {channel} is no coordinate that moves: leave it out of dof too"
    # Where the model holds it still, a channel with a noise that is stated does no harm.
    severity = IMPOSSIBLE if moves or not stated else WARNING
    return Finding("constant", severity, text, f"{remedy}{rest}", channel, size={"value": value})


def _constant(campaign: Campaign, channel: str, about: Channel, beside: str, moves: bool) -> list[Finding]:
    """A channel that never changes, in all runs or in some; ``beside`` says why it is not at rest, if it is not, and
    ``moves`` whether the model lets it."""
    runs = [run for run in campaign.runs if channel in run.channels and len(run.samples(channel)[1]) > 2]
    if runs and all(np.ptp(_nearly_all(run.samples(channel)[1])) == 0.0 for run in runs):
        return [_dead(campaign, channel, runs, beside, moves)]
    still = [run for run in runs if np.ptp(run.samples(channel)[1]) == 0.0]
    if not still:
        return []
    value = float(still[0].samples(channel)[1][0]) + 0.0
    reason = "the sensor is dead or the column wrong"
    size = {"value": value, "runs": len(still)}
    text = (
        f"{channel} is {number(value)} in every sample of {shared([r.name for r in still])} while it moves in other"
        " runs: "
    )
    if about.step >= about.noise:  # a sensor that is well reads so too where nothing moves by as much as its step
        text += f"it is at rest there to its step of {quantity(channel, about.step)}, or the sensor is dead"
        return [
            Finding(
                "constant", WARNING, text, "leave the column out of a run where the sensor is dead", channel, size=size
            )
        ]
    rows = {run.name: np.flatnonzero(~np.isnan(run[channel])) for run in still}
    return [Finding("constant", SET_ASIDE, text + reason, "", channel, samples=as_samples(rows), size=size)]


def _flat(campaign: Campaign, channel: str, about: Channel) -> list[Finding]:
    """Stretches that repeat one value at an end of the range: there the sensor is saturated.

    A sensor's end of range is an effect of the catalogue: nothing is set aside, the diagnosis is to see it."""
    rows: dict[str, Array] = {}
    longest: tuple[int, Run | None, int] = (0, None, 0)
    for run in campaign.runs:
        for numbers in flat_stretches(run, channel, about):
            values = run.samples(channel)[1]
            if run[channel][numbers[0]] in (values.min(), values.max()):
                rows[run.name] = np.append(rows.get(run.name, numbers[:0]), numbers)
                longest = max(longest, (len(numbers), run, int(numbers[0])), key=lambda s: s[0])
    count = sum(len(r) for r in rows.values())
    length, run, at = longest
    if run is None or count < levels.SATURATED * min(about.count, 50 * levels.FLAT):
        return []
    value = float(run[channel][at])
    text = (
        f"{channel} stays at {number(value, 6)} for {length} samples from {place(run, at)}: the end of the sensor's"
        f" range; {count} such samples in all"
    )
    size = {"count": count, "share": count / about.count, "value": value}
    return [Finding("saturated", WARNING, text, "", channel, samples=as_samples(rows), size=size)]


def _clipped(campaign: Campaign, channel: str, about: Channel) -> list[Finding]:
    """An end of the range that is read again and again, although noise is larger than the readings' step: there the
    sensor is saturated, also where the cradle rests on the track."""
    if not about.step < about.noise:
        return []
    runs = [run for run in campaign.runs if channel in run.channels and run.samples(channel)[1].size]
    values, counts = np.unique(np.concatenate([run.samples(channel)[1] for run in runs]), return_counts=True)
    if len(values) < levels.FEW:
        return []
    ends = [(values[k], counts[k], counts[beside]) for k, beside in ((0, 1), (-1, -2))]
    found = [(v, n) for v, n, m in ends if n >= max(levels.FLAT, levels.PILED_UP * m)]
    if not found:
        return []
    value, count = max(found, key=lambda f: f[1])
    rows = {run.name: np.flatnonzero(run[channel] == value) for run in runs if (run[channel] == value).any()}
    beyond = "less" if value == values[0] else "more"
    text = (
        f"{channel} reads exactly {number(float(value), 6)} {int(count)} times and never {beyond}: the end of the"
        " sensor's range"
    )
    size = {"count": int(count), "share": float(count / about.count), "value": float(value)}
    return [Finding("saturated", WARNING, text, "", channel, samples=as_samples(rows), size=size)]


def _coarse(campaign: Campaign, channel: str, about: Channel) -> list[Finding]:
    """Readings in steps that are as large as the noise."""
    given = channel in campaign.noise_std
    stated = campaign.noise_std.get(channel, about.noise)
    if not about.step or about.step < levels.STEP_MATTERS * min(stated, about.scatter):
        return []
    where = f" in {shared(about.stepped)}" if about.stepped else ""
    text = f"{channel} reads in steps of {quantity(channel, about.step)}{where}"
    least = about.step / np.sqrt(12.0)
    size = {"step": about.step}
    if stated < 0.95 * least or about.noise > 1.1 * stated:
        size["noise"] = with_step(stated, about)
        than = "its noise_std says" if given else "the noise from sample to sample"
        text += f", coarser than {than}: {quantity(channel, size['noise'])} is taken"
        text += f" instead of {quantity(channel, stated)}" if given else ""
    run = about.stepped[0] if len(about.stepped) == 1 else None
    return [Finding("quantised", WARNING, text, "", channel, run, size=size)]


def with_step(stated: float, about: Channel) -> float:
    """Noise of a channel whose stated noise may leave its rounding out: what is found, within what stated noise and
    rounding can give."""
    rounding = about.step / np.sqrt(12.0)
    return float(np.clip(about.noise, max(stated, rounding), np.hypot(stated, rounding)))
