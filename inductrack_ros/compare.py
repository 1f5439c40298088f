"""Where a model fails: each run of a campaign predicted open loop from its initial state, error over noise.

Nothing is fitted but the initial states that the campaign does not give. ``comparison.json``, written by
`write_results`::

    {"campaign": "rig-2026-10",
     "model": {"effects": ["aerodynamic_drag"], "parameters": {"eta": 0.7295, …}},
     "notes": ["run_00: …"],      // what was converted or left out while reading
     "noise_std": {"heave": {"value": 3e-05, "given": true}, …},
     "error_over_noise": 41.2,       // RMS of (measured − predicted) / noise over all samples; 1 is a perfect model
     "channels": {"heave": 12.0, …},           // the same per channel
     "runs": [{"name": "run_00", "file": "run_00.csv", "drive_current": 7000.0, "duration": 1.5, "samples": 751,
               "error_over_noise": 50.1, "channels": {"heave": 13.1, …},
               "rmse": {"heave": 3.9e-4, …},                     // in the channel's unit
               "holds_for": 0.31,   // s until the error (RMS over 20 samples) exceeds 3 noises; null: it never does
               "initial_state": {"surge": 0.0, …}, "estimated": ["surge_rate", …],
               "predicted": "run_00.predicted.csv"}, …],
     "stretches": [{"by": "speed", "unit": "m/s", "low": 15.0, "high": 20.0, "samples": 3000,
                    "error_over_noise": 60.2, "channels": {"heave": 14.0, …},
                    "restarted": 1.4,     // when every 0.2 s starts afresh: what goes wrong here, not before
                    "restarted_channels": {"heave": 1.6, …}}, …]}

``by`` is ``speed`` (m/s), ``gap`` (top gap, m), ``place`` (surge, m) or ``contact`` (low 1: an array touches; low 0:
none), taken from the measurements where they show it. A number that is not finite is null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .core.errors import InputError
from .core.model import Model
from .core.state import OUTPUTS, STATES
from .data import Campaign, Run, write_prediction
from .data.measurement import Array
from .estimation import noise
from .estimation.fit import fit
from .estimation.problem import Problem
from .estimation.structure import Structure

#: A stretch with fewer samples than this says nothing.
FEWEST = 30
#: The prediction holds until the RMS of this many samples exceeds this many times the noise.
HOLDS_SAMPLES, HOLDS_LIMIT = 20, 3.0
#: Horizons (s) over which an initial state is fitted before the whole run, while χ² per sample stays below `FOLLOWS`.
HORIZONS, FOLLOWS = (0.15, 0.3, 0.6, 1.2, 2.4, 4.0, 6.0, 9.0, 14.0, 21.0), 2.0
#: Length (s) of the stretches that start afresh, and the fewest samples of each channel in one.
WINDOW, FEWEST_IN_WINDOW = 0.2, 12
#: Slower than this (m/s) is at rest: noise is not a motion backwards.
AT_REST = 0.1
#: Kinds of stretches: name, unit, about how many.
KINDS = (("speed", "m/s", 8), ("gap", "m", 8), ("place", "m", 14), ("contact", "", 2))


@dataclass(frozen=True)
class RunComparison:
    """One run and its prediction.

    predicted: (n, c) as ``run.values``, given at every time
    sigmas: (n, c) (measured − predicted) / noise, NaN where not measured
    restarted: (n, c) the same where every window starts from a state fitted to it
    conditions: speed, gap, place, contact, each (n,)
    """

    run: Run
    initial_state: Mapping[str, float]
    estimated: tuple[str, ...]
    predicted: Array
    sigmas: Array
    restarted: Array | None
    conditions: Mapping[str, Array]
    holds_for: float | None

    @property
    def error(self) -> float:
        """Error over noise of the whole run."""
        return rms(self.sigmas)

    @property
    def errors(self) -> dict[str, float]:
        """Error over noise by channel."""
        return {c: rms(self.sigmas[:, i]) for i, c in enumerate(self.run.channels)}

    @property
    def rmse(self) -> dict[str, float]:
        """RMS error by channel, SI."""
        return {c: rms(self.run.values[:, i] - self.predicted[:, i]) for i, c in enumerate(self.run.channels)}


@dataclass(frozen=True)
class Stretch:
    """All samples of all runs with ``by`` between ``low`` and ``high``."""

    by: str
    unit: str
    low: float
    high: float
    samples: int
    error: float
    errors: Mapping[str, float]
    restarted: float | None
    restarted_errors: Mapping[str, float]


@dataclass(frozen=True)
class Comparison:
    """What `compare` found; ``noise`` by channel in SI, ``noise_given`` the channels whose noise was stated."""

    campaign: Campaign
    model: Model
    noise: Mapping[str, float]
    noise_given: frozenset[str]
    runs: tuple[RunComparison, ...]
    stretches: tuple[Stretch, ...]

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that any run has."""
        return self.campaign.channels

    @property
    def error(self) -> float:
        """Error over noise of the whole campaign."""
        return rms(np.concatenate([r.sigmas.ravel() for r in self.runs]))

    @property
    def errors(self) -> dict[str, float]:
        """Error over noise by channel over all runs."""
        return {c: rms(np.concatenate([_column(r, r.sigmas, c) for r in self.runs])) for c in self.channels}

    @property
    def worst_run(self) -> RunComparison:
        """The run with the largest error over noise."""
        return max(self.runs, key=lambda r: _rank(r.error))

    @property
    def worst_channel(self) -> str:
        """The channel with the largest error over noise."""
        errors = self.errors
        return max(errors, key=lambda c: _rank(errors[c]))


