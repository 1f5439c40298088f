# SPDX-License-Identifier: Apache-2.0
"""Which coil to fire, when, which way and how hard. Without ROS.

Coils stand every half wavelength, wound in alternating sense: coil n at n λ/2 pushes forward hardest when the cradle's
centre passes it, with a current of sign (−1)ⁿ. Half a wavelength passes in 3 ms at 15 m/s, so every command is sent
ahead with the time at which its half sine begins, half a pulse before the predicted passage.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from .detectors import Edge
from .drive import Pulse

MOST_AT_ONCE = 1000  # coils to command in one go; positions that no cradle has could ask for millions


class Motion:
    """Position and speed from photodiode edges; an edge that does not fit the motion is left out."""

    KEPT = 12  # edges in the fit: 0.6 m at the default spacing
    STRANGERS = 4  # so many misfits in a row, and it is the motion that was wrong

    def __init__(self, width: float, latency: float, tolerance: float) -> None:
        self._lead = 0.5 * width  # the edge comes when the flag's end is there, not the centre
        self._latency = latency
        self._tolerance = tolerance
        self._edges: deque[tuple[float, float]] = deque(maxlen=self.KEPT)
        self._strangers: list[tuple[float, float]] = []
        self._fit: tuple[float, float, float, float] | None = None  # time, place, speed, acceleration
        self._since = 0.0
        self.rejected = 0

    def add(self, edge: Edge) -> None:
        """Take one reported edge in."""
        seen = edge.time - self._latency, edge.place - self._lead
        if self._fit is not None and abs(self.place(seen[0]) - seen[1]) > self._tolerance:
            self.rejected += 1
            self._strangers.append(seen)
            if len(self._strangers) < self.STRANGERS:
                return
            self._edges.clear()
            self._edges.extend(self._strangers)
            self._since = self._edges[0][0] + self._latency
        else:
            if not self._edges:
                self._since = edge.time
            self._edges.append(seen)
        self._strangers.clear()
        self._refit()

    def _refit(self) -> None:
        if len(self._edges) < 3:
            return
        times, places = np.array(self._edges).T
        end = times[-1]
        order = 2 if len(times) >= 6 else 1
        coefficients = np.polynomial.polynomial.polyfit(times - end, places, order)
        acceleration = 2.0 * coefficients[2] if order == 2 else 0.0
        self._fit = float(end), float(coefficients[0]), float(coefficients[1]), float(acceleration)

    @property
    def known(self) -> bool:
        """Whether there have been edges enough."""
        return self._fit is not None

    def watched(self, now: float) -> float:
        """For how long (s) reports of this motion have come."""
        return now - self._since

    @property
    def speed(self) -> float:
        """Speed (m/s) at the newest edge."""
        return self._fit[2] if self._fit else 0.0

    def place(self, time: float) -> float:
        """Predicted surge of the cradle's centre (m) at `time` (s)."""
        t0, z0, v, a = self._fit
        return z0 + (time - t0) * (v + 0.5 * a * (time - t0))

    def passage(self, place: float) -> float:
        """When the centre passes a place ahead (s), by two Newton steps from constant speed."""
        t0, z0, v, a = self._fit
        time = t0 + (place - z0) / v
        for _ in range(2):
            time -= (self.place(time) - place) / max(v + a * (time - t0), 0.1 * v)
        return time


class SpeedHold:
    """Current that holds a speed: proportional and integral, within limits, the integral standing still at them.

    ``speed`` (m/s), ``gain``, ``integral_gain`` and ``limit`` (A) may be changed while it holds one.
    """

    def __init__(self, speed: float, current: float, gain: float, integral_gain: float, limit: float) -> None:
        self.speed = speed
        self.gain, self.integral_gain, self.limit = gain, integral_gain, limit
        self._integral = current
        self._last: float | None = None

    def current(self, time: float, speed: float) -> float:
        """Amplitude (A) for a coil fired at `time` (s) while the cradle does `speed` (m/s)."""
        error = self.speed - speed
        passed = 0.0 if self._last is None else time - self._last
        self._last = time
        integral = self._integral + self.integral_gain * error * passed
        asked = integral + self.gain * error
        limited = min(max(asked, 0.0), self.limit)
        if limited == asked:
            self._integral = integral
        return limited


class FiringPlan:
    """Turns edges into pulses: each coil once, ``lead`` seconds or less before its time; none below ``minimum_speed``
    (m/s). Both may be changed. ``waits``: time waits for what is commanded (lockstep), so that nothing comes too late.

    A motion is foretold no further ahead than it has been watched. Three edges say nothing of how the cradle slows
    down: coils fired 50 ms later by what they promise miss it, and an unstable speed is not caught any more.
    """

    def __init__(
        self,
        motion: Motion,
        coil_spacing: float,
        pulse_length: float,
        lead: float,
        minimum_speed: float,
        waits: bool = False,
    ) -> None:
        self.motion = motion
        self._spacing = coil_spacing
        self._half_pulse = 0.5 * pulse_length
        self.lead = lead
        self.minimum_speed = minimum_speed
        self._waits = waits
        self._next_coil: int | None = None

    def pulses(self, now: float, amplitude: float | SpeedHold) -> list[Pulse]:
        """Pulses to command now (s); the amplitude (A) is given, or asked of a `SpeedHold`."""
        if not self.motion.known or self.motion.speed < self.minimum_speed:
            return []
        reach = min(self.lead, self.motion.watched(now))
        here = self.motion.place(now)
        # The first coil whose pulse has not begun yet; never one that was fired already.
        ahead = int(np.floor((here + self.motion.speed * self._half_pulse) / self._spacing)) + 1
        if self._next_coil is None or abs(ahead - self._next_coil) > 100:  # a new run, somewhere else
            self._next_coil = ahead if self._waits else self._first_beyond(now + reach, ahead)
        coil = max(self._next_coil, ahead, 0)
        commands = []
        for _ in range(MOST_AT_ONCE):
            begin = self.motion.passage(coil * self._spacing) - self._half_pulse
            if not begin <= now + reach:
                break
            current = amplitude.current(begin, self.motion.speed) if isinstance(amplitude, SpeedHold) else amplitude
            if begin > now and current != 0.0:
                commands.append(Pulse(begin, coil, current if coil % 2 == 0 else -current))
            coil += 1
        self._next_coil = coil
        return commands

    def _first_beyond(self, time: float, coil: int) -> int:
        """The first coil from this one on whose pulse begins after a time. It is told as early as later ones are: one
        that is nearer would hear of its pulse too late where the machine is busy."""
        for _ in range(MOST_AT_ONCE):
            if self.motion.passage(coil * self._spacing) - self._half_pulse > time:
                break
            coil += 1
        return coil
