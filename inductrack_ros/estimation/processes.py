# SPDX-License-Identifier: Apache-2.0
"""What a log or a rig does besides the model and white noise, as further states of the linear system of a run.

Each process is linear and Gaussian. Its variance, and perhaps a time, is found by marginal likelihood. There are noise
of another size, noise with a memory (Ornstein–Uhlenbeck, for irregular samples too), a hum, stamps that jitter, and a
parameter that differs from run to run. A process competes with physics on equal terms: both are judged by the deviance
they take away."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..checks.steps import on_grid
from ..core.state import ACCELERATIONS, INDEX
from .kalman import LinearRun, Smoothed
from .problem import Problem, RunData
from .structure import Structure

WHITE, NOISY_RUN, COLOURED, HUM, JITTER, RUN_TO_RUN, IMPACT, ROUNDED = (
    "noise_differs", "noisy_run", "coloured_noise", "hum", "time_jitter", "run_to_run", "impact", "quantised"
)  # fmt: skip
#: By kind: the states that it adds to a run, the parameters that it has to be found (none: it is there or not, and its
#: size is not sought), and the size at which it is nothing (share of the noise, s, share of a typical size).
KINDS = {
    WHITE: (0, 1, 1e-2),
    NOISY_RUN: (0, 1, 1e-2),
    COLOURED: (1, 2, 1e-3),
    HUM: (2, 2, 1e-3),
    JITTER: (1, 1, 1e-7),
    RUN_TO_RUN: (1, 1, 1e-6),
    IMPACT: (0, 0, 1e-6),
    ROUNDED: (0, 0, 1e-6),
}
#: Size (m/s at each node) of an impact while a fit looks where the runs touch the track, and from then on: small enough
#: that the normal force stays what the model says, for friction hangs on it; large enough that the nodes of a stiff
#: contact find their place.
LOOSE, TIGHT = 0.1, 5e-3
#: Terms of a sawtooth's Fourier series.
TERMS = 40
#: The rates that an impact changes, and how fast each turns per m/s of it.
STRUCK, STRUCK_BY = slice(5, 8), np.array([1.0, 1.0, 10.0])


@dataclass(frozen=True)
class Process:
    """One process: its kind, the channel, run or free parameter it is ``on``, its size and its time.

    ``size`` is a standard deviation, never above ``most``. Its unit depends on the kind:

    - white, coloured, hum (its amplitude): the channel's noise; noisy run: the noise of every channel in that run
    - jitter: s
    - run to run: typical sizes of the parameter
    - impact: m/s at each node of a contact. Contact is stiff, and no law of it is right to the last micrometre.
    - quantised: steps, of the noise beside the rounding

    ``time`` is the correlation time (s) of coloured noise, the period (s) of a hum, and the step of rounded readings.
    """

    kind: str
    on: str = ""
    size: float = 1.0
    time: float = 0.0
    most: float = np.inf

    @property
    def states(self) -> int:
        """How many states it adds to a run."""
        return KINDS[self.kind][0]

    @property
    def freedom(self) -> int:
        """How many parameters it has to be found; none where it is there or not."""
        return KINDS[self.kind][1]

    @property
    def gone(self) -> bool:
        """Whether nothing is left of it."""
        return self.size < 3.0 * KINDS[self.kind][2]

    def noisier(self, problem: Problem, data: RunData) -> np.ndarray:
        """The readings (m,) of a run whose noise it scales."""
        if self.kind == WHITE:
            return data.channel == problem.channels.index(self.on)
        return np.full(len(data.y), self.kind == NOISY_RUN and self.on == data.run.name)


def augmented(
    problem: Problem, structure: Structure, i: int, system: LinearRun, processes: Sequence[Process]
) -> LinearRun:
    """Run i's linear system with the states of all processes behind its own."""
    data = problem.runs[i]
    variance, kicked, y = system.variance.copy(), system.kicks.copy(), system.data.copy()
    blown = np.zeros(len(variance))
    for p in processes:
        if p.kind in (WHITE, NOISY_RUN):
            variance[p.noisier(problem, data)] *= p.size**2
        if p.kind == IMPACT:
            kicked[system.touching, STRUCK] += (p.size * STRUCK_BY) ** 2
            blown += _struck_meanwhile(problem, data, system) @ (p.size * STRUCK_BY) ** 2
        if p.kind == ROUNDED:
            y[:, 0] -= rounding(problem, data, system, p)
    system = replace(system, variance=variance + blown, kicks=kicked, data=y, blown=blown)
    blocks = [_block(problem, structure, data, system, p) for p in processes if p.states]
    if not blocks:
        return system
    n, N, c = system.inputs.shape
    wide = N + sum(p.states for p in processes)
    H = np.hstack([system.sensitivity, *(b.sensitivity for b in blocks)])
    F = np.zeros((n, wide, wide))
    F[:, :N, :N] = system.transitions
    root, kicks = np.zeros((wide, wide)), np.zeros((n, wide))
    root[:N, :N], kicks[:, :N] = system.start_root, system.kicks
    inputs, mean = np.zeros((n, wide, c)), np.zeros((wide, c))
    inputs[:, :N], mean[:N] = system.inputs, system.start_mean
    at = N
    for b in blocks:
        own = slice(at, at + b.transitions.shape[1])
        F[:, own, own], F[:, :N, own] = b.transitions, b.coupling
        root[own, own], kicks[:, own] = np.eye(b.transitions.shape[1]) * b.size, b.kicks
        at = own.stop
    return replace(system, sensitivity=H, transitions=F, inputs=inputs, start_root=root, start_mean=mean, kicks=kicks)


