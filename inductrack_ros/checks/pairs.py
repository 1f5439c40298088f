# SPDX-License-Identifier: Apache-2.0
"""Channels that are each other's derivative: a rate and its coordinate, an acceleration and either.

Not derivatives but increments are compared, of the coordinate and of the rate's integral over the same stretch, so that
noise is not blown up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import signal

from ..core.state import ACCELERATIONS, COORDINATES, RATES, UNITS
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .apart import of_some
from .finding import IMPOSSIBLE, WARNING, Finding, number
from .late import Pair, late, one_delay
from .noise import meant
from .noise_found import Channel

#: Samples of each run that are looked at, and how many of them an increment spans: the span whose increments correlate
#: best is taken.
MOST, SPANS = 60_000, (1, 2, 4, 8, 16, 32)
#: Increments that an answer needs.
FEWEST = 20
#: Increments whose mean is so many times their scatter are a steady motion: their means are compared.
STEADY = 3.0
#: A delay is said from this part of a step between samples on, and where it is this many standard deviations.
DELAY, SURE = 0.5, 6.0
#: Increments that stand so many times over their noise and correlate by less than this have nothing in common.
CLEAR, STRANGE = 8.0, 0.5
#: Channels further apart than this many steps, alike once they are shifted to this correlation and not to the second
#: before, have two clocks.
FAR, SHIFTED, UNSHIFTED = 10, 0.95, 0.7


def pairs(campaign: Campaign, calm: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings about rates and accelerations that are not the derivative of their coordinate, in all runs or in some;
    of impacts, which are not in ``calm``, an accelerometer's samples see too little."""
    calm_runs = {run.name: run for run in calm.runs}

    def alone(one: Campaign) -> list[Finding]:
        return _pairs(one, replace(one, runs=tuple(calm_runs[run.name] for run in one.runs)), channels)

    return of_some(
        campaign,
        _pairs(campaign, calm, channels),
        alone,
        telling=lambda f: f.severity == IMPOSSIBLE or f.kind == "unit",
    )


