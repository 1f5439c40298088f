"""The simulated cradle, tick by tick. Without ROS: what the `sim` node runs and tests drive directly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.errors import InputError
from ..core.model import Model
from .drive import Pulse, PulseQueue


class Simulation:
    """State, simulated time and waiting pulses of one run; `rate` ticks to a simulated second."""

    def __init__(self, model: Model, initial: Mapping[str, float], rate: float, queue: PulseQueue) -> None:
        self.model = model
        self.initial = dict(initial)
        self.rate = rate
        self.queue = queue
        self.reset()

    def reset(self) -> None:
        """Back to the initial state at time 0; waiting commands are forgotten."""
        self.x = self.model.initial_state(**self.initial)
        self._origin = float(self.x[0])
        self.ticks = 0
        self.queue.clear()

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self.ticks / self.rate

    def change(self, model: Model) -> None:
        """Go on with another model from the present state."""
        self.model = model
        self.queue.pulse_length = model.parameters["pulse_length"]

    def tick(self) -> list[Pulse]:
        """Advance one tick; returns the pulses that began. Raises `InputError` when the motion leaves all bounds."""
        start, end = self.time, (self.ticks + 1) / self.rate
        pulses, begun = self.queue.step(start, end)
        x = self.model.advance(self.x, start, end, pulses=pulses, origin=self._origin)
        if not np.isfinite(x).all():
            raise InputError(f"the motion left all bounds at {start:.3f} s; look at the parameters, then call reset")
        self.x = x
        self.ticks += 1
        return begun

    def quantities(self) -> dict[str, float]:
        """The model's named quantities (gaps, accelerations, normal forces, …) now."""
        return self.model.quantities(self.x, self.time, pulses=self.queue.burning(), origin=self._origin)

    def wrenches(self) -> dict[str, np.ndarray]:
        """Forces apart, now; see `Model.wrenches`."""
        return self.model.wrenches(self.x, self.time, pulses=self.queue.burning(), origin=self._origin)


def parse_initial_state(text: str) -> dict[str, float]:
    """`"surge_rate=15.5,sway=0.004"` → {"surge_rate": 15.5, "sway": 0.004}; names are checked by the model."""
    values = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, _, number = (part.strip() for part in item.partition("="))
        try:
            if not name:
                raise ValueError
            values[name] = float(number)
        except ValueError:
            raise InputError(f"initial_state: '{item}' is not name=number, e.g. surge_rate=15.5,sway=0.004") from None
    return values
