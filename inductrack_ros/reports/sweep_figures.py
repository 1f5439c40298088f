# SPDX-License-Identifier: Apache-2.0
"""Maps and lines of a sweep as plotly's JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..sweep.planned import Placed
from ..sweep.quantities import QUANTITY, Quantity
from ..sweep.sweep import Sweep
from .drawing import BLUE, ORANGE, dots, line
from .page import Figure, packed

#: Cells along an axis of a drawn map; the file of numbers has all of them.
CELLS = 200
#: A quantity that spreads over more than so many times its least value is drawn by its logarithm, over so many decades
#: at most.
WIDE, DECADES = 100.0, 4
#: What says little of a run once it has touched the track is drawn for runs that fly.
OF_FLIGHT = ("hover_gap", "peak_roll", "peak_sway", "swing_growth")
_FLIES = [[0.0, "@series-1"], [1.0, "@low"]]  # dark: near the track
_TOUCHES = [[0.0, "@series-2"], [1.0, "@page"]]
_PLAIN = [[0.0, "@low"], [1.0, "@series-1"]]


def outcome(sweep: Sweep, placed: Sequence[Placed]) -> Figure:
    """Where the cradle flies and how close to the track it comes, where it touches and how soon: one map, or two
    lines."""
    gap, contact = shown(sweep, "smallest_gap"), shown(sweep, "first_contact")
    gap = np.where(np.isnan(contact), gap, np.nan)
    label = "Smallest gap where the cradle flies, and time of the first contact where it touches the track"
    if len(sweep.plan.axes) == 1:
        return _two_lines(sweep, placed, gap, contact, label)
    bar = {"thickness": 12, "len": 0.48, "lenmode": "fraction", "xpad": 4, "tickfont": {"size": 11}}
    data = []
    if np.isfinite(contact).any():
        data.append(
            _heat(
                sweep,
                contact,
                "first contact",
                "s",
                _TOUCHES,
                bar | {"y": 0.0, "yanchor": "bottom", "title": {"text": "touches<br>after (s)", "font": {"size": 12}}},
                zmin=0.0,
                zmax=sweep.plan.duration,
            )
        )
    if np.isfinite(gap).any():
        data.append(
            _heat(
                sweep,
                gap,
                "smallest gap",
                "mm",
                _FLIES,
                bar | {"y": 1.0, "yanchor": "top", "title": {"text": "flies, least<br>gap (mm)", "font": {"size": 12}}},
                **dict(zip(("zmin", "zmax"), _bulk(gap[np.isfinite(gap)]), strict=True)),
            )
        )
        data.append(_contours(sweep, gap, "@ink"))
    data += runs_on_map(sweep, placed)
    return Figure(data, _map_layout(sweep), label, 430)


def single(
    sweep: Sweep, quantity: Quantity, values: np.ndarray | None = None, placed: Sequence[Placed] = (), words: str = ""
) -> Figure:
    """One quantity over the axes; ``values`` (shape of the map, SI) in place of its own."""
    factor, unit = quantity.shown
    flies = np.isnan(drawn(sweep, sweep.values["first_contact"]))
    table = (
        np.where(flies | (quantity.name not in OF_FLIGHT), shown(sweep, quantity.name), np.nan)
        if values is None
        else drawn(sweep, values) * factor
    )
    title = f"{words or quantity.title}{f' ({unit})' if unit else ''}{', of runs that fly' if quantity.name in OF_FLIGHT and not words else ''}"  # noqa: E501
    if len(sweep.plan.axes) == 1:
        own = values is None
        return _one_line(sweep, quantity, table, title, placed if own else (), with_band=own)
    finite = table[np.isfinite(table)]
    wide = finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min()
    bar: dict[str, Any] = {"thickness": 12, "xpad": 4, "tickfont": {"size": 11}}
    if wide:
        low, high = np.log10(max(finite.min(), finite.max() * 10.0**-DECADES)), np.log10(finite.max())
        ticks = np.arange(np.ceil(low), np.floor(high) + 1)
        bar |= {"tickvals": ticks.tolist(), "ticktext": [f"{10.0**t:g}" for t in ticks]}
    scaled = np.log10(np.maximum(table, 10.0**low)) if wide else table
    bounds = (
        {}
        if not finite.size
        else {"zmin": low, "zmax": high}
        if wide
        else dict(zip(("zmin", "zmax"), _bulk(finite), strict=True))
    )
    heat = _heat(
        sweep,
        scaled,
        quantity.title.lower(),
        unit,
        _FLIES if quantity.name.endswith("_gap") and values is None else _PLAIN,
        bar,
        **bounds,
    )
    if wide:
        heat["customdata"] = packed(table)
        heat["hovertemplate"] = heat["hovertemplate"].replace("%{z:.4g}", "%{customdata:.4g}")
    lines = [] if wide or np.unique(finite).size < 4 else [_contours(sweep, table, "@ink", bounds)]
    return Figure(
        [heat, *lines, *runs_on_map(sweep, placed, names=False)],
        _map_layout(sweep) | {"title": {"text": title, "font": {"size": 14}, "x": 0.01}},
        title,
        330,
    )


def runs_on_map(sweep: Sweep, placed: Sequence[Placed], names: bool = True) -> list[dict[str, Any]]:
    """The planned runs as dots with their names."""
    there = sorted((p for p in placed if p.on_the_map), key=lambda p: p.at[sweep.plan.axes[0].name])
    if not there:
        return []
    x, y = (np.array([p.at[a.name] for p in there]) for a in sweep.plan.axes)
    sides = _sides(sweep, x, y)
    more = (
        {
            "mode": "markers+text",
            "text": [f" {p.run.name} " for p in there],
            "textposition": sides,
            "textfont": {"size": 12},
        }
        if names
        else {"text": [p.run.name for p in there]}
    )
    trace = dots(
        x,
        y,
        "planned runs",
        "@page",
        size=9,
        hovertemplate="%{text}<extra></extra>",
        showlegend=False,
        cliponaxis=False,
        **more,
    )
    trace["marker"]["line"] = {"color": "@ink", "width": 2}
    return [trace]


def _sides(sweep: Sweep, x: np.ndarray, y: np.ndarray) -> list[str]:
    """Where the names of dots at x, rising, and y stand: on the right, but where the next dot or the map's edge is."""
    width, height = (np.ptp(a.values) for a in sweep.plan.axes)
    near_edge = x > sweep.plan.axes[0].values[-1] - 0.12 * width
    crowded = np.append((np.diff(x) < 0.12 * width) & (np.abs(np.diff(y)) < 0.04 * height), False)
    return ["middle left" if left else "middle right" for left in near_edge | crowded]


