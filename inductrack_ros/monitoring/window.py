"""One short window of measurements: the run of the model that fits it best, and the constant force that it lacks.

Each window is fitted by itself, state at its start and force together (Gauss–Newton on weighted residuals). Nothing is
carried from one to the next, so that with a complete model and white noise the forces of different windows are
independent and normal about zero, with the covariance that the fit gives: what `evidence` builds on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.model import Model, Pulses
from ..core.state import COORDINATES, INDEX, MOVING, OUTPUTS, RATES, STATES
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
    """``force`` and its ``sigma`` (4,) in N, N, N, N·m (NaN where held); ``residual`` (n,) of the model without a force;
    ``left`` (n,) what remains with it, over noise; ``path`` (3, 8) the states at begin,
    middle and end; ``gap`` (m), the least; ``contact``."""

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
        self.forces = [i for i, c in enumerate(COORDINATES) if c in moving]
        p = model.parameters
        self._inverse_inertia = np.array([1 / p["mass"]] * 3 + [1 / p["roll_inertia"]]) * model.moving
        self._sensors = _Sensors(model)

    def fit(self, samples: Samples, sigma: np.ndarray, pulses: Pulses | None = None, origin: float = 0.0) -> Fit | None:
        """The fit, or None where the samples cannot carry one. ``sigma`` (8,) is the noise of the eight states."""
        usable = np.isin(samples.column, self.states)
        time, column, value = samples.time[usable], samples.column[usable], samples.value[usable]
        s, f = len(self.states), len(self.forces)
        if len(time) < LEAST * (s + f):
            return None
        weight = 1.0 / sigma[column]
        reading = self._sensors.reading(time, column)
        grid = _grid(reading.times)
        run = _Run(self.model, grid, pulses, origin, self._inverse_inertia)

        def look(x: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """Outputs (g, 15), residuals (n,) and derivatives (n, s + f) over noise at a start and a force."""
            xs, forces = np.tile(x, (1 + s + f, 1)), np.tile(force, (1 + s + f, 1))
            steps = np.concatenate([STATE_STEPS[self.states], FORCE_STEPS[self.forces]])
            for j, i in enumerate(self.states):
                xs[1 + j, i] += STATE_STEPS[i]
            for j, i in enumerate(self.forces):
                forces[1 + s + j, i] += FORCE_STEPS[i]
            out = run(xs, forces)
            predicted = reading.read(out, grid) * weight
            return out[0], value * weight - predicted[0], ((predicted[1:] - predicted[0]) / steps[:, None]).T

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

    def __init__(self, model: Model, grid: np.ndarray, pulses: Pulses | None, origin: float, inverse_inertia: np.ndarray) -> None:
        self.model, self.grid, self.origin, self.inverse_inertia = model, grid, origin, inverse_inertia
        none = (np.empty(0),) * 3
        self.pulses = pulses.arrays(model.parameters["wavelength"]) if pulses is not None else none
        self.carries = model.carries_states

    def __call__(self, x: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Outputs (j, g, 15) from starts (j, 8) under constant forces (j, 4)."""
        model, jobs = self.model, len(x)
        state = np.zeros((jobs, len(model.kernel.states)))
        state[:, :8] = x
        if self.carries:
            for row in state:
                row[:] = model.with_effect_states(row, self.grid[0])
        P, on = np.tile(model.vector, (jobs, 1)), np.tile(model.switches, (jobs, 1))
        origin, averaged = np.full(jobs, self.origin), model.drive == "averaged"
        acceleration = force * self.inverse_inertia
        out = np.empty((jobs, len(self.grid), len(OUTPUTS)))
        kick = np.zeros_like(acceleration)
        before = self.grid[0]
        for k, time in enumerate(self.grid):
            half = 0.5 * (time - before) * acceleration
            state[:, 4:8] += kick + half
            here = out[:, k : k + 1]
            model.kernel.simulate_batch(
                self.grid[k : k + 1], before, state, P, on, model.moving, origin, averaged, *self.pulses, 1.0, here
            )
            here[:, 0, 4:8] += half
            kick, before = half, time
        return out


class _Sensors:
    """The model's sensor effects (delay, scale, bias, a user's own), by output column."""

    def __init__(self, model: Model) -> None:
        self._of: dict[int, list] = {}
        for name, parameters in model.effects.items():
            base, colon, channel = name.partition(":")
            if colon:
                self._of.setdefault(INDEX[channel], []).append((model.known_effects[base], parameters))

    def reading(self, time: np.ndarray, column: np.ndarray) -> _Reading:
        times, after = time.copy(), []
        for c, effects in self._of.items():
            mine = column == c
            for effect, parameters in effects:
                function = np.vectorize(effect.function, otypes=[float])  # may be a user's, with an if in it
                if effect.targets == ("sample_time",):
                    times[mine] = function(sample_time=times[mine], **parameters) if mine.any() else times[mine]
                elif mine.any():
                    after.append((mine, function, parameters))
        return _Reading(np.round(times, 9), column, after)


@dataclass(frozen=True)
class _Reading:
    """At which ``times`` each sample's sensor saw its ``column``, and what it makes of it."""

    times: np.ndarray
    column: np.ndarray
    after: list

    def read(self, out: np.ndarray, grid: np.ndarray) -> np.ndarray:
        """Readings (j, n) of simulated outputs (j, g, 15)."""
        values = out[:, np.searchsorted(grid, self.times), self.column]
        for mine, function, parameters in self.after:
            values[:, mine] = function(measured=values[:, mine], **parameters)
        return values


def _grid(times: np.ndarray) -> np.ndarray:
    """The distinct times and, where they lie further apart than `KICK`, others between."""
    times = np.unique(times)
    wide = np.flatnonzero(np.diff(times) > KICK)
    between = [np.linspace(times[i], times[i + 1], int(np.ceil((times[i + 1] - times[i]) / KICK)) + 1)[1:-1] for i in wide]
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
