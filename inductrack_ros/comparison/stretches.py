# SPDX-License-Identifier: Apache-2.0
"""Samples of all runs sorted by speed, gap, place and contact: where the error is large."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..core.flight import AT_REST
from ..core.model import Model
from ..core.state import OUTPUTS
from ..data import Run
from ..data.measurement import Array
from .result import RunComparison, Stretch, column, rms

#: A stretch with fewer samples than this says nothing.
FEWEST = 30
#: Kinds of stretches: name, unit, about how many.
KINDS = (("speed", "m/s", 8), ("gap", "m", 8), ("place", "m", 14), ("contact", "", 2))


def conditions(run: Run, outputs: Array, model: Model, sigma: Mapping[str, float]) -> dict[str, Array]:
    """Under which conditions each sample was taken: as measured where that was, else from simulated outputs (n, w)."""
    simulated = dict(zip(OUTPUTS, outputs.T, strict=False))

    def best(channel: str, instead: Array) -> Array:
        if channel not in run.channels:
            return instead
        times, values = run.samples(channel)
        return np.interp(run.times, times, values)

    place = best("surge", simulated["surge"])
    top = best("gap_top", model.parameters["nominal_gap"] + best("heave", simulated["heave"]))
    lowest = np.min([top, *(best(g, simulated[g]) for g in ("gap_right", "gap_left"))], axis=0)
    margin = 2 * sigma.get("gap_top", sigma.get("heave", 0.0))
    speed = _slope(run.times, place) if "surge" in run.channels else simulated["surge_rate"]
    speed = best("surge_rate", speed)
    speed = np.where(np.abs(speed) < AT_REST, 0.0, speed)
    return {"speed": speed, "gap": np.maximum(top, 0.0), "place": place, "contact": (lowest <= margin).astype(float)}


def _slope(times: Array, values: Array, reach: int = 12) -> Array:
    """Derivative over ``reach`` samples either side: enough to tell one stretch of speed from the next."""
    low = np.maximum(np.arange(len(times)) - reach, 0)
    high = np.minimum(np.arange(len(times)) + reach, len(times) - 1)
    return (values[high] - values[low]) / (times[high] - times[low])


def stretches(runs: tuple[RunComparison, ...]) -> tuple[Stretch, ...]:
    found: list[Stretch] = []
    for by, unit, about in KINDS:
        where = np.concatenate([r.conditions[by] for r in runs])
        edges = np.array([0.0, 1.0, 2.0]) if by == "contact" else _populated(where, nice_edges(where, about))
        part = [np.clip(np.searchsorted(edges, r.conditions[by], side="right") - 1, 0, len(edges) - 2) for r in runs]
        for k, (low, high) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            inside = [p == k for p in part]
            if any(i.any() for i in inside):
                found.append(_stretch(by, unit, float(low), float(high), runs, inside))
    return tuple(found)


def _stretch(
    by: str, unit: str, low: float, high: float, runs: tuple[RunComparison, ...], inside: list[NDArray[np.bool_]]
) -> Stretch:
    channels = [c for c in OUTPUTS if any(c in r.run.channels for r in runs)]

    def over(tables: list[Array | None], channel: str | None = None) -> float:
        parts = [
            (t if channel is None else column(r, t, channel)[:, None])[rows].ravel()
            for r, t, rows in zip(runs, tables, inside, strict=True)
            if t is not None
        ]
        return rms(np.concatenate(parts)) if parts else math.nan

    def each(tables: list[Array | None]) -> dict[str, float]:
        return {c: e for c in channels if not math.isnan(e := over(tables, c))}

    whole, afresh = [r.sigmas for r in runs], [r.restarted for r in runs]
    samples = sum(int(i.sum()) for i in inside)
    local = over(afresh)
    return Stretch(
        by, unit, low, high, samples, over(whole), each(whole), None if math.isnan(local) else local, each(afresh)
    )


def _populated(values: Array, edges: Array) -> Array:
    """``edges`` without those that leave fewer than `FEWEST` values in a part."""
    kept = [edges[0]]
    for edge in edges[1:-1]:
        if ((values >= kept[-1]) & (values < edge)).sum() >= FEWEST and (values >= edge).sum() >= FEWEST:
            kept.append(edge)
    return np.array([*kept, edges[-1]])


def nice_edges(values: Array, about: int) -> Array:
    """Round edges (steps of 1, 2 or 5) that cut the range of nearly all ``values`` into at most ``about`` parts."""
    values = values[np.isfinite(values)]
    if not values.size:
        return np.array([0.0, 1.0])
    low, high = np.quantile(values, [0.002, 0.998])
    if high <= low:
        low, high = low - 0.5 * abs(low) - 1e-6, high + 0.5 * abs(high) + 1e-6
    step = 10.0 ** math.floor(math.log10((high - low) / about))
    for factor in (1, 2, 5, 10, 20):
        # what lies only just beyond an edge, as noise does, needs no part of its own
        first, last = math.floor(low / (step * factor) + 0.02), math.ceil(high / (step * factor) - 0.02)
        if last - first <= about:
            break
    return np.arange(first, max(last, first + 1) + 1) * step * factor
