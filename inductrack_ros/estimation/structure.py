# SPDX-License-Identifier: Apache-2.0
"""What is fitted: a model's structure (its effects) and the list of its free parameters, as vectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..core.effects import catalogue, split_name
from ..core.errors import InputError, did_you_mean
from ..core.model import Model
from ..core.parameters import PARAMETERS, Parameter, Values
from ..core.sensors import Sensors
from ..core.state import CHANNELS
from ..core.uncertainty import Uncertainty

#: Prior of a free parameter about its start, in typical sizes: only keeps what the data say nothing about where it is.
THETA_PRIOR = 300.0
#: Prior standard deviation of a stand-in's straight part, in typical sizes.
STRAIGHT = 100.0


@dataclass(frozen=True)
class Smoothness:
    """What the prior of a table wants of its values: ``weight`` on their squared second differences, or with a ``turn``
    (rad from one value to the next) on how far they are from a constant and an oscillation at that rate."""

    weight: float = 0.0
    turn: float = 0.0

    def bending(self, count: int) -> np.ndarray:
        """Precision (count, count) for a weight of 1: nothing is held against a straight table, or one that
        oscillates."""
        if not self.turn:
            departures = np.diff(np.eye(count), 2, axis=0)
        else:
            first = np.diff(np.eye(count), axis=0)
            departures = first[2:] - 2.0 * np.cos(self.turn) * first[1:-1] + first[:-2]
        return departures.T @ departures

    def precision(self, effect: str, count: int) -> np.ndarray:
        """Precision (count, count) of a stand-in's table: next to nothing on all but its departures."""
        typical = catalogue()[effect].parameters["values"].typical
        return self.weight * self.bending(count) + np.diag(np.full(count, (STRAIGHT * typical) ** -2.0))


