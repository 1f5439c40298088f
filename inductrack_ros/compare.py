# SPDX-License-Identifier: Apache-2.0
"""Where a model fails: each run of a campaign predicted open loop from its initial state, error over noise.

Nothing is fitted but the initial states that the campaign does not give. What is found is in `comparison`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .checks import Finding, admit
from .comparison.outstanding import outstanding
from .comparison.result import Comparison, RunComparison
from .comparison.stretches import conditions, stretches
from .core.errors import InputError
from .core.model import Model
from .core.sensors import counts_from_start
from .core.state import STATES
from .core.uncertainty import Uncertainty
from .data import Campaign, Run
from .data.measurement import Array
from .estimation import noise, shooting
from .estimation.bands import bands, hardly_known, of_the_model
from .estimation.fit import fit
from .estimation.problem import Problem
from .estimation.structure import Structure

#: The prediction holds until the RMS of this many samples exceeds this many times the noise.
HOLDS_SAMPLES, HOLDS_LIMIT = 20, 3.0
#: A model follows a run where no more than this is left of χ² per sample; beginnings (s) over which that is looked for.
FOLLOWS, HORIZONS = 2.0, (0.15, 0.3, 0.6, 1.2, 2.4, 4.8, 9.6, 19.2)
#: Length (s) of the stretches that start afresh, and the fewest samples of each channel in one.
WINDOW, FEWEST_IN_WINDOW = 0.2, 12


def compare(
    campaign: Campaign,
    model: Model,
    hear: Callable[[tuple[Finding, ...]], None] = lambda _: None,
    known: Uncertainty | None = None,
) -> Comparison:
    """Predict every run and say where the prediction fails.

    ``known`` is how well the model's parameters are known, for the bands of the predictions. ``hear`` is told what a
    look at the data finds, before any result. Raises `InputError` for data that cannot be meant as they are written,
    and for what cannot be simulated."""
    campaign, findings = admit(campaign, model)
    hear(findings)
    structure = Structure(model, ())
    problem = Problem(campaign, model, _first_noise(campaign))
    states, horizons = _initial_states(problem, structure)
    if any(c not in campaign.noise_std for c in campaign.channels):
        left = problem.residuals(structure, structure.start, states)
        found = noise.from_residuals(problem, left, campaign.noise_std)
        problem = problem.with_changes(sigma=np.fmax(found, [campaign.rounding.get(c, 0.0) for c in problem.channels]))
        states, horizons = _initial_states(problem, structure)
    sigma = dict(zip(problem.channels, problem.sigma.tolist(), strict=True))
    everywhere = Problem(replace(campaign, runs=tuple(_filled(r) for r in campaign.runs)), model, sigma)

    simulated = [everywhere.simulate(structure, i, structure.start[None], x[None]) for i, x in enumerate(states)]
    truth = [  # the simulated outputs (n, 15) at the run's samples
        out[0][np.searchsorted(data.grid, data.run.times)] for out, data in zip(simulated, everywhere.runs, strict=True)
    ]
    restarted = _restart(campaign, model, sigma, truth)
    known = None if known is None else of_the_model(known.finite(), model)
    badly = hardly_known(known, model) if known else ()
    open_by = _bands(everywhere, campaign, model, None if badly else known, states, horizons)

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
            conditions(run, truth[i], model, sigma),
            _holds_for(run, sigmas),
            open_by[i],
        )

    runs = tuple(one(i) for i in range(len(campaign.runs)))
    parts = stretches(runs)
    worst_part = outstanding(runs, parts, campaign.channels)
    given = frozenset(campaign.noise_std)
    names = known.names if known and not badly else ()
    return Comparison(campaign, model, sigma, given, runs, parts, worst_part, findings, names, badly)


# ---------------------------------------------------------------- one run


def _initial_states(problem: Problem, structure: Structure) -> tuple[list[Array], list[float]]:
    """Initial state (8,) of each run, sought from where multiple shooting has the cradle at its beginning, and the time
    (s) up to which it was fitted.

    It is fitted over as much of the run as the model follows. That is all of it if the model is right. If the model is
    wrong it is the beginning only, so that the fit does not spread the model's error over the run."""
    if not any(data.free_states.size for data in problem.runs):
        return [data.guess for data in problem.runs], [0.0] * len(problem.runs)
    held = shooting.fit(problem, structure).states

    def state(i: int) -> tuple[Array, float]:
        alone = problem.subset([i])
        if not problem.runs[i].free_states.size:
            return problem.runs[i].guess, 0.0
        whole = fit(alone, structure, [held[i]], iterations=12)
        if whole.chi2 <= FOLLOWS * alone.samples:
            return whole.states[0], alone.length
        now, until = held[i], alone.length
        for horizon in HORIZONS:
            part = alone.within(horizon)
            found = fit(part, structure, [now], iterations=12, tolerance=0.5)
            if not found.chi2 <= FOLLOWS * part.samples and (now is not held[i] or not np.isfinite(found.chi2)):
                break
            now, until = found.states[0], horizon
        return now, until

    found = problem.for_runs(state)
    return [state for state, _ in found], [until for _, until in found]


