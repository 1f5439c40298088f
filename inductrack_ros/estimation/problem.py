# SPDX-License-Identifier: Apache-2.0
"""Predictions, residuals and their derivatives for all runs of a campaign, in batches of compiled simulations.

Each run is simulated from its own initial state to its end (single shooting). The fit lengthens the horizon step by
step: else powered runs with their unstable balance speed, and impacts, would derail it. All perturbations of one run
are one batch; runs are spread over threads, for the compiled code releases the interpreter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.effects.stand_in import entries
from ..core.errors import InputError
from ..core.model import Model
from ..core.model import Pulses as ModelPulses
from ..core.sensors import columns_for
from ..core.state import ACCELERATIONS, COORDINATES, INDEX, MOVING, RATES, STATES, Dof
from ..data.campaign import Campaign
from ..data.measurement import Run
from ..workers import Threads
from .response import STATE_STEPS, RunResponse
from .structure import Structure

#: Longest spacing (s) of the grid between samples that predictions are interpolated and forces are integrated on.
GRID = 2.5e-3
#: Step of the parameters' differences, in typical sizes.
THETA_STEP = 2e-3
#: Signs of a central difference.
BOTH_SIDES = (1.0, -1.0)
#: Where the differences to both sides are further apart than this part of their sum, a derivative is the smaller of the
#: two.
JUMP = 0.8
#: Prior standard deviation of an initial state about its first guess: says nothing where anything is measured.
STATE_PRIOR = np.array([0.5, 0.02, 0.02, 0.1, 10.0, 1.0, 1.0, 10.0])


@dataclass(frozen=True)
class RunData:
    """One run laid out for fitting: every measurement (m,) with its grid row, output column and channel number."""

    run: Run
    grid: np.ndarray
    row: np.ndarray
    column: np.ndarray
    time: np.ndarray
    y: np.ndarray
    channel: np.ndarray
    fixed: np.ndarray  # (8,) True where the initial state is given or held
    guess: np.ndarray  # (8,) first guess, exact where fixed
    pulses: tuple[np.ndarray, np.ndarray, np.ndarray]  # as the kernel takes them; see `_measured_current`
    averaged: bool
    contact: np.ndarray | None = None  # grid points at which a run is in contact, see `Problem.with_contacts`

    @property
    def fired(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """The single pulses that drive the run; None of an averaged drive."""
        return None if self.averaged else self.pulses

    @property
    def drive(self) -> np.ndarray:
        """The drive's current (n,) A on the grid, as far as it is known: single pulses are not in it."""
        beyond = np.interp(self.grid, self.pulses[0], self.pulses[2]) if self.averaged and self.pulses[0].size else 0.0
        return self.run.drive_current + beyond * np.ones(len(self.grid))

    @property
    def free_states(self) -> np.ndarray:
        """Indices of the initial states to be estimated."""
        return np.flatnonzero(~self.fixed)

    def within(self, horizon: float) -> RunData:
        """The run with only its samples up to ``horizon`` (s)."""
        kept = self.time <= horizon
        grid = self.grid[: max(2, np.searchsorted(self.grid, horizon + GRID))]
        contact = None if self.contact is None else self.contact[: len(grid)]
        parts = {name: getattr(self, name)[kept] for name in ("row", "column", "time", "y", "channel")}
        return replace(self, grid=grid, contact=contact, **parts)


def _widened(data: RunData, touching: np.ndarray) -> np.ndarray:
    """Contacts (n,) up to the readings before and behind them."""
    read, ways = np.unique(data.row), np.flatnonzero(touching)
    first = read[np.maximum(np.searchsorted(read, ways, side="right") - 1, 0)]
    last = read[np.minimum(np.searchsorted(read, ways + 1), len(read) - 1)]
    contact = touching.copy()
    for a, b in zip(first, last, strict=True):
        contact[a : b + 1] = True
    return contact


