# SPDX-License-Identifier: Apache-2.0
"""What the model gives for each claim of the paper: one short function a claim, named as in `facts.yaml`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import simpson

from ..core.model import Pulses
from . import air
from .facts import AGREES, CLOSE, DISAGREES, Claim
from .runs import SPEED_4, Runs, critical_speed
from .stability import Modes, corner_speed, modes, sign_change

__all__ = ["AGREES", "CLOSE", "DISAGREES", "Claims", "Row"]


@dataclass(frozen=True)
class Row:
    """One claim beside what the model gives; ``why`` is the paper's table's reason with the numbers filled in."""

    claim: Claim
    found: float
    verdict: str
    why: str


class Claims:
    """Numbers of the model for every claim, from the runs."""

    def __init__(self, runs: Runs):
        self.runs = runs
        self.facts, self.model = runs.facts, runs.model

    @cached_property
    def rows(self) -> list[Row]:
        """All claims in the order of the facts."""
        rows = []
        for claim in self.facts.claims.values():
            found = float(FOUND[claim.id](self))
            rows.append(Row(claim, found, claim.verdict(found), claim.why.format(**self.numbers)))
        return rows

    @cached_property
    def air(self) -> list[air.Air]:
        """Aerodynamic friction at 10, 20 and 40 m/s."""
        return air.put_to_the_test(self.model)

    @cached_property
    def at_critical_speed(self) -> Modes:
        """Small motions about steady flight at the critical speed."""
        return modes(self.model, self.runs.critical_speed)

    @cached_property
    def net_lift_to_drag(self) -> float:
        """Lift over drag of the whole cradle at 40 m/s on the equilibrium heave."""
        q = self.runs.forces_at(40.0)
        return self.runs.weight / q["magnetic_drag"]

    @cached_property
    def numbers(self) -> dict[str, float | str]:
        """Numbers that the reasons quote."""
        runs, p = self.runs, self.model.parameters
        coil_time = p["wavelength"] / 2 / 15.5
        m = self.at_critical_speed
        x = self.model.initial_state(surge_rate=runs.critical_speed, sway=0.004)
        force_4mm = abs(self.model.wrenches(x)["lift"][1])
        low, high = runs.second_touch_range
        just_above = self.model.simulate(np.array([0.0, 0.5]), self.model.initial_state(surge_rate=18.5))
        friction = {a.speed: a for a in self.air}
        return {
            "coils_in_600ms": 0.6 / coil_time,
            "coils_in_pulse": p["pulse_length"] / coil_time,
            "critical": runs.critical_speed,
            "critical_finite_pulse": critical_speed(self.model.with_changes(effects=["finite_pulse_width"])),
            "critical_true_impulse": critical_speed(self.model.with_changes({"gamma": 2 * p["gamma"]})),
            "critical_26_coils": critical_speed(
                self.model.with_changes({"coils_per_wavelength": 2 * p["coils_per_wavelength"]})
            ),
            "lift_to_drag": float(runs.corner_ratio(40.0)),
            "speed_for_200": 200 / float(runs.corner_ratio(1.0)),
            "net_lift_to_drag": self.net_lift_to_drag,
            "speed_after_half_a_second": float(just_above["surge_rate"][-1]),
            "doubling": np.log(2) / m.growth,
            "sway_share": m.sway_stiffness / m.heave_stiffness,
            "force_4mm": force_4mm,
            "force_4mm_weights": force_4mm / runs.weight,
            "travel_3s": float(runs.figure_7["surge"][-1]),
            "second_touch_low": low,
            "second_touch_high": f"{high:.1f} s" if np.isfinite(high) else "never",
            "air_10": 1e3 * friction[10.0].lost_powered,
            "air_20": 1e3 * friction[20.0].lost_powered,
            "air_40": 1e3 * friction[40.0].lost_powered,
        }

    @cached_property
    def beyond(self) -> dict[str, float]:
        """Numbers the paper does not print but its equations hold."""
        return {
            "lowest_speed": self.runs.lowest_speed,
            "corner_speed": corner_speed(self.model),
            "current_sign_change": sign_change(self.model, "current_damping", 8.0, 25.0),
            "both_sign_change": sign_change(self.model, "both_damping", 14.0, 40.0),
        }


def _contact_on_sides(claims: Claims) -> float:
    """Contact force in heave (N) with both side arrays 0.01 mm inside the track."""
    g0 = claims.model.parameters["nominal_gap"]
    heave = (g0 + 1e-5) / np.sqrt(0.5)  # g_2 = g_3 = g0 − √½ heave
    x = claims.model.initial_state(heave=heave, surge_rate=0.0)
    return claims.model.wrenches(x)["contact"][2]


def _impulse(claims: Claims) -> float:
    """Impulse (τ) of a drive pulse over its height: the model's own, with the cradle at rest over the coil."""
    model = claims.model.with_changes(drive="pulses")
    x, tau = model.initial_state(heave=0.0), model.parameters["pulse_length"]
    pulse = Pulses(np.zeros(1), np.zeros(1), np.array([model.parameters["drive_current"]]))
    share = np.linspace(0.0, 1.0, 401)
    thrust = np.array([model.quantities(x, s * tau, pulses=pulse)["thrust"] for s in share])
    return float(simpson(thrust, x=share) / thrust.max())


def _closed(claims: Claims) -> float:
    return 1e3 * abs(claims.runs.figure_4.lost)


def _sink(claims: Claims) -> float:
    """Depth (mm) of the top array in the track, at rest."""
    model = claims.model
    return -1e3 * (model.equilibrium_heave(0.0) + model.parameters["nominal_gap"])


def _drag_over_lift(claims: Claims) -> float:
    q = claims.runs.forces_at(15.5)
    return q["magnetic_drag"] / claims.runs.weight


def _apart(claims: Claims) -> float:
    """Largest difference (m) between the 2- and the 4-DOF run of Figure 7."""
    a, b = claims.runs.figure_7, claims.runs.figure_7_as_4dof
    return max(float(np.abs(a[c] - b[c]).max()) for c in ("surge", "sway", "heave"))


FOUND: dict[str, Callable[[Claims], float]] = {
    "drag_peak": lambda c: c.runs.figure_2["peak"][1],
    "drag_peak_at": lambda c: c.runs.figure_2["peak"][0],
    "pulse_length": lambda c: 1e3 * c.model.parameters["pulse_length"],
    "impulse": _impulse,
    "side_contact": _contact_on_sides,
    "lift_to_drag": lambda c: c.runs.corner_ratio(40.0),
    "coils": lambda c: c.model.parameters["coils_per_wavelength"],
    "critical_speed": lambda c: c.runs.critical_speed,
    "critical_speed_caption": lambda c: c.runs.critical_speed,
    "orbit_height": lambda c: 50 * (c.runs.figure_4.high - c.runs.figure_4.low),
    "orbit_speed": lambda c: c.runs.figure_4.fastest,
    "orbit_closed": _closed,
    "no_damping": lambda c: abs(modes(c.model, SPEED_4).held_damping),
    "no_damping_free": lambda c: c.at_critical_speed.coupling_damping,
    "stable_travel": lambda c: c.at_critical_speed.growth,
    "concentric": lambda c: c.at_critical_speed.sway_stiffness,
    "first_touch": lambda c: c.runs.first_touch,
    "sink": _sink,
    "stops": lambda c: c.runs.figure_7["surge_rate"][-1],
    "drag_three_lifts": _drag_over_lift,
    "same_as_2dof": _apart,
    "second_touch": lambda c: c.runs.second_touch,
    "air": lambda c: 100 * c.air[1].friction / c.air[1].magnetic_drag,
}
