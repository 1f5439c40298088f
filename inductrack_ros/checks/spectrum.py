# SPDX-License-Identifier: Apache-2.0
"""The noise's colour and a hum, from the upper part of each channel's spectrum, where a cradle's motion has died away.

Every reading gives its deviation from the cubic through two neighbours on both sides, wherever these lie in time. The
deviations' spectrum is taken at their own times. That of white noise is known, so what the deviations make of it is
divided out: white noise comes out flat again, whether or not samples are lost and stamps uneven. The deviations hold
motion down."""

from __future__ import annotations

import numpy as np
from scipy import stats

from ..data import Campaign
from ..data.measurement import Array
from . import levels
from .finding import WARNING, Finding, number, quantity
from .noise_found import Channel

#: Samples in a stretch that is transformed at a time, the first of these that gives enough stretches; most of them, and
#: fewest for an answer.
LENGTHS, MOST, FEWEST = (256, 128, 64), 200, 8
#: Frequencies from this part of the sampling rate up are looked at: for a hum, and for colour, which motion must not
#: imitate. A cradle's motion has died away above so many Hz, and its own oscillation is no hum; what impacts leave of
#: it above the second imitates no colour. A slower hum shows in what a fit leaves.
LOWEST, NO_MOTION, QUIET, SILENT = 0.04, 0.15, 20.0, 32.0
#: Five neighbours whose span is at most so many times the usual one (no more than one sample lost) give a deviation; a
#: stretch has such for this part of its samples.
SPAN, WHOLE = 1.3, 0.4
#: A hum is at least this amplitude over the noise, and its line falls to a third of its power within so many
#: frequencies on both sides.
HUM, WIDTH = 0.4, 4
#: Correlation from sample to sample from which noise is called coloured.
CORRELATION = 0.3


def look(campaign: Campaign, channel: str, about: Channel) -> list[Finding]:
    """Findings about colour and hum of one channel."""
    found = _spectrum(campaign, channel)
    if found is None or about.noise <= 0.0 or about.step > 2.0 * about.noise:
        return []
    frequency, filtered, gains, count, step = found
    power = filtered / gains
    quiet, surely = frequency > QUIET, frequency > max(SILENT, NO_MOTION / step)
    if min(quiet.sum(), surely.sum()) < 4 * WIDTH:
        return []
    correlation, _ = _colour(frequency[quiet] * step, power[quiet], count)
    _, gain = _colour(frequency[surely] * step, power[surely], count)  # where motion cannot imitate it
    if line := _line(frequency, power / _shape(correlation, frequency * step), gains, count):
        at, amplitude = line
        if amplitude > HUM:
            at_line = _shape(correlation, np.array([at * step]))[0] * np.median(
                power[quiet] / _shape(correlation, frequency[quiet] * step)
            )
            amplitude *= float(np.sqrt(at_line))
            text = f"{channel} hums at {number(at)} Hz, amplitude {quantity(channel, amplitude)}"
            return [Finding("hum", WARNING, text, "", channel, size={"frequency": at, "amplitude": amplitude})]
    if correlation > CORRELATION and gain > levels.sigmas(1) ** 2:
        if stated := campaign.noise_std.get(channel):
            correlation = _with_size(frequency[quiet] * step, power[quiet], count, stated, correlation)
        time = -step / np.log(correlation)
        text = (
            f"the noise of {channel} is coloured: it forgets itself in {number(1e3 * time, 2)} ms, samples are"
            f" {number(1e3 * step, 2)} ms apart"
        )
        return [Finding("coloured_noise", WARNING, text, "", channel, size={"correlation_time": float(time)})]
    return []


def _spectrum(campaign: Campaign, channel: str) -> tuple[Array, Array, Array, int, float] | None:
    """Frequencies (Hz), median power at them of the deviations, what white noise of variance 1 would give, stretches
    taken, and their usual step (s)."""
    runs = [_read(run.times, run[channel]) for run in campaign.runs if channel in run.channels and len(run.times) > 40]
    runs = [(t, y) for t, y in runs if len(t) > 40]
    if not runs:
        return None
    step = float(np.median([np.median(np.diff(t)) for t, _ in runs]))
    for length in LENGTHS:
        parts = [part for t, y in runs for part in _stretches(t, y, step, length)]
        if len(parts) >= FEWEST:
            break
    else:
        return None
    chosen = [parts[i] for i in np.unique(np.linspace(0, len(parts) - 1, MOST).astype(int))]
    cycles = np.fft.rfftfreq(length - 4)
    cycles = cycles[cycles > LOWEST]
    found = [_powers(t, y, step, 2 * np.pi * cycles / step) for t, y in chosen]
    power, gain = np.median([f[0] / f[1] for f in found], axis=0), np.median([f[1] for f in found], axis=0)
    return cycles / step, power * gain / np.log(2.0), gain, len(chosen), step


def _read(times: Array, values: Array) -> tuple[Array, Array]:
    """Times (m,) and readings (m,) without what was not read."""
    known = ~np.isnan(values)
    return times[known], values[known]


