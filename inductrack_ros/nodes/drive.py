# SPDX-License-Identifier: Apache-2.0
"""Drive pulses between their command and their firing. Without ROS; times are simulated seconds."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..core.model import Pulses

HORIZON = 1.0  # s; a stamp further off than this, before or after, is a mistake and no command
MOST_WAITING = 1000  # a second's worth at 50 m/s and the paper's coils; more at once is a flood


@dataclass(frozen=True, order=True)
class Pulse:
    """One half sine: when it begins (s), in which coil, with how many amperes (signed)."""

    time: float
    coil: int
    current: float


class PulseQueue:
    """Takes commands, refuses what cannot be, counts what comes late, and hands out what burns in a time step."""

    def __init__(self, coils: int, max_current: float, pulse_length: float) -> None:
        self.coils = coils
        self.max_current = max_current
        self.pulse_length = pulse_length
        self._waiting: list[Pulse] = []
        self._burning: deque[Pulse] = deque()
        self._heard: float | None = None
        self.fired = self.late = self.refused = self.silences = 0

    def offer(self, now: float, time: float, coil: float, current: float) -> str:
        """Accept a command given while the clock stands at `now`; returns "" or why it is not applied."""
        self.heard(now)
        wrong = self._wrong(now, time, coil, current)
        if wrong:
            self.refused += 1
            return f"refused: {wrong}"
        if time < now:
            self.late += 1
            return f"late by {1e3 * (now - time):.3f} ms, not fired; send it further ahead"
        insort(self._waiting, Pulse(time, int(coil), current))
        return ""

    def heard(self, now: float) -> None:
        """The controller lives: it spoke at `now`."""
        self._heard = now

    def falls_silent(self, now: float, timeout: float) -> bool:
        """Whether the controller, heard before, has just been silent for `timeout` s. What it left behind is not
        fired."""
        if self._heard is None or now - self._heard <= timeout:
            return False
        self._heard = None
        self.silences += 1
        self._waiting.clear()
        return True

    def _wrong(self, now: float, time: float, coil: float, current: float) -> str:
        if not all(map(math.isfinite, (time, coil, current))):
            return f"coil {coil}, current {current}: a number is missing"
        if coil != int(coil) or not 0 <= coil < self.coils:
            return f"coil {coil:g} does not exist; the track has 0 to {self.coils - 1}"
        if abs(current) > self.max_current:
            return f"current {current:g} A; the limit (max_pulse_current) is {self.max_current:g} A"
        if abs(time - now) > HORIZON:
            side = "before" if time < now else "after"
            return f"its stamp is {abs(time - now):.3g} s {side} the simulated time; stamp on the clock of the poses"
        if self._in_use(int(coil), time):
            return f"coil {coil:g} has a pulse at that time already; are there two controllers?"
        if len(self._waiting) >= MOST_WAITING:
            return f"{MOST_WAITING} pulses are waiting already; command each once, shortly before its time"
        return ""

    def _in_use(self, coil: int, time: float) -> bool:
        """Whether a pulse burns in the coil less than its length before or after `time`."""
        first = bisect_left(self._waiting, time - self.pulse_length, key=lambda p: p.time)
        last = bisect_left(self._waiting, time + self.pulse_length, key=lambda p: p.time)
        near = [*self._waiting[first:last], *self._burning]
        return any(p.coil == coil and abs(p.time - time) < self.pulse_length for p in near)

    def step(self, start: float, end: float) -> tuple[Pulses | None, list[Pulse]]:
        """All pulses that burn between `start` and `end`, for the model, and those of them that begin there."""
        begun = [p for p in self._waiting if p.time < end]
        self._waiting = self._waiting[len(begun) :]
        self._burning.extend(begun)
        while self._burning and self._burning[0].time + self.pulse_length <= start:
            self._burning.popleft()
        self.fired += len(begun)
        return _arrays(self._burning), begun

    def burning(self) -> Pulses | None:
        """What burnt in the last step."""
        return _arrays(self._burning)

    def clear(self) -> None:
        """Forget all commands (a reset); the counts stay."""
        self._heard = None
        self._waiting.clear()
        self._burning.clear()


def _arrays(pulses: Iterable[Pulse]) -> Pulses | None:
    rows = list(pulses)
    if not rows:
        return None
    return Pulses(
        np.array([p.time for p in rows]), np.array([p.coil for p in rows]), np.array([p.current for p in rows])
    )