def lay_out(run: Run, model: Model, channels: Sequence[str], dof: Dof) -> RunData:
    """Prepare one run. Raises `InputError` where the speed cannot be had from anything measured or given."""
    measured = run.measured
    times = run.times
    known = times[measured.any(axis=1)]
    between = [
        np.linspace(a, b, int(np.ceil((b - a) / GRID)) + 1)[1:-1]
        for a, b in zip(known[:-1], known[1:], strict=True)
        if b - a > GRID
    ]
    grid = np.unique(np.concatenate([[0.0], known, *between]))
    r, c = np.nonzero(measured)
    names = np.array([channels.index(n) for n in run.channels])
    columns = np.array([INDEX[n] for n in run.channels])
    fixed = np.array([s in run.initial_state for s in STATES])
    fixed |= np.array([s.removesuffix("_rate") not in MOVING[dof] for s in STATES])
    if "surge" not in MOVING[dof] and ("surge" in run.channels or "surge_rate" in run.channels):
        fixed[[0, 4]] = [s in run.initial_state for s in ("surge", "surge_rate")]
    guess = _first_guess(run, model, dof)
    pulses = np.empty(0), np.empty(0), np.empty(0)
    averaged = run.pulses is None and model.drive == "averaged"
    if run.pulses is None and not averaged and run.drive_current != 0.0:
        raise InputError(
            f"{run.file}: driven at {run.drive_current:g} A, but it holds no drive pulses and the model has drive:"
            " pulses; set drive: averaged in the model, or record fired_pulses"
        )
    if run.pulses is not None:
        p = ModelPulses(run.pulses.times, run.pulses.coils, run.pulses.currents)
        begun, places, currents = (np.ascontiguousarray(a, float) for a in p.arrays(model.parameters["wavelength"]))
        pulses = begun, places, currents
    elif averaged and "drive_current" in run.inputs:
        pulses = _measured_current(run)
    return RunData(
        run, grid, np.searchsorted(grid, times[r]), columns[c], times[r], run.values[r, c], names[c], fixed, guess,
        pulses, averaged,
    )  # fmt: skip


