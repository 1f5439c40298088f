# SPDX-License-Identifier: Apache-2.0
"""Traces the reader can choose: a run, a channel, which effects are on. Every combination was predicted beforehand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from .page import Page, packed, parts
from .words import effect_name, shown, title

Array = NDArray[np.float64]

#: Samples drawn of one trace; of a longer one every second, third, … is shown.
MOST = 1500


@dataclass(frozen=True)
class Trace:
    """One channel of one run: times, measured, a prediction per variant, all (m,), SI; error over noise per variant.
    ``band`` (m,) is the first prediction's standard deviation, SI, where that is known."""

    times: Array
    measured: Array
    predicted: Sequence[Array]
    errors: Sequence[float]
    band: Array | None = None


@dataclass(frozen=True)
class RunTraces:
    """One run: its name, a few words about it, its channels."""

    name: str
    about: str
    traces: Mapping[str, Trace]


@dataclass(frozen=True)
class Opening:
    """How the explorer opens: the run and channel shown first, and the names of the first variant and the chosen one.

    ``well`` says that the first variant fits; then it is not drawn in the colour of an alarm. ``either``: pairs of
    effects that stand in each other's place, the one that is on at first before the other."""

    start: tuple[str, str] | None = None
    words: tuple[str, str] = ("this model", "with the effects chosen")
    well: bool = False
    either: tuple[tuple[str, str], ...] = ()


def explorer(
    page: Page,
    runs: Sequence[RunTraces],
    noise: Mapping[str, float],
    effects: Sequence[str] = (),
    variants: Sequence[Sequence[str]] = ((),),
    opening: Opening = Opening(),  # noqa: B008  it never changes
) -> Markup:
    """HTML of the explorer. ``variants`` are the subsets of ``effects`` that were predicted, the first of them none."""
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
            "either": [[list(effects).index(e) for e in pair] for pair in opening.either],
            "words": list(opening.words),
            "colour": "@after" if opening.well else "@before",
            "start": dict(zip(("run", "channel"), opening.start or (runs[0].name, channels[0]), strict=True)),
        },
    )
    thinned = max((len(t.times) for r in runs for t in r.traces.values()), default=0) > MOST
    named = [(c, title(c)) for c in channels]
    banded = any(t.band is not None for r in runs for t in r.traces.values())
    off = {other for _, other in opening.either}
    boxes = [(effect_name(e), e not in off) for e in effects]
    return parts.explorer(runs, named, boxes, thinned, banded, 110 + 34 * len(channels))


def _trace(channel: str, trace: Trace) -> dict[str, object]:
    factor = shown(channel)[0]
    keep = slice(None, None, max(1, -(-len(trace.times) // MOST)))
    return {
        "t": packed(trace.times[keep]),
        "y": packed(trace.measured[keep] * factor),
        "p": [packed(p[keep] * factor) for p in trace.predicted],
        "e": [float(e) for e in trace.errors],
    } | ({} if trace.band is None else {"b": packed(trace.band[keep] * factor)})
