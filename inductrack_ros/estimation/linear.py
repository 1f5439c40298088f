# SPDX-License-Identifier: Apache-2.0
"""A run as a linear system about a trajectory: residuals, defects and their derivatives by states, parameters and force
histories."""

from __future__ import annotations

import numpy as np

from ..core.effects.stand_in import VARIABLES, entries
from ..core.model import Model
from ..core.state import ACCELERATIONS, COORDINATES, GAPS, INDEX, STATES
from .kalman import Columns, LinearRun
from .problem import GRID, STATE_PRIOR, RunData
from .response import STATE_STEPS
from .run_model import RunModel
from .structure import Structure

#: Step of a parameter's difference, in typical sizes; of an effect's state, relative to it.
THETA_STEP, CARRIED_STEP = 2e-3, 1e-6
#: A relative change of γ that tells the thrust.
SMALL = 1e-4
#: A gap (m) below which a node counts as touching: ten times what a resting cradle sinks in.
NEARLY_TOUCHING = 3e-4


def linearise(run: RunModel, theta: np.ndarray, path: np.ndarray) -> LinearRun:
    """A run about a trajectory (n, N): residuals and defects in column 0, derivatives by theta behind it. Its states
    are the active ones."""
    problem, structure, data, model = run.problem, run.structure, run.data, run.model
    active = model.active_states
    n, A, g = len(path), len(active), len(theta)
    steps = np.where(theta + THETA_STEP <= structure.bounds[1], THETA_STEP, -THETA_STEP)
    single, of_sensors = _kinds(structure)
    thetas = np.vstack([np.tile(theta, (1 + A, 1)), theta + np.diag(steps)[single]])
    by_state = np.concatenate(
        [STATE_STEPS, CARRIED_STEP * np.maximum(1.0, np.abs(path[:, active[8:]]).max(axis=0, initial=0.0))]
    )
    offsets = np.zeros((len(thetas), path.shape[1]))
    offsets[1 + np.arange(A), active] = by_state
    outputs, ends = run.pieces(path, thetas, offsets)
    readings, ends = run.read(outputs, thetas), ends[:, :, active]
    weight = 1.0 / run.sigma
    y, inputs = np.zeros((len(data.y), 1 + g)), np.zeros((n, A, 1 + g))
    y[:, 0], inputs[:-1, :, 0] = (data.y - readings[0]) * weight, ends[:-1, 0] - path[1:, active]
    places = [1 + k for k in single]
    y[:, places] = -((readings[1 + A :] - readings[0]) * weight).T / steps[single]
    inputs[:, :, places] = ((ends[:, 1 + A :] - ends[:, :1]) / steps[single][:, None]).transpose(0, 2, 1)
    for k in of_sensors:
        moved = theta + steps * (np.arange(g) == k)
        y[:, 1 + k] = -(run.read(outputs[:, :1], moved[None])[0] - readings[0]) * weight / steps[k]
    for effect, mine in structure.tables.items():
        table = force_columns(data, problem.sigma, model, _table_forces(run, theta, path, effect))
        y[:, [1 + k for k in mine]], inputs[:, :, [1 + k for k in mine]] = -table.data, table.inputs
    sensitivity = ((readings[1 : 1 + A] - readings[0]) * weight).T / by_state
    late = _late(run, outputs, theta, readings, by_state) * weight[:, None]
    sensitivity[:, 4:8] += late
    # A late sensor's first readings are of before the run.
    known = np.isfinite(y).all(axis=1) & np.isfinite(sensitivity).all(axis=1)
    # It tells nothing and is as far off as noise is: no gain.
    sensitivity[~known] = 0.0
    y[~known] = 0.0
    y[~known, 0] = 1.0
    root, mean = _start(run, theta, path[0], 1 + g)
    return LinearRun(
        np.searchsorted(data.row, np.arange(n + 1)),
        sensitivity,
        y,
        problem.variance(run.i),
        (ends[:, 1 : 1 + A] - ends[:, :1]).transpose(0, 2, 1) / by_state,
        inputs,
        np.append(np.diff(data.grid), 0.0),
        root,
        mean,
        np.zeros((n, A)),
        _touching(model, outputs[:, 0]),
        late,
        _struck(data),
        data.contact,
        paced=not data.averaged and active[0] == 0,
    )


def _struck(data: RunData) -> np.ndarray:
    """Readings (m,) of all but the surge."""
    return ~np.isin(data.column, [INDEX[n] for n in ("surge", "surge_rate", "surge_acceleration")])


def _late(
    run: RunModel, outputs: np.ndarray, theta: np.ndarray, readings: np.ndarray, by_state: np.ndarray
) -> np.ndarray:
    """What a rate of each coordinate adds to readings (m, 4) of sensors that look at another moment than that of their
    stamp.

    A reading of the coordinate δ ago is less by δ times its rate. A ramp through the run tells δ: it reads as the time
    less δ."""
    data = run.data
    found = np.zeros((len(data.y), 4))
    if not run.structure.sensors.channels:
        return found
    for c in range(4):
        apart = outputs[:, 1 + c] - outputs[:, 0]
        ramp = outputs[:, 0] + apart * (data.grid / max(data.grid[-1], GRID))[:, None]
        moved = (run.read(ramp[:, None], theta[None])[0] - readings[0]) * max(data.grid[-1], GRID)
        found[:, c] = (moved - (readings[1 + c] - readings[0]) * data.time) / by_state[c]
    return np.nan_to_num(found)