def _struck_meanwhile(problem: Problem, data: RunData, system: LinearRun) -> np.ndarray:
    """Squares (m, 3) of what a unit change of the struck rates does to readings beside what it does to the state.

    An accelerometer reads the blow itself: the rate's change over the time between two nodes."""
    found = _struck_since(data, system)
    for k, name in enumerate(ACCELERATIONS[1:]):
        mine = (data.column == INDEX[name]) & system.touching[data.row]
        found[mine, k] += (problem.sigma[data.channel[mine]] * _nearest(system.spacing)[data.row[mine]]) ** -2.0
    return found


def _nearest(spacing: np.ndarray) -> np.ndarray:
    """Time (n,) from each node to the next, of the last to the one before."""
    return np.append(spacing[:-1], spacing[-2]) if len(spacing) > 1 else np.ones(len(spacing))


def _struck_since(data: RunData, system: LinearRun) -> np.ndarray:
    """Squares (m, 3) of what a unit change of the struck rates does to readings whose moment may be on the other side
    of a contact."""
    late = system.late[:, 1:]
    if not late.any():
        return np.zeros(late.shape)
    reach = 3.0 * np.abs(late).max(axis=1) / np.maximum(np.abs(system.sensitivity[:, 1:4]).max(axis=1), 1e-300)
    touched = np.append(0, np.cumsum(system.touching))
    first, last = (np.searchsorted(data.grid, data.time + side * reach) for side in (-1.0, 1.0))
    between = touched[np.minimum(last + 1, len(data.grid))] - touched[np.maximum(first - 1, 0)]
    return late**2 * (between > 0)[:, None]


@dataclass(frozen=True)
class _Block:
    sensitivity: np.ndarray  # (m, e)
    transitions: np.ndarray  # (n, e, e)
    coupling: np.ndarray  # (n, N, e) into the run's own states
    kicks: np.ndarray  # (n, e)
    size: float  # standard deviation of each state at the start


def _block(problem: Problem, structure: Structure, data: RunData, system: LinearRun, p: Process) -> _Block:
    """The states of one process in one run."""
    n, N = system.inputs.shape[:2]
    T, m, e = system.spacing, len(data.y), p.states
    known = system.known
    H, F, coupling, kicks = np.zeros((m, e)), np.zeros((n, e, e)), np.zeros((n, N, e)), np.zeros((n, e))
    mine = known & (data.channel == problem.channels.index(p.on)) if p.on in problem.channels else known
    if p.kind == COLOURED:
        H[mine, 0] = 1.0
        F[:, 0, 0] = np.exp(-T / p.time)
        kicks[:, 0] = -(p.size**2) * np.expm1(-2.0 * T / p.time)
        return _Block(H, F, coupling, kicks, p.size)
    if p.kind == HUM:
        H[mine, 0] = 1.0
        turn = 2 * np.pi * T / p.time
        F[:, 0, 0], F[:, 0, 1], F[:, 1, 0], F[:, 1, 1] = np.cos(turn), np.sin(turn), -np.sin(turn), np.cos(turn)
        return _Block(H, F, coupling, kicks, p.size / np.sqrt(2.0))
    if p.kind == JITTER:
        H[mine, 0] = _rates(problem, data, system)[mine]
        kicks[:, 0] = p.size**2
        return _Block(H, F, coupling, kicks, p.size)
    k = 1 + structure.free.index(p.on)
    H[mine, 0] = -system.data[mine, k]
    F[:, 0, 0] = 1.0
    coupling[:, :, 0] = system.inputs[:, :, k]
    return _Block(H, F, coupling, kicks, p.size)


