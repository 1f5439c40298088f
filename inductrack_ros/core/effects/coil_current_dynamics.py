# SPDX-License-Identifier: Apache-2.0
"""The coil current takes time to follow the field: two more states."""

from . import effect


@effect(
    changes=("current_lift", "current_drag"),
    states={"current_real": "current_lift", "current_imaginary": "current_drag"},
    max_step=2.5e-4,  # the envelope turns at ω and decays at R/L; this holds both up to 100 m/s
)
def coil_current_dynamics(current_real, current_imaginary, flux, flux_rate, omega, resistance, inductance):
    """Unsteady coil current, L dI/dt + (R + jωL) I = dΦ/dt + jωΦ (Post and Ryutov); lift ∝ Re I, drag ∝ Im I."""
    real_rate = (flux_rate - resistance * current_real) / inductance + omega * current_imaginary
    imaginary_rate = (omega * flux - resistance * current_imaginary) / inductance - omega * current_real
    return current_real, current_imaginary, real_rate, imaginary_rate
