# SPDX-License-Identifier: Apache-2.0
"""The track's resistance is not what the drawing says."""

from . import Parameter, effect


@effect(
    changes="resistance",
    parameters={
        "relative_change": Parameter(0.0, "", -0.9, 10.0, "relative change ε of R", "a wrong constant", typical=0.02)
    },
)
def track_resistance(resistance, relative_change):
    """A wrong constant, R (1 + ε)."""
    return resistance * (1.0 + relative_change)
