# SPDX-License-Identifier: Apache-2.0
"""How measurements come out of a run: the one place where the effects of sensors are applied.

Offline whole runs are read at once (`Sensors.read`); a node reads sample by sample and carries the sensors' states
along (`Sensors.go_on`). Both call the same compiled function, which calls the effects' own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from . import sensor_kernel, sensor_loop
from .effects import Effect
from .errors import InputError, announce
from .model import Model
from .parameters import Values
from .state import INDEX, MOTION, OUTPUTS

#: A reading may ask for the truth so far (s) outside of a run, where it is extrapolated: for derivatives at its ends.
MARGIN = 1e-5
#: Times (s) between which a sensor may look.
CLOCK = np.array([-1e7, 1e7])
_CLOCK_RUN = np.zeros((1, 2, len(OUTPUTS)))  # a run whose surge is the time
_CLOCK_RUN[0, :, INDEX["surge"]], _CLOCK_RUN[0, :, INDEX["surge_rate"]] = CLOCK, 1.0


@dataclass(frozen=True)
class Fault:
    """An effect of a sensor that is on: its full name, its ``channel`` ('' for one of several) and its parameters."""

    name: str
    effect: Effect
    channel: str
    values: Values


@dataclass(frozen=True)
class Past:
    """The states (s,) of a channel's sensor at a time (s from the run's start); (j, s) where each job has its own."""

    time: float
    states: np.ndarray


@dataclass(frozen=True)
class Sensors:
    """What sensors make of the truth: the sensor effects of a model, and ``further`` ones (effect, channel, parameters)
    behind them.

    Parameters of the `faults` are entries of a vector p, named by ``parameters``; ``P`` (k,) is the model's own vector,
    of which an effect may ask for the model's parameters.
    """

    model: Model
    further: tuple[tuple[str, str, Mapping[str, float]], ...] = ()

    @classmethod
    def of(cls, model: Model, further: Iterable[tuple[str, str, Mapping[str, float]]] = ()) -> Sensors:
        """Those of a model, and ``further`` ones."""
        return cls(model, tuple(further))

    def __reduce__(self) -> tuple:
        return Sensors, (self.model, self.further)  # on another machine it is compiled again, or is in the cache

    @cached_property
    def known(self) -> dict[str, Effect]:
        """Every effect of sensors that the model knows, by name."""
        return {n: e for n, e in self.model.known_effects.items() if e.of_sensor}

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """The effects that are on, in the order in which they apply."""
        listed = [(*name.partition(":")[::2], values) for name, values in self.model.effects.items()] + list(
            self.further
        )
        return tuple(
            Fault(f"{n}:{c}" if c else n, self.known[n], c, values) for n, c, values in listed if n in self.known
        )

    @cached_property
    def P(self) -> np.ndarray:
        """The model's vector (k,)."""
        return self.model.vector

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Channels that are not read as they are, in the order of `state.OUTPUTS`."""
        touched = {c for f in self.faults for c in ((f.channel,) if f.channel else f.effect.channels)}
        return tuple(c for c in OUTPUTS if c in touched)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Full names of the entries of p, e.g. ``sensor_bias:sway.bias``."""
        return tuple(
            e for f in self.faults for name, d in f.effect.parameters.items() for e in d.entries(f"{f.name}.{name}")
        )

    @cached_property
    def vector(self) -> np.ndarray:
        """The faults' parameters, p (k,)."""
        flat: list[float] = []
        for fault in self.faults:
            for name, declared in fault.effect.parameters.items():
                value = fault.values.get(name, declared.default)
                entries = list(value) if isinstance(value, tuple) else [value]
                flat += entries + [0.0] * (declared.count - len(entries))
        return np.array(flat)

    def own(self, channel: str) -> np.ndarray:
        """Entries of p that a channel's reading depends on."""
        return self._plans[channel].own if channel in self._plans else np.zeros(0, np.int64)

    def compile(self) -> None:
        """Compile now rather than in the middle of a run, where there is anything to compile. Raises `InputError`."""
        if self.channels:
            self._compiled  # noqa: B018

    def states(self, channel: str) -> int:
        """How many states the effects on a channel carry."""
        return self._plans[channel].states if channel in self._plans else 0

    def read(
        self,
        channel: str,
        at: np.ndarray,
        grid: np.ndarray,
        runs: np.ndarray,
        *,
        which: np.ndarray | None = None,
        p: np.ndarray | None = None,
        P: np.ndarray | None = None,
        past: Past | None = None,
        held: bool = False,
    ) -> np.ndarray:
        """A channel's readings (j, m) at times ``at`` (m,), rising, of whole runs.

        ``runs`` (u, n, w), columns as the first w of `state.OUTPUTS`, are true at ``grid`` (n,), whose first is where
        the run began.
        Job j reads run ``which[j]`` (all, one after the other, unless given) with the parameters ``p[j]`` and ``P[j]``
        (the sensors' own unless given). The sensors' states start at the run's start, or from their ``past``. NaN
        before the run began, unless the truth ``held`` before it, and after its end."""
        which = np.arange(len(runs)) if which is None else np.asarray(which, np.int64)
        return self._read(channel, at, grid, runs, which, p, P, past, held)[0]

    def go_on(
        self, channel: str, at: np.ndarray, grid: np.ndarray, run: np.ndarray, past: Past | None
    ) -> tuple[np.ndarray, Past]:
        """Readings (m,) at times ``at`` of a run (n, w) that is known at ``grid`` so far, from where a reading left
        off.

        ``past`` is None at the run's start. The grid has to reach back to it, and to the `true_times` that are asked
        for."""
        values, states = self._read(channel, at, grid, run[None], np.zeros(1, np.int64), None, None, past, True)
        return values[0], Past(float(at[-1]), states[0])

    def true_times(self, channel: str, at: np.ndarray) -> np.ndarray:
        """When what a channel reads at times ``at`` (m,) was true, (m,) s from the run's start."""
        if channel not in self._shifts:
            return np.array(at, float)
        return self._run(
            self._shifts[channel], INDEX["surge"], at, CLOCK, _CLOCK_RUN, np.zeros(1, np.int64), None, None, None, True
        )[0][0]

    # -- how it is done -----------------------------------------------------------------------------------------

    def _read(self, channel, at, grid, runs, which, p, P, past, held):
        plan = self._plans.get(channel) or _plan(channel, (), {}, ())
        return self._run(plan, INDEX[channel], at, grid, runs, which, p, P, past, held)

    def _run(self, plan, column, at, grid, runs, which, p, P, past, held):
        at, grid = np.ascontiguousarray(at, float), np.ascontiguousarray(grid, float)
        if plan.columns[-1] >= runs.shape[2]:  # the compiled code checks no bounds
            raise InputError(f"a sensor reads {OUTPUTS[plan.columns[-1]]}, which was not simulated")
        runs, jobs = np.ascontiguousarray(runs, float), len(which)
        out, x = np.empty((jobs, at.size)), np.zeros((jobs, plan.states))
        if past is not None:
            x[:] = past.states
        p = self.vector[None].repeat(jobs, axis=0) if p is None else np.ascontiguousarray(p, float)
        P = self.P[None].repeat(jobs, axis=0) if P is None else np.ascontiguousarray(P, float)
        begin = np.nan if past is None else past.time
        self._compiled.read(at, grid, runs, which, p, P, plan.rows, plan.columns, column, begin, x, MARGIN, held, out)
        return out, x

    @cached_property
    def _compiled(self):
        return sensor_kernel.build(tuple(self.known.values()), announce)

    @cached_property
    def _shifts(self) -> dict[str, _Plan]:
        """Of each channel that is not read at once, what changes the time."""
        found = {}
        for channel, plan in self._plans.items():
            mine = plan.rows[:, 0] == sensor_loop.SHIFT
            if mine.any():
                found[channel] = replace(plan, rows=plan.rows[mine], columns=np.array([INDEX["surge"]]), states=0)
        return found

    @cached_property
    def _plans(self) -> dict[str, _Plan]:
        """What is done to each of `channels`, as `sensor_loop` takes it."""
        numbers = {name: i for i, name in enumerate(self.known)}
        places = np.cumsum([0, *map(_size, self.faults)]).tolist()
        return {c: _plan(c, self.faults, numbers, places) for c in self.channels}


