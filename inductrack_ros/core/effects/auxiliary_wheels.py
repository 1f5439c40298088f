# SPDX-License-Identifier: Apache-2.0
"""The landing wheels: they carry the cradle where the magnets do not."""

from . import Parameter, effect


def heights(ranges):
    """Wheels that touch in a part of what the runs flew."""
    low, high = ranges["gap_top"]
    return [{"height": max(low + part * (high - low), 0.0)} for part in (0.1, 0.3, 0.6)]


@effect(
    adds=("force_surge", "force_heave", "moment_roll"),
    starts=heights,
    parameters={
        "height": Parameter(0.0, "m", 0.0, 0.1, "top gap h_w below which the wheels touch", "drawings", typical=2e-4),
        "stiffness": Parameter(0.0, "N/m", 0.0, 1e9, "stiffness k of wheels and tyres", "load test", typical=1e4),
        "damping": Parameter(0.0, "N·s/m", 0.0, 1e6, "damping c of wheels and tyres", "load test", typical=50.0),
        "rolling_resistance": Parameter(0.0, "", 0.0, 1.0, "rolling resistance μ_r", "load test", typical=0.01),
    },
)
def auxiliary_wheels(gap_top, gap_top_rate, arm_top_x, surge_rate, height, stiffness, damping, rolling_resistance):
    """Landing wheels, N = max(k(h_w − g_1) − c ġ_1, 0) where g_1 < h_w: up at the top array, and −μ_r N sgn v."""
    if gap_top >= height:
        return 0.0, 0.0, 0.0
    load = max(stiffness * (height - gap_top) - damping * gap_top_rate, 0.0)
    way = 1.0 if surge_rate > 0.0 else -1.0 if surge_rate < 0.0 else 0.0
    return -rolling_resistance * load * way, load, load * arm_top_x
