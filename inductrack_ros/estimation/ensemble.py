# SPDX-License-Identifier: Apache-2.0
"""Many runs of one model, each with parameters and a start of its own, on all cores or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..core.errors import InputError, did_you_mean
from ..core.lanes import LANES
from ..core.model import Model
from ..core.state import MOTION
from ..workers import Cluster, Threads

#: Runs in one task: a few milliseconds of work, and whole groups of lanes.
CHUNK = 3 * LANES
#: An ensemble of so many runs flies in lanes (`core.lanes`), which take five seconds to compile, once. With
#: effects that is once for each set of them, and takes as long as thousands of short runs.
MANY, MANY_WITH_EFFECTS = 500, 8000


def ensemble(
    model: Model,
    times: np.ndarray,
    states: np.ndarray,
    parameters: Mapping[str, np.ndarray] | None = None,
    workers: Threads | Cluster | None = None,
    reduced: Callable[[np.ndarray], np.ndarray] = np.asarray,
) -> np.ndarray:
    """Outputs (runs, n, 15), columns as in `state.MOTION`, of runs by the averaged drive through ``times`` (n,),
    rising.

    ``states`` (runs, 8) are where they start, at the first of ``times``; ``parameters`` maps full names (``eta``,
    ``drive_current``, ``viscous_drag.coefficient``) to (runs,). Each row is what `Model.simulate` gives for it, to the
    last bit; from `MANY` runs on (with effects `MANY_WITH_EFFECTS`), which fly side by side, to 1e-9 m. A run that
    leaves all bounds ends in NaN rows. ``reduced`` is applied to the outputs (jobs, n, 15) where they are made, so that
    of many runs only what it gives of each, (jobs, …), is kept (a copy: a view would keep all). Raises `InputError` for
    a name or a shape that does not fit."""
    times, states = np.ascontiguousarray(times, float), np.atleast_2d(np.asarray(states, float))
    if states.shape[1] != 8 or times.ndim != 1 or times.size == 0 or not (np.diff(times) >= 0).all():
        raise InputError(
            f"ensemble: states must be (runs, 8) and times rising, got shapes {states.shape} and {times.shape}"
        )
    if model.drive != "averaged":
        raise InputError("ensemble: only for drive: averaged; simulate runs by pulses one by one")
    given, known = parameters or {}, model.kernel.parameters
    columns = _columns(given, known, len(states))
    in_lanes = len(states) >= (MANY_WITH_EFFECTS if model.switches.any() else MANY)
    asked = [known.index(name) for name in model.lanes.parameters] if in_lanes else []  # compiled here, once

    def task(rows: slice) -> np.ndarray:
        x = states[rows]
        P = np.tile(model.vector, (len(x), 1))
        for name, column in columns.items():
            P[:, column] = given[name][rows]
        full = np.zeros((len(x), len(model.kernel.states)))
        full[:, :8] = x
        if model.carries_states:  # else they stay as they are, and move nothing
            full[:] = [model.with_effect_states(s, times[0], p) for s, p in zip(x, P, strict=True)]
        out = np.empty((len(x), times.size, len(MOTION)))
        done = np.zeros(len(x), np.int64)  # rows of each run
        if in_lanes:
            carried = full[:, model.active_states]
            model.lanes.fly(times, times[0], carried, P[:, asked], model.moving, out, done)
            full[:, model.active_states] = carried
        none = np.empty(0)
        for i in np.flatnonzero(done < times.size):
            one, rest, began = slice(i, i + 1), slice(done[i], None), times[max(done[i] - 1, 0)]
            model.kernel.simulate_batch(
                times[rest], began, full[one], P[one], model.switches[None], model.moving, x[one, 0], True, none, none,
                none, 1.0, out[one, rest],
            )  # fmt: skip
        return reduced(out)

    rows = [slice(i, i + CHUNK) for i in range(0, len(states), CHUNK)]
    return np.concatenate((workers or Threads()).map(task, rows))


def _columns(given: Mapping[str, np.ndarray], known: Sequence[str], runs: int) -> dict[str, int]:
    """Where the parameters stand of which each run has a value of its own. Raises `InputError` for others."""
    for name, values in given.items():
        if name not in known:
            raise InputError(f"ensemble: unknown parameter '{name}'{did_you_mean(name, known)}")
        if np.shape(values) != (runs,):
            raise InputError(
                f"ensemble: {name} has shape {np.shape(values)}; give one value for each of the {runs} runs"
            )
    return {name: known.index(name) for name in given}