def _measured_current(run: Run) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (m,) s and what flowed beyond the run's drive current (m,) A, where it was measured in time, as the
    averaged drive takes them."""
    times, values = (np.ascontiguousarray(a, float) for a in run.inputs["drive_current"])
    return times, np.zeros(len(times)), values - run.drive_current


def _first_guess(run: Run, model: Model, dof: Dof) -> np.ndarray:
    """Initial state from a parabola through the first samples of each channel; given entries as given."""
    guess = np.zeros(8)
    found = {}
    for name in run.channels:
        t, y = run.samples(name)
        if t.size == 0 or name in ACCELERATIONS:
            continue
        n = int(np.clip(np.searchsorted(t, t[0] + 0.04), min(5, t.size), max(t.size, 1)))
        degree = min(2, n - 1)
        fit = np.polynomial.Polynomial.fit(t[:n], y[:n], degree) if n > 1 else np.polynomial.Polynomial([y[0]])
        found[name] = (float(fit(0.0)), float(fit.deriv()(0.0)) if n > 1 else 0.0)
    for i, c in enumerate(COORDINATES):
        if c in found:
            guess[i], guess[4 + i] = found[c]
        if RATES[i] in found:
            guess[4 + i] = found[RATES[i]][0]
    g0 = model.parameters["nominal_gap"]
    if "heave" not in found:
        if "gap_top" in found:
            guess[2], guess[6] = found["gap_top"][0] - g0, found["gap_top"][1]
        elif {"gap_left", "gap_right"} <= found.keys():
            guess[2] = g0 / np.sqrt(0.5) - (found["gap_left"][0] + found["gap_right"][0]) / np.sqrt(2)
    if "sway" not in found and {"gap_left", "gap_right"} <= found.keys():
        guess[1], guess[5] = ((found["gap_left"][k] - found["gap_right"][k]) / np.sqrt(2) for k in (0, 1))
    for i, s in enumerate(STATES):
        if s in run.initial_state:
            guess[i] = run.initial_state[s]
        elif s.removesuffix("_rate") not in MOVING[dof] and not ("surge" not in MOVING[dof] and i in (0, 4)):
            guess[i] = 0.0
    if "surge" not in found and "surge_rate" not in found and "surge_rate" not in run.initial_state:
        raise InputError(
            f"{run.file}: nothing tells the speed; measure surge or surge_rate, or give initial_state: {{surge_rate:"
            " …} in campaign.yaml"
        )
    unseen = "heave" not in found and not {"gap_top", "gap_left", "gap_right"} & found.keys()
    if unseen and "heave" not in run.initial_state and "heave" in MOVING[dof]:
        guess[2] = model.equilibrium_heave(max(guess[4], 1.0))
    return guess


class Problem:
    """All runs of a campaign with the noise of each channel, ready to be predicted and fitted.

    ``sigma`` (c,) is the noise by channel in the order of ``channels``; ``runs`` are `RunData`; ``limits`` are the
    rig's; ``width`` is how many of `state.OUTPUTS` are simulated; ``variances`` (m,) by run those of its measurements
    over that of the channel's noise, more than 1 where a reading is worth less (none: 1)."""

    def __init__(self, campaign: Campaign, model: Model, sigma: Mapping[str, float]):
        self.channels = campaign.channels
        self.dof, self.limits = campaign.dof or model.dof, campaign.limits
        self.model = model if model.dof == self.dof else model.with_changes(dof=self.dof)
        self.sigma = np.array([sigma[c] for c in self.channels])
        self.runs = tuple(lay_out(run, self.model, self.channels, self.dof) for run in campaign.runs)
        self.threads = Threads()
        self.width = columns_for(self.channels, self.model.known_effects.values())
        self.variances: tuple[np.ndarray, ...] = ()

    def with_changes(self, **changes: object) -> Problem:
        """The same problem with other attributes; everything else is shared."""
        other = copy(self)
        other.__dict__.pop("samples", None)
        other.__dict__.update(changes)
        return other

    def subset(self, indices: Sequence[int]) -> Problem:
        """The same problem with only some of its runs."""
        variances = tuple(self.variances[i] for i in indices) if self.variances else ()
        return self.with_changes(runs=tuple(self.runs[i] for i in indices), variances=variances)

    def with_contacts(self, touching: Sequence[np.ndarray]) -> Problem:
        """The same problem with contacts that all fits agree on: where one of them touches, (n,) of each run's grid.

        What is read during these does not count in any fit. So all fits explain the same readings, and their deviances
        compare whatever each says of contacts. When one begins or ends is known to a sample: those beside it go with
        it."""
        runs = (replace(r, contact=_widened(r, t)) for r, t in zip(self.runs, touching, strict=True))
        return self.with_changes(runs=tuple(runs))

    @cached_property
    def samples(self) -> int:
        """Number of measured values."""
        return sum(len(r.y) for r in self.runs)

    def variance(self, i: int) -> np.ndarray:
        """The ``variances`` (m,) of run i."""
        return self.variances[i] if self.variances else np.ones(len(self.runs[i].y))

    @property
    def length(self) -> float:
        """Time (s) to the last sample of the longest run."""
        return float(max(d.grid[-1] for d in self.runs))

    def within(self, horizon: float) -> Problem:
        """The same problem with only the samples up to ``horizon`` (s) of each run."""
        return self.with_changes(runs=tuple(data.within(horizon) for data in self.runs))

    def for_runs(self, task: Callable[[int], object]) -> list:
        """``task(i)`` for every run, on the machine's threads, results in order. A trial that leads beyond all numbers
        is no matter for a warning: its deviance is infinite."""
        return self.threads.map(np.errstate(all="ignore")(task), range(len(self.runs)))

    def vectors(self, structure: Structure, i: int, thetas: np.ndarray) -> np.ndarray:
        """Kernel parameter vectors (j, p) of run i for each row of thetas (j, g)."""
        P = structure.vectors(thetas)
        run, names = self.runs[i].run, structure.model.kernel.parameters
        for name, value in {"drive_current": run.drive_current, **run.conditions}.items():
            if name in names:  # any other is for effects that are not known here
                P[:, names.index(name)] = value
        return P

    def simulate(self, structure: Structure, i: int, thetas: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Outputs (j, n, w) of run i on its grid for each row of thetas and states (j, 8)."""
        return self._simulated(structure.model, i, self.vectors(structure, i, thetas), states)

    def _simulated(self, model: Model, i: int, P: np.ndarray, states: np.ndarray) -> np.ndarray:
        data = self.runs[i]
        x = np.zeros((len(states), len(model.kernel.states)))
        x[:, :8] = states
        on = np.tile(model.switches, (len(states), 1))
        if model.carries_states:
            for j in range(len(x)):
                x[j] = model.with_effect_states(x[j], P=P[j], pulses=data.fired)
        out = np.empty((len(states), data.grid.size, self.width))
        model.kernel.simulate_batch(
            data.grid, 0.0, x, P, on, model.moving, np.ascontiguousarray(states[:, 0]), data.averaged, *data.pulses,
            1.0, out,
        )  # fmt: skip
        return out

    def predict(
        self, structure: Structure, i: int, thetas: np.ndarray, out: np.ndarray, which: np.ndarray | None = None
    ) -> np.ndarray:
        """What the sensors of run i would read, (j, m), from simulated outputs (u, n, w); NaN outside the run.

        Row j of thetas reads ``out[which[j]]``, or ``out[j]`` unless given.
        """
        data, sensors = self.runs[i], structure.sensors
        which = np.arange(len(thetas)) if which is None else which
        predicted = out[which[:, None], data.row, data.column]
        if not sensors.channels:
            return predicted
        p, P = structure.faults(thetas), self.vectors(structure, i, thetas)
        for channel in sensors.channels:
            mine = np.flatnonzero(data.column == INDEX[channel])
            if mine.size:  # jobs that differ in other sensors' parameters read the same
                keys = np.column_stack([which, p[:, sensors.own(channel)]])
                _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
                values = sensors.read(
                    channel, data.time[mine], data.grid, out, which=which[first], p=p[first], P=P[first]
                )
                predicted[:, mine] = values[same.reshape(-1)]
        return predicted

    def residuals(self, structure: Structure, theta: np.ndarray, states: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Residuals over noise of each run, (m,): NaN where there is nothing to compare (see `predict`)."""

        def task(i: int) -> np.ndarray:
            data = self.runs[i]
            thetas = theta[None]
            out = self.simulate(structure, i, thetas, states[i][None])
            return (data.y - self.predict(structure, i, thetas, out)[0]) / self.sigma[data.channel]

        return self.for_runs(task)

    def linearise(
        self, structure: Structure, theta: np.ndarray, states: Sequence[np.ndarray], sides: Sequence[float] = BOTH_SIDES
    ) -> list[Linearisation]:
        """Residuals and derivatives of the predictions for each run, by differences in one batch a run.

        ``sides``: the signs by which each free initial state is moved. One costs half; it says where to go, not how
        well a state is known. Without any there are no derivatives by the states, and those by theta are one-sided."""
        return self.for_runs(lambda i: self._linearised(structure, i, theta, states[i], sides))

    def _linearised(
        self, structure: Structure, i: int, theta: np.ndarray, state: np.ndarray, sides: Sequence[float]
    ) -> Linearisation:
        """Residuals and derivatives of run i."""
        low, high = structure.bounds
        up, down = np.minimum(theta + THETA_STEP, high), np.maximum(theta - THETA_STEP, low)
        if not sides:
            down = np.where(up > theta, theta, down)
        data, tables = self.runs[i], structure.tables
        g, free = len(theta), data.free_states if sides else data.free_states[:0]
        single = [k for k in range(g) if not any(k in columns for columns in tables.values())]
        points = [(k, side[k]) for side in (up, down) for k in single if side[k] != theta[k]]
        jobs = 1 + len(points) + len(sides) * len(free)
        thetas, x = np.tile(theta, (jobs, 1)), np.tile(state, (jobs, 1))
        for j, (k, v) in enumerate(points):
            thetas[1 + j, k] = v
        moved = 1 + len(points) + np.arange(len(sides) * len(free)).reshape(len(sides), len(free))
        for rows, side in zip(moved, sides, strict=True):
            x[rows, free] += side * STATE_STEPS[free]
        out, read = self._read(structure, i, thetas, x)
        weight = 1.0 / self.sigma[data.channel]
        at = {(k, v): 1 + j for j, (k, v) in enumerate(points)}
        ends = [(read[at.get((k, up[k]), 0)], read[at.get((k, down[k]), 0)]) for k in range(g)]
        slopes = [
            _slope(a - read[0], up[k] - theta[k], read[0] - b, theta[k] - down[k]) for k, (a, b) in enumerate(ends)
        ]
        by_theta = np.array(slopes).reshape(g, data.y.size)
        for effect, columns in tables.items():
            by_theta[columns] = self._table_columns(structure, i, theta, out[0], effect, columns) / weight
        by_state = np.zeros((0, data.y.size))
        if sides:
            steps, ahead, behind = STATE_STEPS[free][:, None], read[moved[0]] - read[0], read[0] - read[moved[-1]]
            by_state = ahead / steps if len(sides) == 1 else _slope(ahead, steps, behind, steps)
        return Linearisation(
            (data.y - read[0]) * weight, (by_theta * weight).T, (by_state * weight).T, data.free_states
        )

    def _read(self, structure: Structure, i: int, thetas: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is simulated of run i, the first of all as it is, and what the sensors read (jobs, m), for each row of
        thetas and of initial states. Rows in which only a sensor's parameter moves share one simulation."""
        P = self.vectors(structure, i, thetas)
        apart = np.flatnonzero(~((P == P[0]).all(axis=1) & (x == x[0]).all(axis=1)))
        out = self._simulated(structure.model, i, P[[0, *apart]], x[[0, *apart]])
        which = np.zeros(len(x), np.int64)
        which[apart] = 1 + np.arange(apart.size)
        return out, self.predict(structure, i, thetas, out, which)

    def _table_columns(self, structure, i, theta, outputs, effect: str, columns: Sequence[int]) -> np.ndarray:
        """Derivative (l, m) over noise by a stand-in's table: the response to each of its basis functions."""
        P = self.vectors(structure, i, theta[None])[0]
        response = RunResponse(self.runs[i], self.sigma, structure.model, P, outputs, self.dof)
        values = structure.model.effects[effect]
        forces = entries(values, response.variables, len(columns)) * structure.scale[columns]
        return response.respond(response.forces(effect.removeprefix("stand_in_"), forces)).T


@dataclass(frozen=True)
class Linearisation:
    """One run near a point: residual (m,) over noise, derivatives of the prediction over noise by theta (m, g) and by
    the free initial states (m, f); NaN rows have nothing to compare."""

    residual: np.ndarray
    by_theta: np.ndarray
    by_state: np.ndarray
    free_states: np.ndarray


def _slope(ahead: np.ndarray, up, behind: np.ndarray, down) -> np.ndarray:
    """Derivative from the changes ``ahead`` over ``up`` and ``behind`` over ``down``: central, but where they differ by
    a factor the smaller.

    A sample near an impact jumps (an accelerometer's does) when it falls on the other side: that is no slope, and would
    pass for knowledge of the parameters that nobody has."""
    with np.errstate(invalid="ignore", divide="ignore"):
        forward, backward = ahead / up, behind / down
        smaller = np.where(np.abs(forward) < np.abs(backward), forward, backward)
        central = (ahead + behind) / (up + down)
        jumps = (np.abs(forward - backward) > JUMP * (np.abs(forward) + np.abs(backward))) & (up > 0) & (down > 0)
    return np.where(jumps, smaller, central)