class Fitted:
    """What every fit of a ``structure`` has: ``theta`` (g,) and its ``covariance`` (g, g)."""

    structure: Structure
    theta: np.ndarray
    covariance: np.ndarray

    @property
    def values(self) -> dict[str, float]:
        """Fitted parameters by full name."""
        return self.structure.decode(self.theta)

    @property
    def deviations(self) -> dict[str, float]:
        """Their standard deviations."""
        return self.structure.spread(self.theta, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @cached_property
    def model(self) -> Model:
        """The model with the fitted parameters."""
        return self.structure.with_theta(self.theta)

    @property
    def uncertainty(self) -> Uncertainty:
        """The covariance of the parameter values to first order, as ``model.yaml`` carries it: theta's correlations and
        the `deviations`.

        Without parameters that are held, and without those of which the data say nothing."""
        of_theta = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        std = np.array([self.deviations[n] for n in self.structure.free])
        known = [k for k in np.flatnonzero(np.isfinite(std) & (of_theta > 0)).tolist() if k not in self.structure.held]
        scale = np.array([self._sign(k, float(of_theta[k])) for k in known]) * std[known] / of_theta[known]
        covariance = self.covariance[np.ix_(known, known)] * np.outer(scale, scale)
        return Uncertainty(tuple(self.structure.free[k] for k in known), 0.5 * (covariance + covariance.T))

    def _sign(self, k: int, deviation: float) -> float:
        """Whether parameter k rises or falls with its theta: a fit of 1/x falls, and one of several alike may be turned
        over."""
        step = np.where(np.arange(len(self.theta)) == k, 1e-3 * deviation, 0.0)
        above, below = (self.structure.decode(self.theta + side)[self.structure.free[k]] for side in (step, -step))
        return -1.0 if above - below < 0 else 1.0


@dataclass(frozen=True)
class Structure:
    """A model whose ``free`` parameters (full names, e.g. ``eta`` or ``aerodynamic_drag.drag_area``) are to be fitted.

    ``theta`` vectors hold the free parameters in their fit coordinates divided by `scale`, so that a unit step is a
    typical change of each. ``smoothness`` says by effect what is wanted of its table.
    """

    model: Model
    free: tuple[str, ...]
    smoothness: Mapping[str, Smoothness] = field(default_factory=dict)
    known: tuple[np.ndarray, np.ndarray] | None = None  # mean and precision of theta from earlier runs

    def knowing(self, theta: np.ndarray, covariance: np.ndarray, further: Sequence[str] = ()) -> Structure:
        """This structure with a fit of other runs as its prior; ``further`` parameters free that those runs said
        nothing about."""
        wide = replace(
            self,
            model=self.with_theta(theta),
            free=self.free + tuple(n for n in further if n not in self.free),
            known=None,
        )
        precision, g = wide.precision.copy(), len(theta)
        precision[:g, :g] = np.linalg.pinv(covariance, rcond=1e-15, hermitian=True)
        return replace(wide, known=(wide.start, precision))

    def surprise(self, theta: np.ndarray) -> float:
        """How far theta is from the prior's mean, as a χ²."""
        return float((theta - self.centre) @ self.precision @ (theta - self.centre))

    def declared(self, name: str) -> Parameter:
        """Declaration of a free parameter."""
        effect, _, parameter = name.rpartition(".")
        if not effect:
            if name not in PARAMETERS:
                raise InputError(f"free: unknown parameter '{name}'{did_you_mean(name, PARAMETERS)}")
            return PARAMETERS[name]
        item, channel = split_name(effect, self.model.known_effects, CHANNELS)
        declared = item.parameters[parameter.partition("[")[0]]
        return declared.for_channel(channel) if channel else declared

    def check(self) -> None:
        """Raise `InputError` for a free parameter that does not exist."""
        for name in self.free:
            self.declared(name)

    @cached_property
    def declarations(self) -> tuple[Parameter, ...]:
        """Declarations in the order of ``free``."""
        return tuple(self.declared(name) for name in self.free)

    @cached_property
    def scale(self) -> np.ndarray:
        """Typical change of each free parameter in its fit coordinate, (g,)."""
        sizes = []
        for p in self.declarations:
            neutral = 0.0 if np.isinf(p.default) else p.to_fit(p.default)
            typical = p.typical if p.typical else 0.1 * abs(p.default) or 1.0
            sizes.append(abs(p.to_fit(typical)) if neutral == 0.0 else typical)
        return np.array(sizes)

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bound of theta, each (g,); what the model holds is within them."""
        pairs = np.array([p.fit_bounds() for p in self.declarations]).reshape(-1, 2)
        return np.minimum(pairs[:, 0] / self.scale, self.start), pairs[:, 1] / self.scale

    @cached_property
    def tables(self) -> dict[str, list[int]]:
        """Indices in theta of each stand-in's free table, by effect."""
        found: dict[str, list[int]] = {}
        for k, name in enumerate(self.free):
            effect, table, _ = name.partition(".values[")
            if table:
                found.setdefault(effect, []).append(k)
        return found

    @cached_property
    def held(self) -> list[int]:
        """Indices in theta of what stays where it starts: γ beside a change of the thrust, for only their product
        shows."""
        return [k for k, name in enumerate(self.free) if name == "gamma" and "stand_in_thrust" in self.tables]

    @cached_property
    def precision(self) -> np.ndarray:
        """Inverse covariance (g, g) of theta's prior about its start: wide, but for tables that are to be smooth."""
        if self.known is not None:
            return self.known[1]
        precision = np.diag(np.full(len(self.free), THETA_PRIOR**-2.0))
        for effect, smooth in self.smoothness.items():
            mine = self.tables[effect]
            precision[np.ix_(mine, mine)] = smooth.precision(effect, len(mine)) * self.scale[mine[0]] ** 2
        return precision

    @cached_property
    def centre(self) -> np.ndarray:
        """Theta's prior mean, (g,): where it starts, but nothing for tables."""
        if self.known is not None:
            return self.known[0]
        return np.where(["values[" in f for f in self.free], 0.0, self.start)

    @cached_property
    def start(self) -> np.ndarray:
        """Theta of the model as it stands, (g,)."""
        return self.encode([self.value(name) for name in self.free])

    def value(self, name: str) -> float:
        """The model's value of a parameter by its full name."""
        effect, _, parameter = name.rpartition(".")
        parameter, table, entry = parameter.partition("[")
        if not effect:
            return self.model.parameters[name]
        value = self.model.effects[effect][parameter]
        return value[int(entry[:-1])] if table else value

    def encode(self, values: Sequence[float]) -> np.ndarray:
        """Theta from parameter values."""
        return np.array([p.to_fit(v) for p, v in zip(self.declarations, values, strict=True)]) / self.scale

    def decode(self, theta: np.ndarray) -> dict[str, float]:
        """Parameter values by full name from theta."""
        u = theta * self.scale
        values = {
            n: float(min(max(p.from_fit(x), p.low), p.high))
            for n, p, x in zip(self.free, self.declarations, u, strict=True)
        }
        for effect in self.effects:
            item, _ = split_name(effect, self.model.known_effects, CHANNELS)
            own = [f"{effect}.{p}" for p in item.parameters]
            if item.canonical and all(n in values for n in own):
                values |= {
                    f"{effect}.{p}": v
                    for p, v in item.canonical({p: values[f"{effect}.{p}"] for p in item.parameters}).items()
                }
        return values

    def spread(self, theta: np.ndarray, deviation: np.ndarray) -> dict[str, float]:
        """Standard deviations of the parameter values, from those of theta, to first order."""
        result = {}
        for n, p, u, s in zip(self.free, self.declarations, theta * self.scale, deviation * self.scale, strict=True):
            h = max(1e-6 * abs(u), 1e-3 * s, 1e-12)
            slope = (
                (p.from_fit(u + h) - p.from_fit(max(u - h, h * 1e-3))) / (u + h - max(u - h, h * 1e-3))
                if p.fit_as != "x"
                else 1.0
            )
            result[n] = float(abs(slope) * s) if np.isfinite(slope) else float("inf")
        return result

    def with_theta(self, theta: np.ndarray) -> Model:
        """The model with the free parameters at theta."""
        values = self.decode(theta)
        base = {n: v for n, v in values.items() if "." not in n}
        effects = {e: dict(v) for e, v in self.model.effects.items()}
        for name, value in values.items():
            effect, dot, parameter = name.rpartition(".")
            parameter, table, entry = parameter.partition("[")
            if table:
                effects[effect][parameter] = list(effects[effect][parameter])
                effects[effect][parameter][int(entry[:-1])] = value
            elif dot:
                effects[effect][parameter] = value
        return self.model.with_changes(base, effects)

    @cached_property
    def columns(self) -> tuple[int | None, ...]:
        """Column of each free parameter in the kernel's vector P; None for a sensor's."""
        names = self.model.kernel.parameters
        return tuple(names.index(n) if n in names else None for n in self.free)

    def vectors(self, thetas: np.ndarray) -> np.ndarray:
        """Kernel parameter vectors (j, p) for each row of ``thetas`` (j, g)."""
        P = np.tile(self.model.vector, (len(thetas), 1))
        for k, column in enumerate(self.columns):
            if column is not None:
                p, s = self.declarations[k], self.scale[k]
                P[:, column] = [p.from_fit(u) for u in thetas[:, k] * s]
        return P

    @cached_property
    def sensors(self) -> Sensors:
        """What the model's sensors make of the truth."""
        return Sensors.of(self.model)

    def faults(self, thetas: np.ndarray) -> np.ndarray:
        """The sensors' parameter vectors (j, k) for each row of ``thetas`` (j, g)."""
        names = self.sensors.parameters
        p = np.tile(self.sensors.vector, (len(thetas), 1))
        for k, name in enumerate(self.free):
            if name in names:
                declared, s = self.declarations[k], self.scale[k]
                p[:, names.index(name)] = [declared.from_fit(u) for u in thetas[:, k] * s]
        return p

    def plus(self, name: str, values: Values | None = None, free: Sequence[str] | None = None) -> Structure:
        """This structure with one more effect started at ``values`` (where it vanishes otherwise), ``free`` of its
        parameters (all, unless said) to be fitted."""
        item, _ = split_name(name, self.model.known_effects, CHANNELS)
        start = {p: d.default for p, d in item.parameters.items()} | dict(values or {})
        start = {
            p: v if isinstance(v, tuple) else min(max(v, item.parameters[p].low), item.parameters[p].high)
            for p, v in start.items()
        }
        model = self.model.with_changes(effects={**self.model.effects, name: start})
        added = tuple(f"{name}.{p}" for p in (item.parameters if free is None else free))
        return Structure(model, self.free + added, self.smoothness)

    def minus(self, name: str) -> Structure:
        """This structure without one effect."""
        effects = {e: v for e, v in self.model.effects.items() if e != name}
        smoothness = {e: w for e, w in self.smoothness.items() if e != name}
        free = tuple(f for f in self.free if f.rpartition(".")[0] != name)
        return Structure(self.model.with_changes(effects=effects), free, smoothness)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the model's effects."""
        return tuple(self.model.effects)