def compare(campaign: Campaign, model: Model) -> Comparison:
    """Predict every run and say where the prediction fails. Raises `InputError` for what cannot be simulated."""
    structure = Structure(model, ())
    problem = Problem(campaign, model, _first_noise(campaign))
    states = _initial_states(problem, structure)
    if any(c not in campaign.noise_std for c in campaign.channels):
        left = problem.residuals(structure, structure.start, states)
        found = noise.from_residuals(problem, left, campaign.noise_std)
        problem = problem.with_sigma(np.fmax(found, [_resolution(campaign, c) for c in problem.channels]))
        states = _initial_states(problem, structure)
    sigma = dict(zip(problem.channels, problem.sigma.tolist(), strict=True))
    everywhere = Problem(replace(campaign, runs=tuple(_filled(r) for r in campaign.runs)), model, sigma)

    simulated = [everywhere.simulate(structure, i, structure.start[None], x[None]) for i, x in enumerate(states)]
    truth = [  # the simulated outputs (n, 15) at the run's samples
        out[0][np.searchsorted(data.grid, data.run.times)] for out, data in zip(simulated, everywhere.runs, strict=True)
    ]
    restarted = _restart(campaign, model, sigma, truth)

    def one(i: int) -> RunComparison:
        run = campaign.runs[i]
        predicted = everywhere.predict(structure, i, structure.start[None], simulated[i])[0].reshape(run.values.shape)
        sigmas = _sigmas(run, predicted, truth[i], sigma)
        return RunComparison(
            run,
            dict(zip(STATES, states[i].tolist(), strict=True)),
            tuple(STATES[k] for k in problem.runs[i].free_states),
            _continued(run.times, predicted),
            sigmas,
            restarted[i],
            _conditions(run, truth[i], model, sigma),
            _holds_for(run, sigmas),
        )

    runs = tuple(one(i) for i in range(len(campaign.runs)))
    return Comparison(campaign, model, sigma, frozenset(campaign.noise_std), runs, _stretches(runs))


def write_results(result: Comparison, folder: Path) -> None:
    """Write ``comparison.json`` and each run's ``<run>.predicted.csv``."""
    text = json.dumps(to_json(result), indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "comparison.json").write_text(text + "\n", encoding="utf-8")
    for r in result.runs:
        write_prediction(folder, r.run, r.predicted)


