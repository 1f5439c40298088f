# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction where an array touches the track."""

from . import Parameter, effect


@effect(
    adds="force_surge",
    parameters={"coefficient": Parameter(0.0, "", 0.0, 5.0, "friction coefficient μ", "Coulomb", typical=0.1)},
)
def sliding_friction(surge_rate, normal_force, coefficient):
    """Sliding friction, −μ N sgn v, N the sum of the contacts' normal forces."""
    if surge_rate > 0.0:
        return -coefficient * normal_force
    if surge_rate < 0.0:
        return coefficient * normal_force
    return 0.0
