# SPDX-License-Identifier: Apache-2.0
"""What sensors and pulses say in, as they come; fitted windows and what they say of the model out."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from ..core.model import Model, Pulses
from ..core.state import CHANNEL, COORDINATES, FURTHER, FURTHER_SENSORS, INDEX, INSTRUMENTS, OUTPUTS, STATES
from .evidence import Detector
from .region import regions
from .window import Fit, Samples, WindowFit

#: The sensors that it listens to, and their channels.
SENSORS = ("pose", "twist", *FURTHER_SENSORS)
SEEN = (*STATES, *FURTHER)
_COLUMNS = {sensor: np.array([INDEX[c] for c in INSTRUMENTS[sensor].channels]) for sensor in SENSORS}
#: s that a window waits after its end for what is on its way on other topics.
WAIT = 0.02
#: m; a pose so far behind the last one, or a stamp that goes back by a whole window, begins a new run.
BACK = 0.1
#: Numbers beyond this are a fault of the sensor.
ABSURD = 1e6
#: Windows after which silence is called a fit.
ENOUGH = 5
#: Windows that the noise found in them is averaged over.
NOISE_MEMORY = 20
MOST_WAITING = 20_000  # samples of a kind, pulses


@dataclass(frozen=True)
class Window:
    """A fitted window: ``begin``, ``end`` in ns, its samples and their `Fit` (None: it could not be judged)."""

    begin: int
    end: int
    stamps: np.ndarray
    samples: Samples
    fit: Fit | None


@dataclass
class Counts:
    """What happened since the start."""

    windows: int = 0
    unfit: int = 0
    contact: int = 0
    not_numbers: int = 0
    out_of_order: int = 0
    restarts: int = 0


@dataclass
class Monitor:
    """``noise`` (c,) standard deviations of the first of `SEEN`, the others being as declared; ``length`` s of a
    window; ``memory`` s that the verdict looks back; ``false_alarms`` an hour at most, on average, while the model is
    complete."""

    model: Model
    noise: np.ndarray
    length: float = 0.1
    memory: float = 60.0
    false_alarms: float = 0.1
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        self._declared = np.array([CHANNEL[c].noise for c in OUTPUTS])
        self._declared[[INDEX[c] for c in SEEN[: len(self.noise)]]] = self.noise
        self._forget_run()
        self.change(self.model)

    def change(self, model: Model) -> None:
        """Judge another model from here on; what spoke for or against the last one is forgotten."""
        self.model = model
        self._fit = WindowFit(model)
        self._detector = Detector(3600.0 / self.false_alarms / self.length)
        size = max(ENOUGH, round(self.memory / self.length))
        self._judged: deque[tuple[Fit, np.ndarray]] = deque(maxlen=size)
        self._noise_found: deque[np.ndarray] = deque(maxlen=NOISE_MEMORY)
        self._in_contact = False

    # -- what comes in --------------------------------------------------------------------------------------------

    def pose(self, stamp: int, coordinates: np.ndarray) -> None:
        """Surge, sway, heave, roll (4,) measured at ``stamp`` (ns)."""
        if self._take("pose", stamp, coordinates):
            if self._surge is not None and coordinates[0] < self._surge - BACK:
                self._restart("pose", stamp, coordinates)
            self._surge = coordinates[0]
            if self._epoch is None:
                self._epoch, self._origin = stamp, float(coordinates[0])

    def twist(self, stamp: int, rates: np.ndarray) -> None:
        """Their rates (4,)."""
        self._take("twist", stamp, rates)

    def further(self, sensor: str, stamp: int, reading: np.ndarray) -> None:
        """What one of `state.FURTHER_SENSORS` read, in the order of its channels."""
        self._take(sensor, stamp, reading)

    def pulse(self, stamp: int, coil: float, current: float, fired: bool) -> None:
        """A drive pulse that begins at ``stamp``; once any is reported ``fired``, mere commands are passed over."""
        if np.isfinite([coil, current]).all() and abs(current) < ABSURD and coil == round(coil):
            if fired and not self._fired:
                self._pulses.clear()
            if fired or not self._fired:
                self._pulses.append((stamp, coil, current))
            self._fired |= fired
        else:
            self.counts.not_numbers += 1

    def _take(self, sensor: str, stamp: int, values: np.ndarray) -> bool:
        if not (np.isfinite(values).all() and np.abs(values).max() < ABSURD):
            self.counts.not_numbers += 1
            return False
        last = self._last[sensor]
        if last is not None and stamp <= last:
            if stamp < last - self.length * 1e9:
                self._restart(sensor, stamp, values)
                return True
            self.counts.out_of_order += stamp < last  # the same again: it stands still
            return False
        self._last[sensor] = stamp
        self._waiting[sensor].append((stamp, values))
        return True

    def _restart(self, sensor: str, stamp: int, values: np.ndarray) -> None:
        self.counts.restarts += 1
        self._forget_run()
        self._last[sensor] = stamp
        self._waiting[sensor].append((stamp, values))

    def _forget_run(self) -> None:
        self._waiting: dict[str, deque] = {sensor: deque(maxlen=MOST_WAITING) for sensor in SENSORS}
        self._pulses: deque = deque(maxlen=MOST_WAITING)
        self._last: dict[str, int | None] = dict.fromkeys(SENSORS)
        self._epoch: int | None = None
        self._surge: float | None = None
        self._origin, self._fired = 0.0, False

    # -- what comes out -------------------------------------------------------------------------------------------

    def windows(self) -> list[Window]:
        """The windows that are complete by now, oldest first."""
        found = []
        length, wait = round(self.length * 1e9), round(WAIT * 1e9)
        poses = self._waiting["pose"]
        while self._epoch is not None and poses and self._last["pose"] - poses[0][0] >= length + wait:
            begin = poses[0][0]
            found.append(self._judge(begin, begin + length))
        return found

    def _judge(self, begin: int, end: int) -> Window:
        rows = []
        for sensor, waiting in self._waiting.items():
            while waiting and waiting[0][0] < end:
                stamp, values = waiting.popleft()
                if stamp >= begin:
                    rows.append((stamp, _COLUMNS[sensor], values))
        stamps = np.repeat([row[0] for row in rows], [len(row[1]) for row in rows])
        columns = np.concatenate([row[1] for row in rows])
        values = np.concatenate([row[2] for row in rows])
        samples = Samples((stamps - self._epoch) / 1e9, columns, _unwrapped(columns, values))
        pulses = self._burning(begin, end)
        fit = self._fit.fit(samples, self._declared * self.noise_ratio, pulses, self._origin)
        if fit is not None:
            before = self.noise_ratio
            self._noise_found.append(self._noise_in(samples, fit, before))
            if (self.noise_ratio > 1.1 * before).any():  # the sensors are worse than declared
                fit = self._fit.fit(samples, self._declared * self.noise_ratio, pulses, self._origin)
        self._learn(fit)
        return Window(begin, end, stamps, samples, fit)

    def _burning(self, begin: int, end: int) -> Pulses | None:
        if self.model.drive != "pulses":
            return None
        early = (
            self._epoch
            + (self._fit.looks_at((begin - self._epoch) / 1e9) - self.model.parameters["pulse_length"]) * 1e9
        )
        while self._pulses and self._pulses[0][0] < min(begin - 1e9, early):
            self._pulses.popleft()
        rows = np.array([((s - self._epoch) / 1e9, c, i) for s, c, i in self._pulses if early < s < end]).reshape(-1, 3)
        return Pulses(*rows.T)

    def _noise_in(self, samples: Samples, fit: Fit, ratio: np.ndarray) -> np.ndarray:
        """Mean squares of what the fit leaves, over the declared noise, for each of `state.OUTPUTS`; NaN for a
        channel that was not measured."""
        known = np.isfinite(fit.left)
        columns = samples.column[known]
        count = np.bincount(columns, minlength=len(OUTPUTS))
        squares = np.bincount(columns, fit.left[known] ** 2, minlength=len(OUTPUTS))
        unknowns = len(self._fit.states) + len(self._fit.forces)
        with np.errstate(invalid="ignore", divide="ignore"):
            return squares / (count * (1.0 - unknowns / known.sum())) * ratio**2

    @property
    def noise_found(self) -> np.ndarray:
        """Noise of the last windows over the declared one, for each of `state.OUTPUTS`; NaN where nothing was
        measured."""
        if not self._noise_found:
            return np.full(len(OUTPUTS), np.nan)
        rows = np.array(self._noise_found)
        known = np.isfinite(rows)
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.where(known, rows, 0.0).sum(axis=0) / known.sum(axis=0))

    @property
    def noise_ratio(self) -> np.ndarray:
        """By how much the declared noise is raised: sensors may be worse than declared, not better."""
        return np.fmax(self.noise_found, 1.0)

    def _learn(self, fit: Fit | None) -> None:
        self.counts.windows += 1
        if fit is None:
            self.counts.unfit += 1
            return
        self._in_contact = fit.contact
        if fit.contact:  # the contact's stiffness is an assumption, and an impact is no small change
            self.counts.contact += 1
            return
        self._judged.append((fit, self._detector.add(fit.force / fit.sigma)))

    @property
    def failing(self) -> dict[str, list[str]]:
        """Coordinates in which the model fails, each with the regions that the windows support (see `region`)."""
        if not self._judged:
            return {}
        alarms = np.array([a for _, a in self._judged]).any(axis=0)
        fits = [fit for fit, _ in self._judged]
        features = {
            "speed": np.array([f.path[:, 4] for f in fits]),
            "gap": np.array([[f.gap] * 3 for f in fits]),
            "place": np.array([f.path[:, 0] for f in fits]),
        }
        return {
            COORDINATES[i]: regions(
                np.array([f.force[i] / f.sigma[i] for f in fits]), np.array([f.sigma[i] for f in fits]), features
            )
            for i in np.flatnonzero(alarms)
        }

    @property
    def largest(self) -> dict[str, tuple[float, float]]:
        """For each coordinate that fails the largest force that a window shows for sure (beyond two sigma), and its
        sigma.

        In N; of roll in N·m.
        """
        fits = [fit for fit, _ in self._judged]
        found = {}
        for name in self.failing:
            i = COORDINATES.index(name)
            fit = max(fits, key=lambda f, i=i: abs(f.force[i]) - 2.0 * f.sigma[i])
            found[name] = float(fit.force[i]), float(fit.sigma[i])
        return found

    @property
    def started(self) -> bool:
        """Whether a pose has come."""
        return self._epoch is not None

    def status(self) -> tuple[bool, str]:
        """Whether the model holds, as far as can be told, and the sentence that says so."""
        failing = self.failing
        if failing:
            return False, "fails in " + ", ".join(" ".join([c, *where[:1]]) for c, where in failing.items())
        if not self.started:
            return True, "waiting for measured/pose"
        if len(self._judged) < ENOUGH:
            return True, "in contact: not judged" if self._in_contact else "too early to tell"
        return True, "model fits"


def _unwrapped(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A roll recorded as a quaternion comes back within ±π; the model's does not jump."""
    values, roll = values.copy(), columns == COORDINATES.index("roll")
    values[roll] = np.unwrap(values[roll])
    return values
