# SPDX-License-Identifier: Apache-2.0
"""Lines, dots and marks as plotly's JSON, for figures of several reports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from .page import packed

BLUE, ORANGE, GREEN, PURPLE = "@series-1", "@series-2", "@series-3", "@series-4"


def line(x: ArrayLike, y: ArrayLike, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """A line through points; ``more`` goes to plotly."""
    width = more.pop("width", 2)
    style = {"color": colour, "width": width, "dash": more.pop("dash", "solid")}
    return {"type": "scatter", "mode": "lines", "x": packed(x), "y": packed(y), "name": name, "line": style, **more}


def dots(x: ArrayLike, y: ArrayLike, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """Points without a line."""
    marker = {"color": colour, "size": more.pop("size", 7), "symbol": more.pop("symbol", "circle")}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": packed(x),
        "y": packed(y),
        "name": name,
        "marker": marker,
        **more,
    }


def at(
    x: float, words: str, colour: str = "@soft", axis: str = "x", up: float = 1.0, side: str = "left"
) -> tuple[dict, dict]:
    """A vertical line with words at its top: a shape and an annotation."""
    number_ = axis.removeprefix("x")
    shape = {
        "type": "line",
        "xref": axis,
        "yref": f"y{number_} domain",
        "x0": x,
        "x1": x,
        "y0": 0,
        "y1": 1,
        "line": {"color": colour, "width": 1, "dash": "dot"},
    }
    note = {
        "xref": axis,
        "yref": f"y{number_} domain",
        "x": x,
        "y": up,
        "text": words,
        "showarrow": False,
        "font": {"color": colour, "size": 12},
        "xanchor": side,
        "yanchor": "top",
        "xshift": 4 if side == "left" else -4,
        "bgcolor": "@page",
        "borderpad": 1,
    }
    return shape, note


def axes(x: str, y: str, marks: Sequence[tuple[dict, dict]] = (), **more: Any) -> dict[str, Any]:
    """A layout with titled axes and marks of `at`."""
    return {
        "xaxis": {"title": x, **more.pop("xaxis", {})}, "yaxis": {"title": y, **more.pop("yaxis", {})},
        "shapes": [m[0] for m in marks], "annotations": [m[1] for m in marks], **more,
    }  # fmt: skip
