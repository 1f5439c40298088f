# SPDX-License-Identifier: Apache-2.0
"""Pictures of what `inductrack check` found: the samples that are meant among those beside them."""

from __future__ import annotations

import numpy as np

from ..checks.check import Check
from ..checks.finding import CALLED, IMPOSSIBLE, Finding
from ..core.state import UNITS
from ..data import Run
from .page import Figure, Page, packed
from .words import shown, title

#: Samples shown beside the first one that is meant; and of a channel that is meant as a whole.
BESIDE, MANY = 60, 400
#: Nothing is drawn larger than this; above this many thousandths the unit itself reads better.
LARGEST, READABLE = 1e30, 1e4
#: Findings about a whole channel, of which its beginning is shown.
WHOLE = ("constant", "quantised", "turned", "zero")


def picture(page: Page, result: Check, finding: Finding) -> str:
    """The samples around the first that a finding is about, those meant marked; nothing for one that names none."""
    if "off" in finding.size:
        return page.figure(_motion(finding), f"{finding.text}.")
    if finding.kind in ("clock_jump", "hole") and "sample" in finding.size:
        run = next(r for r in result.campaign.runs if r.name == finding.run)
        return page.figure(_clock(run, finding), f"{run.name}: {finding.text}.")
    if finding.kind == "rest":
        return _release(page, result, finding)
    if {_whole(finding), finding.channel or ""} <= UNITS.keys():
        return _derivative(page, result, finding)
    if finding.channel not in UNITS or (not finding.samples and finding.kind not in WHOLE):
        return ""
    if not finding.samples:
        return _beginning(page, result, finding)
    name, rows = next(iter(finding.samples.items()))
    run = next(r for r in result.campaign.runs if r.name == name)
    first, last = max(rows[0] - BESIDE, 0), min(rows[0] + BESIDE + 1, len(run.times))
    marked = np.array([i for i in rows if first <= i < last])
    factor, unit = _scale(finding.channel, run[finding.channel][first:last])
    others = np.setdiff1d(np.arange(first, last), marked)
    values = np.clip(run[finding.channel], -LARGEST, LARGEST) * factor
    axis = title(finding.channel).lower()
    seen = others[~np.isnan(values[others])]
    if finding.channel == "surge" and len(seen) > 1:  # its travel would hide all else
        values = values - np.polynomial.Polynomial.fit(run.times[seen], values[seen], 1)(run.times)
        axis = "off a steady travel"
    data = [
        _dots(run, others, values, "@measured", "measured" if finding.severity == IMPOSSIBLE else "used"),
        _dots(run, marked, values, "@before", CALLED[finding.severity], meant=True),
    ]
    layout = {"xaxis": {"title": "time, s"}, "yaxis": {"title": f"{axis}, {unit}"}, "margin": {"t": 10}}
    return page.figure(
        Figure(data, layout, f"{title(finding.channel)} of {name}: {finding.text}", 260), f"{name}: {finding.text}."
    )


def _scale(channel: str, values: np.ndarray) -> tuple[float, str]:
    """What a channel is multiplied by for a picture, and the unit that it then has."""
    factor, unit = shown(channel)
    if np.nanmax(np.abs(values), initial=0.0) * factor > READABLE:
        return 1.0, UNITS[channel]
    return factor, unit


def _beginning(page: Page, result: Check, finding: Finding) -> str:
    """The first samples of a channel that is meant as a whole."""
    channel = str(finding.channel)
    run = next((r for r in result.campaign.runs if channel in r.channels), None)
    if run is None:
        return ""
    rows = np.flatnonzero(~np.isnan(run[channel]))[:MANY]
    factor, unit = _scale(channel, run[channel][rows])
    data = [_dots(run, rows, run[channel] * factor, "@measured", "measured")]
    layout = {"xaxis": {"title": "time, s"}, "yaxis": {"title": f"{title(channel).lower()}, {unit}"}}
    figure = Figure(data, layout | {"margin": {"t": 10}}, f"{title(channel)} of {run.name}: {finding.text}", 260)
    return page.figure(figure, f"{run.name}: {finding.text}.")


def _release(page: Page, result: Check, finding: Finding) -> str:
    """The travel about the sample at which the cradle is let go."""
    name, rows = next(iter(finding.samples.items()))
    run = next(r for r in result.campaign.runs if r.name == name)
    channel = "surge" if "surge" in run.channels else "surge_rate"
    first, last = max(rows[-1] - BESIDE, 0), min(rows[-1] + BESIDE + 1, len(run.times))
    factor, unit = _scale(channel, run[channel][first:last])
    values = run[channel] * factor
    data = [
        _dots(run, np.arange(rows[-1] + 1, last), values, "@measured", "used"),
        _dots(run, np.arange(first, rows[-1] + 1), values, "@before", CALLED[finding.severity], meant=True),
    ]
    layout = {"xaxis": {"title": "time, s"}, "yaxis": {"title": f"{title(channel).lower()}, {unit}"}}
    figure = Figure(data, layout | {"margin": {"t": 10}}, f"{title(channel)} of {name}: {finding.text}", 260)
    return page.figure(figure, f"{finding.text}.")


