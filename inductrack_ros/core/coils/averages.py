# SPDX-License-Identifier: Apache-2.0
"""What a track of single coils does on average: steady forces, ripple, stiffness and damping in heave.

These are the numbers that the averaged law and the effect `coil_current_dynamics` are compared with (docs/coils.md)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..kernel import QUANTITIES
from ..model import Model
from ..state import INDEX, STATES
from .flight import STEP_TIME, STEP_TRAVEL
from .track import Coils, Path

Array = NDArray[np.float64]

#: Where flights are level and coils whole: far behind the first coil that has a number (m).
BEHIND = -100.0
#: Heave of each array's gap, top, right and left.
_BY_HEAVE = np.array([1.0, -np.sqrt(0.5), -np.sqrt(0.5)])
#: Amplitude of the heave in which damping is measured, over the wavelength, and periods: a first one to settle.
_AMPLITUDE, _PERIODS = 1e-3, 4


@dataclass(frozen=True)
class Heave:
    """Small motions in heave at a held ``speed`` (m/s): ``stiffness`` (N/m), ``frequency`` (Hz), ``damping``
    (N·s/m)."""

    speed: float
    stiffness: float
    frequency: float
    damping: float


def level(model: Model, speed: float, heave: float) -> Array:
    """The kernel's quantities in level flight at ``speed`` (m/s) and ``heave`` (m)."""
    x = np.zeros(len(STATES))
    x[INDEX["surge"]], x[INDEX["surge_rate"]], x[INDEX["heave"]] = BEHIND, speed, heave
    found = model.quantities(x)
    return np.array([found[name] for name in QUANTITIES])


def lift_of(forces: Array) -> Array:
    """Vertical force (N) of repulsions in the last axis: the side arrays push down."""
    return forces[..., :3] @ _BY_HEAVE


def _coils(model: Model) -> Coils:
    """The coils of a model that has them."""
    if model.coils is None:
        raise ValueError("an averaged track has no coils; give a model with track: coils")
    return model.coils


def mean_forces(model: Model, speed: float, heave: float) -> Array:
    """Repulsion of the top, right and left array and drag (4,), N, over one pitch of whole coils."""
    return _coils(model).mean_forces(BEHIND, speed, level(model, speed, heave))


def ripple(model: Model, speed: float, heave: float) -> tuple[float, float]:
    """How much lift and drag (N) swing within one pitch, from least to most."""
    coils = _coils(model)
    forces = coils.steady(BEHIND, speed, level(model, speed, heave), coils.settings.pitch).forces
    return float(np.ptp(lift_of(forces))), float(np.ptp(forces[:, 3]))


def heave_motion(model: Model, speed: float) -> Heave:
    """Stiffness about the equilibrium, and what a swing at the natural frequency gives the coils: −⟨F ḣ⟩/⟨ḣ²⟩."""
    heave, mass, step = model.equilibrium_heave(speed), model.parameters["mass"], 1e-4 * model.parameters["wavelength"]
    up, down = (lift_of(mean_forces(model, speed, heave + s)) for s in (step, -step))
    stiffness = float(down - up) / (2.0 * step)
    rate = np.sqrt(stiffness / mass)
    path, swing, swing_rate = _swing(model, speed, level(model, speed, heave), rate)
    late = slice(len(swing) // _PERIODS, len(swing) - 1)  # whole periods, after the first
    force = lift_of(path.forces)[late]
    damping = -float(np.mean((force - force.mean()) * swing_rate[late]) / np.mean(swing_rate[late] ** 2))
    return Heave(speed, stiffness, float(rate / (2.0 * np.pi)), damping)


def _swing(model: Model, speed: float, q: Array, rate: float) -> tuple[Path, Array, Array]:
    """Coils under a cradle that swings in heave at ``rate`` (rad/s): the path, the swing (m) and its rate (m/s)."""
    coils, wavelength = _coils(model), model.parameters["wavelength"]
    inductance, resistance = (q[QUANTITIES.index(n)] for n in ("inductance", "resistance"))
    longest = min(STEP_TIME * inductance / resistance, STEP_TRAVEL * wavelength / speed)
    period = 2.0 * np.pi / rate
    times = np.linspace(0.0, _PERIODS * period, _PERIODS * int(np.ceil(period / longest)) + 1)
    swing = _AMPLITUDE * wavelength * np.sin(rate * times)
    gaps = q[:3] + np.outer(swing, _BY_HEAVE)
    path = coils.follow(times, BEHIND + speed * times, gaps, q, coils.steady(BEHIND, speed, q).tail)
    return path, swing, _AMPLITUDE * wavelength * rate * np.cos(rate * times)