def to_json(result: Comparison) -> dict[str, Any]:
    """The contents of ``comparison.json`` (see the module's docstring)."""
    return _finite(
        {
            "campaign": result.campaign.name,
            "model": {
                "effects": list(result.model.effects),
                "parameters": {k: v for k, v in result.model.to_mapping().items() if isinstance(v, (int, float))},
            },
            "notes": list(result.campaign.notes),
            "noise_std": {c: {"value": s, "given": c in result.noise_given} for c, s in result.noise.items()},
            "error_over_noise": result.error,
            "channels": result.errors,
            "runs": [
                {
                    "name": r.run.name,
                    "file": r.run.file.name,
                    "drive_current": r.run.drive_current,
                    "duration": r.run.duration,
                    "samples": len(r.run.times),
                    "error_over_noise": r.error,
                    "channels": r.errors,
                    "rmse": r.rmse,
                    "holds_for": r.holds_for,
                    "initial_state": dict(r.initial_state),
                    "estimated": list(r.estimated),
                    "predicted": f"{r.run.name}.predicted.csv",
                }
                for r in result.runs
            ],
            "stretches": [
                {
                    "by": s.by,
                    "unit": s.unit,
                    "low": s.low,
                    "high": s.high,
                    "samples": s.samples,
                    "error_over_noise": s.error,
                    "channels": dict(s.errors),
                    "restarted": s.restarted,
                    "restarted_channels": dict(s.restarted_errors),
                }
                for s in result.stretches
            ],
        }
    )


def rms(values: Array) -> float:
    """Root mean square of what is measured; infinite where a prediction left all bounds."""
    present = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(present**2))) if present.size else math.nan


# ---------------------------------------------------------------- one run


def _initial_states(problem: Problem, structure: Structure) -> list[Array]:
    """Initial state (8,) of each run."""
    return problem.for_runs(lambda i: _initial_state(problem.subset([i]), structure, HORIZONS, 0.02))


def _initial_state(problem: Problem, structure: Structure, horizons: Sequence[float], tolerance: float) -> Array:
    """Initial state (8,) of the one run in ``problem``, fitted over as much of its beginning as the model follows.

    A right model so takes all of the run in; a wrong one starts where the cradle was instead of sharing its error out
    over the run. ``tolerance`` is what a step must still gain in χ² over the whole run.
    """
    (data,) = problem.runs
    states: Sequence[Array] = (data.guess,)
    if not data.free_states.size:
        return data.guess
    for horizon in [h for h in horizons if h < data.grid[-1]] + [math.inf]:
        needed = tolerance if horizon == math.inf else 0.5
        part = problem.within(horizon)
        found = fit(part, structure, states, iterations=12, tolerance=needed)
        per_sample = found.chi2 / max(part.samples, 1)
        if math.isfinite(per_sample) and (per_sample <= FOLLOWS or states[0] is data.guess):
            states = found.states
        if per_sample > FOLLOWS:
            break
    return states[0]


def _filled(run: Run) -> Run:
    """The run with a number in every cell, so that everything is predicted everywhere."""
    return replace(run, values=np.zeros_like(run.values))


def _continued(times: Array, predicted: Array) -> Array:
    """``predicted`` with the first moments, which a late sensor's model cannot know, continued in a straight line."""
    result = predicted.copy()
    for column in result.T:
        known = np.flatnonzero(np.isfinite(column))
        if len(known) > 1 and known[0] > 0:
            i, j = known[:2]
            slope = (column[j] - column[i]) / (times[j] - times[i])
            column[:i] = column[i] + slope * (times[:i] - times[i])
    return result


def _sigmas(run: Run, predicted: Array, outputs: Array, sigma: Mapping[str, float]) -> Array:
    """(measured − predicted) / noise; NaN where there is nothing to compare, infinite once the simulation is lost."""
    difference = (run.values - predicted) / np.array([sigma[c] for c in run.channels])
    lost = np.isnan(outputs[-1]).any() & np.isnan(predicted) & (np.cumsum(np.isfinite(predicted), axis=0) > 0)
    return np.where(run.measured & lost, np.inf, difference)


def _restart(campaign: Campaign, model: Model, sigma: Mapping[str, float], truth: list[Array]) -> list[Array | None]:
    """Error over noise of each run, (n, c), where every `WINDOW` starts from a state fitted to it.

    An error that builds up slowly vanishes here; one that arises at a place, a speed or a touch stays, and stays there.
    None for a model with effects that count from the run's start.
    """
    if any({"time", "travel"} & set(model.known_effects[e.partition(":")[0]].arguments) for e in model.effects):
        return [None] * len(campaign.runs)
    cut = [(i, rows, part) for i, run in enumerate(campaign.runs) for rows, part in _windows(run, truth[i])]
    if not cut:
        return [None] * len(campaign.runs)
    result: list[Array | None] = [np.full(run.values.shape, np.nan) for run in campaign.runs]
    structure = Structure(model, ())
    problem = Problem(replace(campaign, runs=tuple(part for _, _, part in cut)), model, sigma)
    states = problem.for_runs(lambda k: _initial_state(problem.subset([k]), structure, (), 1.0))
    residuals = problem.residuals(structure, structure.start, states)
    for (i, rows, part), residual in zip(cut, residuals, strict=True):
        table = np.full(part.values.shape, np.nan)
        table[part.measured] = residual
        result[i][rows] = table
    return result


