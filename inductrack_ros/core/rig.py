# SPDX-License-Identifier: Apache-2.0
"""What a rig would measure beside the truth: rates, dropouts, noise, bias and delay of its sensors, and their effects.

The `sim` node takes samples tick by tick (`Rig.step`), `inductrack simulate --measured` those of a whole run
(`Rig.record`): the same samples for the same seed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .model import Model
from .parameters import Parameter
from .sensors import Past, Sensors
from .state import CHANNEL, INDEX, INSTRUMENTS

#: The channels that each sensor delivers in one message.
SENSORS = {name: instrument.channels for name, instrument in INSTRUMENTS.items()}
MAX_DELAY = 0.1  # s
_FIRST = 256  # ticks of the truth that are kept to begin with
_EARLY = 1e-9  # s by which a moment may come before it is asked for: rounding


def declared() -> dict[str, Parameter]:
    """Parameters of the sensor model: `measured.<sensor>.<rate|dropout>`, `measured.<channel>.<noise|bias|delay>`."""
    table = {}
    for sensor, channels in SENSORS.items():
        table[f"measured.{sensor}.rate"] = Parameter(
            INSTRUMENTS[sensor].rate, "Hz", 0.0, 1000.0, f"samples of {sensor}; 0 is off"
        )
        table[f"measured.{sensor}.dropout"] = Parameter(0.0, "", 0.0, 1.0, f"share of {sensor} samples that are lost")
        for c in channels:
            unit, most = CHANNEL[c].unit, max(1e3, CHANNEL[c].span)
            table[f"measured.{c}.noise"] = Parameter(
                CHANNEL[c].noise, unit, 0.0, most, f"standard deviation of the noise of {c}"
            )
            table[f"measured.{c}.bias"] = Parameter(0.0, unit, -most, most, f"what {c} reads too much")
            table[f"measured.{c}.delay"] = Parameter(0.0, "s", 0.0, MAX_DELAY, f"how late the reading of {c} is")
    return table


def noise(values: Mapping[str, float]) -> dict[str, float]:
    """The standard deviation of each channel's noise, from parameters named as `declared` has it."""
    return {c: values[f"measured.{c}.noise"] for channels in SENSORS.values() for c in channels}


@dataclass(frozen=True)
class Sample:
    """One message of a sensor: its stamp (s), the reading by channel, and the true roll (rad), which an Imu turns
    with."""

    sensor: str
    time: float
    reading: Mapping[str, float]
    roll: float


@dataclass(frozen=True)
class Record:
    """A run as one sensor saw it: stamps (m,) s, readings (m, c) in the order of `SENSORS`, the true roll (m,) rad."""

    times: np.ndarray
    readings: np.ndarray
    roll: np.ndarray


