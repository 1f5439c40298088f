# SPDX-License-Identifier: Apache-2.0
"""The whole look: every kind of finding about a campaign, and the campaign without what they set aside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..core.errors import InputError
from ..core.model import Model
from ..core.state import ACCELERATIONS, COORDINATES, RATES
from ..data import Campaign, Run
from . import levels
from .clocks import clocks
from .computed import computed
from .copies import copies
from .drive import lost_pulses
from .excitation import excitation, held_still, too_few
from .filled import filled
from .finding import SET_ASIDE, Finding, impossible, worst_first
from .hangs import hangs
from .holds import held
from .interleaved import interleaved
from .jitter import jitter
from .jumps import jumps, wraps
from .measured_current import measured_current
from .noise import noises
from .noise_apart import noises_apart
from .noise_found import Channel, channels_of
from .outliers import fillers, outliers
from .pairs import pairs
from .readings import readings
from .repeats import repeats
from .resampled import resampled
from .rest import rest
from .sensors import sensors
from .stated import stated
from .touch import Touch
from .turned import half_turns

#: Coordinates along the axes of the frame.
_AXES = COORDINATES[:3]


@np.errstate(all="ignore")  # what overflows or divides by nothing here is no number that anything is concluded from
def look(campaign: Campaign, model: Model | None = None) -> tuple[Finding, ...]:
    """Every finding about a campaign, worst first. Linear in the samples; no fit.

    With a model its geometry and forces tell units and signs that the channels alone do not. What is set aside by one
    look the later ones do not see."""
    touch = None if model is None else Touch.of(model)
    found = clocks(campaign)
    campaign = set_aside(campaign, found)
    found += (undriven := lost_pulses(campaign))
    campaign = set_aside(campaign, undriven)
    found += (before := [] if wraps(campaign) else rest(campaign, touch))  # a travel that begins again comes to no rest
    campaign = set_aside(campaign, before)
    found += (again := repeats(campaign))
    campaign = set_aside(campaign, again)
    found += (fill := fillers(campaign, touch))
    campaign = set_aside(campaign, fill)
    found += (stuck := held(campaign))
    campaign = set_aside(campaign, stuck)
    found += (between := resampled(campaign))
    campaign = set_aside(campaign, between)
    channels = channels_of(campaign)
    found += (twice := copies(campaign, channels))
    campaign = set_aside(campaign, twice)
    if torn := interleaved(campaign, channels) + wraps(campaign):
        return worst_first(_causes_only(found + torn))
    found += (hung := hangs(campaign, campaign if touch is None else touch.calm(campaign), channels))
    campaign = set_aside(campaign, hung)
    found += (lines := filled(campaign, channels))
    campaign = set_aside(campaign, lines)
    off = outliers(campaign, channels, touch)
    jumped = jumps(campaign, channels, off)
    named = {f.channel for f in jumped}
    found += (off := jumped + [f for f in off if f.channel not in named])
    campaign = set_aside(campaign, off)
    calm = campaign if touch is None else touch.calm(campaign)
    found += (flat := sensors(campaign, calm, channels, model))
    campaign, calm = set_aside(campaign, flat), set_aside(calm, flat)
    found += computed(campaign, channels) + too_few(campaign, model) + (kept := held_still(campaign, channels, model))
    found += noises(calm, channels) + noises_apart(calm) + jitter(campaign, channels)
    found += measured_current(campaign)
    found += stated(campaign, channels, model) + pairs(campaign, calm, channels) + excitation(campaign, channels)
    if model is not None and not any(
        f.kind in ("clock_jump", "hole", "time_unit", "value_jump", "batches") for f in impossible(found)
    ):
        still = {c for f in kept for c in f.size["channels"]}
        found += _readings(campaign, channels, model, still | {f.channel for f in flat if f.kind == "constant"})
    return worst_first(_causes_only(found))


def _readings(
    campaign: Campaign, channels: Mapping[str, Channel], model: Model, dead: set[str | None]
) -> list[Finding]:
    """What the model's motion says of the channels but for dead ones, and those it holds still; what moves without them
    is nobody's fault."""
    if not dead:
        return readings(campaign, channels, model)
    runs = tuple(_blanked(run, dead) for run in campaign.runs)
    alive = {c: about for c, about in channels.items() if c not in dead}
    return [f for f in readings(replace(campaign, runs=runs), alive, model) if f.kind != "unlike"]


def _blanked(run: Run, channels: set[str | None]) -> Run:
    """The run as if some channels had not been measured."""
    values = run.values.copy()
    values[:, [c in channels for c in run.channels]] = np.nan
    return replace(run, values=values)


