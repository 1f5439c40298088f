# SPDX-License-Identifier: Apache-2.0
"""Figures of a diagnosis: the error as effects are added, what would have shown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ..diagnosis.result import Diagnosis, Limit, Step
from .diagnosis_words import declared, finite, full, of_sensor
from .page import Figure
from .words import effect_name, listed, number, ratio


def steps_figure(result: Diagnosis) -> Figure:
    names = [step_name(s, before) for s, before in zip(result.steps, [None, *result.steps], strict=False)]
    fitted = [math.sqrt(s.reduced_chi2) for s in result.steps]
    held = [s.heldout_nrmse for s in result.steps]
    above = [finite(h) and h > f for f, h in zip(fitted, held, strict=True)]  # the label that is not between the lines

    def line(values: Sequence[float], name: str, colour: str, top: Sequence[bool], dash: str) -> dict[str, Any]:
        return {
            "type": "scatter",
            "mode": "lines+markers+text",
            "name": name,
            "x": names,
            "y": [v if finite(v) else None for v in values],
            "text": [ratio(v) for v in values],
            "textposition": ["top center" if t else "bottom center" for t in top],
            "textfont": {"color": colour},
            "cliponaxis": False,
            "line": {"color": colour, "width": 2.5, "dash": dash},
            "marker": {"size": 9, "color": colour},
            "hovertemplate": "%{x}: %{text} × noise",
        }

    data = [line(fitted, "runs in the fit", "@after", [not a for a in above], "solid")]
    if any(finite(h) for h in held):
        data.append(line(held, "runs left out", "@before", above, "dot"))
    values = [v for v in [*fitted, *held] if finite(v) and v > 0]
    least, most = min([*values, 1.0]), max(values)
    if most > 3.0:
        scale = {"type": "log", "range": [math.log10(least * 0.6), math.log10(most * 1.9)], "dtick": 1}
    else:
        pad = 0.25 * max(most - least, 0.1)
        scale = {"range": [least - pad, most + pad]}
    layout = {
        "xaxis": {"type": "category", "range": [-0.35, len(names) - 0.65], "ticks": ""},
        "yaxis": {"title": "error / noise", **scale},
        "shapes": [_line_at_one("y")],
    }
    return Figure(
        data, layout, "Error over noise as effects are added, in the fit and on runs left out", 330, fixed=True
    )


def step_name(step: Step, before: Step | None) -> str:
    new = [e for e in step.effects if before is None or e not in before.effects]
    if before is None:
        return "the model, refitted" if not new else listed([effect_name(e) for e in new])
    return "+ " + listed([effect_name(e) for e in new])


def _line_at_one(axis: str) -> dict[str, Any]:
    along, across = ("x", "y") if axis == "y" else ("y", "x")
    line = {"color": "@good", "width": 1.5, "dash": "dash"}
    return {
        "type": "line",
        f"{along}ref": "paper",
        f"{along}0": 0,
        f"{along}1": 1,
        f"{across}0": 1,
        f"{across}1": 1,
        "line": line,
    }


def limits_figure(result: Diagnosis) -> Figure:
    # A sensor's faults are in the table.
    shares = {x.name: share(result, x) for x in result.limits if not of_sensor(result, x.name)}
    rows = sorted((x for x in result.limits if finite(shares.get(x.name))), key=lambda x: -shares[x.name])
    data = {
        "type": "bar",
        "orientation": "h",
        "y": [effect_name(x.name) for x in rows],
        "x": [shares[x.name] for x in rows],
        "marker": {"color": "@after"},
        "text": [limit_size(result, x) for x in rows],
        "textposition": "outside",
        "cliponaxis": False,
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }
    layout = {
        "xaxis": {"type": "log", "title": "smallest size that would have shown / size that matters", "dtick": 1},
        "yaxis": {"ticks": "", "tickfont": {"size": 11}, "dtick": 1},
        "margin": {"l": 8, "r": 110, "t": 8, "b": 8},
        "shapes": [_line_at_one("x")],
    }
    label = "Smallest size of each effect that would have shown; the table below has the numbers"
    return Figure([data], layout, label, 70 + 17 * len(rows), fixed=True)


def share(result: Diagnosis, limit: Limit) -> float:
    """A limit over the size that matters; where a smaller value is the larger effect, the other way round."""
    typical, _ = matters(result, limit)
    one = declared(result, full(limit.name, limit.parameter))
    grows = one.fit_as in ("x", "x^2")
    share = limit.size / typical if grows else typical / limit.size if limit.size else math.nan
    return share if share > 0 else math.nan


def matters(result: Diagnosis, limit: Limit) -> tuple[float, str]:
    """A size at which an effect matters, with its unit; an error in a channel's unit matters from ten times its
    noise."""
    channel = limit.name.partition(":")[2]
    one = declared(result, full(limit.name, limit.parameter))
    if one.per_channel == "size" and channel in result.noise:
        return 10 * result.noise[channel], one.unit
    return abs(one.typical or one.default) or math.nan, one.unit


def limit_size(result: Diagnosis, limit: Limit) -> str:
    shrinks = declared(result, full(limit.name, limit.parameter)).fit_as not in ("x", "x^2")
    return f"{'under ' if shrinks else ''}{number(limit.size, 2)} {matters(result, limit)[1]}".strip()
