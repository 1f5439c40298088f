# SPDX-License-Identifier: Apache-2.0
"""One short window of measurements: the run of the model that fits it best, and the constant force that it lacks.

Each window is fitted by itself: the state at its start and the force together (Gauss–Newton on weighted residuals).
Nothing is carried from one window to the next. So with a complete model and white noise the forces of different windows
are independent and normal about zero, with the covariance that the fit gives. `evidence` relies on this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.model import Model, Pulses
from ..core.sensors import Past, Sensors, columns_for
from ..core.state import CHANNEL, COORDINATES, FURTHER, INDEX, MOVING, OUTPUTS, RATES, STATES
from ..estimation.response import STATE_STEPS

#: Longest interval (s) over which the force acts as one kick at either end.
KICK = 2.5e-3
#: Steps of the force's differences, N and N·m.
FORCE_STEPS = np.array([1e-2, 1e-2, 1e-2, 1e-3])
#: A fit has converged when no prediction moves by more than this share of its noise.
CONVERGED = 0.05
ITERATIONS = 8
#: Standard deviations beyond which the force is fitted and not only extrapolated from the model's own run.
LARGE = 3.0
#: Ratio of the normal matrix's eigenvalues below which some unknown shows in nothing that was measured.
SINGULAR = 1e-12
#: A sensor's state that shows by less than this part of the noise when it is moved by all of it shows not at all.
UNSEEN = 1e-6
#: Measured values for each unknown, below which a window is not judged.
LEAST = 3


@dataclass(frozen=True)
class Samples:
    """What was measured: ``time`` (n,) s since the run began, ``column`` (n,) in `state.OUTPUTS`, ``value`` (n,) SI."""

    time: np.ndarray
    column: np.ndarray
    value: np.ndarray


@dataclass(frozen=True)
class Fit:
    """``force`` and its ``sigma`` (4,) in N, N, N, N·m (NaN where held); ``residual`` (n,) of the model without a
    force; ``left`` (n,) what remains with it, over noise; ``path`` (3, 8) the states at begin, middle and end; ``gap``
    (m), the least; ``contact``."""

    force: np.ndarray
    sigma: np.ndarray
    residual: np.ndarray
    left: np.ndarray
    path: np.ndarray
    gap: float
    contact: bool


class WindowFit:
    """Fits windows with one model. ``origin`` is the surge (m) where the run began."""

    def __init__(self, model: Model) -> None:
        self.model = model
        moving = MOVING[model.dof]
        self.states = [i for i, s in enumerate(STATES) if s.removesuffix("_rate") in (*moving, "surge")]
        self.read = [*self.states, *(INDEX[c] for c in FURTHER)]
        self.forces = [i for i, c in enumerate(COORDINATES) if c in moving]
        p = model.parameters
        self._inverse_inertia = np.array([1 / p["mass"]] * 3 + [1 / p["roll_inertia"]]) * model.moving
        self._sensors = Sensors.of(model)

    def looks_at(self, time: float) -> float:
        """The earliest moment (s) of which a sensor reads at a time, or the time itself."""
        at = np.array([time])
        return min([time, *(float(self._sensors.true_times(c, at)[0]) for c in self._sensors.channels)])

    def fit(self, samples: Samples, sigma: np.ndarray, pulses: Pulses | None = None, origin: float = 0.0) -> Fit | None:
        """The fit, or None where the samples cannot carry one. ``sigma`` is the noise of each of `OUTPUTS`."""
        usable = np.isin(samples.column, self.read)
        time, column, value = samples.time[usable], samples.column[usable], samples.value[usable]
        s, f = len(self.states), len(self.forces)
        if len(time) < LEAST * (s + f):
            return None
        weight = 1.0 / sigma[column]
        reading = _Reading(self._sensors, time, column)
        grid = reading.grid
        seen = [OUTPUTS[c] for c in np.unique(column)]
        width = columns_for(seen, self.model.known_effects.values())
        run = _Run(self.model, grid, pulses, origin, self._inverse_inertia, width)

        def look(x: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """Outputs (g, w), residuals (n,) and derivatives (n, s + f) over noise at a start and a force."""
            xs, forces = np.tile(x, (1 + s + f, 1)), np.tile(force, (1 + s + f, 1))
            steps = np.concatenate([STATE_STEPS[self.states], FORCE_STEPS[self.forces]])
            for j, i in enumerate(self.states):
                xs[1 + j, i] += STATE_STEPS[i]
            for j, i in enumerate(self.forces):
                forces[1 + s + j, i] += FORCE_STEPS[i]
            out = run(xs, forces)
            predicted = reading.read(out) * weight
            free = reading.own_states(out[0]) * weight[:, None]
            left, slopes = value * weight - predicted[0], ((predicted[1:] - predicted[0]) / steps[:, None]).T
            return out[0], _beside(free, left), _beside(free, slopes)

        x, force = _guess(grid[0], time, column, value), np.zeros(4)
        found = self._descend(look, x, force, s)  # the model's own run
        if found is None:
            return None
        x, _, out, residual, derivative = found
        bare = residual
        force_now = _solve(derivative, residual)
        if force_now is None:
            return None
        step, covariance = force_now
        spread = np.sqrt(np.diag(covariance)[s:])
        if (np.abs(step[s:]) > LARGE * spread).any():
            found = self._descend(look, x, force, s + f)
            if found is None:
                return None
            _, force, out, left, derivative = found
            solved = _solve(derivative, left)
            if solved is None:
                return None
            spread = np.sqrt(np.diag(solved[1])[s:])
        else:
            force[self.forces] = step[s:]
            left = residual - derivative @ step
        full, error = np.full(4, np.nan), np.full(4, np.nan)
        full[self.forces], error[self.forces] = force[self.forces], spread
        everywhere = np.full(len(usable), np.nan)
        remains = everywhere.copy()
        everywhere[usable], remains[usable] = bare / weight, left
        gaps = out[:, 8:11].min()
        return Fit(full, error, everywhere, remains, out[[0, len(out) // 2, -1], :8], float(gaps), bool(gaps < 0))

    def _descend(self, look, x: np.ndarray, force: np.ndarray, unknowns: int):
        """Gauss–Newton in the first ``unknowns`` of states and forces; None where it does not converge."""
        s = len(self.states)
        for _ in range(ITERATIONS):
            out, residual, derivative = look(x, force)
            solved = _solve(derivative[:, :unknowns], residual)
            if solved is None:
                return None
            step = solved[0]
            if np.abs(derivative[:, :unknowns] @ step).max() < CONVERGED:
                return x, force, out, residual, derivative
            x, force = x.copy(), force.copy()
            x[self.states] += step[:s]
            force[self.forces[: unknowns - s]] += step[s:]
        return None


class _Run:
    """Simulates batches of starts and forces through a grid of times."""

    def __init__(
        self,
        model: Model,
        grid: np.ndarray,
        pulses: Pulses | None,
        origin: float,
        inverse_inertia: np.ndarray,
        width: int,
    ) -> None:
        self.model, self.grid, self.origin, self.inverse_inertia = model, grid, origin, inverse_inertia
        self.width = width
        none = (np.empty(0),) * 3
        self.pulses = pulses.arrays(model.parameters["wavelength"]) if pulses is not None else none
        self.carries = model.carries_states

    def __call__(self, x: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Outputs (j, g, w) from starts (j, 8) under constant forces (j, 4)."""
        model, jobs = self.model, len(x)
        state = np.zeros((jobs, len(model.kernel.states)))
        state[:, :8] = x
        if self.carries:
            for row in state:
                row[:] = model.with_effect_states(
                    row, self.grid[0], None, None if model.drive == "averaged" else self.pulses, self.origin
                )
        P, on = np.tile(model.vector, (jobs, 1)), np.tile(model.switches, (jobs, 1))
        origin, averaged = np.full(jobs, self.origin), model.drive == "averaged"
        acceleration = force * self.inverse_inertia
        out = np.empty((jobs, len(self.grid), self.width))
        here = np.empty((jobs, 1, self.width))  # contiguous: for a slice of `out` the kernel would be compiled anew
        kick = np.zeros_like(acceleration)
        before = self.grid[0]
        for k, time in enumerate(self.grid):
            half = 0.5 * (time - before) * acceleration
            state[:, 4:8] += kick + half
            model.kernel.simulate_batch(
                self.grid[k : k + 1], before, state, P, on, model.moving, origin, averaged, *self.pulses, 1.0, here
            )
            out[:, k] = here[:, 0]
            out[:, k, 4:8] += half
            kick, before = half, time
        return out