def shown(sweep: Sweep, name: str) -> np.ndarray:
    """A quantity's map as it is drawn: thinned, in the unit in which it is shown."""
    return drawn(sweep, sweep.values[name]) * QUANTITY[name].shown[0]


def drawn(sweep: Sweep, values: np.ndarray) -> np.ndarray:
    """Every so-manieth cell of a map, so that a page stays small."""
    return values[tuple(slice(None, None, s) for s in strides(sweep))]


def strides(sweep: Sweep) -> tuple[int, ...]:
    """Every how-manieth point of each axis is drawn."""
    return tuple(-(-n // CELLS) if len(sweep.plan.shape) > 1 else 1 for n in sweep.plan.shape)


# ---------------------------------------------------------------- pieces of maps


def _places(sweep: Sweep) -> list[np.ndarray]:
    return [a.values[::s] for a, s in zip(sweep.plan.axes, strides(sweep), strict=True)]


def _heat(
    sweep: Sweep, table: np.ndarray, what: str, unit: str, colours: list, bar: dict[str, Any], **more: Any
) -> dict[str, Any]:
    first, second = sweep.plan.axes
    x, y = _places(sweep)
    hover = (
        f"{first.name} %{{x:.4g}} {first.unit}<br>{second.name} %{{y:.4g}} {second.unit}<br>{what} %{{z:.4g}}"
        f" {unit}<extra></extra>"
    )
    return {
        "type": "heatmap",
        "x": packed(x),
        "y": packed(y),
        "z": packed(table.T),
        "colorscale": colours,
        "colorbar": bar,
        "hovertemplate": hover,
        "hoverongaps": False,
        **more,
    }


def _contours(sweep: Sweep, table: np.ndarray, colour: str, bounds: dict[str, float] | None = None) -> dict[str, Any]:
    x, y = _places(sweep)
    low, high = (bounds["zmin"], bounds["zmax"]) if bounds else _bulk(table[np.isfinite(table)])
    step = _round_step((high - low) / 6)
    levels = {
        "coloring": "none",
        "showlabels": True,
        "labelfont": {"size": 11, "color": colour},
        "start": float(np.ceil(low / step) * step),
        "end": high,
        "size": step,
    }
    return {
        "type": "contour",
        "x": packed(x),
        "y": packed(y),
        "z": packed(table.T),
        "contours": levels,
        "line": {"color": colour, "width": 1},
        "showscale": False,
        "showlegend": False,
        "hoverinfo": "skip",
        "connectgaps": False,
    }


def _bulk(finite: np.ndarray) -> tuple[float, float]:
    """Where most of the values lie: a few that run away do not take all colours."""
    low, high = (float(v) for v in np.percentile(finite, [1.0, 99.0]))
    return (low, high) if high > low else (float(finite.min()), float(max(finite.max(), finite.min() + 1e-12)))


def _round_step(size: float) -> float:
    """The nearest 1, 2 or 5 times a power of ten."""
    if not size > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(size))
    return float(power * min((1, 2, 5, 10), key=lambda m: abs(np.log(m * power / size))))


def _map_layout(sweep: Sweep) -> dict[str, Any]:
    first, second = sweep.plan.axes
    kinds = ["log" if a.logarithmic else "linear" for a in (first, second)]
    return {
        "xaxis": {"title": first.title, "type": kinds[0], "showgrid": False, "zeroline": False, **_whole(first)},
        "yaxis": {"title": second.title, "type": kinds[1], "showgrid": False, "zeroline": False, **_whole(second)},
        "margin": {"l": 8, "r": 8, "t": 34, "b": 8},
    }  # fmt: skip


def _whole(axis) -> dict[str, Any]:
    """The axis ends where its values do."""
    ends = np.log10(axis.values[[0, -1]]) if axis.logarithmic else axis.values[[0, -1]]
    room = 0.5 * (ends[1] - ends[0]) / max(len(axis.values) - 1, 1)
    return {"range": [float(ends[0] - room), float(ends[1] + room)]}


# ---------------------------------------------------------------- one axis


def _two_lines(sweep: Sweep, placed: Sequence[Placed], gap: np.ndarray, contact: np.ndarray, label: str) -> Figure:
    (axis,) = sweep.plan.axes
    data = [line(axis.values, gap, "smallest gap (mm), flies", BLUE, width=3)]
    if sweep.spread is not None:
        low, high = (
            np.where(sweep.spread.touching < 1, 1e3 * t["smallest_gap"], np.nan)
            for t in (sweep.spread.low, sweep.spread.high)
        )
        data = [*_band(axis.values, low, high, "90 % of the draws"), *data]
    data.append(line(axis.values, contact, "first contact (s), touches", ORANGE, width=3, yaxis="y2"))
    there = [p for p in placed if p.on_the_map]
    if there:
        where = np.array([p.at[axis.name] for p in there])
        data.append(
            dots(
                where,
                [1e3 * max(p.values["smallest_gap"], 0.0) for p in there],
                "planned runs",
                "@ink",
                size=9,
                text=[p.run.name for p in there],
                mode="markers+text",
                textposition="top center",
            )
        )
    layout = {
        "xaxis": {"title": axis.title, "type": "log" if axis.logarithmic else "linear"},
        "yaxis": {"title": "smallest gap (mm)", "rangemode": "tozero"},
        "yaxis2": {
            "title": {"text": "first contact (s)"},
            "overlaying": "y",
            "side": "right",
            "tickmode": "auto",
            "range": [0, sweep.plan.duration * 1.05],
            "showgrid": False,
        },
    }
    return Figure(data, layout, label, 400)


def _one_line(
    sweep: Sweep, quantity: Quantity, table: np.ndarray, title: str, placed: Sequence[Placed], with_band: bool
) -> Figure:
    (axis,) = sweep.plan.axes
    factor, _ = quantity.shown
    data = [line(axis.values, table, quantity.title, BLUE, showlegend=False)]
    if with_band and sweep.spread is not None:
        data = [
            *_band(
                axis.values,
                factor * sweep.spread.low[quantity.name],
                factor * sweep.spread.high[quantity.name],
                "90 % of the draws",
            ),
            *data,
        ]
    there = [p for p in placed if p.on_the_map and np.isfinite(p.values[quantity.name])]
    if there:
        data.append(
            dots(
                [p.at[axis.name] for p in there],
                [factor * p.values[quantity.name] for p in there],
                "planned runs",
                "@ink",
                size=8,
                text=[p.run.name for p in there],
                hovertemplate="%{text}<extra></extra>",
                showlegend=False,
            )
        )
    finite = table[np.isfinite(table)]
    wide = finite.size and finite.min() > 0 and finite.max() > WIDE * finite.min()
    layout = {
        "xaxis": {"title": axis.title, "type": "log" if axis.logarithmic else "linear"},
        "yaxis": {"title": quantity.shown[1], "type": "log" if wide else "linear"},
    }
    layout |= {
        "showlegend": False,
        "title": {"text": title, "font": {"size": 14}, "x": 0.01},
        "margin": {"l": 8, "r": 8, "t": 34, "b": 8},
    }
    return Figure(data, layout, title, 300)


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray, name: str) -> list[dict[str, Any]]:
    return [
        line(x, low, name, BLUE, width=0, showlegend=False, hoverinfo="skip"),
        line(x, high, name, BLUE, width=0, fill="tonexty", fillcolor="@band", hoverinfo="skip"),
    ]
