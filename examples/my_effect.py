# SPDX-License-Identifier: Apache-2.0
"""An effect of one's own: a magnetised patch of the track pulls the cradle down as it passes.

    inductrack diagnose CAMPAIGN --effects examples/my_effect.py --output DIR

or, in a model's YAML, `effect_files: [my_effect.py]`, `effects: [magnetised_patch]`, `magnetised_patch: {force: 3.0}`.
"""

import math

from inductrack_ros.core.effects import Parameter, effect

HALF_LENGTH = 0.5  # m


def bell(distance):
    """1 on the spot, 0 far away."""
    return math.exp(-((distance / HALF_LENGTH) ** 2))


@effect(
    adds="force_heave",
    parameters={
        "force": Parameter(0.0, "N", 0.0, 1e3, "greatest pull", "guess", typical=1.0),
        "place": Parameter(8.0, "m", 0.0, 1e3, "where along the track", "guess", typical=0.5),
    },
)
def magnetised_patch(surge, force, place):
    """A magnetised patch, F_y −= F exp(−((z − z_0)/0.5 m)²)."""
    return -force * bell(surge - place)