def _touching(model: Model, outputs: np.ndarray) -> np.ndarray:
    """Whether the cradle touches the track at a node or the next (n,), from the nodes' outputs (n, 15); a track without
    stiffness is none."""
    if not model.parameters["contact_stiffness"]:
        return np.zeros(len(outputs), bool)
    near = np.nan_to_num(outputs[:, [INDEX[g] for g in GAPS]]).min(axis=1) < NEARLY_TOUCHING
    return near | np.append(near[1:], False)


def near_track(run: RunModel, path: np.ndarray) -> np.ndarray:
    """Whether the cradle touches the track at a node of a trajectory (n, N) or at the next, (n,)."""
    outputs, _ = run.forced(path, np.zeros((1, len(run.structure.free))), np.zeros(len(path)))
    return _touching(run.model, outputs[:, 0])


def _kinds(structure: Structure) -> tuple[list[int], list[int]]:
    """Indices in theta of the plant's single parameters and of the sensors'; the rest are entries of tables."""
    tabled = {k for mine in structure.tables.values() for k in mine}
    single = [k for k, column in enumerate(structure.columns) if column is not None and k not in tabled]
    return single, [k for k, column in enumerate(structure.columns) if column is None]


def _table_forces(run: RunModel, theta: np.ndarray, path: np.ndarray, effect: str) -> np.ndarray:
    """Force histories (n, 4, l) of the entries of a stand-in's table, each of its typical size, along a trajectory."""
    structure = run.structure
    values, mine = structure.model.effects[effect], structure.tables[effect]
    forces = entries(values, histories(run.data, path), len(mine)) * structure.scale[mine]
    return acting(run, theta, path, effect.removeprefix("stand_in_"), forces)


def acting(run: RunModel, theta: np.ndarray, path: np.ndarray, on: str, shapes: np.ndarray) -> np.ndarray:
    """Force histories (n, 4, l) of shapes (n, l) that act on a coordinate (N, N·m), or on the thrust (shares of it)."""
    forces = np.zeros((len(path), 4, shapes.shape[1]))
    if on == "thrust":
        forces[:, 0] = mean_thrust(run, theta, path)[:, None] * shapes
    else:
        forces[:, COORDINATES.index(on)] = shapes
    return forces


def mean_thrust(run: RunModel, theta: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Thrust (n,) of each piece of a trajectory, N, averaged over it: what a small relative change of γ would bring.

    Shares of the thrust in a stand-in's table are left out, for they are shares of what is there without them."""
    plain = theta.copy()
    plain[run.structure.tables.get("stand_in_thrust", [])] = 0.0
    free, thetas = _thrust_changed(run, plain)
    _, ends = free.pieces(path, thetas)
    thrust = run.model.parameters["mass"] * (ends[:-1, 1, 4] - ends[:-1, 0, 4]) / (SMALL * np.diff(run.data.grid))
    return np.append(thrust, thrust[-1:])


def mean_pulse(run: RunModel, theta: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Current (n,) of the pulses that burn during each piece of a trajectory, averaged over it, A: what they do over
    what one ampere would. Of an averaged drive, what flows beyond the run's current."""
    data = run.data
    if data.averaged:
        beyond = data.drive - data.run.drive_current
        return 0.5 * (beyond + np.append(beyond[1:], beyond[-1]))
    free, thetas = _thrust_changed(run, theta)
    _, ends = free.pieces(path, thetas)
    _, one = free.forced(path, thetas, np.ones(len(path)))
    did, would = ends[:, 1, 4] - ends[:, 0, 4], one[:, 1, 4] - one[:, 0, 4]
    return np.divide(did, would, out=np.zeros(len(path)), where=would > 0.0)


def _thrust_changed(run: RunModel, theta: np.ndarray) -> tuple[RunModel, np.ndarray]:
    """The run with γ alone free, and two rows of its theta: γ as it is and larger by the share `SMALL`."""
    model = run.structure.with_theta(theta)
    free = Structure(model, ("gamma",))
    larger = free.encode([model.parameters["gamma"] * (1 + SMALL)])
    return RunModel(run.problem, free, run.i), np.vstack([free.start, larger])


def histories(data: RunData, path: np.ndarray) -> dict[str, np.ndarray]:
    """Histories (n,) of what a force may depend on along a trajectory (n, N) of a run."""
    found = {s: path[:, k] for k, s in enumerate(STATES)} | {"time": data.grid, "drive": data.drive}
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


def _start(run: RunModel, theta: np.ndarray, x: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """A square root (A, A) of the initial state's covariance and the mean (A, c) of its deviation from x, over the
    active states."""
    data, model = run.data, run.model
    active = model.active_states
    root, mean = np.zeros((len(x), len(x))), np.zeros((len(x), columns))
    free = data.free_states
    root[free, free] = STATE_PRIOR[free]
    mean[:8, 0] = data.guess - x[:8]
    if model.carries_states:
        P, pulses = run.vectors(theta[None])[0], data.fired
        begun = model.with_effect_states(x, P=P, pulses=pulses)
        for s in free:
            moved = x.copy()
            moved[s] += STATE_STEPS[s]
            slope = (model.with_effect_states(moved, P=P, pulses=pulses) - begun)[8:] / STATE_STEPS[s]
            root[8:, s] = slope * STATE_PRIOR[s]
            mean[8:, 0] += slope * mean[s, 0]
        mean[8:, 0] += begun[8:] - x[8:]
    return root[np.ix_(active, active)], mean[active]