def _bands(
    everywhere: Problem,
    campaign: Campaign,
    model: Model,
    known: Uncertainty | None,
    states: list[Array],
    horizons: list[float],
) -> list[Array | None]:
    """Standard deviation (n, c) over noise of each run's predictions; None where nothing is known of the parameters."""
    if known is None or not known.names:
        return [None] * len(campaign.runs)
    fitted = [
        run.measured.ravel() & (data.time <= until)
        for run, data, until in zip(campaign.runs, everywhere.runs, horizons, strict=True)
    ]
    found = bands(everywhere, known, states, fitted, model)
    return [band.reshape(run.values.shape) for run, band in zip(campaign.runs, found, strict=True)]


def _followed(problem: Problem, structure: Structure) -> Array:
    """Initial state (8,) of the one short run in ``problem`` that fits the whole of it."""
    (data,) = problem.runs
    if not data.free_states.size:
        return data.guess
    return fit(problem, structure, (data.guess,), iterations=12, tolerance=1.0).states[0]


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
    if counts_from_start(model):
        return [None] * len(campaign.runs)
    cut = [(i, rows, part) for i, run in enumerate(campaign.runs) for rows, part in _windows(run, truth[i])]
    if not cut:
        return [None] * len(campaign.runs)
    result: list[Array | None] = [np.full(run.values.shape, np.nan) for run in campaign.runs]
    structure = Structure(model, ())
    problem = Problem(replace(campaign, runs=tuple(part for _, _, part in cut)), model, sigma)
    states = problem.for_runs(lambda k: _followed(problem.subset([k]), structure))
    residuals = problem.residuals(structure, structure.start, states)
    for (i, rows, part), residual in zip(cut, residuals, strict=True):
        table = np.full(part.values.shape, np.nan)
        table[part.measured] = residual
        result[i][rows] = table
    return result


def _windows(run: Run, truth: Array) -> Iterator[tuple[NDArray[np.intp], Run]]:
    """The run cut into stretches of about `WINDOW`: rows, and those as a run. A speed nobody measures is as
    simulated."""
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


def _first_noise(campaign: Campaign) -> dict[str, float]:
    """Noise (standard deviation) of each channel: as the campaign states it, else a guess from its samples alone."""
    guess = noise.from_samples(campaign)
    levels = {}
    for channel in campaign.channels:
        levels[channel] = campaign.noise_std.get(channel) or float(
            np.fmax(guess[channel], campaign.rounding.get(channel, 0.0))
        )
        if not levels[channel] > 0.0:
            readings = np.concatenate([run.samples(channel)[1] for run in campaign.runs if channel in run.channels])
            why = "never changes from sample to sample" if readings.size > 2 else f"has {readings.size} samples"
            raise InputError(
                f"{campaign.folder}: {channel} {why}, so its noise cannot be estimated; "
                f"give noise_std: {{{channel}: …}} in campaign.yaml, or leave the channel out"
            )
    return levels
