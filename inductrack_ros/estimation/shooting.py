"""Multiple shooting over a plant that may be shaken: every run is held to its data at every node (Bock and Plitt 1984).

A run's trajectory is the state at each point of its grid. Between neighbours the model is integrated; where it does not lead
from one to the next, a white disturbance of the coordinates' accelerations did the rest. `linearise` gives the run as a linear
system about a trajectory (`kalman.LinearRun`), `start` a trajectory from the data alone, and `fit` alternates the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.effects.stand_in import basis
from ..core.model import Model
from ..core.state import ACCELERATIONS, COORDINATES, GAPS, INDEX, OUTPUTS, STATES
from . import fit as end_to_end
from .kalman import Columns, Filtered, LinearRun, Smoothed, run_filter, run_smoother
from .problem import GRID, STATE_PRIOR, Problem, RunData
from .processes import IMPACT, Process, augmented, offsets, resized, tightened, told, variances
from .response import STATE_STEPS, VARIABLES, gap_geometry
from .structure import Structure

#: Step of a parameter's difference, in typical sizes; of an effect's state, relative to it.
THETA_STEP, CARRIED_STEP = 2e-3, 1e-6
#: Range of the disturbances' power (m²/s³, rad²/s³) that a start from the data looks through.
ROUGHEST, SMOOTHEST = 1e6, 1e-6
#: Below this power of an acceleration a disturbance moves nothing that any sensor of the package could see in an hour.
NO_POWER = 1e-14
#: The power a fit starts with, in surge, sway, heave and roll: whatever the model lacks, the trajectories stay on the data.
FIRST_POWER = np.array([1e2, 1e1, 1e1, 1e2])
#: Share of that power with which a fit begins anew where an effect was taken away: its trajectories are good, its power is not.
ANEW = 1e-4
#: The power falls by no more than this in a step, so that the trajectories can follow (continuation); so many steps at the most.
FALL, STEPS = 1e-3, 25
#: Length of a step of the power's logarithm over its ratio's where that is ``FAR_ABOVE`` (below this), and at the most.
REACH, LONGEST_REACH, FAR_ABOVE = 3.0, 8.0, -0.7
#: A gap (m) below which a node counts as touching: ten times what a resting cradle sinks in.
NEARLY_TOUCHING = 3e-4
#: A step that a run fares worse for is halved for that run, so often at the most.
HALVINGS = 6
#: Updates of the power at each linearisation; one that falls below this part of itself is still on its way.
POWER_STEPS, RESTING = 3, 0.3
#: A step that changes the deviance by less than this has converged.
TOLERANCE = 0.5
#: So many steps that gain nothing end a fit.
IDLE = 2
#: A power (m²/s³, rad²/s³) at which trajectories have no defects but what the integration's tolerance leaves; steps of a fit from
#: end to end that looks for such trajectories.
QUIET, FLOWN_STEPS = 1e-8, 15


@dataclass(frozen=True)
class Point:
    """Where a fit stands: theta (g,), each run's trajectory (n, N), the disturbances' power (4,), the processes beside
    them, where each run touches the track (n,), once that is settled, and whether contact is taken ``exactly`` (see `exactly`)."""

    theta: np.ndarray
    paths: tuple[np.ndarray, ...]
    power: np.ndarray
    processes: tuple[Process, ...] = ()
    touching: tuple[np.ndarray, ...] | None = None
    exact: bool = False


@dataclass(frozen=True)
class Fit:
    """A structure fitted by multiple shooting.

    theta (g,), a trajectory (n, N) for each run, the power (4,) of the disturbances, the deviance (twice the negative log
    likelihood), χ² of the innovations, and the covariance of theta (g, g).
    """

    structure: Structure
    theta: np.ndarray
    paths: tuple[np.ndarray, ...]
    power: np.ndarray
    deviance: float
    chi2: float
    covariance: np.ndarray
    converged: bool
    processes: tuple[Process, ...] = ()
    touching: tuple[np.ndarray, ...] | None = None
    exact: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Fitted parameters by full name."""
        return self.structure.decode(self.theta)

    @property
    def deviations(self) -> dict[str, float]:
        """Their standard deviations."""
        return self.structure.spread(self.theta, np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))

    @cached_property
    def model(self):
        """The model with the fitted parameters."""
        return self.structure.with_theta(self.theta)

    @property
    def states(self) -> list[np.ndarray]:
        """Initial state (8,) of each run."""
        return [path[0, :8] for path in self.paths]

    @property
    def point(self) -> Point:
        """Where it stands."""
        return Point(self.theta, self.paths, self.power, self.processes, self.touching, self.exact)


