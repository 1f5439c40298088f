# SPDX-License-Identifier: Apache-2.0
"""The aerodynamic part (14)–(16), and the claim that it is negligible, put to the test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.model import Model

SPEEDS = (10.0, 20.0, 40.0)
DURATION = 1.0  # s of travel
WETTED_AREA = 1.0  # m²; the paper prints none, and force and effect are proportional to it


@dataclass(frozen=True)
class Air:
    """At one initial speed (m/s): friction and magnetic drag (N) there, and what friction takes from 1 s of travel (m),
    powered and coasting."""

    speed: float
    friction: float
    magnetic_drag: float
    powered: float
    lost_powered: float
    coasting: float
    lost_coasting: float


def put_to_the_test(model: Model) -> list[Air]:
    """One `Air` for each of `SPEEDS`, with `WETTED_AREA`."""
    rough = model.with_changes(effects={**model.effects, "skin_friction_drag": {"wetted_area": WETTED_AREA}})
    return [_at(model, rough, speed) for speed in SPEEDS]


def _at(model: Model, rough: Model, speed: float) -> Air:
    x = model.initial_state(surge_rate=speed)
    friction = float(-rough.wrenches(x)["skin_friction_drag"][0])
    travels = {}
    for current in (model.parameters["drive_current"], 0.0):
        for m in (model, rough):
            travels[m is rough, current > 0] = m.simulate(np.array([0.0, DURATION]), x, current)["surge"][-1]
    return Air(
        speed, friction, model.quantities(x)["magnetic_drag"],
        float(travels[False, True]), float(travels[False, True] - travels[True, True]),
        float(travels[False, False]), float(travels[False, False] - travels[True, False]),
    )  # fmt: skip
