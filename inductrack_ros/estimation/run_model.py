# SPDX-License-Identifier: Apache-2.0
"""One run of a problem as the model of a structure has it: from node to node of its grid, at its nodes, and as its
sensors read it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..core.model import Model
from ..core.state import MOTION
from .problem import Problem, RunData
from .structure import Structure


@dataclass(frozen=True)
class RunModel:
    """Run ``i`` of a problem under a structure. Its trajectories are states (n, N) at the n nodes of its grid."""

    problem: Problem
    structure: Structure
    i: int

    @property
    def data(self) -> RunData:
        """The run."""
        return self.problem.runs[self.i]

    @property
    def model(self) -> Model:
        """The structure's model."""
        return self.structure.model

    @property
    def sigma(self) -> np.ndarray:
        """Noise (m,) of each reading."""
        return self.problem.sigma[self.data.channel]

    def vectors(self, thetas: np.ndarray) -> np.ndarray:
        """Kernel parameter vectors (j, p) for each row of thetas (j, g)."""
        return self.problem.vectors(self.structure, self.i, thetas)

    def pieces(
        self, path: np.ndarray, thetas: np.ndarray, offsets: np.ndarray | None = None, some: slice = slice(None)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (n, jobs, 15) at each node and states (n, jobs, N) at the next, of a trajectory moved by each job's
        offsets (jobs, N) (none, unless given) and theta. With ``some`` these are at some neighbouring nodes, of which
        the last is no piece."""
        data, model = self.data, self.model
        offsets = np.zeros((len(thetas), path.shape[1])) if offsets is None else offsets
        grid, nodes = data.grid[some], np.ascontiguousarray(path[some])
        outputs, ends = np.empty((len(nodes), len(offsets), self.problem.width)), np.empty((len(nodes), *offsets.shape))
        model.kernel.linearise_pieces(
            grid, nodes, offsets, self.vectors(thetas), model.switches, model.moving, float(path[0, 0]), data.averaged,
            *data.pulses, 1.0, outputs, ends,
        )  # fmt: skip
        return outputs, ends

    def forced(self, path: np.ndarray, thetas: np.ndarray, pulses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (n, jobs, 15) at each node of a trajectory, and what the accelerations at both ends of a piece do to
        places and rates until the next (n, jobs, 8), for each theta; ``pulses`` (n,) as `linear.mean_pulse` gives
        them."""
        data, model = self.data, self.model
        P = self.vectors(thetas)
        outputs, changes = np.empty((len(path), len(P), self.problem.width)), np.empty((len(path), len(P), 8))
        model.kernel.forced_pieces(
            data.grid, np.ascontiguousarray(path), P, model.switches, model.moving, float(path[0, 0]), data.averaged,
            pulses, *data.pulses, outputs, changes,
        )  # fmt: skip
        return outputs, changes

    def read(self, outputs: np.ndarray, thetas: np.ndarray) -> np.ndarray:
        """What the sensors read, (jobs, m), from the nodes' outputs (n, jobs, 15)."""
        of_jobs = np.ascontiguousarray(outputs.transpose(1, 0, 2))
        return self.problem.predict(self.structure, self.i, thetas, of_jobs)

    def followed(self, path: np.ndarray, x: np.ndarray, P: np.ndarray, own: slice = slice(None)) -> np.ndarray:
        """A trajectory in which the ``own`` states are those that the model flies to from node to node, from a state x
        (N,) at the first; P (1, p) are the kernel's parameters."""
        data, model, path = self.data, self.model, path.copy()
        row = np.empty((1, 1, len(MOTION)))
        path[0, own] = x[own]
        for k in range(len(path) - 1):
            x = path[k : k + 1].copy()
            model.kernel.simulate_batch(
                data.grid[k + 1 : k + 2], float(data.grid[k]), x, P, model.switches[None], model.moving,
                path[:1, 0].copy(), data.averaged, *data.pulses, 1.0, row,
            )  # fmt: skip
            path[k + 1, own] = x[0, own]
        return path