def _stretches(times: Array, values: Array, step: float, length: int) -> list[tuple[Array, Array]]:
    """Stretches of ``length`` readings, most with their neighbours near by, each overlapping the next by half."""
    near = times[4:] - times[:-4] < SPAN * 4.0 * step
    starts = range(0, len(times) + 1 - length, length // 2)
    return [
        (times[k : k + length], values[k : k + length])
        for k in starts
        if near[k : k + length - 4].mean() > WHOLE and times[k + length - 1] - times[k] < 2.0 * length * step
    ]


def _powers(times: Array, values: Array, step: float, omega: Array) -> tuple[Array, Array]:
    """Power (f,) of a stretch's deviations at ``omega`` (rad/s), and that of white noise of variance 1."""
    around = np.lib.stride_tricks.sliding_window_view(times, 5)
    weights = _deviation(around)
    taper = np.hanning(len(weights) + 2)[1:-1] * (around[:, 4] - around[:, 0] < SPAN * 4.0 * step)
    weights *= taper[:, None]
    deviations = np.sum(weights * np.lib.stride_tricks.sliding_window_view(values, 5), axis=1)
    turning = np.exp(-1j * np.outer(omega, around[:, 2]))
    of_each = np.zeros((len(omega), len(times)), complex)  # what a unit of each reading does to the sum
    for j in range(5):
        of_each[:, j : j + len(weights)] += turning * weights[:, j]
    total = np.sum(taper**2)
    return np.abs(turning @ deviations) ** 2 / total, np.sum(np.abs(of_each) ** 2, axis=1) / total


def _deviation(times: Array) -> Array:
    """Weights (n, 5) of five readings at ``times`` (n, 5). They sum to how far the third lies off the cubic through the
    other four. At even steps they are (1, −4, 6, −4, 1)/6."""
    t = times - times[:, 2:3]
    weights = np.zeros(t.shape)
    weights[:, 2] = 1.0
    for j in (0, 1, 3, 4):
        others = [m for m in (0, 1, 3, 4) if m != j]
        weights[:, j] = -np.prod([t[:, m] / (t[:, m] - t[:, j]) for m in others], axis=0)
    return weights


def _shape(correlation: float, cycles: Array) -> Array:
    """Spectrum of first-order noise at ``cycles`` per sample, up to its size."""
    return 1.0 / (1 - 2 * correlation * np.cos(2 * np.pi * cycles) + correlation**2)


def _colour(cycles: Array, power: Array, count: int) -> tuple[float, float]:
    """Correlation from sample to sample of the first-order noise nearest to the spectrum, and how much likelier it is
    than white noise (log)."""
    trials = np.linspace(0.0, 0.97, 98)
    ratio = power / np.stack([_shape(r, cycles) for r in trials])
    # Whittle, the size profiled out.
    misfit = len(power) * np.log(ratio.mean(axis=1)) + np.log(power / ratio).sum(axis=1)
    best = int(np.argmin(misfit))
    # stretches overlap and a median keeps two thirds of the mean's information: about a third of the count
    return float(trials[best]), float(count / 3.0 * (misfit[0] - misfit[best]))


def _with_size(cycles: Array, power: Array, count: int, stated: float, free: float) -> float:
    """The correlation with which first-order noise of the stated size has this spectrum, if it fits about as well as
    noise of any size; else ``free``. Of a long memory the spectrum above the motion shows the size of the steps only.
    """
    trials = np.linspace(0.01, 0.995, 198)
    models = np.stack([stated**2 * (1 - r**2) * _shape(r, cycles) for r in trials])
    misfits = (np.log(models) + power / models).sum(axis=1)
    shape = _shape(free, cycles)
    best = len(power) * (1.0 + np.log((power / shape).mean())) + np.log(shape).sum()
    k = int(np.argmin(misfits))
    return float(trials[k]) if count / 3.0 * (misfits[k] - best) < 0.5 * levels.sigmas(1) ** 2 else free


def _line(frequency: Array, power: Array, gains: Array, count: int) -> tuple[float, float] | None:
    """Frequency (Hz) of the strongest line in an otherwise flat spectrum and its amplitude over the noise; None where
    chance gives as much."""
    flat = np.median(power)
    sought = np.where(frequency > QUIET, power, 0.0)[WIDTH:-WIDTH]  # below, a cradle's own oscillation is a line too
    peak = int(np.argmax(sought)) + WIDTH if len(power) > 4 * WIDTH else 0
    near = slice(peak - WIDTH, peak + WIDTH + 1)
    # The power of noise is exponential; of a median of so many, the share that is below it is a beta variable.
    middle = (count + 1) / 2.0
    share = stats.beta.isf(stats.norm.sf(levels.sigmas(len(power))), middle, middle)
    if not peak or power[peak] < flat * -np.log1p(-share) / np.log(2.0):
        return None
    if power[near][0] > power[peak] / 3.0 or power[near][-1] > power[peak] / 3.0:
        return None
    line = np.maximum(power[near] - flat, 0.0) * gains[near]  # as it was filtered: there the window's shape is even
    at = float(line @ frequency[near] / line.sum())
    # Parseval: a line of amplitude a adds a²/4 for each sample of the window; a flat median stands ln 2 off a line's
    #     full power
    transformed = len(power) / (0.5 - LOWEST)
    return at, float(np.sqrt(4.0 * np.log(2.0) * line.sum() / np.interp(at, frequency, gains) / flat / transformed))
