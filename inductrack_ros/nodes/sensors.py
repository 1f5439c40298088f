"""What a rig would measure beside the truth: noise, bias, delay, rate and dropout of its sensors. Without ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from ..core.model import Model
from ..core.parameters import Parameter
from ..core.state import ACCELERATIONS, COORDINATES, GAPS, RATES, UNITS

#: The channels that each sensor delivers in one message.
SENSORS: dict[str, tuple[str, ...]] = {
    "pose": COORDINATES,
    "twist": RATES,
    "imu": ACCELERATIONS[:3],
    **{gap: (gap,) for gap in GAPS},
}
_NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}
_NOISE |= {f"{c}_rate": v for c, v in {"surge": 0.02, "sway": 2e-3, "heave": 2e-3, "roll": 5e-3}.items()}
_NOISE |= dict.fromkeys(GAPS, 3e-5) | dict.fromkeys(ACCELERATIONS[:3], 0.05)
MAX_DELAY = 0.1  # s


def declared() -> dict[str, Parameter]:
    """Parameters of the sensor model: `measured.<sensor>.<rate|dropout>`, `measured.<channel>.<noise|bias|delay>`."""
    table = {}
    for sensor, channels in SENSORS.items():
        rate = 500.0 if sensor in ("pose", "twist") else 100.0
        table[f"measured.{sensor}.rate"] = Parameter(rate, "Hz", 0.0, 1000.0, f"samples of {sensor}; 0 is off")
        table[f"measured.{sensor}.dropout"] = Parameter(0.0, "", 0.0, 1.0, f"share of {sensor} samples that are lost")
        for c in channels:
            unit = UNITS[c]
            noise = Parameter(_NOISE[c], unit, 0.0, 1e3, f"standard deviation of the noise of {c}")
            table[f"measured.{c}.noise"] = noise
            table[f"measured.{c}.bias"] = Parameter(0.0, unit, -1e3, 1e3, f"what {c} reads too much")
            table[f"measured.{c}.delay"] = Parameter(0.0, "s", 0.0, MAX_DELAY, f"how late the reading of {c} is")
    return table


class SensorModel:
    """Turns the truth at every tick into samples. The same seed and the same truth give the same samples; a negative
    seed is another each time."""

    def __init__(self, values: Mapping[str, float], model: Model, seed: int) -> None:
        self.values = dict(values)
        self.model = model  # its sensor_* effects apply as well
        self._seed = seed
        self.restart()

    def restart(self) -> None:
        """Begin a new run with the same noise."""
        self._random = {name: np.random.default_rng([self._seed, i] if self._seed >= 0 else None) for i, name in enumerate(SENSORS)}
        self._past: deque[tuple[float, Mapping[str, float]]] = deque()
        self._taken = dict.fromkeys(SENSORS, -1)

    def due(self, time: float, period: float) -> list[str]:
        """Sensors that sample at this tick; `period` (s) is the ticks'."""
        names = []
        for name in SENSORS:
            # Whole samples begun by this tick: the sample falls on the first tick at or after its own time.
            number = int((time + 1e-6 * period) * self.values[f"measured.{name}.rate"])
            if self.values[f"measured.{name}.rate"] > 0 and number > self._taken[name]:
                self._taken[name] = number
                names.append(name)
        return names

    def remember(self, time: float, truth: Mapping[str, float]) -> None:
        """Keep the truth (all channels) of this tick for readings that come late."""
        self._past.append((time, truth))
        while len(self._past) > 2 and self._past[1][0] < time - MAX_DELAY:
            self._past.popleft()

    def sample(self, sensor: str, time: float) -> dict[str, float] | None:
        """The sensor's channels as measured at `time` (the last one remembered); None where the sample is lost."""
        random = self._random[sensor]
        lost = random.random() < self.values[f"measured.{sensor}.dropout"]
        reading = {}
        for channel in SENSORS[sensor]:
            value = self._true(channel, time - self.values[f"measured.{channel}.delay"])
            value += self.values[f"measured.{channel}.bias"]
            reading[channel] = value + self.values[f"measured.{channel}.noise"] * random.standard_normal()
        return None if lost else reading

    def _true(self, channel: str, time: float) -> float:
        """The channel at an earlier time, through the model's sensor effects."""
        after = []
        for name, parameters in self.model.effects.items():
            base, _, of_channel = name.partition(":")
            if of_channel == channel:
                effect = self.model.known_effects[base]
                if effect.targets == ("sample_time",):
                    time = effect.function(sample_time=time, **parameters)
                else:
                    after.append((effect, parameters))
        value = self._at(channel, time)
        for effect, parameters in after:
            value = effect.function(measured=value, **parameters)
        return value

    def _at(self, channel: str, time: float) -> float:
        later_time, later = self._past[-1]
        if time >= later_time:
            return later[channel]
        for earlier_time, earlier in reversed(self._past):
            if earlier_time <= time:
                part = (time - earlier_time) / (later_time - earlier_time)
                return earlier[channel] + part * (later[channel] - earlier[channel])
            later_time, later = earlier_time, earlier
        return later[channel]  # before the run began it stood there
