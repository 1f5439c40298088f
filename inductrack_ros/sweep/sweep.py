# SPDX-License-Identifier: Apache-2.0
"""A sweep: every point of its axes flown, with the model's own parameters and with as many draws of them as asked for.

`estimation.ensemble` flies blocks of whole points. Of each run only the quantities of the map are kept, so memory grows
with the number of points, not with the length of the runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..core.errors import InputError
from ..core.model import Model
from ..core.state import INDEX, STATES
from ..estimation.ensemble import ensemble
from ..workers import Cluster, Threads
from .axes import Axis
from .draws import Draws
from .quantities import NAMES, measure
from .starts import on_equilibrium

#: Runs in one block, which ends with a word of progress; runs whose equilibrium one task seeks.
BLOCK, TOGETHER = 16384, 256
#: Percentiles that are kept of the draws.
LOW, HIGH = 5.0, 95.0
MOST_RUNS = 2_000_000


@dataclass(frozen=True)
class Plan:
    """What is to be flown: ``initial`` is the state at the start by name, where no axis says it; ``duration`` (s),
    ``rate`` (Hz)."""

    model: Model
    axes: tuple[Axis, ...]
    initial: Mapping[str, float]
    duration: float = 3.0
    rate: float = 500.0
    draws: Draws = field(default_factory=Draws.none)

    def __post_init__(self) -> None:
        if self.runs > MOST_RUNS:
            shape = " × ".join(str(n) for n in self.shape)
            raise InputError(
                f"--over and --samples make {self.runs} runs ({shape} points, {1 + self.samples} runs each); at most"
                f" {MOST_RUNS}: give fewer points or samples"
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return tuple(len(a.values) for a in self.axes)

    @property
    def points(self) -> int:
        """Points of the map."""
        return int(np.prod(self.shape))

    @property
    def samples(self) -> int:
        """Draws at each point, besides the run with the model's own parameters."""
        return len(self.draws.values)

    @property
    def runs(self) -> int:
        """Runs in all."""
        return self.points * (1 + self.samples)

    @property
    def times(self) -> np.ndarray:
        """Times (n,) of the samples, s."""
        return np.arange(round(self.duration * self.rate) + 1) / self.rate


@dataclass(frozen=True)
class Spread:
    """What the draws made of each quantity, each by name with the shape of the map: mean, standard deviation,
    percentiles, over the runs that have it; ``touching`` is the part of the draws that touch the track, ``stable`` the
    part that is stable."""

    mean: Mapping[str, np.ndarray]
    std: Mapping[str, np.ndarray]
    low: Mapping[str, np.ndarray]
    high: Mapping[str, np.ndarray]
    touching: np.ndarray
    stable: np.ndarray


@dataclass(frozen=True)
class Sweep:
    """A finished sweep: each of `quantities.QUANTITIES` by name with the shape of the map, for the model's own
    parameters and over the draws."""

    plan: Plan
    values: Mapping[str, np.ndarray]
    spread: Spread | None = None

    @property
    def unflown(self) -> int:
        """Points without a run: no heave balances the weight there."""
        return int(np.isnan(self.values["stable"]).sum())

    @property
    def lost(self) -> int:
        """Points whose run left all bounds."""
        return int((np.isnan(self.values["travel"]) & ~np.isnan(self.values["stable"])).sum())


