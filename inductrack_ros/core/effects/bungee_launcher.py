# SPDX-License-Identifier: Apache-2.0
"""A bungee pulls the cradle off at the start of the track."""

from . import Parameter, effect


def strokes(ranges):
    """A stroke that ends in the runs, or behind them."""
    low, high = ranges["surge"]
    return [{"stroke": max(low + part * (high - low), 0.05)} for part in (0.1, 0.3, 0.6, 1.1)]


@effect(
    adds="force_surge",
    starts=strokes,
    parameters={
        "stiffness": Parameter(0.0, "N/m", 0.0, 1e6, "stiffness k of the bungee", "load test", typical=5.0),
        "stroke": Parameter(1.0, "m", 0.0, 1e3, "travel at which the bungee is slack", "drawings", typical=0.05),
    },
)
def bungee_launcher(surge, stiffness, stroke):
    """A bungee launcher, F_z += k·max(stroke − z, 0)."""
    return stiffness * max(stroke - surge, 0.0)
