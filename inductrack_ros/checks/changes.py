# SPDX-License-Identifier: Apache-2.0
"""What could be meant otherwise: one unit, sign, zero, current, clock or exchange of channels after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..core.model import Model
from ..core.state import COORDINATES, GAPS
from . import levels
from .units import COUNTED, CURRENTS, TIMES, units_of
from .windows import SWINGING, Reading, Windows

#: Channels that may have changed places.
SWAPS = (
    *(("gap_left", "gap_right"), ("gap_top", "gap_right"), ("gap_top", "gap_left")),
    *(("sway", "heave"), ("sway", "roll"), ("heave", "roll")),
)


@dataclass(frozen=True)
class Change:
    """One thing that is read otherwise.

    - kind: ``unit``, ``flipped``, ``swapped``, ``gap`` (in the place of heave), ``rate`` (of the clock), ``counted``
      (too often or too rarely, by an encoder) or ``off``
    - about: the channels, ``time`` or ``drive_current``
    - reading: how the data are read then
    - unit: its name, of a ``unit``
    """

    kind: str
    about: tuple[str, ...]
    reading: Reading
    unit: str = ""

    def first_of(self, now: Reading) -> Change:
        """The change without its sign where it is one of unit and sign: these are two things wrong, and data in which
        the unit is right tell whose sign it is."""
        if self.kind != "unit" or factor_between(now, self.reading) > 0.0:
            return self
        return replace(self, reading=self.reading.times(self.about[0], -1.0))


def factor_between(before: Reading, after: Reading) -> float:
    """What the second reading multiplies by where the first does not."""
    channels = [after.of(c) / before.of(c) for c in after.channels]
    return float(np.prod([after.time / before.time, after.current / before.current, *channels]))


def changes(
    now: Reading, windows: Windows, left: Mapping[str, float], wanted: float | None, model: Model
) -> Iterator[Change]:
    """Changes of one thing, or of unit and sign of one channel, but of no channel that belongs as it is; ``left`` is
    how far each is off. One of sway and roll is off where the other is flipped. The current has no other unit, and was
    not off, where what is ``wanted`` of it is not so far off."""

    def fits(channel: str) -> bool:
        twins = SWINGING if channel in SWINGING else (channel,)
        return all(left.get(c, np.inf) < levels.GOOD for c in twins)

    if now.time == 1.0:
        for factor, unit in TIMES:
            yield Change("unit", ("time",), replace(now, time=factor), unit)
    stated = wanted is not None and 1 / levels.UNIT < wanted < levels.UNIT
    if now.current == 1.0 and windows.current.any() and not windows.pulsed and not stated:
        for factor, unit in CURRENTS:
            yield Change("unit", ("drive_current",), replace(now, current=factor), unit)
        yield Change("off", ("drive_current",), replace(now, current=0.0))
    for channel in windows.values:
        if channel not in (*COORDINATES, *GAPS) or fits(channel):
            continue
        if channel == "heave" and not now.zeros:
            yield above(now, model)
        if now.of(channel) > 0.0:
            yield Change("flipped", (channel,), now.times(channel, -1.0))
        if abs(now.of(channel)) != 1.0:
            continue
        if channel == "surge":
            for often in COUNTED:
                yield Change("counted", (channel,), now.times(channel, 1.0 / often))
        for factor, unit in units_of(channel):
            if channel != "surge" or factor * _speed(windows) < levels.FASTEST:
                yield Change("unit", (channel,), now.times(channel, factor), unit)
                if now.of(channel) > 0.0:
                    yield Change("unit", (channel,), now.times(channel, -factor), unit)
    yield from exchanges(now, windows, [c for c in windows.values if fits(c)])


def above(now: Reading, model: Model, sign: float = 1.0) -> Change:
    """Heave that is the gap above, or with a ``sign`` of −1 its negative: the gap grows with heave, and is the nominal
    one where heave is 0."""
    return Change("gap", ("heave",), now.times("heave", sign).plus("heave", -model.parameters["nominal_gap"]))


def exchanges(now: Reading, windows: Windows, fitting: list[str]) -> Iterator[Change]:
    """Two channels that change places, but not two of those ``fitting`` as they are."""
    for pair in () if now.swapped else SWAPS:
        if set(pair) <= windows.values.keys() and not set(pair) <= set(fitting):
            yield Change("swapped", pair, replace(now, swapped=pair))


def _speed(windows: Windows) -> float:
    """The largest mean speed (m/s) of surge over a window, as it is written."""
    ends = [0, -1]
    moved = np.diff(windows.values["surge"][:, ends], axis=1) / np.diff(windows.times[:, ends], axis=1)
    return float(np.abs(moved).max())
