"""What a small force, whatever its law, would do to the measurements: variation of constants along a fitted run.

The fitted trajectory is linearised interval by interval, δs_{k+1} = Φ_k δs_k, with Φ_k from differences of one-interval
simulations (through contact too, where a single long sensitivity would be singular). Any force history f(t) in a
coordinate then shows in the measurements as a sum over those intervals, so whole libraries of force laws are
screened for the price of one linearisation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from ..core.state import ACCELERATIONS, COORDINATES, GAPS, INDEX, MOVING, OUTPUTS, STATES
from ..estimation.fit import Fit
from ..estimation.problem import STATE_STEPS, Problem

#: What a missing force may depend on, as `diagnosis.json` names it.
VARIABLES = (*STATES, "time", "drive")


@numba.njit(cache=True, nogil=True)
def _propagate(transitions, a, half):
    """δs_{k+1} = Φ_k (δs_k + h/2 a_k) + h/2 a_{k+1}: trapezoid of the kicks, (n, 8, l) from accelerations (n, 4, l)."""
    n, _, width = a.shape
    state = np.zeros((n, 8, width))
    kicked = np.empty((8, width))
    for k in range(n - 1):
        kicked[:] = state[k]
        kicked[4:] += half[k] * a[k]
        state[k + 1] = transitions[k] @ kicked
        state[k + 1, 4:] += half[k] * a[k + 1]
    return state


class RunResponse:
    """One run's response to small forces: ``variables`` (n,) by name on its grid, `respond` for force histories."""

    def __init__(self, problem: Problem, fit: Fit, i: int):
        data, model = problem.runs[i], fit.model
        self.data, self.sigma = data, problem.sigma
        self.outputs = problem.simulate(fit.structure, i, fit.theta[None], fit.states[i][None])[0]
        inertia = model.parameters["mass"], model.parameters["roll_inertia"]
        self.inverse_inertia = np.array([1 / inertia[0]] * 3 + [1 / inertia[1]])
        self.transitions = _transitions(problem, fit, i, self.outputs)
        self.geometry = _gap_geometry(model)

    @property
    def variables(self) -> dict[str, np.ndarray]:
        """Histories (n,) of what a force may depend on."""
        n = len(self.data.grid)
        histories = {s: self.outputs[:, INDEX[s]] for s in STATES}
        return histories | {"time": self.data.grid, "drive": np.full(n, self.data.run.drive_current)}

    def respond(self, forces: np.ndarray) -> np.ndarray:
        """Change of the measurements over noise, (m, l), that force histories (n, 4, l) (N, N·m by coordinate) would make."""
        a = forces * self.inverse_inertia[:, None]
        half = 0.5 * np.diff(self.data.grid)
        state = _propagate(self.transitions, np.ascontiguousarray(a), half)
        width = a.shape[2]
        data = self.data
        result = np.empty((len(data.y), width))
        for column in np.unique(data.column):
            mine = data.column == column
            result[mine] = self._output(OUTPUTS[column], state)[data.row[mine]]
        return result / self.sigma[data.channel][:, None]

    def _output(self, name: str, state: np.ndarray) -> np.ndarray:
        if name in STATES:
            return state[:, STATES.index(name)]
        if name in GAPS:
            return np.einsum("c,ncl->nl", self.geometry[GAPS.index(name)], state[:, :4])
        rate = state[:, 4 + ACCELERATIONS.index(name)]
        return np.gradient(rate, self.data.grid, axis=0)


def _gap_geometry(model) -> np.ndarray:
    """Derivative (3, 4) of the gaps by the coordinates at small roll, (29)–(34)."""
    c = np.sqrt(0.5)
    p = model.parameters
    arm = p["magnet_side_offset"] + p["magnet_side_height"]
    return np.array([[0, 0, 1, 0], [0, -c, -c, c * arm], [0, c, -c, -c * arm]])


def _transitions(problem: Problem, fit: Fit, i: int, outputs: np.ndarray) -> np.ndarray:
    """Φ_k (n−1, 8, 8): derivative of the state at the next grid point by the state at this one."""
    data, model = problem.runs[i], fit.model
    structure = fit.structure
    P = structure.vectors(fit.theta[None])
    P[:, model.kernel.parameters.index("drive_current")] = data.run.drive_current
    n_states = len(model.kernel.states)
    free = np.array([s.removesuffix("_rate") in MOVING[problem.dof] for s in STATES])
    moved = np.flatnonzero(free | (np.arange(8) == 0))
    jobs = 2 * len(moved)
    Ps, on = np.tile(P, (jobs, 1)), np.tile(model.switches, (jobs, 1))
    origin = np.full(jobs, float(fit.states[i][0]))
    out = np.empty((jobs, 1, len(OUTPUTS)))
    result = np.tile(np.eye(8), (len(data.grid) - 1, 1, 1))
    offsets = np.zeros((jobs, n_states))
    for k, s in enumerate(moved):
        offsets[2 * k, s], offsets[2 * k + 1, s] = STATE_STEPS[s], -STATE_STEPS[s]
    base = np.zeros(n_states)
    carries = n_states > 8 and any(model.known_effects[e].states for e in model.kernel.effects if e in model.effects)
    for k in range(len(data.grid) - 1):
        base[:8] = outputs[k, :8]
        if not np.isfinite(base).all():
            break
        x = (model.with_effect_states(base, data.grid[k]) if carries else base) + offsets
        model.kernel.simulate_batch(
            data.grid[k + 1 : k + 2], data.grid[k], x, Ps, on, model.moving, origin, data.averaged, *data.pulses, 1.0, out
        )
        for j, s in enumerate(moved):
            result[k, :, s] = (out[2 * j, 0, :8] - out[2 * j + 1, 0, :8]) / (2 * STATE_STEPS[s])
    return result


def responses(problem: Problem, fit: Fit) -> list[RunResponse]:
    """`RunResponse` of every run."""
    return problem.for_runs(lambda i: RunResponse(problem, fit, i))


def knots(responses: Sequence[RunResponse], variable: str, count: int) -> tuple[float, float] | None:
    """Start and spacing of ``count`` basis functions over the range a variable covers in all runs; None if it does not move."""
    values = np.concatenate([r.variables[variable] for r in responses])
    values = values[np.isfinite(values)]
    low, high = np.quantile(values, [0.001, 0.999]) if values.size else (0.0, 0.0)
    scale = max(abs(low), abs(high), 1e-9)
    if high - low < 1e-6 * scale:
        return None
    return float(low), float((high - low) / (count - 1))


def basis(values: np.ndarray, start: float, step: float, count: int) -> np.ndarray:
    """Uniform cubic B-splines (n, count), centred on start + j·step; held constant outside the range."""
    u = np.clip((values - start) / step, 0.0, count - 1.0)[:, None] - np.arange(count)
    u = np.abs(u)
    return np.where(u < 1, 2 / 3 - u**2 + u**3 / 2, np.where(u < 2, (2 - u) ** 3 / 6, 0.0))


def in_coordinate(coordinate: int, histories: np.ndarray) -> np.ndarray:
    """Force histories (n, 4, l) from those (n, l) of one coordinate."""
    forces = np.zeros((histories.shape[0], 4, histories.shape[1]))
    forces[:, coordinate] = histories
    return forces


def moving_coordinates(dof: int) -> list[int]:
    """Indices of the coordinates that move."""
    return [i for i, c in enumerate(COORDINATES) if c in MOVING[dof]]