class _Reading:
    """What the model's sensors read at each sample; ``grid`` are the times of the truth that this takes.

    How the states of a sensor stood when the window began, nobody knows: they settle on what is read then, and what
    they may do beside that (`own_states`) is no evidence."""

    def __init__(self, sensors: Sensors, time: np.ndarray, column: np.ndarray) -> None:
        self.sensors, self.time, self.column = sensors, time, column
        ends = [time.min(), time.max()]
        self._faulty: dict[str, np.ndarray] = {}
        for channel in sensors.channels:
            mine = np.flatnonzero(column == INDEX[channel])
            if mine.size:
                self._faulty[channel] = mine[np.argsort(time[mine], kind="stable")]
                looks_at = sensors.true_times(channel, time[mine])
                ends += [looks_at.min(), looks_at.max()]
        self.grid = _grid(np.concatenate([time, [min(ends), max(ends)]]))
        self._row = np.searchsorted(self.grid, time)

    def read(self, out: np.ndarray) -> np.ndarray:
        """Readings (j, n) of simulated outputs (j, g, w)."""
        values = out[:, self._row, self.column]
        for channel, mine in self._faulty.items():
            values[:, mine] = self.sensors.read(
                channel, self.time[mine], self.grid, out, past=self._settled(channel, out[0]), held=True
            )
        return values

    def own_states(self, out: np.ndarray) -> np.ndarray:
        """Change of the readings (n, k) of one run (g, w) with each state of each sensor at the window's begin."""
        columns = []
        for channel, mine in self._faulty.items():
            if count := self.sensors.states(channel):
                begin = self._settled(channel, out)
                moved = Past(
                    begin.time, begin.states + np.vstack([np.zeros(count), CHANNEL[channel].noise * np.eye(count)])
                )
                which = np.zeros(count + 1, np.int64)
                values = self.sensors.read(
                    channel, self.time[mine], self.grid, out[None], which=which, past=moved, held=True
                )
                column = np.zeros((len(self.time), count))
                column[mine] = (values[1:] - values[0]).T
                columns.append(column)
        return np.hstack(columns) if columns else np.zeros((len(self.time), 0))

    def _settled(self, channel: str, run: np.ndarray) -> Past | None:
        if not self.sensors.states(channel):
            return None
        begin = self.time[self._faulty[channel][:1]]
        return self.sensors.go_on(channel, begin, np.append(begin, begin + 1.0), _held(self.grid, run, begin), None)[1]