@dataclass(frozen=True)
class Evidence:
    """What the data say at a point: twice the negative log likelihood, whitened residuals of each run and their columns by theta."""

    deviance: float
    chi2: float
    whitened: tuple[np.ndarray, ...]
    filtered: tuple[Filtered, ...]
    step: np.ndarray
    covariance: np.ndarray


# ---------------------------------------------------------------- linear systems


def linearise(problem: Problem, structure: Structure, i: int, theta: np.ndarray, path: np.ndarray) -> LinearRun:
    """Run i about a trajectory (n, N): residuals and defects in column 0, derivatives by theta behind it. Its states are the active ones."""
    data, model = problem.runs[i], structure.model
    active = model.active_states
    n, A, g = len(path), len(active), len(theta)
    steps = np.where(theta + THETA_STEP <= structure.bounds[1], THETA_STEP, -THETA_STEP)
    single, of_sensors, _ = _kinds(structure)
    thetas = np.vstack([np.tile(theta, (1 + A, 1)), theta + np.diag(steps)[single]])
    by_state = np.concatenate([STATE_STEPS, CARRIED_STEP * np.maximum(1.0, np.abs(path[:, active[8:]]).max(axis=0, initial=0.0))])
    offsets = np.zeros((len(thetas), path.shape[1]))
    offsets[1 + np.arange(A), active] = by_state
    outputs, ends = pieces(problem, structure, i, thetas, offsets, path)
    readings, ends = read(problem, structure, i, outputs, thetas), ends[:, :, active]
    weight = 1.0 / problem.sigma[data.channel]
    y, inputs = np.zeros((len(data.y), 1 + g)), np.zeros((n, A, 1 + g))
    y[:, 0], inputs[:-1, :, 0] = (data.y - readings[0]) * weight, ends[:-1, 0] - path[1:, active]
    places = [1 + k for k in single]
    y[:, places] = -((readings[1 + A :] - readings[0]) * weight).T / steps[single]
    inputs[:, :, places] = ((ends[:, 1 + A :] - ends[:, :1]) / steps[single][:, None]).transpose(0, 2, 1)
    for k in of_sensors:
        moved = theta + steps * (np.arange(g) == k)
        y[:, 1 + k] = -(read(problem, structure, i, outputs[:, :1], moved[None])[0] - readings[0]) * weight / steps[k]
    for effect, mine in structure.tables.items():
        table = force_columns(data, problem.sigma, model, _table_forces(problem, structure, i, theta, path, effect))
        y[:, [1 + k for k in mine]], inputs[:, :, [1 + k for k in mine]] = -table.data, table.inputs
    sensitivity = ((readings[1 : 1 + A] - readings[0]) * weight).T / by_state
    late = _late(problem, structure, i, outputs, theta, readings, by_state) * weight[:, None]
    sensitivity[:, 4:8] += late
    known = np.isfinite(y).all(axis=1) & np.isfinite(sensitivity).all(axis=1)  # a late sensor's first readings are of before the run
    sensitivity[~known], y[~known], y[~known, 0] = 0.0, 0.0, 1.0  # it tells nothing and is as far off as noise is: no gain
    root, mean = _start(problem, structure, i, theta, path[0], 1 + g)
    return LinearRun(
        np.searchsorted(data.row, np.arange(n + 1)), sensitivity, y, problem.variance(i),
        (ends[:, 1 : 1 + A] - ends[:, :1]).transpose(0, 2, 1) / by_state, inputs, np.append(np.diff(data.grid), 0.0), root, mean, np.zeros((n, A)),
        _touching(outputs[:, 0]), late, _struck(data),
    )  # fmt: skip


def _struck(data: RunData) -> np.ndarray:
    """Readings (m,) of all but the surge."""
    return ~np.isin(data.column, [INDEX[n] for n in ("surge", "surge_rate", "surge_acceleration")])


