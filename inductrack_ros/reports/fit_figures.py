# SPDX-License-Identifier: Apache-2.0
"""Figures of an identification: profile likelihoods, and distances measured minus fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..estimation.identify import Profile
from .drawing import BLUE, ORANGE, at, axes, dots, line
from .page import Figure
from .words import SYMBOL


def profiles(found: Sequence[Profile], truth: Sequence[float] | None = None) -> Figure:
    """Profile likelihoods, one panel a parameter, with the 95 % interval shaded."""
    n = len(found)
    data, layout = [], {"annotations": [], "shapes": [], "showlegend": False}
    for k, p in enumerate(found):
        axis = "" if k == 0 else str(k + 1)
        name = SYMBOL.get(p.name, p.name)
        data.append(
            line(
                p.values,
                p.rise,
                name,
                BLUE,
                xaxis=f"x{axis}",
                yaxis=f"y{axis}",
                mode="lines+markers",
                marker={"size": 5, "color": BLUE},
            )
        )
        low, high = max(p.low, p.values[0]), min(p.high, p.values[-1])
        layout["shapes"] += _interval(axis, low, high, p.threshold)
        if truth is not None:
            shape, note = at(truth[k], "true", ORANGE, f"x{axis}", up=0.98)
            layout["shapes"].append(shape)
            layout["annotations"].append(note)
        width = 1 / n
        layout[f"xaxis{axis}"] = {
            "title": name,
            "domain": [k * width + (0.06 if k else 0), (k + 1) * width - 0.01],
            "anchor": f"y{axis}",
            "nticks": 5,
        }
        layout[f"yaxis{axis}"] = {
            "title": "rise of the misfit (σ²)" if k == 0 else "",
            "anchor": f"x{axis}",
            "range": [-0.2, 2.2 * p.threshold],
        }
    return Figure(data, layout, "Profile likelihood of each parameter with its 95 % interval", 300)


def _interval(axis: str, low: float, high: float, threshold: float) -> list[dict[str, object]]:
    """The shaded interval, and the line at the misfit's rise that bounds it."""
    here = {"xref": f"x{axis}", "yref": f"y{axis} domain", "x0": low, "x1": high, "y0": 0, "y1": 1}
    across = {"xref": f"x{axis} domain", "yref": f"y{axis}", "x0": 0, "x1": 1, "y0": threshold, "y1": threshold}
    return [
        here | {"type": "rect", "fillcolor": "@band", "line": {"width": 0}, "layer": "below"},
        across | {"type": "line", "line": {"color": "@soft", "width": 1, "dash": "dash"}},
    ]


def distances(speed: np.ndarray, left: np.ndarray, std: np.ndarray) -> Figure:
    """What is left of each distance after the fit (m), with its standard deviation."""
    bars = {"type": "data", "array": std.tolist(), "color": BLUE}
    data = [dots(speed, left, "measured − fitted", BLUE, error_y=bars)]
    layout = axes("initial speed (m/s)", "distance: measured − fitted (m)", showlegend=False)
    return Figure(data, layout, "Distances measured minus fitted, with their standard deviation", 300)