def _held(grid: np.ndarray, run: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """The outputs (2, w) of a run (g, w) at the grid's point ``begin`` (1,), twice."""
    return run[np.searchsorted(grid, begin.repeat(2))]


def _beside(columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """What of ``rows`` (n,) or (n, m) is not in the span of ``columns`` (n, k)."""
    if not columns.shape[1]:
        return rows
    basis, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, sizes > UNSEEN * len(sizes)]
    return rows - basis @ (basis.T @ rows)


def _grid(times: np.ndarray) -> np.ndarray:
    """The distinct times and, where they lie further apart than `KICK`, others between."""
    times = np.unique(times)
    wide = np.flatnonzero(np.diff(times) > KICK)
    between = [
        np.linspace(times[i], times[i + 1], int(np.ceil((times[i + 1] - times[i]) / KICK)) + 1)[1:-1] for i in wide
    ]
    return np.union1d(times, np.concatenate(between)) if between else times


def _guess(start: float, time: np.ndarray, column: np.ndarray, value: np.ndarray) -> np.ndarray:
    """A state to start from: parabolas through the positions, lines through the rates."""
    x = np.zeros(8)
    for i, (coordinate, rate) in enumerate(zip(COORDINATES, RATES, strict=True)):
        for name, degree, entries in ((coordinate, 2, (i, 4 + i)), (rate, 1, (4 + i,))):
            mine = column == INDEX[name]
            if mine.sum() > degree:
                fitted = np.polynomial.Polynomial.fit(time[mine], value[mine], degree)
                for order, entry in enumerate(entries):
                    x[entry] = fitted.deriv(order)(start) if order else fitted(start)
    return x


def _solve(derivative: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Least-squares step and its covariance; None for numbers that are not finite or unknowns that nothing shows."""
    if not (np.isfinite(derivative).all() and np.isfinite(residual).all()):
        return None
    scale = np.linalg.norm(derivative, axis=0)
    if not scale.all():
        return None
    scaled = derivative / scale
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    if values[0] < SINGULAR * values[-1]:
        return None
    inverse = (vectors / values) @ vectors.T / scale / scale[:, None]
    return inverse @ (derivative.T @ residual), inverse