def set_aside(campaign: Campaign, findings: list[Finding] | tuple[Finding, ...]) -> Campaign:
    """The campaign without the samples and runs that the findings leave out, and with the noise that coarse readings
    have."""
    left_out = [f for f in findings if f.severity == SET_ASIDE]
    gone = {f.run for f in left_out if f.run and not f.samples}
    runs = tuple(_without(run, left_out) for run in campaign.runs if run.name not in gone)
    steps = {f.channel: f.size for f in findings if f.kind == "quantised" and f.channel}
    stated = {c: size["noise"] for c, size in steps.items() if "noise" in size and c in campaign.noise_std}
    rounding = {c: float(size["step"] / np.sqrt(12.0)) for c, size in steps.items()}
    return replace(
        campaign, runs=runs, noise_std={**campaign.noise_std, **stated}, rounding={**campaign.rounding, **rounding}
    )


def admit(campaign: Campaign, model: Model) -> tuple[Campaign, tuple[Finding, ...]]:
    """The campaign as it may be held against a model, and all findings. Raises `InputError` where the data cannot be
    meant as they are written."""
    findings = look(campaign, model)
    if wrong := impossible(findings):
        more = (
            f" ({len(wrong) - 1} more: `inductrack check {campaign.folder} --output DIR` shows all)"
            if len(wrong) > 1
            else ""
        )
        raise InputError(f"{campaign.folder}: {wrong[0].line}{more}")
    return set_aside(campaign, findings), findings


def _without(run: Run, findings: list[Finding]) -> Run:
    """A run without what findings leave out of it: cells where they name a channel, else whole samples. A channel of
    which nothing is left is left out itself."""
    mine = [f for f in findings if run.name in f.samples]
    if not mine:
        return run
    values = run.values.copy()
    kept = np.ones(len(run.times), bool)
    for finding in mine:
        rows = list(finding.samples[run.name])
        if finding.channel is None:
            kept[rows] = False
        elif finding.channel in run.channels:
            values[rows, run.channels.index(finding.channel)] = np.nan
    emptied = run.measured.any(axis=0) & np.isnan(values[kept]).all(axis=0)
    held = ~emptied
    start = run.times[kept][0]
    pulses = run.pulses and replace(run.pulses, times=run.pulses.times - start)
    inputs = {name: (times - start, readings) for name, (times, readings) in run.inputs.items()}
    samples = {"values": values[kept][:, held], "times": run.times[kept] - start, "stamps": run.stamps[kept]}
    numbers = None if run.numbers is None else run.numbers[kept]
    channels = tuple(c for c, stays in zip(run.channels, held, strict=True) if stays)
    return replace(run, channels=channels, **samples, numbers=numbers, pulses=pulses, inputs=inputs)


def _causes_only(findings: list[Finding]) -> list[Finding]:
    """Without findings that another one explains: a wrong unit makes the noise differ and the rates not fit."""
    units = {f.channel for f in findings if f.kind in ("unit", "zero") and "slope" not in f.size}
    rates = {f.channel for f in impossible(findings) if f.kind == "unit"}
    flipped = {c for f in findings if f.kind in ("axis_flipped", "zero") for c in f.size.get("candidates", ())}
    flipped |= {rate for c, rate in zip(COORDINATES, RATES, strict=True) if c in flipped}
    turned = any(f.kind == "turned" or len({*_AXES} & {*f.size.get("candidates", ())}) > 1 for f in findings)
    inverted = any(
        f.channel == "roll" and abs(abs(f.size.get("value", 0.0)) - np.pi) < levels.UPRIGHT for f in findings
    )
    in_g = bool(rates & {*ACCELERATIONS})
    time = any(f.kind == "time_unit" for f in findings)
    jumped = {f.channel for f in findings if f.kind == "value_jump"}
    apart = {f.channel for f in impossible(findings) if "runs" in f.size}
    late = any(f.kind == "time_jitter" for f in findings)
    sums = {f.channel for f in findings if f.kind == "computed"}
    flips = [f for f in findings if f.kind == "axis_flipped" and "candidates" in f.size]
    swapped = {(run, *sorted(f.size["candidates"])) for f in flips for run in f.size.get("runs", ())}
    kept = []
    for f in findings:
        whole = f.size.get("of", f.channel)
        by_noise = f in flips and "runs" not in f.size
        explained = (
            (
                f.kind == "noise_differs"
                and (f.channel in units | rates | apart or (late and f.channel == "surge" and f.size["ratio"] > 1))
            )
            or (f.kind == "unit" and "slope" in f.size and (time or whole in units or f.channel in units))
            or (f.kind == "sign" and whole in flipped)
            or (by_noise and (f.run, *sorted(f.size["candidates"])) in swapped)
            or (f.kind == "zero" and f.channel in ACCELERATIONS and (in_g or inverted))
            or (turned and (f.kind == "time_jitter" or f.channel in RATES))
            or (f.kind in ("offset", "hum", "coloured_noise") and (time or whole in units or f.channel in jumped))
            or (f.kind in ("offset", "hum", "coloured_noise", "noise_differs") and f.channel in sums)
        )
        if not explained:
            kept.append(f)
    return half_turns(kept)
