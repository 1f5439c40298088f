# SPDX-License-Identifier: Apache-2.0
"""Runs of a campaign on a map: where each stands, and what it would do if it were flown with the map's model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.parameters import PARAMETERS
from ..core.state import INDEX, STATES
from ..data.planned import PlannedRun
from ..workers import Threads
from .quantities import NAMES
from .sweep import Plan, fly, seeks


@dataclass(frozen=True)
class Placed:
    """A run: its place ``at`` on each axis by name (NaN where it is not known), and its quantities by name (NaN where
    it cannot be flown).

    ``assumed`` are states that the campaign does not tell, taken from the sweep's own start; ``unused`` are conditions
    that no effect of the model asks for."""

    run: PlannedRun
    at: Mapping[str, float]
    values: Mapping[str, float]
    assumed: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()

    @property
    def on_the_map(self) -> bool:
        """Whether its place is known."""
        return bool(np.isfinite(list(self.at.values())).all())


def place(plan: Plan, runs: Sequence[PlannedRun]) -> tuple[Placed, ...]:
    """Each run on the axes of a plan, flown."""
    return tuple(_placed(plan, run) for run in runs)


def _placed(plan: Plan, run: PlannedRun) -> Placed:
    model = plan.model
    asked = {c for e, item in model.known_effects.items() if e in model.effects for c in item.conditions}
    unused = tuple(n for n in run.values if n not in STATES and n not in PARAMETERS and n not in asked)
    known = dict(plan.initial) | {n: v for n, v in run.values.items() if n not in unused}
    names = model.kernel.parameters

    def at(name: str) -> float:
        if name in STATES:
            return known.get(name, 0.0 if "surge_rate" in known and name not in ("heave", "surge_rate") else np.nan)
        return known.get(name, float(model.vector[names.index(name)]))

    own = {axis.name: at(axis.name) for axis in plan.axes}
    assumed = tuple(n for n in plan.initial if n not in run.values)
    if "surge_rate" not in known:
        return Placed(run, own, dict.fromkeys(NAMES, np.nan), assumed, unused)
    states = np.zeros((1, len(STATES)))
    for name in STATES:
        states[0, INDEX[name]] = known.get(name, 0.0)
    parameters = {n: np.array([v]) for n, v in known.items() if n not in STATES}
    found = fly(model, plan.times, states, seeks(model, list(known)), parameters, Threads(1))
    return Placed(run, own, dict(zip(NAMES, found[0].tolist(), strict=True)), assumed, unused)
