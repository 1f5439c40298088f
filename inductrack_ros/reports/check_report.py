# SPDX-License-Identifier: Apache-2.0
"""The report of `inductrack check`: can these data be meant as they are written, what is set aside, what may
mislead."""

from __future__ import annotations

import math

import numpy as np

from ..checks.check import Check
from ..checks.finding import IMPOSSIBLE, SET_ASIDE, WARNING, Finding
from ..core.state import UNITS
from .check_pictures import picture
from .page import Figure, Page, findings_list, joined, markup, severity_word, table
from .words import in_channel, listed, number, shown, title

TONES = {"clean": "good", "usable": "warn", "impossible": "bad"}
#: Findings said on the first screen; pictures of where they are.
SAID, PICTURES = 5, 8


def check_report(result: Check) -> str:
    """The whole page."""
    page = Page(
        title=result.campaign.name,
        kind="The data, before any fit",
        verdict=verdict(result),
        tone=TONES[result.verdict],
        lead=_lead(result),
        notes=result.campaign.notes,
    )
    page.picture(page.figure(_noise(result), "Noise found from neighbouring samples, and as campaign.yaml states it."))
    if len(result.findings) > SAID:
        page.section("Findings", _findings(result))
    pictures = [picture(page, result, f) for f in result.findings]
    if shown_ := [p for p in pictures if p][:PICTURES]:
        page.section("Where", markup('<div class="two">{}</div>', joined(shown_)))
    page.section("Channels", _channels(result))
    page.section("Runs", _runs(result))
    return page.render()


# ---------------------------------------------------------------- the answer in words


def verdict(result: Check) -> str:
    """The answer in one sentence."""
    runs = "The one run" if len(result.campaign.runs) == 1 else f"All {len(result.campaign.runs)} runs"
    if result.verdict == "impossible":
        wrong = [f for f in result.findings if f.severity == IMPOSSIBLE]
        return "The data cannot be meant as they are written" + (
            f": {len(wrong)} things cannot be so." if len(wrong) > 1 else "."
        )
    if result.verdict == "clean":
        return (
            f"Nothing wrong was found in the data. {runs} can be used as"
            f" {'it is' if len(result.campaign.runs) == 1 else 'they are'}."
        )
    parts = [f for f in result.findings if f.severity == SET_ASIDE]
    hints = [f for f in result.findings if f.severity == WARNING]
    said = ([f"{len(parts)} thing{_s(parts)} {'is' if len(parts) == 1 else 'are'} left out"] if parts else []) + (
        [f"{len(hints)} thing{_s(hints)} may mislead"] if hints else []
    )
    return f"The data can be used; {listed(said)}."


def _s(things: list[Finding]) -> str:
    return "" if len(things) == 1 else "s"


def _lead(result: Check) -> str:
    said = result.findings[:SAID]
    if not said:
        channels = listed([title(c).lower() for c in result.channels])
        return markup(
            "<p>Looked at: clocks, single samples, sensors, noise, and whether {} fit each other and the model's"
            " motion.</p>",
            channels,
        )
    more = len(result.findings) - len(said)
    rest = markup('<p><a href="#findings">{} more</a></p>', more) if more else ""
    return findings_list(said) + rest


# ---------------------------------------------------------------- sections


def _findings(result: Check) -> str:
    rows = [
        [severity_word(f), title(f.channel) if f.channel in UNITS else f.run or "–", f.text, f.remedy or "–"]
        for f in result.findings
    ]
    return table(["", "where", "what", "what to do"], rows, words=4)


def _noise(result: Check) -> Figure:
    """Bars of noise found beside noise stated, each over the stated one (or over the found one where none is
    stated)."""
    channels = [c for c, about in result.channels.items() if math.isfinite(about.noise) and about.noise > 0]
    names = [title(c) for c in channels]
    stated = [result.campaign.noise_std.get(c) for c in channels]
    found = [result.channels[c].noise / (s or result.channels[c].noise) for c, s in zip(channels, stated, strict=True)]
    words = [
        in_channel(c, result.channels[c].noise) + ("" if s else ", none stated")
        for c, s in zip(channels, stated, strict=True)
    ]
    bars = {
        "type": "bar",
        "orientation": "h",
        "name": "found",
        "y": names,
        "x": found,
        "text": words,
        "textposition": "auto",
        "insidetextanchor": "start",
        "marker": {"color": ["@after" if 1 / 1.5 < f < 1.5 else "@before" for f in found]},
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }
    wide = bool(found) and (max(found) > 5 or min(found) < 0.2)
    axis = {"title": "noise found over noise stated", "type": "log" if wide else "linear", "zeroline": False}
    layout = {
        "xaxis": axis,
        "yaxis": {"autorange": "reversed", "automargin": True},
        "shapes": [
            {
                "type": "line",
                "x0": 1,
                "x1": 1,
                "yref": "paper",
                "y0": 0,
                "y1": 1,
                "line": {"color": "@good", "width": 1.5, "dash": "dash"},
            }
        ],
        "showlegend": False,
        "margin": {"t": 20},
    }
    return Figure([bars], layout, "Noise found over noise stated, by channel", 90 + 34 * len(channels), fixed=True)


def _channels(result: Check) -> str:
    rows = []
    for channel, about in result.channels.items():
        stated = result.campaign.noise_std.get(channel)
        runs = [run for run in result.campaign.runs if channel in run.channels]
        missing = sum(len(run.times) for run in runs) - about.count
        rows.append(
            [
                title(channel),
                f"{about.count}",
                f"{missing}" if missing else "–",
                f"{number(about.low * shown(channel)[0])} … {in_channel(channel, about.high)}",
                in_channel(channel, about.noise),
                in_channel(channel, stated) if stated else "not stated",
                in_channel(channel, about.step) if about.step > about.noise else "–",
            ]
        )
    caption = "98 % of the samples lie in the range; the noise is what neighbouring samples do not say of each other."
    return table(
        ["channel", "samples", "missing or left out", "range", "noise found", "noise_std", "step"], rows, caption
    )


def _runs(result: Check) -> str:
    rows = []
    for run in result.campaign.runs:
        steps = np.diff(run.times)
        rows.append(
            [
                run.name,
                "pulses" if run.pulses is not None else f"{run.drive_current:g} A",
                f"{len(run.times)}",
                f"{number(run.duration)} s",
                f"{number(1e3 * float(np.median(steps)))} ms",
                f"{number(1e3 * float(steps.max()))} ms",
            ]
        )
    return table(["run", "drive", "samples", "duration", "step", "longest step"], rows)