def sweep(plan: Plan, workers: Threads | Cluster | None = None, tell: Callable[[str], None] = lambda _: None) -> Sweep:
    """Fly all of it. ``tell`` hears how far it is. Raises `InputError` where not one point can be flown."""
    hands = workers or Threads()
    nominal = np.full((plan.points, len(NAMES)), np.nan)
    statistics: list[tuple[np.ndarray, ...]] = []
    each = 1 + plan.samples
    blocks = np.array_split(np.arange(plan.points), -(-plan.points * each // max(BLOCK, each)))
    done = 0
    for points in blocks:
        tell(f"{done * each} of {plan.runs} runs")
        found = _flown(plan, points, hands).reshape(len(points), each, len(NAMES))
        nominal[points] = found[:, 0]
        if plan.samples:
            statistics.append(_statistics(found[:, 1:]))
        done += len(points)
    values = {n: nominal[:, i].reshape(plan.shape) for i, n in enumerate(NAMES)}
    if np.isnan(values["stable"]).all():
        raise InputError(
            "no point of the sweep can be flown: no heave balances the weight; give heave in --initial, or look at the"
            " model"
        )
    return Sweep(plan, values, _spread(plan, statistics) if plan.samples else None)


def fly(
    model: Model,
    times: np.ndarray,
    states: np.ndarray,
    seek: bool,
    parameters: Mapping[str, np.ndarray],
    hands: Threads | Cluster,
) -> np.ndarray:
    """What is read off runs from ``states`` (runs, 8), under ``parameters`` by name (runs,): (runs, quantities).

    With ``seek`` each starts on its equilibrium heave; rows are NaN where there is none.
    """
    columns = {model.kernel.parameters.index(n): v for n, v in parameters.items()}

    def start(rows: slice) -> np.ndarray:
        P = np.tile(model.vector, (len(states[rows]), 1))
        for column, values in columns.items():
            P[:, column] = values[rows]
        return on_equilibrium(model, states[rows], P)

    if seek:
        states = np.concatenate(hands.map(start, [slice(i, i + TOGETHER) for i in range(0, len(states), TOGETHER)]))
    found = np.full((len(states), len(NAMES)), np.nan)
    can = np.isfinite(states).all(axis=1)
    if can.any():
        found[can] = ensemble(
            model, times, states[can], {n: v[can] for n, v in parameters.items()}, hands, partial(measure, times)
        )
    return found


def _flown(plan: Plan, points: np.ndarray, hands: Threads | Cluster) -> np.ndarray:
    """What is read off the runs of some points (flat indices), each point's runs one after another: (runs,
    quantities)."""
    each = 1 + plan.samples
    runs = len(points) * each
    places = np.unravel_index(points, plan.shape)
    states = np.zeros((runs, len(STATES)))
    for name, value in plan.initial.items():
        states[:, INDEX[name]] = value
    parameters = {}
    for k, name in enumerate(plan.draws.names):
        own = plan.model.vector[plan.model.kernel.parameters.index(name)]
        parameters[name] = np.tile(np.concatenate([[own], plan.draws.values[:, k]]), len(points))
    for axis, place in zip(plan.axes, places, strict=True):
        values = np.repeat(axis.values[place], each)
        if axis.of_state:
            states[:, INDEX[axis.name]] = values
        else:
            parameters[axis.name] = values
    return fly(
        plan.model,
        plan.times,
        states,
        seeks(plan.model, [*plan.initial, *(a.name for a in plan.axes)]),
        parameters,
        hands,
    )


def seeks(model: Model, given: Sequence[str]) -> bool:
    """Whether runs start on their equilibrium heave: it is not given, and it may move."""
    return "heave" not in given and bool(model.moving[INDEX["heave"]])


def _statistics(found: np.ndarray) -> tuple[np.ndarray, ...]:
    """Mean, standard deviation and percentiles (points, quantities) of draws (points, samples, quantities), and the
    parts that touch and are stable."""
    flown = np.isfinite(found).any(axis=(1, 2))
    counted = np.where(np.isfinite(found), found, np.nan)
    has = np.isfinite(counted).any(axis=1)
    # A column without a number would be warned of; it is emptied again below.
    filled = np.where(has[:, None, :], counted, 0.0)
    low, high = np.nanpercentile(filled, [LOW, HIGH], axis=1)
    parts = np.nanmean(filled, axis=1), np.nanstd(filled, axis=1, ddof=1 if found.shape[1] > 1 else 0), low, high
    touching = np.where(flown, np.isfinite(found[:, :, NAMES.index("first_contact")]).mean(axis=1), np.nan)
    stable = np.where(flown, (found[:, :, NAMES.index("stable")] == 1.0).mean(axis=1), np.nan)
    return *(np.where(has, p, np.nan) for p in parts), touching, stable


def _spread(plan: Plan, statistics: Sequence[tuple[np.ndarray, ...]]) -> Spread:
    mean, std, low, high, touching, stable = (np.concatenate(part) for part in zip(*statistics, strict=True))
    tables = [{n: t[:, i].reshape(plan.shape) for i, n in enumerate(NAMES)} for t in (mean, std, low, high)]
    return Spread(*tables, touching.reshape(plan.shape), stable.reshape(plan.shape))
