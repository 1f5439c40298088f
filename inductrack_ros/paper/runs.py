# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments as the model runs them: one property per figure, computed once, numbers in SI."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from ..core.model import Model, Trajectory
from .facts import Facts

Array = NDArray[np.float64]

START_7 = {"surge_rate": 15.5}  # Figure 7: below the critical speed
START_10 = {"surge_rate": 15.5, "sway": 0.004, "sway_rate": -0.1}  # Figure 10: 4 mm off the centre
DURATION_6 = 2.0  # s, travel of Figure 6
DURATION_7 = 3.0  # s
SPEED_4 = 20.0  # m/s, held in Figure 4
RATE = 2000  # rows a second


@dataclass(frozen=True)
class Orbit:
    """Figure 4: trajectory of the held-speed model over 20 swings, and the period (s)."""

    run: Trajectory
    period: float
    gaps: Array
    low: float
    high: float
    fastest: float
    lost: float


class Runs:
    """All runs of the paper with one model (the identified one) and the paper's facts."""

    def __init__(self, model: Model, facts: Facts):
        self.model, self.facts = model, facts
        self.before = model.with_changes(facts.before)

    # -- steady state ------------------------------------------------------------------------------------------

    def corner_ratio(self, speed: Array | float) -> Array:
        """ωL/R at ``speed``."""
        p = self.model.parameters
        return 2 * np.pi / p["wavelength"] * np.asarray(speed, float) * p["inductance"] / p["resistance"]

    def forces_at(self, speed: float, heave: float | None = None, model: Model | None = None) -> dict[str, float]:
        """Named quantities at a speed, on the equilibrium heave unless ``heave`` is given."""
        model = model or self.model
        start = {"surge_rate": speed} if heave is None else {"surge_rate": speed, "heave": heave}
        return model.quantities(model.initial_state(**start))

    @cached_property
    def figure_2(self) -> dict[str, Array]:
        """Repulsion and drag in the zero pose over ωL/R, both over the largest repulsion (its limit at high speed)."""
        ratio = np.linspace(0.0, 10.0, 401)[1:]
        speed = ratio / self.corner_ratio(1.0)
        q = [self.forces_at(v, 0.0) for v in speed]
        limit = self.forces_at(1e6, 0.0)
        most = sum(limit[f"repulsion_{s}"] for s in ("top", "right", "left"))
        lift = np.array([sum(f[f"repulsion_{s}"] for s in ("top", "right", "left")) for f in q]) / most
        drag = np.array([f["magnetic_drag"] for f in q]) / most
        fine = np.linspace(0.9, 1.1, 401)
        near = np.array([self.forces_at(v, 0.0)["magnetic_drag"] for v in fine / self.corner_ratio(1.0)]) / most
        peak = int(np.argmax(near))
        return {"ratio": ratio, "lift": lift, "drag": drag, "peak": np.array([fine[peak], near[peak]])}

    @cached_property
    def figure_5(self) -> dict[str, Array]:
        """Over speed: net lift in the zero pose (N), and the gap on which lift equals weight (m; from the lowest speed
        that carries)."""
        speed = np.linspace(0.5, 60.0, 239)
        q = [self.forces_at(v, 0.0) for v in speed]
        lift = np.array([f["force_heave"] for f in q]) + self.weight
        gap = np.array([self.forces_at(v)["gap_top"] for v in speed])
        return {"speed": speed, "lift": lift, "gap": np.where(speed >= self.lowest_speed, gap, np.nan)}

    @property
    def weight(self) -> float:
        """m a_g (N)."""
        return self.model.parameters["mass"] * self.model.parameters["gravity"]

    @cached_property
    def lowest_speed(self) -> float:
        """Speed (m/s) at which the lift carries the weight at zero gap."""
        touching = -self.model.parameters["nominal_gap"] + 1e-12
        return float(brentq(lambda v: self.forces_at(v, touching)["force_heave"], 1.0, 40.0, xtol=1e-9))

    @cached_property
    def critical_speed(self) -> float:
        """Speed (m/s) at which thrust equals drag on the equilibrium heave."""
        return critical_speed(self.model)

    # -- Figure 4 ----------------------------------------------------------------------------------------------

    @cached_property
    def figure_4(self) -> Orbit:
        """Held at 20 m/s with η = 1, let go at the nominal gap: 20 swings."""
        model = self.before.with_changes(dof=1)
        start = model.initial_state(surge_rate=SPEED_4, heave=0.0)
        probe = model.simulate(np.arange(0, 0.5, 1e-4), start)
        rate = probe["heave_rate"]
        i = np.flatnonzero((rate[:-1] > 0) & (rate[1:] <= 0))[0]  # back at the top
        guess = probe.times[i]

        def top(t: float) -> float:
            return model.simulate(np.array([0.0, t]), start)["heave_rate"][-1]

        period = float(brentq(top, guess - 1e-3, guess + 2e-3, xtol=1e-13))
        run = model.simulate(np.linspace(0.0, 20 * period, 20 * 200 + 1), start)
        gap = run["gap_top"]
        return Orbit(
            run,
            period,
            gap,
            float(gap.min()),
            float(gap.max()),
            float(np.abs(run["heave_rate"]).max()),
            float(gap[0] - gap[-1]),
        )

    # -- Figure 6 ----------------------------------------------------------------------------------------------

    @cached_property
    def figure_6(self) -> dict[str, Array]:
        """Travel (m) in 2 s and the speed (m/s) then, over the initial speed."""
        speed = np.concatenate([np.arange(9.0, 15.5, 0.5), np.arange(15.5, 20.01, 0.1)])
        ends = [self.travel(v) for v in speed]
        return {"speed": speed, "travel": np.array([e[0] for e in ends]), "end_speed": np.array([e[1] for e in ends])}

    def travel(
        self, speed: float, duration: float = DURATION_6, model: Model | None = None, drive_current: float | None = None
    ) -> tuple[float, float]:
        """Travel (m) and speed (m/s) after ``duration`` s from a start on the equilibrium heave."""
        model = model or self.model
        run = model.simulate(
            np.array([0.0, duration]), model.initial_state(surge_rate=speed, drive_current=drive_current), drive_current
        )
        return float(run["surge"][-1]), float(run["surge_rate"][-1])

    # -- Figures 7 and 10 --------------------------------------------------------------------------------------

    @cached_property
    def times(self) -> Array:
        """Rows of Figures 7 and 10 (s)."""
        return np.linspace(0.0, DURATION_7, int(DURATION_7 * RATE) + 1)

    @cached_property
    def figure_7(self) -> Trajectory:
        """2-DOF, started at 15.5 m/s on the equilibrium heave."""
        model = self.model.with_changes(dof=2)
        return model.simulate(self.times, model.initial_state(**START_7))

    @cached_property
    def figure_7_forces(self) -> dict[str, Array]:
        """Times, net magnetic lift, drag, thrust and contact force (N) along Figure 7, at every tenth row."""
        run, model = self.figure_7, self.model.with_changes(dof=2)
        rows = slice(None, None, 10)
        wrenches = [model.wrenches(x) for x in run.states[rows]]
        return {
            "times": run.times[rows],
            "lift": np.array([w["lift"][2] for w in wrenches]),
            "drag": -np.array([w["drag"][0] for w in wrenches]),
            "thrust": np.array([w["thrust"][0] for w in wrenches]),
            "contact": np.array([w["contact"][2] for w in wrenches]),
        }

    @cached_property
    def figure_7_as_4dof(self) -> Trajectory:
        """The same with all four coordinates free."""
        return self.model.simulate(self.times, self.model.initial_state(**START_7))

    @cached_property
    def figure_10(self) -> Trajectory:
        """4-DOF, started 4 mm to the left at −0.1 m/s."""
        return self.model.simulate(self.times, self.model.initial_state(**START_10))

    @cached_property
    def figure_10_moment(self) -> dict[str, Array]:
        """Times, slip force (N) and roll moment (N·m) of the magnets along Figure 10."""
        run = self.figure_10
        wrenches = [self.model.wrenches(x) for x in run.states[::4]]
        return {
            "times": run.times[::4],
            "slip": np.array([w["lift"][1] for w in wrenches]),
            "moment": np.array([w["lift"][3] for w in wrenches]),
        }

    @cached_property
    def first_touch(self) -> float:
        """Time (s) of the first contact of Figure 7."""
        return first_zero(self.figure_7.times, self.figure_7["gap_top"])

    @cached_property
    def second_touch(self) -> float:
        """Time (s) at which a side array first touches in Figure 10."""
        return second_touch(self.figure_10)

    @cached_property
    def second_touch_range(self) -> tuple[float, float]:
        """The same over other assumed geometries: roll inertia and the arrays' places each a tenth smaller and larger;
        infinite: not in 6 s."""
        times = np.linspace(0.0, 6.0, 6 * RATE + 1)
        found = []
        for name in ("roll_inertia", "magnet_top_height", "magnet_side_offset", "magnet_side_height"):
            for factor in (0.9, 1.1):
                model = self.model.with_changes({name: self.model.parameters[name] * factor})
                found.append(second_touch(model.simulate(times, model.initial_state(**START_10))))
        found = [f if np.isfinite(f) else np.inf for f in found]
        return min(found), max(found)


def critical_speed(model: Model) -> float:
    """Speed (m/s) at which thrust equals drag on the equilibrium heave."""

    def surplus(speed: float) -> float:
        return model.quantities(model.initial_state(surge_rate=speed))["force_surge"]

    return float(brentq(surplus, 3.0, 60.0, xtol=1e-9))


def second_touch(run: Trajectory) -> float:
    """When the first of the side arrays touches (s); NaN if none does."""
    found = [first_zero(run.times, run[gap]) for gap in ("gap_right", "gap_left")]
    return float(np.nanmin(found)) if np.isfinite(found).any() else float("nan")


def first_zero(times: Array, values: Array) -> float:
    """Time of the first fall through zero, between rows by a straight line; NaN if there is none."""
    below = np.flatnonzero(values <= 0)
    if not len(below):
        return float("nan")
    i = below[0]
    if i == 0:
        return float(times[0])
    return float(times[i - 1] + (times[i] - times[i - 1]) * values[i - 1] / (values[i - 1] - values[i]))
