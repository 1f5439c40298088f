# SPDX-License-Identifier: Apache-2.0
"""Multiple shooting over a plant that may be shaken: every run is held to its data at every node (Bock and Plitt 1984).

A run's trajectory is the state at each point of its grid. Between neighbours the model is integrated; where it does not
lead from one to the next, a white disturbance of the coordinates' accelerations did the rest. `linear` gives the run as
a linear system about a trajectory, `start` a trajectory from the data alone, `likelihood` the best step; `fit`
alternates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import fit as end_to_end
from .kalman import LinearRun, run_smoother
from .likelihood import (
    TOLERANCE,
    Beside,
    Evidence,
    Lost,
    Misses,
    MostLikely,
    Point,
    cost,
    evidence_of,
    linear_misses,
    maximise_evidence,
    misses,
)
from .linear import histories, linearise
from .problem import STATE_PRIOR, Problem
from .processes import IMPACT, Process, offsets, tightened
from .run_model import RunModel
from .start import start
from .structure import Fitted, Structure

#: The power a fit starts with, in surge, sway, heave and roll: whatever the model lacks, the trajectories stay on the
#: data.
FIRST_POWER = np.array([1e2, 1e1, 1e1, 1e2])
#: Share of that power with which a fit begins anew where an effect was taken away: its trajectories are good, its power
#: is not.
ANEW = 1e-4
#: Gauss–Newton steps at the most.
STEPS = 25
#: A step that a run fares worse for is halved for that run, so often at the most.
HALVINGS = 6
#: Updates of the power at each linearisation.
POWER_STEPS = 3
#: So many steps that gain nothing end a fit, where other variances would gain nothing either.
IDLE = 2
#: A power (m²/s³, rad²/s³) at which trajectories have no defects but what the integration's tolerance leaves; steps of
#: a fit from end to end that looks for such trajectories.
QUIET, FLOWN_STEPS = 1e-8, 15


@dataclass(frozen=True)
class Fit(Fitted):
    """A structure fitted by multiple shooting.

    - theta: (g,); covariance: of theta, (g, g)
    - paths: a trajectory (n, N) for each run; touching: where each is in contact (n,)
    - power: of the disturbances, (4,)
    - deviance: twice the negative log likelihood; chi2: of the innovations
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
    exact: bool = False
    touching: tuple[np.ndarray, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether its runs lead beyond all numbers: it explains nothing, and nothing can be asked beside it."""
        return not np.isfinite(self.deviance)

    @property
    def states(self) -> list[np.ndarray]:
        """Initial state (8,) of each run."""
        return [path[0, :8] for path in self.paths]

    @property
    def point(self) -> Point:
        """Where it stands."""
        return Point(self.theta, self.paths, self.power, self.processes, self.exact)


def linearise_all(problem: Problem, fit: Fit | Point, structure: Structure | None = None) -> list[LinearRun]:
    """Every run about a fit's trajectories, without the processes' states. A point needs a ``structure``."""
    chosen = fit.structure if structure is None and isinstance(fit, Fit) else structure
    assert chosen is not None
    systems = problem.for_runs(lambda i: linearise(RunModel(problem, chosen, i), fit.theta, fit.paths[i]))
    return [replace(s, touching=np.zeros_like(s.touching), contact=None) for s in systems] if fit.exact else systems


def all_histories(problem: Problem, fit: Fit) -> list[dict[str, np.ndarray]]:
    """`histories` of every run along a fit's trajectories."""
    return [histories(d, path) for d, path in zip(problem.runs, fit.paths, strict=True)]


def outputs_of(problem: Problem, fit: Fit, i: int) -> np.ndarray:
    """Outputs (n, 15) at the nodes of a fit's run i."""
    return RunModel(problem, fit.structure, i).pieces(fit.paths[i], fit.theta[None])[0][:, 0]


def fit(
    problem: Problem,
    structure: Structure,
    point: Point | None = None,
    steps: int = STEPS,
    processes: Sequence[Process] = (),
) -> Fit:
    """Fit theta, every run's trajectory, the power of the disturbances and the processes' sizes, from the data or from
    a ``point`` nearby.

    Gauss–Newton over the nodes with a power that falls step by step to what the data want (continuation). Each step is
    shortened for a run that would fare worse for it. From the data it is done twice, with small blows in the end."""
    if point is not None:
        return (exactly if point.exact else _gauss_newton)(problem, structure, point, steps)
    paths = tuple(problem.for_runs(lambda i: start(problem, structure, i)))
    point = Point(np.clip(structure.start, *structure.bounds), paths, np.zeros(4), tuple(processes))
    point = replace(point, power=first_power(problem, linearise_all(problem, point, structure)))
    first = _gauss_newton(problem, structure, point, steps)
    return _gauss_newton(problem, structure, replace(first.point, processes=tightened(first.processes)), steps)


def first_power(problem: Problem, systems: Sequence[LinearRun]) -> np.ndarray:
    """The power (4,) with which a fit begins: none in a coordinate that no reading of the linear runs shows.

    What shakes such a coordinate shows at second order alone, through what it does to the others. A power that is free
    there throws it far off, until it explains whatever the others lack."""
    return np.where(_shown(systems), FIRST_POWER, 0.0) * problem.model.moving


def exactly(
    problem: Problem, structure: Structure, point: Point, steps: int = STEPS, whole: end_to_end.Fit | None = None
) -> Fit:
    """A fit with contact taken at its word: no blow is forgiven, and what is read during a contact counts like the
    rest.

    Where nothing shakes the rig this is the deterministic fit, and friction and lift during a contact are known as well
    as the data know them. Where something does, a node's noise in a stiff contact looks like a normal force, and the
    fit is not to be believed. Gauss–Newton steps from node to node may end with defects left over a stiff contact. A
    fit from end to end (``whole``) has none. The fit goes on from there where it leaves nothing but noise, or where
    that ends lower."""
    point = replace(point, processes=tuple(p for p in point.processes if p.kind != IMPACT), exact=True)
    whole = whole or end_to_end.fit(problem, structure, [path[0, :8] for path in point.paths], point.theta, FLOWN_STEPS)

    def as_flown() -> Point:
        paths = tuple(problem.for_runs(lambda i: flown(problem, structure, i, whole.theta, whole.states[i])))
        return replace(point, theta=whole.theta, paths=paths, power=np.full(4, QUIET) * problem.model.moving)

    if whole.leaves_noise:
        return _condensed(problem, structure, as_flown(), steps)
    f = _gauss_newton(problem, structure, point, steps)
    if whole.chi2 >= f.deviance:
        return f
    return min(f, _gauss_newton(problem, structure, as_flown(), steps), key=lambda x: x.deviance)


def flown(problem: Problem, structure: Structure, i: int, theta: np.ndarray, state: np.ndarray) -> np.ndarray:
    """The trajectory (n, N) of run i that the model flies from an initial state (8,), node by node."""
    run = RunModel(problem, structure, i)
    P, path = run.vectors(theta[None]), np.zeros((len(run.data.grid), len(run.model.kernel.states)))
    path[0, :8] = state
    x = path[0]
    if run.model.carries_states:
        x = run.model.with_effect_states(x, P=P[0], pulses=run.data.fired)
    return run.followed(path, x, P)


def _condensed(problem: Problem, structure: Structure, point: Point, steps: int) -> Fit:
    """A fit from trajectories that are flown and leave nothing but noise.

    A step moves theta and the initial states, and the runs are flown anew (condensing). Nothing shakes the rig, so
    nodes of their own gain nothing, and a stiff contact makes much of each. The trajectories come from a fit from end
    to end that has converged; what is left is to weigh the sensors as they are."""
    best: tuple[Point, MostLikely, tuple[np.ndarray, ...]] | None = None
    for _ in range(steps):
        plain = linearise_all(problem, point, structure)
        settled = maximise_evidence(problem, structure, plain, point, FLOWN_STEPS)
        idle = best is not None and settled.evidence.deviance > best[1].evidence.deviance - TOLERANCE
        if best is None or settled.evidence.deviance < best[1].evidence.deviance:
            best = point, settled, tuple(s.touching for s in plain)
        if idle:
            break
        there = _condensed_step(problem, structure, point, plain, settled)
        point = replace(there, power=settled.next_power, processes=settled.next_processes)
    assert best is not None  # there is one step at least
    here, settled, touching = best
    evidence = settled.evidence
    return Fit(
        structure, here.theta, here.paths, settled.power, evidence.deviance, evidence.chi2, evidence.covariance,
        True, settled.processes, here.exact, touching,
    )  # fmt: skip


def _condensed_step(
    problem: Problem, structure: Structure, point: Point, plain: Sequence[LinearRun], settled: MostLikely
) -> Point:
    """The point a step of theta and of the initial states further, all runs flown from there. The step is shortened
    where they would fare worse for it."""
    systems, active = settled.systems, structure.model.active_states
    still = evidence_of(problem, structure, systems, point.theta, np.zeros(4))
    smooth = problem.for_runs(lambda i: run_smoother(systems[i], still.filtered[i], still.step).deviations)
    beside = [offsets(*of)[0] for of in zip(plain, systems, smooth, strict=True)]

    def costs(i: int, theta: np.ndarray, path: np.ndarray) -> float:
        left = misses(RunModel(problem, structure, i), theta, path, (beside[i], np.zeros_like(path)))
        return float(np.nansum(left.readings**2 / systems[i].variance))

    def anew(i: int, theta: np.ndarray, share: float) -> np.ndarray:
        state = point.paths[i][0].copy()
        state[active] += share * smooth[i][0, : len(active)]
        return flown(problem, structure, i, theta, state[:8])

    aim = sum(problem.for_runs(lambda i: costs(i, point.theta, point.paths[i])))
    for share in 0.5 ** np.arange(HALVINGS):
        theta = point.theta + share * still.step
        paths = tuple(problem.for_runs(lambda i, t=theta, s=share: anew(i, t, s)))
        if sum(problem.for_runs(lambda i, t=theta, p=paths: costs(i, t, p[i]))) < aim:
            return replace(point, theta=theta, paths=paths)
    return point


def _lost(structure: Structure, point: Point) -> Fit:
    """A fit that cannot begin: it explains nothing."""
    nothing = np.zeros((len(point.theta),) * 2)
    return Fit(
        structure, point.theta, point.paths, point.power, np.inf, np.inf, nothing, False, point.processes, point.exact
    )  # fmt: skip


def _gauss_newton(problem: Problem, structure: Structure, point: Point, steps: int) -> Fit:
    best, idle = None, 0
    for _ in range(steps):
        try:
            new = _gauss_newton_step(problem, structure, point)
        except Lost:
            break
        idle = idle + 1 if best and new.deviance > best.deviance - TOLERANCE and new.to_gain < TOLERANCE else 0
        if best is None or new.deviance < best.deviance:
            best = new
        if idle == IDLE:
            break
        point = new.next
    if best is None:
        return _lost(structure, point)
    now = best.point
    return Fit(
        structure, now.theta, now.paths, now.power, best.deviance, best.evidence.chi2, best.evidence.covariance,
        idle == IDLE, now.processes, now.exact, best.touching,
    )  # fmt: skip


@dataclass(frozen=True)
class Step:
    """A Gauss–Newton step.

    - evidence: before it
    - point: where it leads to, with its likeliest disturbances; deviance: there
    - next: where to go on from
    - touching: where each run touched the track (n,)
    - to_gain: by how much other variances would lower the deviance
    """

    evidence: Evidence
    point: Point
    deviance: float
    next: Point
    touching: tuple[np.ndarray, ...]
    to_gain: float


def _gauss_newton_step(problem: Problem, structure: Structure, point: Point) -> Step:
    """A step from a point, shortened where the runs would fare worse for it.

    Its deviance is what the linear runs promise and by how much the trajectories that are flown miss that: far from
    linear a promise is not kept. What is missed says nothing where a coordinate is free to run anywhere, for no reading
    shows it. It says nothing where contact is taken exactly either: there trajectories begin as flown, and a stiff
    contact makes much of little."""
    plain = linearise_all(problem, point, structure)
    settled = maximise_evidence(problem, structure, plain, point, POWER_STEPS, follow=True)
    A = len(structure.model.active_states)
    moved = [s.deviations[:, :A] for s in settled.smooth]
    beside = [offsets(*of) for of in zip(plain, settled.systems, (s.deviations for s in settled.smooth), strict=True)]

    def hoped(share: float) -> list[Misses]:
        step, ways = share * settled.evidence.step, zip(plain, moved, beside, strict=True)
        runs = (RunModel(problem, structure, i) for i in range(len(plain)))
        return [linear_misses(run, s, step, share * m, b) for run, (s, m, b) in zip(runs, ways, strict=True)]

    went, kept = _line_search(problem, structure, point, settled, (moved, beside), hoped(0.0))
    promises = hoped(1.0)
    quiet = np.maximum(settled.power, QUIET)

    def missed(i: int) -> float:
        of_both = (_where_told(settled.systems[i], left) for left in (kept[i], promises[i]))
        came, promise = (cost(problem, i, left, quiet, settled.systems[i]) for left in of_both)
        return came - promise

    told = not point.exact and bool(_shown(plain)[problem.model.moving > 0.0].all())
    lost = max(float(np.sum(problem.for_runs(missed))), 0.0) if told else 0.0
    here = replace(went, power=settled.power, processes=settled.processes)
    onward = replace(went, power=settled.next_power, processes=settled.next_processes)
    touching = tuple(s.touching for s in plain)
    return Step(settled.evidence, here, settled.evidence.deviance + lost, onward, touching, settled.to_gain)


def _shown(systems: Sequence[LinearRun]) -> np.ndarray:
    """Whether some reading shows each coordinate, or its rate, (4,): it moves by more than its noise over the range of
    these."""
    seen = np.logical_or.reduce([(np.abs(s.sensitivity[:, :8]) * STATE_PRIOR > 1.0).any(axis=0) for s in systems])
    return np.logical_or(seen[:4], seen[4:8])


def _where_told(system: LinearRun, left: Misses) -> Misses:
    """What is left where a linear run promises anything: of a contact whose blows are forgiven it does not."""
    readings = np.where(system.scored, left.readings, 0.0)
    blind = (system.touching | system.forgiven)[:-1, None]
    return replace(left, readings=readings, defects=np.where(blind, 0.0, left.defects))


def _line_search(
    problem: Problem,
    structure: Structure,
    point: Point,
    settled: MostLikely,
    by: tuple[Sequence[np.ndarray], Sequence[Beside]],
    here: Sequence[Misses],
) -> tuple[Point, list[Misses]]:
    """The point a step further, and what each run leaves there; ``here`` is what they leave at the point, ``by`` by how
    much the step moves their states (n, A), and what processes add.

    Theta and all trajectories go by the same share of the step, a trajectory that fares worse by less. To fare worse by
    no more than what ends a fit is not to fare worse."""
    active, (moved, beside) = structure.model.active_states, by

    def costs(i: int, left: Misses) -> float:
        return cost(problem, i, _where_told(settled.systems[i], left), settled.power, settled.systems[i])

    aims = [costs(i, left) + TOLERANCE / len(here) for i, left in enumerate(here)]

    def path(i: int, theta: np.ndarray, most: float) -> tuple[float, np.ndarray, Misses]:
        tried = []
        for share in (*(most * 0.5 ** np.arange(HALVINGS)), 0.0):
            there = point.paths[i].copy()
            there[:, active] += share * moved[i]
            left = misses(RunModel(problem, structure, i), theta, there, beside[i])
            tried.append((costs(i, left), there, left))
            if tried[-1][0] <= aims[i]:
                break
        return min(reversed(tried), key=lambda t: t[0])  # where all are beyond numbers it stays

    for share in 0.5 ** np.arange(HALVINGS):
        theta = point.theta + share * settled.evidence.step
        found = problem.for_runs(lambda i, theta=theta, share=share: path(i, theta, share))
        if sum(f[0] for f in found) <= sum(aims):
            break
    return replace(point, theta=theta, paths=tuple(f[1] for f in found)), [f[2] for f in found]
