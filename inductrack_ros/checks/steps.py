# SPDX-License-Identifier: Apache-2.0
"""The step that readings are whole multiples of: of a converter, an encoder, or the digits that a file writes."""

from __future__ import annotations

import numpy as np

from ..data.measurement import Array

#: Fewer different readings than this show no step, unless each occurs so many times.
FEWEST_READINGS, OFTEN = 4, 10
#: Readings are whole steps where all but this part of them are, to this part of a step.
EXCEPTIONS, ROUNDED = 0.01, 0.02
#: Readings of one step differ by the last bits of a conversion, by less than this part of it.
SAME = 1e-6
#: Of more steps than these `on_grid`, which allows for the last bits of a conversion, would take any for a grid.
MOST_STEPS = 2.5e5
#: Differences of which a common divisor is sought at a time, and how often: of so many one in four has an exception
#: among them, hardly ever all. Fewer different readings than the last would have one by chance.
TOGETHER, TIMES, FEWEST = 32, 6, 12
#: Digits that a file is written with, at most, where their number is told; a step that so large a part of the readings
#: has is one of the channel.
DIGITS, LARGE = 6, 0.05


def step_of(readings: Array, least: float = np.inf) -> float:
    """What readings (n,) are whole multiples of, from the differences between those that occur; 0 where no step shows.

    The digits that a file writes are a step too; whether it matters its size beside the noise says. Where the channel
    moves by many steps between two samples few readings are one step apart: steps of ``least`` and more are found
    there too. Of readings that are written with so many digits, whatever their size, it is the step of the largest.
    """
    return max(_step_of(readings, least), _of_digits(readings))


def _of_digits(readings: Array) -> float:
    """The step of the largest readings, where all have few significant digits (as `%.5g` writes them); 0 where not."""
    sizes = np.abs(readings[readings != 0.0])
    if len(np.unique(sizes)) < FEWEST:
        return 0.0
    power = np.floor(np.log10(sizes) + SAME)
    for digits in range(1, DIGITS + 1):
        steps = 10.0 ** (power - digits + 1)
        whole = sizes / steps
        if np.mean(np.abs(whole - np.rint(whole)) > SAME * whole) <= EXCEPTIONS:
            return float(np.quantile(steps, 1.0 - LARGE, method="lower")) if np.ptp(power) > 0.0 else 0.0
    return 0.0


def _step_of(readings: Array, least: float) -> float:
    """The one step of all readings; 0 where there is none."""
    different = np.unique(readings)
    if len(different) < 2 or (len(different) < FEWEST_READINGS and len(readings) < OFTEN * len(different)):
        return 0.0
    apart = np.diff(different)
    small = apart[apart > 1e-9 * np.abs(different).max()]
    if not len(small):
        return 0.0
    step = float(np.quantile(small, EXCEPTIONS))
    step = _sharpened(readings, different, float(np.median(small[small < 1.5 * step])))
    if on_grid(readings, step):
        return 0.0 if _even_motion(readings, step) else step
    return _divisor(readings, different, small, max(least, float(np.ptp(different)) / MOST_STEPS))


def on_grid(readings: Array, step: float) -> bool:
    """Whether readings are whole steps apart, all but a few of them."""
    steps = (readings - np.median(readings[: 2 * ((len(readings) - 1) // 2) + 1])) / step
    off = np.abs(steps - np.rint(steps)) > ROUNDED + 1e-6 * np.abs(steps)
    return bool(np.mean(off) <= EXCEPTIONS)


def _makes(different: Array, step: float) -> bool:
    """Whether it is rounding that brings readings on a grid: each of its points is one reading, not many that are near
    each other."""
    points = len(np.unique(np.rint((different - different[0]) / step)))
    values = 1 + int(np.sum(np.diff(different) > SAME * step))
    return points >= (1.0 - EXCEPTIONS) * values


def _even_motion(readings: Array, step: float) -> bool:
    """Whether the step is what an even motion covers from one reading to the next, to its noise."""
    moved = np.diff(readings) / step
    even = max(float(np.mean(np.rint(moved) == 1.0)), float(np.mean(np.rint(moved) == -1.0)))
    return even > 0.5 and float(np.median(np.abs(moved - np.rint(moved)))) > ROUNDED**2


def _sharpened(readings: Array, different: Array, step: float) -> float:
    """A step from near readings counts those a little further off, and is sharpened by them."""
    away = readings - different[len(different) // 2]
    for reach in (30.0, 1e3, 3e4):
        near = away[np.abs(away) < reach * step]
        steps = np.rint(near / step)
        step = float(steps @ near / (steps @ steps)) if steps.any() else step
    return step


def _divisor(readings: Array, different: Array, apart: Array, least: float) -> float:
    """The largest step of ``least`` or more of which all differences ``apart`` are multiples; 0 where there is none."""
    if len(different) < FEWEST or not np.isfinite(least) or least <= 0.0:
        return 0.0
    found = 0.0
    for part in np.array_split(apart, min(TIMES, -(-len(apart) // TOGETHER))):
        step = float(part[0])
        for difference in part[1:TOGETHER].tolist():
            step = _common(step, difference, 0.5 * least)
        step = _sharpened(readings, different, step)
        if step > max(least, found) and on_grid(readings, step) and _makes(different, step):
            found = step
    return found


def _common(a: float, b: float, nothing: float) -> float:
    """Euclid's common divisor of two differences; what is smaller than ``nothing`` is none."""
    while b > nothing:
        rest = a % b
        a, b = b, min(rest, b - rest)
    return a
