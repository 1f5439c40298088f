# SPDX-License-Identifier: Apache-2.0
"""What a small force, whatever its law, would do to the measurements: variation of constants along a run.

The trajectory is linearised interval by interval, δs_{k+1} = Φ_k δs_k, with Φ_k from differences of one-interval
simulations (through contact too, where a single long sensitivity would be singular). Any force history f(t) in a
coordinate then shows in the measurements as a sum over those intervals, so whole libraries of force laws cost one
linearisation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.cache import compiled_once
from ..core.kernel import QUANTITIES
from ..core.state import ACCELERATIONS, COORDINATES, GAPS, INDEX, MOVING, OUTPUTS, STATES, Dof

#: Steps of the state's differences, by state: above rounding, and small enough for runs whose errors grow
#: ten-thousandfold
STATE_STEPS = np.array([3e-7, 3e-8, 3e-8, 3e-7, 3e-6, 3e-7, 3e-7, 3e-6])


@compiled_once
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

    def __init__(self, data, sigma: np.ndarray, model, P: np.ndarray, outputs: np.ndarray, dof: Dof):
        """``data`` a `problem.RunData`, P (p,) the kernel's parameters, ``outputs`` (n, 15) the simulated run."""
        self.data, self.sigma, self.outputs = data, sigma, outputs
        self.grid, self.model, self.P = data.grid, model, P
        inertia = [P[model.kernel.parameters.index(name)] for name in ("mass", "roll_inertia")]
        self.inverse_inertia = np.array([1 / inertia[0]] * 3 + [1 / inertia[1]])
        self.transitions = _transitions(data, model, P, outputs, dof)
        self.geometry = gap_geometry(model)

    @property
    def variables(self) -> dict[str, np.ndarray]:
        """Histories (n,) of what a force may depend on."""
        histories = {s: self.outputs[:, INDEX[s]] for s in STATES}
        return histories | {"time": self.grid, "drive": self.data.drive}

    def quantities(
        self, names: Sequence[str], offset: np.ndarray | float = 0.0, on: np.ndarray | None = None
    ) -> np.ndarray:
        """Quantities (n, q) of the equations along the run, its states moved by an ``offset`` (8,); ``on`` other
        switches."""
        path = np.zeros((len(self.grid), len(self.model.kernel.states)))
        path[:, :8] = self.outputs[:, :8] + offset
        return quantities_along(self.data, self.model, self.P, path, names, on)

    def forces(self, acts_on: str, histories: np.ndarray) -> np.ndarray:
        """Force histories (n, 4, l) from those (n, l) of what a stand-in acts on: a coordinate's force, or shares of
        the thrust."""
        forces = np.zeros((len(histories), 4, histories.shape[1]))
        if acts_on == "thrust":
            others = self.model.switches & (np.array(self.model.kernel.effects) != "stand_in_thrust")
            forces[:, 0] = self.quantities(["thrust"], on=others) * histories
        else:
            forces[:, COORDINATES.index(acts_on)] = histories
        return forces

    def respond(self, forces: np.ndarray) -> np.ndarray:
        """Change of the measurements over noise, (m, l), that force histories (n, 4, l) (N, N·m by coordinate) would
        make."""
        a = forces * self.inverse_inertia[:, None]
        half = 0.5 * np.diff(self.grid)
        state = _propagate(self.transitions, np.ascontiguousarray(a), half)
        width = a.shape[2]
        data = self.data
        result = np.full((len(data.y), width), np.nan)
        for column in np.unique(data.column):
            mine = data.column == column
            result[mine] = self._output(OUTPUTS[column], state)[data.row[mine]]
        return result / self.sigma[data.channel][:, None]

    def _output(self, name: str, state: np.ndarray) -> np.ndarray:
        if name in STATES:
            return state[:, STATES.index(name)]
        if name in GAPS:
            return np.einsum("c,ncl->nl", self.geometry[GAPS.index(name)], state[:, :4])
        if name in ACCELERATIONS:
            return np.gradient(state[:, 4 + ACCELERATIONS.index(name)], self.grid, axis=0)
        return np.einsum("ns,nsl->nl", self._slopes(name), state)

    def _slopes(self, name: str) -> np.ndarray:
        """Derivative (n, 8) of a channel beside the motion by the states along the run."""
        moved = np.diag(STATE_STEPS)
        ahead, behind = (
            np.column_stack([self.quantities([name], side * offset)[:, 0] for offset in moved]) for side in (1.0, -1.0)
        )
        return (ahead - behind) / (2.0 * STATE_STEPS)


def quantities_along(
    data, model, P: np.ndarray, path: np.ndarray, names: Sequence[str], on: np.ndarray | None = None
) -> np.ndarray:
    """Quantities (n, q) of the equations along a run's states (n, N); ``on`` other switches than the model's."""
    on = model.switches if on is None else on
    dx, q = np.zeros(path.shape[1]), np.zeros(len(QUANTITIES))
    columns = [QUANTITIES.index(n) for n in names]
    out = np.zeros((len(path), len(columns)))
    for k, t in enumerate(data.grid):
        model.kernel.evaluate(t, path[k].copy(), P, on, model.moving, 0.0, data.averaged, *data.pulses, dx, q)
        out[k] = q[columns]
    return out


def gap_geometry(model) -> np.ndarray:
    """Derivative (3, 4) of the gaps by the coordinates at small roll, (29)–(34)."""
    c = np.sqrt(0.5)
    p = model.parameters
    arm = p["magnet_side_offset"] + p["magnet_side_height"]
    return np.array([[0, 0, 1, 0], [0, -c, -c, c * arm], [0, c, -c, -c * arm]])


def _transitions(data, model, P: np.ndarray, outputs: np.ndarray, dof: Dof) -> np.ndarray:
    """Φ_k (n−1, 8, 8): derivative of the state at the next grid point by the state at this one."""
    grid = data.grid
    n_states = len(model.kernel.states)
    free = np.array([s.removesuffix("_rate") in MOVING[dof] for s in STATES])
    moved = np.flatnonzero(free | (np.arange(8) == 0))
    result = np.tile(np.eye(8), (len(grid) - 1, 1, 1))
    finite = np.logical_and.reduce(np.isfinite(outputs[:-1, :8]), axis=1)
    known = int(finite.argmin()) if not finite.all() else len(finite)  # grid points before a run left all bounds
    x = np.zeros((known, n_states))
    x[:, :8] = outputs[:known, :8]
    if model.carries_states:
        for k in range(known):
            x[k] = model.with_effect_states(x[k], grid[k], P, data.fired, outputs[0, 0])
    offsets = np.zeros((1 + len(moved), n_states))
    offsets[1 + np.arange(len(moved)), moved] = STATE_STEPS[moved]
    out = np.empty((known, len(offsets), 8))
    model.kernel.simulate_pieces(
        grid, x, offsets, P, model.switches, model.moving, float(outputs[0, 0]), data.averaged, *data.pulses, 1.0, out
    )
    result[:known][:, :, moved] = ((out[:, 1:] - out[:, :1]) / STATE_STEPS[moved, None]).transpose(0, 2, 1)
    return result