def rounding(problem: Problem, data: RunData, system: LinearRun, p: Process) -> np.ndarray:
    """What rounding to the readings' own grid does on average to what is predicted, (m,), in its noise; 0 in other
    channels, and in runs that have no such grid.

    Noise beside the rounding spreads a reading near a cell's edge over two cells: of the sawtooth's Fourier series each
    term is as much smaller as a normal dither makes it (Schuchman 1964)."""
    mine = (data.channel == problem.channels.index(p.on)) & (system.data[:, 0] != 0.0)
    sigma = problem.sigma[problem.channels.index(p.on)]
    predicted = data.y[mine] - system.data[mine, 0] * sigma
    if not mine.any() or not on_grid(data.y[mine], p.time):
        return np.zeros(len(data.y))
    turn = 2.0 * np.pi * (predicted - data.y[mine] % p.time) / p.time
    k = np.arange(1, TERMS + 1)[:, None]
    terms = (-1.0) ** k / (np.pi * k) * np.exp(-2.0 * (np.pi * k * p.size) ** 2) * np.sin(k * turn)
    found = np.zeros(len(data.y))
    found[mine] = p.time * terms.sum(axis=0) / sigma
    return found


def _rates(problem: Problem, data: RunData, system: LinearRun) -> np.ndarray:
    """How fast each reading changes (m,), in its noise per second: along what is predicted, channel by channel."""
    predicted = data.y / problem.sigma[data.channel] - system.data[:, 0]
    rates = np.zeros(len(predicted))
    for c in range(len(problem.channels)):
        mine = np.flatnonzero(data.channel == c)
        if mine.size > 2:
            rates[mine] = np.gradient(predicted[mine], data.time[mine])
    return rates


def offsets(system: LinearRun, wide: LinearRun, deviations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What processes add to the readings (m,), in noise, and to the way to the next node (n, N): smoothed ones (their
    states behind the run's own in ``deviations`` (n, N + e)), and rounding."""
    N = system.transitions.shape[1]
    extra = deviations[:, N:]
    node = np.repeat(np.arange(len(extra)), np.diff(system.first))
    readings = np.einsum("me,me->m", wide.sensitivity[:, N:], extra[node]) + system.data[:, 0] - wide.data[:, 0]
    return readings, np.einsum("nae,ne->na", wide.transitions[:, :N, N:], extra)


def of_variances(
    problem: Problem, processes: Sequence[Process], smooth: Sequence[Smoothed], n_states: int
) -> np.ndarray:
    """Found and expected (2, p) of each process's variance, over all runs: where they are equal it is the likeliest."""
    result, at = np.zeros((2, len(processes))), n_states
    for k, p in enumerate(processes):
        if not p.freedom:
            result[:, k] = 1.0
        elif not p.states:
            for data, s in zip(problem.runs, smooth, strict=True):
                result[:, k] += s.of_readings[:, s.counts & p.noisier(problem, data)].sum(axis=1)
        else:
            result[:, k] = sum(s.of_states[:, at : at + p.states].sum(axis=1) for s in smooth)
            at += p.states
    return result


def resized(processes: Sequence[Process], variances: np.ndarray) -> tuple[Process, ...]:
    """The processes with other variances (p,)."""
    return tuple(
        replace(p, size=float(min(max(np.sqrt(v), KINDS[p.kind][2]), p.most)))
        for p, v in zip(processes, variances, strict=True)
    )


def tightened(processes: Sequence[Process]) -> tuple[Process, ...]:
    """The processes with impacts as they are once it is known where the runs touch the track."""
    return tuple(replace(p, size=TIGHT) if p.kind == IMPACT else p for p in processes)


def variances(processes: Sequence[Process]) -> np.ndarray:
    """Their variances (p,)."""
    return np.array([p.size**2 for p in processes])