def columns_for(channels: Iterable[str], known: Iterable[Effect]) -> int:
    """How many of `state.OUTPUTS` a run needs where these channels are read and these effects are known: the motion's,
    or all."""
    needed = [INDEX[c] for c in channels]
    needed += [column for e in known if e.of_sensor for column in sensor_kernel.columns_of(e)]
    needed += [INDEX[c] for e in known for c in e.channels]
    return len(MOTION) if max(needed, default=0) < len(MOTION) else len(OUTPUTS)


def counts_from_start(model: Model) -> bool:
    """Whether a piece of a run cannot be simulated by itself.

    There are three reasons. An effect needs the time or the travel since the run began. A sensor has states, which are
    unknown in the middle of a run. A sensor's clock gains on the run's."""
    if any({"time", "travel"} & set(model.known_effects[name.partition(":")[0]].arguments) for name in model.effects):
        return True
    sensors = Sensors.of(model)
    late = np.array([0.0, 1e3])
    return any(sensors.states(c) or abs(np.ptp(sensors.true_times(c, late)) - 1e3) > 1e-6 for c in sensors.channels)


@dataclass(frozen=True)
class _Plan:
    """Rows (r, 4) of `sensor_loop`, entries of p that they take, columns of the truth that are needed, number of
    states."""

    rows: np.ndarray
    own: np.ndarray
    columns: np.ndarray
    states: int


def _size(fault: Fault) -> int:
    return sum(declared.count for declared in fault.effect.parameters.values())


def _plan(channel: str, faults: Sequence[Fault], numbers: Mapping[str, int], places: Sequence[int]) -> _Plan:
    mixes = any(channel in f.effect.channels for f in faults if not f.channel)
    rows, own, states, columns = [], [], 0, {INDEX[channel]}
    for fault, place in zip(faults, places, strict=False):
        if fault.channel != channel and not (mixes and not fault.channel):
            continue
        kind = (
            sensor_loop.SHIFT
            if fault.effect.targets == ("sample_time",)
            else sensor_loop.ALTER
            if fault.channel
            else sensor_loop.MIX
        )
        rows.append((kind, numbers[fault.effect.name], place, states))
        own += range(place, place + _size(fault))
        states += len(fault.effect.states)
        columns |= {*sensor_kernel.columns_of(fault.effect), *(INDEX[c] for c in fault.effect.channels)}
    return _Plan(
        np.array(rows, np.int64).reshape(-1, 4), np.array(own, np.int64), np.array(sorted(columns), np.int64), states
    )
