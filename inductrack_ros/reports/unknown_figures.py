# SPDX-License-Identifier: Apache-2.0
"""Figures of an unknown force: its curve with the laws through it, and its surface over two variables."""

from __future__ import annotations

import numpy as np

from ..diagnosis.result import Diagnosis, Unknown
from .diagnosis_words import DEPENDS, law
from .drawing import dots
from .law_section import curves
from .page import Figure, packed
from .words import number

#: Lines of the surface's grid, each way.
GRID = 80
#: Colours of a force, from one way over none to the other.
_EITHER_WAY = [[0.0, "@series-2"], [0.5, "@page"], [1.0, "@series-1"]]


def usually(unknown: Unknown) -> str:
    """At what second variable a curve is drawn: `` at speed = 23.1 (SI)``; nothing where there is none."""
    if unknown.factor is None:
        return ""
    name, _, unit = DEPENDS[unknown.factor.variable][1].rpartition(", ")
    return f" at {name} = {number(unknown.factor.scale, 3)} {unit}"


def unknown_figure(result: Diagnosis) -> Figure:
    """The curve of an unknown force with its band, the best laws through it, and ticks where runs have been."""
    unknown = result.unknown
    assert unknown is not None
    named, (factor, unit), _ = law(unknown)
    at = np.asarray(unknown.at, float)
    force = factor * np.asarray(unknown.force, float)
    half = factor * np.asarray(unknown.band, float)
    quiet = {"type": "scatter", "mode": "lines", "showlegend": False}
    band = quiet | {
        "x": packed(np.concatenate([at, at[::-1]])),
        "y": packed(np.concatenate([force + half, (force - half)[::-1]])),
        "fill": "toself",
        "fillcolor": "@shade",
        "line": {"width": 0},
        "hoverinfo": "skip",
    }
    line = quiet | {
        "x": packed(at),
        "y": packed(force),
        "line": {"color": "@before", "width": 2.5},
        "hovertemplate": f"%{{x:.4g}}: %{{y:.3g}} {unit}<extra></extra>",
    }
    on = DEPENDS[unknown.depends_on[0]][1] if unknown.depends_on else ""
    ticks = quiet | {
        "mode": "markers",
        "x": packed(unknown.seen[:, 0]),
        "y": packed(np.full(len(unknown.seen), 0.02)),
        "yaxis": "y2",
        "marker": {"symbol": "line-ns-open", "size": 9, "color": "@measured", "opacity": 0.35},
        "hoverinfo": "skip",
    }
    what = named.split(" ", 1)[1]
    layout = {
        "xaxis": {"title": on},
        "yaxis": {"title": f"{what}, {unit}", "zeroline": True, "zerolinecolor": "@soft"},
        "yaxis2": {"overlaying": "y", "range": [0, 1], "visible": False, "fixedrange": True},
        "margin": {"l": 8, "r": 8, "t": 10, "b": 8},
    }
    laws = curves(result, unknown, factor)
    if laws:
        line |= {"showlegend": True, "name": "table"}
    return Figure([band, line, *laws, ticks], layout, f"The {what} that no effect explains over {on}", 330)


def surface_figure(unknown: Unknown) -> Figure:
    """A force over both of its variables, with dots where runs have been."""
    factor, seen = unknown.factor, unknown.seen
    assert factor is not None
    named, (times, unit), _ = law(unknown)
    low, high = (seen[:, 1].min(), seen[:, 1].max()) if len(seen) else (0.0, factor.scale)
    u = np.linspace(unknown.at[0], unknown.at[-1], GRID)
    w = np.linspace(low, high, GRID)
    curve = times * np.interp(u, unknown.at, unknown.force)
    surface = ((w / factor.scale) ** factor.power)[:, None] * curve
    most = float(np.abs(surface).max()) or 1.0
    what = named.split(" ", 1)[1]
    x, y = (DEPENDS[v][1] for v in unknown.depends_on[:2])
    heat = {
        "type": "heatmap",
        "x": packed(u),
        "y": packed(w),
        "z": packed(surface),
        "colorscale": _EITHER_WAY,
        "zmin": -most,
        "zmax": most,
        "colorbar": {"title": {"text": unit}, "thickness": 12},
        "hovertemplate": f"%{{x:.4g}}, %{{y:.4g}}: %{{z:.3g}} {unit}<extra></extra>",
    }
    been = dots(seen[:, 0], seen[:, 1], "where runs have been", "@ink", size=3, showlegend=False, opacity=0.45)
    layout = {"xaxis": {"title": x}, "yaxis": {"title": y}, "margin": {"l": 8, "r": 8, "t": 10, "b": 8}}
    return Figure([heat, been], layout, f"The {what} that no effect explains over {x} and {y}", 380)
