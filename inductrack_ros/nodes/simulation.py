# SPDX-License-Identifier: Apache-2.0
"""The simulated cradle, tick by tick. Without ROS: what the `sim` node runs and tests drive directly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.errors import InputError
from ..core.model import Model, Pulses
from ..core.named_values import named_values
from ..core.state import FURTHER
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
        """Back to the initial state at time 0; waiting commands are forgotten.

        Raises `InputError`, and changes nothing, where the model has no such state.
        """
        x = self.model.initial_state(**self.initial)
        origin = float(x[0])
        self._quantities = self._finite(x, 0.0, None, origin)
        self.x, self._origin, self.ticks = x, origin, 0
        self._begun_at = float(x[4])
        self.queue.clear()

    @property
    def time(self) -> float:
        """Simulated seconds since the start or the last reset."""
        return self.ticks / self.rate

    def check(self, model: Model) -> None:
        """Raises `InputError` where another model has no finite forces in the present state."""
        self._finite(self.x, self.time, self.queue.burning(), self._origin, model)

    def change(self, model: Model) -> None:
        """Go on with another model from the present state. Raises `InputError` where it has no finite forces there."""
        quantities = self._finite(self.x, self.time, self.queue.burning(), self._origin, model)
        self.model, self._quantities = model, quantities
        self.queue.pulse_length = model.parameters["pulse_length"]

    def tick(self) -> list[Pulse]:
        """Advance one tick; returns the pulses that began. Raises `InputError` when the motion leaves all bounds."""
        start, end = self.time, (self.ticks + 1) / self.rate
        pulses, begun = self.queue.step(start, end)
        x = self.model.advance(self.x, start, end, pulses=pulses, origin=self._origin)
        try:
            self._quantities = self._finite(x, end, pulses, self._origin)
        except InputError as error:
            if self._quantities["thrust"] > self._quantities["magnetic_drag"]:
                raise InputError(
                    f"the cradle ran away, from {self.x[4]:.0f} m/s at {start:.3f} s: above its balance speed thrust"
                    " beats drag; drive it less, then call reset"
                ) from error
            raise
        self.x = x
        self.ticks += 1
        return begun

    @property
    def begun_at(self) -> float:
        """Surge rate (m/s) at the beginning of this run."""
        return self._begun_at

    @property
    def travelled(self) -> float:
        """Metres since the beginning of this run."""
        return float(self.x[0]) - self._origin

    def quantities(self) -> dict[str, float]:
        """The model's named quantities (gaps, accelerations, normal forces, …) now; all are finite."""
        return self._quantities

    def _finite(
        self, x: np.ndarray, time: float, pulses: Pulses | None, origin: float, model: Model | None = None
    ) -> dict[str, float]:
        """The quantities at a state, which nobody gets to see where one of them is not a finite number."""
        quantities = None
        if np.isfinite(x).all():
            quantities = (model or self.model).quantities(x, time, pulses=pulses, origin=origin)
        # What no sensor of this model can see is not a number, and no fault of the motion.
        known = [v for name, v in quantities.items() if name not in FURTHER] if quantities else [np.nan]
        if quantities is None or not np.isfinite(known).all():
            raise InputError(f"the motion left all bounds at {time:.3f} s; look at the parameters, then call reset")
        return quantities

    def wrenches(self) -> dict[str, np.ndarray]:
        """Forces apart, now; see `Model.wrenches`."""
        return self.model.wrenches(self.x, self.time, pulses=self.queue.burning(), origin=self._origin)


def parse_initial_state(text: str) -> dict[str, float]:
    """`"surge_rate=15.5,sway=0.004"` → {"surge_rate": 15.5, "sway": 0.004}; names are checked by the model."""
    return named_values(text, "initial_state", "surge_rate=15.5,sway=0.004")
