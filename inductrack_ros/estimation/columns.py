# SPDX-License-Identifier: Apache-2.0
"""What a small cause would do along a fit's trajectories: a parameter of an effect, or a switch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.state import INDEX
from ..data.stretches import stretches
from .kalman import Columns
from .linear import THETA_STEP, mean_pulse, near_track
from .problem import Problem
from .response import quantities_along
from .run_model import RunModel
from .shooting import Fit
from .structure import Structure


@dataclass(frozen=True)
class Told:
    """Where the forces at a run's nodes tell what happens between them: not where the cradle is ``touching`` (n,) the
    track, but for where they are the same. ``pulses`` (n,) as `linear.mean_pulse` gives them."""

    pulses: np.ndarray
    touching: np.ndarray


def told_by_forces(problem: Problem, fit: Fit) -> list[Told]:
    """`Told` of each run along a fit's trajectories."""
    structure = Structure(fit.model, ())

    def one(i: int) -> Told:
        run, path = RunModel(problem, structure, i), fit.paths[i]
        return Told(mean_pulse(run, np.zeros(0), path), near_track(run, path))

    return problem.for_runs(one)


def of_parameters(problem: Problem, fit: Fit, effects: Sequence[str], told: Sequence[Told]) -> dict[str, list[Columns]]:
    """By effect, what each of its parameters would do to every run where the effect vanishes, in typical sizes;
    ``told`` as `told_by_forces` gives it."""
    integrated = [n for n in effects if needs_integration(fit, n)]
    found = {}
    for names in (integrated, [n for n in effects if n not in integrated]):
        wide = Structure(fit.model, ())
        for name in names:
            wide = wide.plus(name)
        steps = np.where(wide.start + THETA_STEP <= wide.bounds[1], THETA_STEP, -THETA_STEP)
        runs = of_thetas(problem, fit, wide, np.vstack([wide.start, wide.start + np.diag(steps)]), steps, told)
        for name in names:
            mine = [k for k, full in enumerate(wide.free) if full.rpartition(".")[0] == name]
            found[name] = [Columns(c.inputs[:, :, mine], c.data[:, mine]) for c in runs]
    return found


def of_thetas(
    problem: Problem, fit: Fit, wide: Structure, thetas: np.ndarray, steps: np.ndarray, told: Sequence[Told]
) -> list[Columns]:
    """`differences` of every run along a fit's trajectories, for a structure with further effects: their states follow
    from node to node. Pieces are integrated where one of them asks for it."""
    if len(thetas) == 1:
        return []
    added = [n for n in wide.effects if n not in fit.model.effects]
    states = any(fit.model.known_effects[n.partition(":")[0]].states for n in added)
    integrated = any(needs_integration(fit, n) for n in added)

    def one(i: int) -> Columns:
        run = RunModel(problem, wide, i)
        path = carried(run, fit.paths[i]) if states else fit.paths[i]
        return differences(run, path, thetas, steps, fit.model.active_states, None if integrated else told[i])

    return problem.for_runs(one)


def needs_integration(fit: Fit, name: str) -> bool:
    """Whether the forces at the nodes do not tell what an effect does between them: it has states, or acts on single
    pulses."""
    item = fit.model.known_effects[name.partition(":")[0]]
    return bool(item.states) or item.only == "pulses"


def differences(
    run: RunModel, path: np.ndarray, thetas: np.ndarray, steps: np.ndarray, active: np.ndarray, told: Told | None = None
) -> Columns:
    """Changes of a run's pieces and readings from the first row of thetas (1 + p, g) to each other one, over its step
    (p,).

    The pieces are integrated, or ``told`` from the forces at their ends where these tell."""
    if told is None:
        outputs, ends = run.pieces(path, thetas)
    else:
        outputs, changes = run.forced(path, thetas, told.pulses)
        ends = np.zeros((*changes.shape[:2], path.shape[1]))
        ends[:, :, :8] = changes
        differ = _differ(outputs, changes)
        for a, b in stretches(told.touching & differ.any(axis=1)):
            jobs = np.append(0, np.flatnonzero(differ[a:b].any(axis=0)))
            flown = run.pieces(path, thetas[jobs], some=slice(a, b + 1))
            for known, found in zip((outputs, ends), flown, strict=True):
                known[a:b] = found[: b - a, :1]
                known[a:b, jobs] = found[: b - a]
    inputs = ((ends[:, 1:] - ends[:, :1]) / steps[:, None]).transpose(0, 2, 1)[:, active]
    readings = run.read(outputs, thetas)
    change = (readings[1:] - readings[0]).T / steps / run.sigma[:, None]
    return Columns(np.nan_to_num(inputs), np.nan_to_num(change))


def _differ(outputs: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """Whether the forces at a node or the next are others in a job than in the first, (n, jobs)."""
    return (outputs != outputs[:, :1]).any(axis=2) | (changes != changes[:, :1]).any(axis=2)


def of_switch(problem: Problem, fit: Fit, name: str, values: Mapping[str, float] | None = None) -> list[Columns]:
    """What switching an effect with these values (on, or off where it is on) would do to every run."""
    here = Structure(fit.model, ())
    there = here.minus(name) if name in here.effects else here.plus(name, values, ())
    states = bool(fit.model.known_effects[name.partition(":")[0]].states)

    def one(i: int) -> Columns:
        off, on, path, none = RunModel(problem, here, i), RunModel(problem, there, i), fit.paths[i], np.zeros((1, 0))
        before, ends = off.pieces(path, none)
        after, ends_after = on.pieces(carried(on, path) if states else path, none)
        inputs = (ends_after[:, 0] - ends[:, 0])[:, fit.model.active_states, None].copy()
        inputs[:, 8:] = 0.0
        change = on.read(after, none)[0] - off.read(before, none)[0]
        return Columns(np.nan_to_num(inputs), np.nan_to_num(change / off.sigma)[:, None])

    return problem.for_runs(one)


def carried(run: RunModel, path: np.ndarray) -> np.ndarray:
    """A trajectory (n, N) whose effects' own states follow from node to node, from where they start."""
    data = run.data
    P = run.vectors(run.structure.start[None])
    x = run.model.with_effect_states(path[0], data.grid[0], P[0], data.fired, path[0, 0])
    return run.followed(path, x, P, slice(8, None))


def all_carried(problem: Problem, structure: Structure, paths: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Every run's trajectory (n, N) so `carried`."""
    return tuple(problem.for_runs(lambda i: carried(RunModel(problem, structure, i), paths[i])))


def quantities(problem: Problem, fit: Fit, i: int, names: Sequence[str], raised: float = 0.0) -> np.ndarray:
    """Quantities (n, q) of the equations along run i, the cradle ``raised`` above where it was (m)."""
    run, path = RunModel(problem, Structure(fit.model, ()), i), fit.paths[i].copy()
    path[:, INDEX["heave"]] += raised
    return quantities_along(run.data, run.model, run.vectors(np.zeros((1, 0)))[0], path, names)
