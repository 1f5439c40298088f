# SPDX-License-Identifier: Apache-2.0
"""Where the coils' forces enter the equations: in place of (36) and (38), as an effect does.

It is no part of the catalogue: the kernel of a track of single coils has it, and `flight` writes its four parameters
before each step of the cradle."""

from __future__ import annotations

from ..effects import Effect, Parameter, effect

_FORCE = Parameter(0.0, "N", -1e12, 1e12, "from the coils' currents")

#: What the averaged law computes and single coils do not have: no effect may change it on a track of coils.
AVERAGED_ONLY = frozenset(
    {
        "wavelength", "wave_number", "coils_per_wavelength", "overlap_top", "overlap_right", "overlap_left", "overlap",
        "flux", "flux_rate", "reactance", "impedance_squared", "current_lift", "current_drag", "force_per_overlap",
        "repulsion_top", "repulsion_right", "repulsion_left", "magnetic_drag",
    }
)  # fmt: skip
#: What the coils take from the equations, as effects have it.
TAKEN = ("eta", "peak_field", "inductance", "resistance", "width_top", "width_right", "width_left")


@effect(
    changes=("repulsion_top", "repulsion_right", "repulsion_left", "magnetic_drag"),
    parameters={"top": _FORCE, "right": _FORCE, "left": _FORCE, "drag": _FORCE},
    screened=False,
)
def single_coils(top, right, left, drag):
    """Repulsion of each array and drag from the currents of single coils."""
    return top, right, left, drag


SEAM: Effect = single_coils


def averaged_change(item: Effect) -> str:
    """The quantity of the averaged law that an effect changes; empty where there is none."""
    return next((t for part in item.parts for t in part.changes if t in AVERAGED_ONLY), "")