def _late(
    problem: Problem, structure: Structure, i: int, outputs: np.ndarray, theta: np.ndarray, readings: np.ndarray, by_state: np.ndarray
) -> np.ndarray:
    """What a rate of each coordinate adds to readings (m, 4) of sensors that look at another moment than that of their stamp.

    A reading of the coordinate δ ago is less by δ times its rate. A ramp through the run tells δ: it reads as the time less δ.
    """
    data = problem.runs[i]
    found = np.zeros((len(data.y), 4))
    if not structure.sensors.channels:
        return found
    for c in range(4):
        apart = outputs[:, 1 + c] - outputs[:, 0]
        ramp = outputs[:, 0] + apart * (data.grid / max(data.grid[-1], GRID))[:, None]
        moved = (read(problem, structure, i, ramp[:, None], theta[None])[0] - readings[0]) * max(data.grid[-1], GRID)
        found[:, c] = (moved - (readings[1 + c] - readings[0]) * data.time) / by_state[c]
    return np.nan_to_num(found)


def _touching(outputs: np.ndarray) -> np.ndarray:
    """Whether the cradle touches the track at a node or the next (n,), from the nodes' outputs (n, 15)."""
    near = np.nan_to_num(outputs[:, [INDEX[g] for g in GAPS]]).min(axis=1) < NEARLY_TOUCHING
    return near | np.append(near[1:], False)


def _kinds(structure: Structure) -> tuple[list[int], list[int], list[int]]:
    """Indices in theta of the plant's single parameters, of the sensors' and of the tables' entries."""
    tabled = sorted(k for mine in structure.tables.values() for k in mine)
    single = [k for k, column in enumerate(structure.columns) if column is not None and k not in tabled]
    return single, [k for k, column in enumerate(structure.columns) if column is None], tabled


def _table_forces(problem: Problem, structure: Structure, i: int, theta: np.ndarray, path: np.ndarray, effect: str) -> np.ndarray:
    """Force histories (n, 4, l) of the entries of a stand-in's table, each of its typical size, along a trajectory."""
    values, mine = structure.model.effects[effect], structure.tables[effect]
    u = np.ascontiguousarray(histories(problem.runs[i], path)[VARIABLES[int(values["variable"])]])
    shapes = basis(u, values["start"], values["step"], len(mine)) * structure.scale[mine]
    return acting(problem, structure, i, theta, path, effect.removeprefix("stand_in_"), shapes)


def acting(problem: Problem, structure: Structure, i: int, theta: np.ndarray, path: np.ndarray, on: str, shapes: np.ndarray) -> np.ndarray:
    """Force histories (n, 4, l) of shapes (n, l) that act on a coordinate (N, N·m), or on the thrust (shares of it)."""
    forces = np.zeros((len(path), 4, shapes.shape[1]))
    if on == "thrust":
        forces[:, 0] = mean_thrust(problem, structure, i, theta, path)[:, None] * shapes
    else:
        forces[:, COORDINATES.index(on)] = shapes
    return forces