def _windows(run: Run, truth: Array) -> Iterator[tuple[NDArray[np.intp], Run]]:
    """The run cut into stretches of about `WINDOW`: rows, and those as a run. A speed nobody measures is as simulated."""
    number = np.floor(run.times / (run.duration + 1e-9) * max(round(run.duration / WINDOW), 1))
    for k in np.unique(number):
        rows = np.flatnonzero(number == k)
        values, start, state = run.values[rows], run.times[rows[0]], truth[rows[0], :8]
        seen = ~np.isnan(values)
        if seen.sum(axis=0).max() < FEWEST_IN_WINDOW or not np.isfinite(state).all():
            continue
        moving = {c for c, any_ in zip(run.channels, seen.any(axis=0), strict=True) if any_}
        held = () if moving & {"surge", "surge_rate"} else ("surge", "surge_rate")
        known = {s: float(state[STATES.index(s)]) for s in held}
        pulses = run.pulses and replace(run.pulses, times=run.pulses.times - start)
        part = {"times": run.times[rows] - start, "values": values, "stamps": run.stamps[rows]}
        yield rows, replace(run, initial_state=known, pulses=pulses, **part)


def _holds_for(run: Run, sigmas: Array) -> float | None:
    """Seconds until some channel leaves its noise."""
    ends = []
    for column in sigmas.T:
        present = np.flatnonzero(~np.isnan(column))
        n = min(HOLDS_SAMPLES, len(present))
        power = np.minimum(column[present] ** 2, 1e12)
        sums = np.cumsum(power)
        sums[n:] -= sums[:-n].copy()
        left = np.flatnonzero(np.sqrt(sums[n - 1 :] / n) > HOLDS_LIMIT)
        if len(left):
            ends.append(float(run.times[present[left[0] + n - 1]]))
    return min(ends, default=None)


def _conditions(run: Run, outputs: Array, model: Model, sigma: Mapping[str, float]) -> dict[str, Array]:
    """Under which conditions each sample was taken: as measured where that was, else from simulated outputs (n, 15)."""
    simulated = dict(zip(OUTPUTS, outputs.T, strict=True))

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


# ---------------------------------------------------------------- stretches


def _stretches(runs: tuple[RunComparison, ...]) -> tuple[Stretch, ...]:
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
            (t if channel is None else _column(r, t, channel)[:, None])[rows].ravel()
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


def _column(r: RunComparison, table: Array, channel: str) -> Array:
    """A channel's column, all NaN where the run has none."""
    return table[:, r.run.channels.index(channel)] if channel in r.run.channels else np.full(len(table), np.nan)


def _rank(error: float) -> float:
    return -1.0 if math.isnan(error) else error


def _first_noise(campaign: Campaign) -> dict[str, float]:
    """Noise (standard deviation) of each channel: as the campaign states it, else a guess from its samples alone."""
    guess = noise.from_samples(campaign)
    levels = {}
    for channel in campaign.channels:
        levels[channel] = campaign.noise_std.get(channel) or float(
            np.fmax(guess[channel], _resolution(campaign, channel))
        )
        if not levels[channel] > 0.0:
            raise InputError(
                f"{campaign.folder}: the noise of {channel} cannot be estimated (too few samples, or none at all); "
                f"give noise_std: {{{channel}: …}} in campaign.yaml"
            )
    return levels


def _resolution(campaign: Campaign, channel: str) -> float:
    """Standard deviation of a channel's rounding: a sensor is no better than its steps; 0 where none show."""
    steps = []
    for run in campaign.runs:
        if channel in run.channels:
            readings = run.samples(channel)[1]
            different = np.unique(readings)
            if 1 < different.size < 0.5 * readings.size:
                steps.append(float(np.diff(different).min()))
    return max(steps, default=0.0) / math.sqrt(12.0)


def _finite(data: Any) -> Any:
    """The same with None for numbers JSON has no word for."""
    if isinstance(data, dict):
        return {k: _finite(v) for k, v in data.items()}
    if isinstance(data, list):
        return [_finite(v) for v in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
