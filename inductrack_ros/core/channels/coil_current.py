# SPDX-License-Identifier: Apache-2.0
"""The current in the track's coils."""

import math

from . import channel


@channel(unit="A", noise=1.0, span=1000.0, title="Coil current", rate=0.0)
def coil_current(current_lift, current_drag):
    """Amplitude of the current in a coil below the arrays, |jωΦ/(R + jωL)|."""
    return math.hypot(current_lift, current_drag)
