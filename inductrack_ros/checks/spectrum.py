# SPDX-License-Identifier: Apache-2.0
"""The noise's colour and a hum, from the upper part of each channel's spectrum, where a cradle's motion has died away.

Every stretch with even steps gives its deviations from the neighbours' cubics. Their spectrum is that of the channel
times a known filter, (2 − 2 cos ω)⁴/36/(70/36). The filter holds motion down. White noise comes out flat again once the
filter is divided out."""

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
#: imitate. A cradle's motion has died away above so many Hz; what impacts leave of it above the second imitates no
#: colour.
LOWEST, NO_MOTION, QUIET, SILENT = 0.04, 0.15, 20.0, 32.0
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
    """Frequencies (Hz), median power at them of the deviations, the filter's power gain there, stretches taken, and
    their step (s).

    Power over gain is the variance of white noise that has as much.
    """
    runs = [(run.times, run[channel]) for run in campaign.runs if channel in run.channels and len(run.times) > 40]
    if not runs:
        return None
    step = float(np.median([np.median(np.diff(t)) for t, _ in runs]))
    for length in LENGTHS:
        parts = [part for t, y in runs for part in _even(t, y, step, length)]
        if len(parts) >= FEWEST:
            break
    else:
        return None
    chosen = [parts[i] for i in np.unique(np.linspace(0, len(parts) - 1, MOST).astype(int))]
    bend = np.stack([np.convolve(y, np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0, "valid") for y in chosen])
    window = np.hanning(bend.shape[1] + 2)[1:-1]
    omega = 2 * np.pi * np.fft.rfftfreq(bend.shape[1])
    power = np.abs(np.fft.rfft(bend * window, axis=1)) ** 2 / np.sum(window**2)
    keep = omega > 2 * np.pi * LOWEST
    gain = ((2 - 2 * np.cos(omega[keep])) ** 2 / 6.0) ** 2
    return omega[keep] / (2 * np.pi * step), np.median(power[:, keep], axis=0) / np.log(2.0), gain, len(chosen), step


def _even(times: Array, values: Array, step: float, length: int) -> list[Array]:
    """Stretches of ``length`` samples with even steps and nothing missing, each overlapping the next by half."""
    good = np.abs(np.diff(times) - step) < 0.02 * step
    good &= ~np.isnan(values[1:]) & ~np.isnan(values[:-1])
    edges = np.flatnonzero(np.diff(np.concatenate([[0], good.astype(np.int8), [0]])))
    found = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        found += [values[k : k + length] for k in range(first, end + 2 - length, length // 2)]
    return found


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
    peak = int(np.argmax(power[WIDTH:-WIDTH])) + WIDTH if len(power) > 4 * WIDTH else 0
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