def mean_thrust(problem: Problem, structure: Structure, i: int, theta: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Thrust (n,) of each piece of a trajectory, N, averaged over it: what a small relative change of γ would bring."""
    model, small = structure.model, 1e-4
    free = Structure(structure.with_theta(theta), ("gamma",))
    gamma = free.start
    moved = free.encode([model.parameters["gamma"] * (1 + small)]) if "gamma" not in structure.free else gamma * (1 + small)
    _, ends = pieces(problem, free, i, np.vstack([gamma, moved]), np.zeros((2, path.shape[1])), path)
    T = np.diff(problem.runs[i].grid)
    thrust = model.parameters["mass"] * (ends[:-1, 1, 4] - ends[:-1, 0, 4]) / (small * T)
    return np.append(thrust, thrust[-1:])


def histories(data: RunData, path: np.ndarray) -> dict[str, np.ndarray]:
    """Histories (n,) of what a force may depend on along a trajectory (n, N) of a run."""
    found = {s: path[:, k] for k, s in enumerate(STATES)} | {"time": data.grid, "drive": np.full(len(path), data.run.drive_current)}
    return {v: np.ascontiguousarray(found[v]) for v in VARIABLES}


def force_columns(data: RunData, sigma: np.ndarray, model: Model, forces: np.ndarray) -> Columns:
    """What force histories (n, 4, l) (N, N·m by coordinate) would do to a run: a trapezoid between nodes."""
    inertia = np.array([model.parameters["mass"]] * 3 + [model.parameters["roll_inertia"]])
    a = forces * (model.moving / inertia)[:, None]
    inputs = np.zeros((len(a), len(model.active_states), a.shape[2]))
    T = np.diff(data.grid)[:, None, None]
    inputs[:-1, :4] = T**2 / 6.0 * (2.0 * a[:-1] + a[1:])
    inputs[:-1, 4:8] = 0.5 * T * (a[:-1] + a[1:])
    change = np.zeros((len(data.y), a.shape[2]))
    for c, name in enumerate(ACCELERATIONS):
        mine = data.column == INDEX[name]
        change[mine] = a[data.row[mine], c] / sigma[data.channel[mine]][:, None]
    return Columns(inputs, change)


def pieces(
    problem: Problem, structure: Structure, i: int, thetas: np.ndarray, offsets: np.ndarray, path: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (n, jobs, 15) at each node and states (n, jobs, N) at the next, of the trajectory moved by each job's offsets and theta."""
    data, model = problem.runs[i], structure.model
    P = problem.vectors(structure, i, thetas)
    outputs, ends = np.empty((len(path), len(offsets), len(OUTPUTS))), np.empty((len(path), *offsets.shape))
    model.kernel.linearise_pieces(
        data.grid, np.ascontiguousarray(path), offsets, P, model.switches, model.moving, float(path[0, 0]), data.averaged, *data.pulses, 1.0,
        outputs, ends,
    )  # fmt: skip
    return outputs, ends


def outputs_of(problem: Problem, fit: Fit, i: int) -> np.ndarray:
    """Outputs (n, 15) at the nodes of a fit's run i."""
    return pieces(problem, fit.structure, i, fit.theta[None], np.zeros((1, fit.paths[i].shape[1])), fit.paths[i])[0][:, 0]


def read(problem: Problem, structure: Structure, i: int, outputs: np.ndarray, thetas: np.ndarray) -> np.ndarray:
    """What the sensors read, (jobs, m), from the nodes' outputs (n, jobs, 15)."""
    return problem.predict(structure, i, thetas, np.ascontiguousarray(outputs.transpose(1, 0, 2)))


def _start(problem: Problem, structure: Structure, i: int, theta: np.ndarray, x: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """A square root (A, A) of the initial state's covariance and the mean (A, c) of its deviation from x, over the active states."""
    data, model = problem.runs[i], structure.model
    active = model.active_states
    root, mean = np.zeros((len(x), len(x))), np.zeros((len(x), columns))
    free = data.free_states
    root[free, free] = STATE_PRIOR[free]
    mean[:8, 0] = data.guess - x[:8]
    if model.carries_states:
        P, pulses = problem.vectors(structure, i, theta[None])[0], None if data.averaged else data.pulses
        begun = model.with_effect_states(x, P=P, pulses=pulses)
        for s in free:
            moved = x.copy()
            moved[s] += STATE_STEPS[s]
            slope = (model.with_effect_states(moved, P=P, pulses=pulses) - begun)[8:] / STATE_STEPS[s]
            root[8:, s] = slope * STATE_PRIOR[s]
            mean[8:, 0] += slope * mean[s, 0]
        mean[8:, 0] += begun[8:] - x[8:]
    return root[np.ix_(active, active)], mean[active]


# ---------------------------------------------------------------- a start from the data


def start(problem: Problem, structure: Structure, i: int) -> np.ndarray:
    """A trajectory (n, N) of run i from its data alone: every coordinate a random walk of its rate, as rough as the data say."""
    data, model = problem.runs[i], structure.model
    n = len(data.grid)
    kinematic = _kinematic(problem, model, data)

    def deviance(c: int, exponent: float, power: np.ndarray) -> float:
        tried = power.copy()
        tried[c] = 10.0**exponent
        whitened, determinant = run_filter(kinematic, tried).scored(kinematic)
        return float((whitened[:, 0] ** 2).sum() + determinant)

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
            path[k] = model.with_effect_states(path[k], t, P, None if data.averaged else data.pulses, path[0, 0])
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
        np.searchsorted(data.row[used], np.arange(n + 1)), H / sigma[:, None], y[:, None], np.ones(len(y)), F, inputs, spacing, root, np.zeros((8, 1)), np.zeros((n, 8)),
        np.zeros(n, bool), np.zeros((len(y), 4)), np.zeros(len(y), bool),
    )


def _balance(model, speed: np.ndarray) -> np.ndarray:
    """Equilibrium heave (n,) along a run, from a few speeds of it."""
    few = np.linspace(max(speed.min(), 1.0), max(speed.max(), 1.001), 7)
    return np.interp(speed, few, [model.equilibrium_heave(v) for v in few])


# ---------------------------------------------------------------- likelihood and fit


def weigh(problem: Problem, structure: Structure, systems: Sequence[LinearRun], theta: np.ndarray, power: np.ndarray) -> Evidence:
    """The likelihood of linear runs at a power of the disturbances, theta's best step (g,) within its bounds, and its covariance (g, g)."""
    shaken = np.where(power > NO_POWER, power, 0.0)
    filtered = tuple(problem.for_runs(lambda i: run_filter(systems[i], shaken)))
    g = len(theta)
    A, b = structure.precision.copy(), structure.precision @ (structure.centre - theta)
    whitened, determinants = zip(*(f.scored(system) for f, system in zip(filtered, systems, strict=True)), strict=True)
    for w in whitened:
        A += w[:, 1:].T @ w[:, 1:]
        b -= w[:, 1:].T @ w[:, 0]
    step, free = _bounded(A, b, theta, structure)
    left = tuple(w[:, 0] + w[:, 1:] @ step for w in whitened)
    chi2 = sum(float(r @ r) for r in left)
    covariance = np.zeros((g, g))
    if free.any():
        covariance[np.ix_(free, free)] = np.linalg.pinv(A[np.ix_(free, free)], rcond=1e-15, hermitian=True)
    deviance = chi2 + structure.surprise(theta + step) + sum(determinants)
    return Evidence(deviance, chi2, left, filtered, step, covariance)


def _bounded(A: np.ndarray, b: np.ndarray, theta: np.ndarray, structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """The minimiser of a quadratic within theta's bounds by an active set, and which entries are free (g,)."""
    low, high = structure.bounds
    free = np.ones(len(theta), bool)
    free[structure.held] = False
    step = np.zeros(len(theta))
    for _ in range(len(theta) + 1):
        step[~free & (step == 0.0)] = 0.0
        if free.any():
            step[free] = np.linalg.lstsq(A[np.ix_(free, free)], b[free] - A[np.ix_(free, ~free)] @ step[~free], rcond=1e-14)[0]
        over = free & ((theta + step < low) | (theta + step > high))
        if not over.any():
            break
        step[over] = np.clip(theta + step, low, high)[over] - theta[over]
        free &= ~over
    return step, free


@dataclass(frozen=True)
class Settled:
    """Linear runs with the disturbances that suit them: their power (4,) and processes, what the data say there, and where they lead."""

    power: np.ndarray
    processes: tuple[Process, ...]
    systems: tuple[LinearRun, ...]
    evidence: Evidence
    smooth: tuple[Smoothed, ...]
    next_power: np.ndarray
    next_processes: tuple[Process, ...]


def settle(
    problem: Problem, structure: Structure, plain: Sequence[LinearRun], point: Point, passes: int, follow: bool = False
) -> Settled:
    """The disturbances' power and the processes' sizes that make linear runs about a point most likely.

    A fixed-point iteration of all variances in their logarithm (MacKay 1992), its steps lengthened as the last two tell (secant).
    With ``follow`` it ends where a variance is so far from its place that the trajectories have to follow first.
    """
    power, processes, before, last = np.maximum(point.power, NO_POWER), point.processes, None, np.inf
    n_states = plain[0].transitions.shape[1]
    for left in reversed(range(passes)):
        systems = tuple(problem.for_runs(lambda i, p=processes: augmented(problem, structure, i, plain[i], p)))
        evidence = weigh(problem, structure, systems, point.theta, power)
        smooth = tuple(problem.for_runs(lambda i, s=systems, e=evidence: run_smoother(s[i], e.filtered[i], e.step)))
        here = np.concatenate([power, variances(processes)])
        ratio = variance_ratio(problem, processes, smooth, n_states)
        there = likelier(here, ratio, before)
        new = np.clip(there[:4], NO_POWER, ROUGHEST), resized(processes, there[4:])
        if not left or abs(last - evidence.deviance) < TOLERANCE or follow and (there < RESTING * here).any():
            break
        power, processes, before, last = *new, (here, ratio), evidence.deviance
    return Settled(power, processes, systems, evidence, smooth, *new)


def variance_ratio(problem: Problem, processes: Sequence[Process], smooth: Sequence[Smoothed], n_states: int) -> np.ndarray:
    """Log of what the data show of each disturbance and process over what its variance would make them show, (4 + p,); 0 at the likeliest."""
    found, expected = (np.sum([getattr(s, name) for s in smooth], axis=0) for name in ("found", "expected"))
    of_processes = told(problem, processes, smooth, n_states)
    found, expected = np.concatenate([found, of_processes[0]]), np.concatenate([expected, of_processes[1]])
    return np.clip(np.log(np.maximum(found, 1e-300)) - np.log(np.maximum(expected, 1e-300)), -50.0, 50.0)


def likelier(values: np.ndarray, ratio: np.ndarray, before: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """Variances nearer to the likeliest from their `variance_ratio`, and that ``before`` at others, where there was one."""
    reach = np.where(ratio < FAR_ABOVE, REACH, 1.0)
    if before is not None:
        moved, change = np.log(values / before[0]), before[1] - ratio
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = moved / change
        reach = np.where(np.isfinite(secant) & (secant > 0), np.clip(secant, 1.0, LONGEST_REACH), reach)
    return values * np.exp(np.clip(reach * ratio, np.log(FALL), -np.log(FALL)))


def cost(
    problem: Problem, structure: Structure, i: int, theta: np.ndarray, path: np.ndarray, power: np.ndarray, system: LinearRun,
    beside: tuple[np.ndarray, np.ndarray],
) -> float:  # fmt: skip
    """What run i costs on a trajectory (n, N): residuals over noise, defects over what the disturbances explain, and its start, squared.

    The ``system`` has the readings' variances and the kicks; ``beside`` is what processes add to them (m,) and to the way to the next node (n, N).
    """
    data = problem.runs[i]
    outputs, ends = pieces(problem, structure, i, theta[None], np.zeros((1, path.shape[1])), path)
    if not np.isfinite(ends).all():
        return np.inf
    left = (data.y - read(problem, structure, i, outputs, theta[None])[0]) / problem.sigma[data.channel] - beside[0]
    total = float(np.nansum(left**2 / system.variance))
    T, defect = np.diff(data.grid), path[1:, :8] - ends[:-1, 0, :8] - beside[1][:-1, :8]
    for c in np.flatnonzero(problem.model.moving):
        place, rate = defect[:, c], defect[:, 4 + c]
        q, kicks = max(power[c], NO_POWER), system.kicks[:-1, 4 + c]
        a, b, d = q * T**3 / 3.0, q * T**2 / 2.0, q * T + kicks
        total += float(np.sum((d * place**2 - 2.0 * b * place * rate + a * rate**2) / (a * d - b**2)))
    free = data.free_states
    return total + float(np.sum(((path[0, free] - data.guess[free]) / STATE_PRIOR[free]) ** 2))


def linearise_all(problem: Problem, fit: Fit | Point, structure: Structure | None = None) -> list[LinearRun]:
    """Every run about a fit's trajectories, without the processes' states."""
    structure = structure or fit.structure
    systems = problem.for_runs(lambda i: linearise(problem, structure, i, fit.theta, fit.paths[i]))
    if fit.touching is None:
        return systems
    return [replace(system, touching=touching) for system, touching in zip(systems, fit.touching, strict=True)]


def fit(problem: Problem, structure: Structure, point: Point | None = None, steps: int = STEPS, processes: Sequence[Process] = ()) -> Fit:
    """Fit theta, every run's trajectory, the power of the disturbances and the processes' sizes, from the data or from a ``point`` nearby.

    Gauss–Newton over the nodes with a power that falls step by step to what the data want (continuation). Each step is shortened
    for a run that would fare worse for it. From the data it is done twice: where the runs touch the track the first time tells.
    """
    if point is not None:
        return (exactly if point.exact else _descended)(problem, structure, point, steps)
    paths = tuple(problem.for_runs(lambda i: start(problem, structure, i)))
    point = Point(np.clip(structure.start, *structure.bounds), paths, FIRST_POWER * problem.model.moving, tuple(processes))
    first = _descended(problem, structure, point, steps)
    touching = tuple(s.touching for s in linearise_all(problem, first))
    return _descended(problem, structure, replace(first.point, processes=tightened(first.processes), touching=touching), steps)


def exactly(problem: Problem, structure: Structure, point: Point, steps: int = STEPS, whole: end_to_end.Fit | None = None) -> Fit:
    """A fit with contact taken at its word: no blow is forgiven, and what is read during a contact counts like the rest.

    Where nothing shakes the rig this is the deterministic fit, and friction and lift during a contact are known as well as the data
    know them. Where something does, a node's noise in a stiff contact looks like a normal force, and the fit is not to be believed.
    Gauss–Newton steps from node to node may end with defects left over a stiff contact; a fit from end to end (``whole``) has none, and
    is gone on from where it leaves nothing but noise, or where that ends lower.
    """
    touching = tuple(np.zeros(len(path), bool) for path in point.paths)
    point = replace(point, processes=tuple(p for p in point.processes if p.kind != IMPACT), touching=touching, exact=True)
    whole = whole or end_to_end.fit(problem, structure, [path[0, :8] for path in point.paths], point.theta, FLOWN_STEPS)

    def from_flown() -> Fit:
        paths = tuple(problem.for_runs(lambda i: flown(problem, structure, i, whole.theta, whole.states[i])))
        power = np.full(4, QUIET) * problem.model.moving
        return _descended(problem, structure, replace(point, theta=whole.theta, paths=paths, power=power), steps)

    if whole.leaves_noise:
        return from_flown()
    f = _descended(problem, structure, point, steps)
    return min(f, from_flown(), key=lambda x: x.deviance) if whole.chi2 < f.deviance else f


def flown(problem: Problem, structure: Structure, i: int, theta: np.ndarray, state: np.ndarray) -> np.ndarray:
    """The trajectory (n, N) of run i that the model flies from an initial state (8,), node by node."""
    data, model = problem.runs[i], structure.model
    P = problem.vectors(structure, i, theta[None])
    path, outputs, still = np.zeros((len(data.grid), len(model.kernel.states))), np.empty((2, 1, len(OUTPUTS))), np.zeros((1, len(model.kernel.states)))
    path[0, :8] = state
    if model.carries_states:
        path[0] = model.with_effect_states(path[0], P=P[0], pulses=None if data.averaged else data.pulses)
    ends = np.empty((2, 1, path.shape[1]))
    for k in range(len(path) - 1):
        model.kernel.linearise_pieces(
            data.grid[k : k + 2], path[k : k + 2], still, P, model.switches, model.moving, float(path[0, 0]), data.averaged, *data.pulses, 1.0,
            outputs, ends,
        )  # fmt: skip
        path[k + 1] = ends[0, 0]
    return path


def _descended(problem: Problem, structure: Structure, point: Point, steps: int) -> Fit:
    best, idle = None, 0
    for _ in range(steps):
        evidence, now, new = _step(problem, structure, point)
        idle = idle + 1 if best and evidence.deviance > best[0].deviance - TOLERANCE else 0
        if best is None or evidence.deviance < best[0].deviance:
            best = evidence, now
        if idle == IDLE:
            break
        point = new
    evidence, now = best
    return Fit(
        structure, now.theta, now.paths, now.power, evidence.deviance, evidence.chi2, evidence.covariance, idle == IDLE, now.processes, now.touching,
        now.exact,
    )  # fmt: skip


def _step(problem: Problem, structure: Structure, point: Point) -> tuple[Evidence, Point, Point]:
    """The evidence at a point, that point with its likeliest disturbances, and the point a Gauss–Newton step further."""
    plain = linearise_all(problem, point, structure)
    settled = settle(problem, structure, plain, point, POWER_STEPS, follow=True)
    theta, active = point.theta + settled.evidence.step, structure.model.active_states
    A = len(active)

    def path(i: int) -> np.ndarray:
        moved = settled.smooth[i].deviations
        beside = offsets(plain[i], settled.systems[i], moved)
        rest = settled.power, settled.systems[i], beside
        aim = cost(problem, structure, i, point.theta, point.paths[i], *rest)
        best = cost(problem, structure, i, theta, point.paths[i], *rest), point.paths[i]
        for share in 0.5 ** np.arange(HALVINGS):
            tried = point.paths[i].copy()
            tried[:, active] += share * moved[:, :A]
            if (found := cost(problem, structure, i, theta, tried, *rest)) < best[0]:
                best = found, tried
            if found <= aim:
                break
        return best[1]

    now = replace(point, power=settled.power, processes=settled.processes)
    return settled.evidence, now, replace(point, theta=theta, paths=tuple(problem.for_runs(path)), power=settled.next_power, processes=settled.next_processes)