def _pairs(campaign: Campaign, calm: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """Findings that runs share. An acceleration that jumps with every pulse is not told by its samples."""
    unpulsed = replace(calm, runs=tuple(run for run in calm.runs if not run.pulsed))
    rates: dict[Pair, list[Finding]] = {}
    accelerations: dict[Pair, list[Finding]] = {}
    for k, coordinate in enumerate(COORDINATES):
        rate, acceleration = RATES[k], ACCELERATIONS[k]
        if coordinate == "heave" and coordinate not in channels:
            coordinate = "gap_top"  # grows with the heave, and with nothing else
        if {coordinate, rate} <= channels.keys():
            found = _pair(campaign, coordinate, rate, 1) or _foreign(campaign, channels, coordinate, rate)
            rates[coordinate, rate, 1] = found
        told = unpulsed if coordinate == "surge" else calm
        if {rate, acceleration} <= channels.keys():
            accelerations[rate, acceleration, 1] = _pair(told, rate, acceleration, 1)
        elif {coordinate, acceleration} <= channels.keys() and told.runs:
            found = _pair(told, coordinate, acceleration, 2)
            found = found or _foreign(told, channels, coordinate, acceleration, 2)
            accelerations[coordinate, acceleration, 2] = found
    of_rates, delay = _of_one_sensor(campaign, channels, rates)
    of_accelerations, later = _of_one_sensor(unpulsed, channels, accelerations)
    if delay and later and abs(delay + later) < 0.1 * abs(delay):  # the accelerometer is on time
        of_accelerations = []
    return of_rates + of_accelerations


def _of_one_sensor(
    campaign: Campaign, channels: Mapping[str, Channel], found: Mapping[Pair, list[Finding]]
) -> tuple[list[Finding], float]:
    """The findings about a sensor's channels, or the one delay that all of them have; and that (s), 0 for none."""
    findings = [f for mine in found.values() for f in mine]
    step = float(np.median([np.median(np.diff(r.times)) for r in campaign.runs if len(r.times) > 1] or [0.0]))
    delay = one_delay(list(campaign.runs), channels, list(found)) if findings else None
    if delay is None or abs(delay) <= FAR * step:
        return findings, 0.0
    return [late(delay, list(found))], delay


def _pair(campaign: Campaign, whole: str, derivative: str, order: int) -> list[Finding]:
    """Findings about a channel and its ``order``-th derivative."""
    runs = [r for r in campaign.runs if whole in r.channels and derivative in r.channels]
    tried = [found for span in SPANS if (found := _increments(runs, whole, derivative, order, span)) is not None]
    if not tried:
        return []
    a, b, late = max(tried, key=lambda f: abs(_correlation(f[0], f[1])))
    correlation = _correlation(a, b)
    if abs(correlation) < levels.ALIKE:
        shift = _shift(runs, whole, derivative, order)
        if shift is None:
            return []
        text = (
            f"{derivative} and {whole} are {number(1e3 * abs(shift))} ms apart: the"
            f" {'latter' if shift > 0 else 'former'} comes later"
        )
        step = float(np.median([np.median(np.diff(r.times)) for r in runs]))
        severity = IMPOSSIBLE if abs(shift) > FAR * step else WARNING
        return [
            Finding(
                "offset", severity, text, "stamp both with one clock", derivative, size={"offset": shift, "of": whole}
            )
        ]
    size_of = np.mean if all(abs(y.mean()) > STEADY * y.std() for y in (a, b)) else np.std
    slope = float(abs(size_of(a) / size_of(b)) * np.sign(correlation))
    size = {"slope": slope, "of": whole}
    what = "derivative" if order == 1 else "second derivative"
    if slope < 0:
        text = f"{derivative} runs against {whole}: its sign is not that of the {what}"
        return [
            Finding("sign", IMPOSSIBLE, text, f"flip the sign of {derivative}, or of {whole}", derivative, size=size)
        ]
    if not 1 / levels.SCALE < slope < levels.SCALE:
        hint = _in_unit(whole, derivative, 1 / slope)
        text = f"{derivative} is {number(1 / slope)} times the {what} of {whole}"
        remedy = (
            f"all channels are in SI units; is {hint}?"
            if hint
            else "all channels are in SI units; convert one of the two"
        )
        exactly = _in_unit(whole, derivative, 1 / slope, levels.EXACTLY)  # no sensor's scale is off by just that
        severity = WARNING if 1 / levels.UNIT < slope < levels.UNIT and not exactly else IMPOSSIBLE
        return [Finding("unit", severity, text, remedy, derivative, size=size)]
    return _late(runs, whole, derivative, (a, b, late)) if order == 1 else []


def _in_unit(whole: str, derivative: str, ratio: float, near_to: float = levels.NEAR) -> str:
    """Which of the two is in which unit where the derivative is ``ratio`` times as large as it should be, to the factor
    ``near_to``; empty for none."""
    if hint := meant(ratio, UNITS[derivative], near_to):
        return f"{derivative} in {hint} instead of {UNITS[derivative]}"
    if hint := meant(1 / ratio, UNITS[whole], near_to):
        return f"{whole} in {hint} instead of {UNITS[whole]}"
    return ""


def _foreign(
    campaign: Campaign, channels: Mapping[str, Channel], coordinate: str, rate: str, order: int = 1
) -> list[Finding]:
    """A rate that has nothing in common with its coordinate, though both stand clear of their noise: perhaps another's
    rate. The same of an acceleration, ``order`` 2, of which vibration that no pose shows is no fault."""
    runs = [r for r in campaign.runs if coordinate in r.channels and rate in r.channels]
    if not runs:  # each is measured in runs of its own
        return []
    step = float(np.median([np.median(np.diff(r.times)) for r in runs]))
    best, clear = 0.0, False
    for span in SPANS:
        found = _increments(runs, coordinate, rate, order, span)
        if found is not None:
            best = max(best, abs(_correlation(found[0], found[1])))
            noise = np.array([channels[coordinate].noise, channels[rate].noise * step * np.sqrt(span)]) * np.sqrt(2.0)
            noise *= 1.0 if order == 1 else (np.sqrt(3.0), step * span)
            clear |= all(y.std() > CLEAR * n for y, n in zip(found[:2], noise, strict=True))
    if best > STRANGE or not clear:
        return []
    text, size = (
        f"{rate} is not the {'second ' * (order - 1)}derivative of {coordinate}: they have nothing in common",
        {"correlation": best, "whole": coordinate},
    )
    for other in (r for r in (RATES if order == 1 else ACCELERATIONS) if r != rate and r in channels):
        tried = [
            _increments([r for r in runs if other in r.channels], coordinate, other, order, span) for span in SPANS
        ]
        if any(found is not None and _correlation(found[0], found[1]) > levels.ALIKE for found in tried):
            remedy = f"{other} is: exchange the two columns"
            size |= {"candidates": [rate, other]}
            return [Finding("axis_flipped", IMPOSSIBLE, text, remedy, rate, size=size)]
    if order > 1:
        return []
    return [Finding("unlike", WARNING, text, "look at both channels, or leave one out", rate, size=size)]


def _increments(
    runs: list[Run], whole: str, derivative: str, order: int, span: int
) -> tuple[Array, Array, Array] | None:
    """Increments over ``span`` samples: of the channel, of its derivative's integral, of the derivative; second
    differences for order 2."""
    parts = []
    for run in runs:
        rows = np.flatnonzero(~np.isnan(run[whole]) & ~np.isnan(run[derivative]))[:MOST]
        if len(rows) < 2 * order * span + 2:
            continue
        t, x, v = run.times[rows], run[whole][rows], run[derivative][rows]
        integral = v
        for _ in range(order):
            integral = np.concatenate([[0.0], np.cumsum(0.5 * (integral[1:] + integral[:-1]) * np.diff(t))])
        width = t[span:] - t[:-span]
        even = width < 1.5 * np.median(width)  # nothing across a hole, where the integral is anyone's guess
        d = [(y[span:] - y[:-span]) for y in (x, integral, v)]
        if order == 2:
            even = even[span:] & even[:-span] & (np.abs(width[span:] - width[:-span]) < 0.02 * width[span:])
            d = [y[span:] - y[:-span] for y in d]
        parts.append(np.stack(d)[:, even][:, :: max(span // 2, 1)])
    table = np.concatenate(parts, axis=1) if parts else np.empty((3, 0))
    if table.shape[1] < FEWEST:
        return None
    # Impacts, of which samples see too little, and what else is rare are left out.
    size = np.abs(table[:2] - np.median(table[:2], axis=1, keepdims=True))
    kept = (size <= 20 * np.quantile(size, 0.8, axis=1, keepdims=True) + 1e-300).all(axis=0) & np.isfinite(table).all(
        axis=0
    )
    return tuple(table[:, kept]) if kept.sum() >= FEWEST else None


def _correlation(a: Array, b: Array) -> float:
    """Correlation of increments: about their means, or about zero where both are nearly steady."""
    if len(a) and all(abs(y.mean()) > STEADY * y.std() > 0.0 for y in (a, b)):
        return float(np.sign(a.mean() * b.mean()))
    with np.errstate(invalid="ignore", divide="ignore"):
        central = float(np.mean((a - a.mean()) * (b - b.mean())) / (a.std() * b.std())) if len(a) else 0.0
    return central if np.isfinite(central) else 0.0


def _late(runs: list[Run], whole: str, derivative: str, increments: tuple[Array, Array, Array]) -> list[Finding]:
    """A small delay between the two: what is left of the increments follows the derivative's own."""
    a, b, late = increments
    basis = np.stack([b, late], axis=1) - np.array([b.mean(), late.mean()])
    answer, rest, rank, _ = np.linalg.lstsq(basis, a - a.mean(), rcond=None)
    if rank < 2 or not len(rest):
        return []
    covariance = np.linalg.inv(basis.T @ basis) * float(rest[0]) / (len(a) - 3)
    delay = float(answer[1])
    step = float(np.median([np.median(np.diff(r.times)) for r in runs]))
    if abs(delay) < DELAY * step or abs(delay) < SURE * np.sqrt(covariance[1, 1]):
        return []
    text = f"{derivative} is {number(1e3 * abs(delay))} ms {'later' if delay > 0 else 'earlier'} than {whole}"
    return [Finding("offset", WARNING, text, "", derivative, size={"offset": delay, "whole": whole})]


def _shift(runs: list[Run], whole: str, derivative: str, order: int) -> float | None:
    """Seconds by which the channel comes after its derivative says so, where that makes them alike; None where nothing
    does."""
    best: list[tuple[float, float]] = []
    for run in runs:
        rows = np.flatnonzero(~np.isnan(run[whole]) & ~np.isnan(run[derivative]))[:MOST]
        if len(rows) < 8 * FEWEST:
            continue
        t = np.linspace(run.times[rows[0]], run.times[rows[-1]], len(rows))
        x, v = (np.interp(t, run.times[rows], run[c][rows]) for c in (whole, derivative))
        for _ in range(order):
            v = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            return None
        x, v = signal.detrend(x), signal.detrend(v)
        product = signal.correlate(x, v, method="fft")
        lags = signal.correlation_lags(len(x), len(v))
        near = np.abs(lags) < len(x) // 4
        overlap = 1.0 - np.abs(lags) / len(x)
        alike = product / (np.std(x) * np.std(v) * len(x) * overlap + 1e-300)
        k = int(np.argmax(np.where(near, alike, -np.inf)))
        best.append((float(alike[k]), float(lags[k] * (t[1] - t[0])), float(alike[len(x) - 1])))
    if not best or min(b[0] for b in best) < SHIFTED or max(b[2] for b in best) > UNSHIFTED:
        return None
    shifts = [b[1] for b in best]
    return float(np.median(shifts)) if np.ptp(shifts) < 0.2 * abs(np.median(shifts)) else None