def _whole(finding: Finding) -> str:
    """The channel whose derivative a finding is about; empty for none."""
    return str(finding.size.get("of") or finding.size.get("whole") or "")


def _derivative(page: Page, result: Check, finding: Finding) -> str:
    """A channel as it is written, beside what it is the derivative of says that it should be."""
    whole, channel = _whole(finding), str(finding.channel)
    order = 2 if channel.endswith("_acceleration") and not whole.endswith("_rate") else 1
    names = finding.size.get("runs") or [r.name for r in result.campaign.runs]
    held = [r for r in result.campaign.runs if r.name in names and {whole, channel} <= set(r.channels)]
    if not held:
        return ""
    run = held[0]
    rows = np.flatnonzero(~np.isnan(run[whole]) & ~np.isnan(run[channel]))[:MANY]
    near = min(8, (len(rows) - 1) // (2 * order))  # samples on each side: fewer would show noise
    if near < 1:
        return ""
    times, should = run.times[rows], run[whole][rows]
    for _ in range(order):
        should = (should[2 * near :] - should[: -2 * near]) / (times[2 * near :] - times[: -2 * near])
        times = times[near:-near]
    factor, unit = _scale(channel, np.concatenate([run[channel][rows], should]))
    of = f"{'second ' * (order - 1)}derivative of {title(whole).lower()}"
    data = [
        _line(times, should * factor, "@after", of),
        _dots(run, rows, run[channel] * factor, "@before", f"{title(channel).lower()} as written"),
    ]
    layout = {"xaxis": {"title": "time, s"}, "yaxis": {"title": unit}, "margin": {"t": 10}}
    return page.figure(Figure(data, layout, f"{run.name}: {finding.text}", 260), f"{run.name}: {finding.text}.")


def _line(times: np.ndarray, values: np.ndarray, colour: str, name: str) -> dict[str, object]:
    line = {"color": colour, "width": 2}
    return {"type": "scatter", "mode": "lines", "name": name, "x": packed(times), "y": packed(values), "line": line}


def _clock(run: Run, finding: Finding) -> Figure:
    """The times of the samples around a jump of the clock, those behind it marked."""
    jump = int(finding.size["sample"])
    rows = np.arange(max(jump - BESIDE, 0), min(jump + BESIDE, len(run.times)))
    data = [
        {
            "type": "scatter", "mode": "markers", "name": name, "x": packed(mine + 1.0), "y": packed(run.times[mine]),
            "marker": {"color": colour, "size": 5},
        }
        for name, mine, colour in (
            ("before", rows[rows < jump], "@measured"), ("behind", rows[rows >= jump], "@before"),
        )
    ]  # fmt: skip
    layout = {"xaxis": {"title": "sample"}, "yaxis": {"title": "time, s"}, "margin": {"t": 10}}
    return Figure(data, layout, f"Times of {run.name}: {finding.text}", 260)


def _motion(finding: Finding) -> Figure:
    """Bars of how far each channel is from the model's motion, as it is written and, where that is known, as it may be
    meant."""
    off, then = finding.size["off"], finding.size.get("then")
    channels = [c for c in off if then is None or c in then]
    readings = [("as written", off, "@before")] + ([("as it may be meant", then, "@after")] if then else [])
    bars = [
        {
            "type": "bar",
            "orientation": "h",
            "name": name,
            "y": [title(c) for c in channels],
            "x": [min(f[c], 2.0) for c in channels],
            "marker": {"color": colour},
        }
        for name, f, colour in readings
    ]
    layout = {
        "barmode": "group",
        "xaxis": {"title": "off the model's motion; 0 is the same, 1 has nothing in common", "rangemode": "tozero"},
        "yaxis": {"autorange": "reversed", "automargin": True},
        "margin": {"t": 10},
    }
    return Figure(
        bars,
        layout,
        f"How far each channel is from the model's motion, {' and '.join(name for name, _, _ in readings)}",
        130 + 44 * len(channels),
        fixed=True,
    )


def _dots(
    run: Run, rows: np.ndarray, values: np.ndarray, colour: str, name: str, meant: bool = False
) -> dict[str, object]:
    """Dots of some samples, or crosses where they are those that a finding is about."""
    return {
        "type": "scatter", "mode": "markers", "name": name, "x": packed(run.times[rows]), "y": packed(values[rows]),
        "marker": {"color": colour, "size": 10 if meant else 5, "symbol": "x" if meant else "circle"},
    }  # fmt: skip
