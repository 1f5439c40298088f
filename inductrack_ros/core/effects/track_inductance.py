# SPDX-License-Identifier: Apache-2.0
"""The track's inductance is not what the drawing says."""

from . import Parameter, effect


@effect(
    changes="inductance",
    parameters={
        "relative_change": Parameter(0.0, "", -0.9, 10.0, "relative change ε of L", "a wrong constant", typical=0.02)
    },
)
def track_inductance(inductance, relative_change):
    """A wrong constant, L (1 + ε)."""
    return inductance * (1.0 + relative_change)
