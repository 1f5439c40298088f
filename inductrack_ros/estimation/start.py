# SPDX-License-Identifier: Apache-2.0
"""A trajectory of each run from its data alone, to begin with."""

from __future__ import annotations

import numpy as np

from ..core.state import ACCELERATIONS, GAPS, INDEX, OUTPUTS
from .kalman import LinearRun, run_filter, run_smoother
from .likelihood import ROUGHEST
from .problem import STATE_PRIOR, Problem, RunData
from .response import gap_geometry
from .structure import Structure

#: Least power of the disturbances (m²/s³, rad²/s³) that a start looks at.
SMOOTHEST = 1e-6


def start(problem: Problem, structure: Structure, i: int) -> np.ndarray:
    """A trajectory (n, N) of run i from its data alone: every coordinate a random walk of its rate, as rough as the
    data say."""
    data, model = problem.runs[i], structure.model
    n = len(data.grid)
    kinematic = _kinematic(problem, model, data)

    def deviance(c: int, exponent: float, power: np.ndarray) -> float:
        tried = power.copy()
        tried[c] = 10.0**exponent
        filtered = run_filter(kinematic, tried)
        return float((filtered.whitened[:, 0] ** 2).sum() + np.log(filtered.variances).sum())

    power = model.moving * 1e2
    seen = [c for c in range(4) if power[c] and (kinematic.sensitivity[:, [c, 4 + c]] != 0).any()]
    exponents = np.arange(np.log10(SMOOTHEST), np.log10(ROUGHEST) + 1, 2.0)
    for _ in range(2):
        for c in seen:
            power[c] = 10.0 ** min(exponents, key=lambda e, c=c: deviance(c, e, power))
    smoothed = run_smoother(kinematic, run_filter(kinematic, power), np.empty(0)).deviations
    path = np.zeros((n, len(model.kernel.states)))
    path[:, :8] = data.guess + smoothed
    held = ~np.isin(np.arange(8), data.free_states) & np.tile(model.moving == 0, 2)
    path[:, :8][:, held] = data.guess[held]
    path[:, 0] = np.where(model.moving[0] == 0, data.guess[0] + data.guess[4] * data.grid, path[:, 0])
    if 2 not in seen and model.moving[2] and data.free_states.size:
        path[:, 2] = _balance(model, path[:, 4])
        path[:, 6] = 0.0
    if model.carries_states:
        P = problem.vectors(structure, i, structure.start[None])[0]
        for k, t in enumerate(data.grid):
            path[k] = model.with_effect_states(path[k], t, P, data.fired, path[0, 0])
    return path


def _kinematic(problem: Problem, model, data: RunData) -> LinearRun:
    """The run without physics: coordinates and their rates, as positions, rates and gaps show them."""
    n = len(data.grid)
    geometry, g0 = gap_geometry(model), model.parameters["nominal_gap"]
    rows = np.zeros((len(OUTPUTS), 8))
    offset = np.zeros(len(OUTPUTS))
    rows[:8] = np.eye(8)
    for k, name in enumerate(GAPS):
        rows[INDEX[name], :4], offset[INDEX[name]] = geometry[k], g0
    used = data.column < INDEX[ACCELERATIONS[0]]
    column, sigma = data.column[used], problem.sigma[data.channel[used]]
    H = rows[column]
    y = (data.y[used] - offset[column] - H @ data.guess) / sigma
    spacing = np.append(np.diff(data.grid), 0.0)
    F = np.tile(np.eye(8), (n, 1, 1))
    F[:, np.arange(4), 4 + np.arange(4)] = spacing[:, None]
    inputs = np.zeros((n, 8, 1))
    inputs[:, :4, 0] = spacing[:, None] * data.guess[4:]
    root = np.zeros((8, 8))
    root[data.free_states, data.free_states] = STATE_PRIOR[data.free_states]
    return LinearRun(
        np.searchsorted(data.row[used], np.arange(n + 1)), H / sigma[:, None], y[:, None], np.ones(len(y)), F, inputs,
        spacing, root, np.zeros((8, 1)), np.zeros((n, 8)), np.zeros(n, bool), np.zeros((len(y), 4)),
        np.zeros(len(y), bool),
    )  # fmt: skip


def _balance(model, speed: np.ndarray) -> np.ndarray:
    """Equilibrium heave (n,) along a run, from a few speeds of it."""
    few = np.linspace(max(speed.min(), 1.0), max(speed.max(), 1.001), 7)
    return np.interp(speed, few, [model.equilibrium_heave(v) for v in few])