class Rig:
    """Turns the truth at every tick into samples. The same seed and the same truth give the same samples; a negative
    seed is another each time.

    A reading of what is yet to be true (a clock that is fast, a negative delay) is delivered when it is, with its
    stamp."""

    def __init__(self, values: Mapping[str, float], model: Model, seed: int) -> None:
        self._seed = seed
        self.change(values, model)
        self.restart()

    def change(self, values: Mapping[str, float], model: Model) -> None:
        """From here on other parameters (names as `declared`; others are passed over) or another model's sensor
        effects."""
        self.values = {name: values.get(name, parameter.default) for name, parameter in declared().items()}
        late = [("sensor_delay", c, {"delay": d}) for c in INDEX if (d := self.values.get(f"measured.{c}.delay"))]
        off = [("sensor_bias", c, {"bias": b}) for c in INDEX if (b := self.values.get(f"measured.{c}.bias"))]
        self.sensors = Sensors.of(model, late + off)
        self.sensors.compile()
        self._pasts = {c: p for c, p in getattr(self, "_pasts", {}).items() if len(p.states) == self.sensors.states(c)}

    def restart(self) -> None:
        """Begin a new run with the same noise."""
        self._random = {
            name: np.random.default_rng([self._seed, i] if self._seed >= 0 else None) for i, name in enumerate(SENSORS)
        }
        self._taken = dict.fromkeys(SENSORS, -1)
        self._waiting: dict[str, deque[tuple[float, np.ndarray]]] = {name: deque() for name in SENSORS}
        self._pasts: dict[str, Past] = {}
        self._times, self._runs, self._count = np.empty(_FIRST), np.empty((_FIRST, 0)), 0

    def step(self, time: float, truth: np.ndarray, period: float) -> list[Sample]:
        """The samples that come with this tick. ``truth`` (w,), as `state.OUTPUTS`, is the run's at ``time`` (s),
        ``period`` (s) the ticks'."""
        self._remember(time, truth)
        found = []
        for sensor in self._due(time, period):
            self._waiting[sensor].append((time, truth.copy()))
        for sensor, waiting in self._waiting.items():
            while waiting and self._known(sensor, waiting[0][0], time):
                stamp, row = waiting.popleft()
                reading = [self._reading(channel, stamp, row) for channel in SENSORS[sensor]]
                noisy = self._noisy(sensor, reading) if np.isfinite(reading).all() else None
                if noisy is not None:
                    found.append(
                        Sample(sensor, stamp, dict(zip(SENSORS[sensor], noisy, strict=True)), float(row[INDEX["roll"]]))
                    )
        return found

    def record(self, times: np.ndarray, runs: np.ndarray, period: float) -> dict[str, Record]:
        """What each sensor that is on delivers of a whole run (n, w) at the ticks ``times`` (n,), from the run's
        start."""
        self.restart()
        due = [self._due(time, period) for time in times.tolist()]
        found = {}
        for sensor, channels in SENSORS.items():
            ticks = np.array([k for k, names in enumerate(due) if sensor in names], int)
            if not ticks.size:
                continue
            readings = np.column_stack(
                [self.sensors.read(c, times[ticks], times, runs[None], held=True)[0] for c in channels]
            )
            kept = []
            for k, row in enumerate(readings):
                noisy = self._noisy(sensor, row.tolist()) if np.isfinite(row).all() else None
                if noisy is not None:
                    readings[k] = noisy
                    kept.append(k)
            found[sensor] = Record(times[ticks[kept]], readings[kept], runs[ticks[kept], INDEX["roll"]])
        return found

    def _due(self, time: float, period: float) -> list[str]:
        """Sensors that sample at this tick."""
        names = []
        for name in SENSORS:
            # Whole samples begun by this tick: the sample falls on the first tick at or after its own time.
            number = int((time + 1e-6 * period) * self.values[f"measured.{name}.rate"])
            if self.values[f"measured.{name}.rate"] > 0 and number > self._taken[name]:
                self._taken[name] = number
                names.append(name)
        return names

    def _noisy(self, sensor: str, reading: list[float]) -> list[float] | None:
        """The reading with noise on it; None where the sample is lost."""
        random = self._random[sensor]
        lost = random.random() < self.values[f"measured.{sensor}.dropout"]
        noisy = [
            v + self.values[f"measured.{c}.noise"] * random.standard_normal()
            for c, v in zip(SENSORS[sensor], reading, strict=True)
        ]
        return None if lost else noisy

    # -- the truth of the last ticks ----------------------------------------------------------------------------

    def _remember(self, time: float, truth: np.ndarray) -> None:
        if self._count == 0 and self._runs.shape[1] != truth.size:
            self._runs = np.empty((len(self._times), truth.size))
        if self._count == len(self._times):
            self._forget(time)
        self._times[self._count], self._runs[self._count] = time, truth
        self._count += 1

    def _forget(self, time: float) -> None:
        """Make room: drop what no reading to come looks at, or take more memory where all of it is looked at."""
        needed = [time, *(past.time for past in self._pasts.values())]
        stamps = [waiting[0][0] for waiting in self._waiting.values() if waiting]
        for channel in self.sensors.channels:
            at = [min([time, *stamps, *([self._pasts[channel].time] if channel in self._pasts else [])])]
            needed += self.sensors.true_times(channel, np.array(at)).tolist()
        first = max(int(np.searchsorted(self._times, min(needed))) - 3, 0)
        self._count -= first
        size = len(self._times) * (2 if self._count > len(self._times) // 2 else 1)
        for name in ("_times", "_runs"):
            old = getattr(self, name)
            new = np.empty((size, *old.shape[1:]))
            new[: self._count] = old[first:]
            setattr(self, name, new)

    def _known(self, sensor: str, stamp: float, now: float) -> bool:
        """Whether what a sensor reads at a stamp is true by now."""
        shifted = [c for c in SENSORS[sensor] if c in self.sensors.channels]
        return all(self.sensors.true_times(c, np.array([stamp]))[0] <= now + _EARLY for c in shifted)

    def _reading(self, channel: str, stamp: float, row: np.ndarray) -> float:
        if channel not in self.sensors.channels:
            return float(row[INDEX[channel]])
        times, run = self._times[: self._count], self._runs[: self._count]
        past = self._pasts.get(channel)
        if past is not None and past.time >= stamp:
            past = None
        values, past = self.sensors.go_on(channel, np.array([stamp]), times, run, past)
        self._pasts[channel] = past
        return float(values[0])
