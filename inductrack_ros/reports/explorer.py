"""Traces the reader can choose: a run, a channel, which effects are on. Every combination was predicted beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .page import Page, packed, text
from .words import effect_name, shown, title

Array = NDArray[np.float64]

#: Samples drawn of one trace; of a longer one every second, third, … is shown.
MOST = 1500


@dataclass(frozen=True)
class Trace:
    """One channel of one run: times, measured, a prediction per variant, all (m,), SI; error over noise per variant."""

    times: Array
    measured: Array
    predicted: Sequence[Array]
    errors: Sequence[float]


@dataclass(frozen=True)
class RunTraces:
    """One run: its name, a few words about it, its channels."""

    name: str
    about: str
    traces: Mapping[str, Trace]


def explorer(
    page: Page,
    runs: Sequence[RunTraces],
    noise: Mapping[str, float],
    effects: Sequence[str] = (),
    variants: Sequence[Sequence[str]] = ((),),
    start: tuple[str, str] | None = None,
    words: tuple[str, str] = ("this model", "with the effects chosen"),
    well: bool = False,
) -> str:
    """HTML of the explorer.

    ``variants`` are the subsets of ``effects`` that were predicted, the first of them none; ``start`` is the run and
    the channel shown first; ``words`` name the first variant and the chosen one; ``well``: the first variant fits, so
    that it has no colour of alarm.
    """
    channels = [c for c in noise if any(c in r.traces for r in runs)]
    page.script(
        "explorer.js",
        "explorer",
        {
            "runs": [
                {"name": r.name, "about": r.about, "channels": {c: _trace(c, t) for c, t in r.traces.items()}}
                for r in runs
            ],
            "channels": {
                c: {"title": title(c), "unit": shown(c)[1], "noise": noise[c] * shown(c)[0]} for c in channels
            },
            "effects": list(effects),
            "variants": [sum(1 << list(effects).index(e) for e in v) for v in variants],
            "words": list(words),
            "colour": "@after" if well else "@before",
            "start": {"run": start[0] if start else runs[0].name, "channel": start[1] if start else channels[0]},
        },
    )
    options = "".join(
        f'<option value="{i}">{text(r.name)}{f" · {text(r.about)}" if r.about else ""}</option>'
        for i, r in enumerate(runs)
    )
    choices = "".join(f'<option value="{c}">{text(title(c))}</option>' for c in channels)
    switches = "".join(
        f'<label><input type="checkbox" data-effect="{i}" checked> {text(effect_name(e))}</label>'
        for i, e in enumerate(effects)
    )
    switches = f"<fieldset><legend>Effects added</legend>{switches}</fieldset>" if effects else ""
    thinned = max((len(t.times) for r in runs for t in r.traces.values()), default=0) > MOST
    note = "Long runs are drawn with every second, third, … sample. " if thinned else ""
    return f"""<div class="controls" id="explorer-controls">
<label>Run <select id="explorer-run">{options}</select></label>
<label>Channel <select id="explorer-channel">{choices}</select></label>
{switches}</div>
<p id="explorer-sentence" aria-live="polite"></p>
{_plot("explorer-traces", "Measured and predicted values of the chosen run over time, and the error over noise", 460)}
<p class="caption">Above, dots are measured, lines predicted from the run's initial state, open loop to its end. Below,
measured minus predicted over the sensor's noise; the band is ±2. {note}</p>
{_plot("explorer-errors", "Error over noise of each channel of the chosen run", 110 + 34 * len(channels))}"""


def _plot(name: str, label: str, height: int) -> str:
    return (
        f'<figure><div class="plot" id="{name}" tabindex="0" role="img" aria-label="{label}" '
        f'style="height:{height}px"></div></figure>'
    )


def _trace(channel: str, trace: Trace) -> dict[str, object]:
    factor = shown(channel)[0]
    keep = slice(None, None, max(1, -(-len(trace.times) // MOST)))
    return {
        "t": packed(trace.times[keep]),
        "y": packed(trace.measured[keep] * factor),
        "p": [packed(p[keep] * factor) for p in trace.predicted],
        "e": [float(e) for e in trace.errors],
    }
