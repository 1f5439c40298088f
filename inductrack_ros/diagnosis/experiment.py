# SPDX-License-Identifier: Apache-2.0
"""The run, or the two, that would settle what is open: T-optimal design over a menu (Atkinson and Fedorov).

For each run of the menu the truth is taken to be the chosen model. Each rival gets its best chance: the run's initial
state and the rival's parameters are refitted within what is known of them. The difference that remains is its
separation in sigmas. All runs are looked at to first order, and a few that promise most are refitted. No run leaves the
limits that the campaign gives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import InputError
from ..core.firing import pulses_of
from ..core.model import Model
from ..core.state import GAPS, INDEX, MOTION, STATES
from ..data.limits import Limits
from ..data.measurement import Run
from ..estimation import columns, shooting
from ..estimation.likelihood import Lost, Point, evidence_of
from ..estimation.problem import Problem, lay_out
from ..estimation.processes import IMPACT
from ..estimation.shooting import Fit
from ..estimation.structure import Structure
from .result import Proposal, Unknown
from .settings import REFIT_STEPS

SPEEDS = (12.0, 16.0, 20.0, 26.0, 34.0, 42.0)
CURRENTS = (0.0, 3500.0, 7000.0)
OFFSETS = ((0.0, 0.0, 0.0), (1e-3, 3e-3, 4e-3))  # heave over equilibrium, sway (m), roll (rad)
DURATIONS = (1.0, 3.0)
#: A rig with limits may have to end a run sooner.
SHORT = (0.3,)
RATE = 250.0
#: A run that sets every rival apart by so many sigmas settles the question.
SETTLED = 3.0
#: Runs of which the rivals are refitted, and of which pairs are looked at: those that promise most.
LOOKED = 5
#: Runs that set every rival apart by so many sigmas will do; no wilder ones are looked at then.
ENOUGH = 8.0


class MenuRun(NamedTuple):
    """A run that could be made: speed (m/s), drive current (A), offsets of heave, sway (m) and roll (rad) at the start,
    duration (s), and whether it may touch the track."""

    speed: float
    current: float
    offsets: tuple[float, float, float]
    duration: float
    contact: bool = False

    def proposal(self, sigmas: Mapping[str, float], std_after: Mapping[str, float] | None = None) -> Proposal:
        """The run with what it would tell."""
        return Proposal(self.speed, self.current, self.offsets, self.duration, sigmas, std_after or {})


def propose(
    problem: Problem,
    at_once: Callable[[Callable, Sequence], list],
    chosen: Fit,
    rivals: Mapping[str, Fit],
    twins: Mapping[str, tuple[str, ...]],
    undetermined: Sequence[str],
) -> tuple[str | None, Proposal | None]:
    """The next run of the menu that sets the rivals apart, in words and in numbers; None where none helps.

    ``undetermined`` parameters, which the runs so far say nothing about, would be free to fit the next one.
    """

    def apart(run: MenuRun, separation: Callable) -> Proposal | None:
        if (made := made_run(problem, chosen.model, run)) is None:
            return None
        return run.proposal({n: separation(made, chosen, f, undetermined) for n, f in rivals.items()})

    limits = problem.limits
    promised: dict[MenuRun, float] = {}
    tried: dict[MenuRun, Proposal] = {}

    def refit(runs: Sequence[MenuRun]) -> None:
        found = at_once(lambda run: apart(run, _separation), runs)
        tried.update((run, p) for run, p in zip(runs, found, strict=True) if p is not None)

    for runs in batches(limits):
        found = at_once(lambda run: apart(run, _expected), runs)
        promised |= {run: p.least for run, p in zip(runs, found, strict=True) if p is not None}
        refit([run for run in runs if promised.get(run, 0.0) > ENOUGH])
        if any(p.least > ENOUGH for p in tried.values()):
            break
    else:
        refit(sorted(promised.keys() - tried, key=lambda run: -promised[run])[:LOOKED])
    best = max(tried.values(), key=lambda p: p.least, default=None)
    if best is None:
        return ("no run within the campaign's limits sets apart what is open" if limits.ranges else None), None
    gains = ", ".join(f"{n} by {s:.1f} sigmas" for n, s in best.sigmas.items())
    if best.least < SETTLED and (two := pair(problem, chosen, rivals, list(tried), undetermined)):
        gains = ", ".join(f"{n} by {s:.1f} sigmas" for n, s in two.sigmas.items())
        return f"no single run settles it, two do: {two.words}: together they set apart {gains}", two
    if best.least < SETTLED:
        return (
            f"no single run of this kind settles it; the best ({best.words}) sets apart {gains}. {_other_means(twins)}",
            best,
        )
    return f"{best.words}: sets apart {gains}", best


def batches(limits: Limits) -> Iterator[list[MenuRun]]:
    """The menu: runs of all speeds at a time, the gentlest first."""
    speeds, currents = menu(limits, "surge_rate", SPEEDS), menu(limits, "drive_current", CURRENTS)
    durations = (*SHORT, *DURATIONS) if limits.ranges else DURATIONS
    touching = (False, True) if limits.contact else (False,)
    for contact, duration, current, offsets in product(touching, durations, currents, OFFSETS):
        yield [MenuRun(speed, current, offsets, duration, contact) for speed in speeds]


def pair(
    problem: Problem, chosen: Fit, rivals: Mapping[str, Fit], runs: Sequence[MenuRun], undetermined: Sequence[str]
) -> Proposal | None:
    """Two of the runs that together set every rival apart by `SETTLED` sigmas; None where none do that promise it.

    A rival that is fitted to both at once has one set of parameters for them. So it is at least as far off as the two
    separations say together, √(a² + b²). It is further off where the runs pull at different parameters."""

    def apart(both: tuple[MenuRun, MenuRun], separation: Callable) -> Proposal:
        found = [made for run in both if (made := made_run(problem, chosen.model, run)) is not None]
        joint = problem.with_changes(runs=tuple(single.runs[0] for single in found), variances=())
        sigmas = {n: separation(joint, chosen, f, undetermined) for n, f in rivals.items()}
        return replace(both[0].proposal(sigmas), second=both[1].proposal({}))

    promised = {both: apart(both, _expected).least for both in combinations(runs, 2)}
    for both in sorted(promised, key=lambda b: -promised[b])[:LOOKED]:
        if promised[both] >= SETTLED and (found := apart(both, _separation)).least >= SETTLED:
            return found
    return None


def menu(limits: Limits, name: str, usual: Sequence[float]) -> tuple[float, ...]:
    """As many values as usual, spread over the rig's limits where it has any."""
    if name not in limits.ranges:
        return tuple(usual)
    low, high = limits.ranges[name]
    return tuple(min(max(float(f"{v:.3g}"), low), high) for v in np.linspace(low, high, len(usual)))


def made_run(problem: Problem, model: Model, planned: MenuRun) -> Problem | None:
    """A run of the menu as the chosen model has it, its first guess the exact start; None where it is not to be had
    with (without) contact."""
    speed, current, offsets, duration, contact = planned
    start = model.initial_state(surge_rate=speed, drive_current=current)
    for i, offset in zip((INDEX["heave"], INDEX["sway"], INDEX["roll"]), offsets, strict=True):
        start[i] += offset
    times = np.arange(0.0, duration, 1.0 / RATE)
    pulses = None
    try:
        if model.drive == "pulses":
            pulses = pulses_of(model, start, duration, current)
        made = model.simulate(times, start, drive_current=current, pulses=pulses, further=problem.width > len(MOTION))
    except InputError:
        return None
    values = np.column_stack([made[c] for c in problem.channels])
    gaps = np.array([made[g] for g in GAPS])
    if not np.isfinite(values).all() or (gaps.min() < 0) != contact:
        return None
    if not all(problem.limits.allow(s, made[s]) for s in STATES):
        return None
    # As in the runs so far.
    given = {s: float(start[i]) for i, s in enumerate(STATES) if all(s in d.run.initial_state for d in problem.runs)}
    run = Run("proposal", Path("proposal"), problem.channels, times, values, times, current, given, pulses)
    data, exact = lay_out(run, model, problem.channels, problem.dof), start[:8].copy()
    single = problem.with_changes(runs=(data,), variances=())
    return single.with_changes(runs=(replace(data, y=_read(single, model, exact), guess=exact),))


def _separation(made: Problem, chosen: Fit, rival: Fit, undetermined: Sequence[str]) -> float:
    """√χ² that a rival is left with on the runs made; infinite where it leads beyond all numbers.

    Their initial states are refitted and, as far as the runs so far leave room, its parameters."""
    prior, point = _begun(made, chosen, rival, undetermined)
    return _left(made, prior, shooting.fit(made, prior, point, REFIT_STEPS).point)


def _expected(made: Problem, chosen: Fit, rival: Fit, undetermined: Sequence[str]) -> float:
    """`_separation` to first order about the runs as the chosen model flies them; 0 where nothing is to be had."""
    left = _left(made, *_begun(made, chosen, rival, undetermined))
    return left if np.isfinite(left) else 0.0


def _begun(made: Problem, chosen: Fit, rival: Fit, undetermined: Sequence[str]) -> tuple[Structure, Point]:
    """The rival with what is known of its parameters, and the runs' trajectories as the chosen model flies them."""
    prior = rival.structure.knowing(rival.theta, rival.covariance, undetermined)
    flown = [shooting.flown(made, chosen.structure, i, chosen.theta, d.guess) for i, d in enumerate(made.runs)]
    paths = columns.all_carried(made, prior, flown) if prior.model.carries_states else tuple(flown)
    touch = tuple(p for p in chosen.processes if p.kind == IMPACT)
    return prior, Point(prior.centre, paths, np.zeros(4), touch)


def _left(made: Problem, structure: Structure, point: Point) -> float:
    """√χ² of the readings and of what is known of theta, to first order about a point, where nothing shakes the
    cradle."""
    try:
        found = evidence_of(made, structure, shooting.linearise_all(made, point, structure), point.theta, np.zeros(4))
    except Lost:
        return np.inf
    return float(np.sqrt(found.chi2 + structure.surprise(point.theta + found.step)))


def _read(problem: Problem, model, start: np.ndarray) -> np.ndarray:
    structure = Structure(model, ())
    thetas = np.zeros((1, 0))
    out = problem.simulate(structure, 0, thetas, start[None])
    read = problem.predict(structure, 0, thetas, out)[0]
    return np.where(np.isfinite(read), read, problem.runs[0].y)


def _other_means(twins: Mapping[str, tuple[str, ...]]) -> str:
    names = {n for pair in ((k, *v) for k, v in twins.items()) for n in pair}
    if any(n.startswith("sensor_") for n in names):
        return "Check that sensor against another instrument, with the cradle at rest and in motion."
    if names & {"track_resistance", "track_inductance"}:
        return "Only their ratio shows in motion: measure one of them on the bench."
    return "Measure a further channel, or the suspected quantity itself."


def look_closer(unknown: Unknown) -> str:
    """The runs that would tell more of a force of any shape, in words."""
    variable = unknown.depends_on[0] if unknown.depends_on else "time"
    where = ""
    if unknown.at.size:
        on = np.abs(unknown.force) > 0.2 * np.abs(unknown.force).max()
        where = f" between {unknown.at[on].min():.3g} and {unknown.at[on].max():.3g}" if on.any() else ""
    if "drive" in unknown.depends_on[1:]:
        return (
            "repeat a driven run with half of its current and coasting: a change of the thrust halves and vanishes, any"
            " other force stays"
        )
    if variable == "surge":
        return (
            f"coast slowly and at two further speeds over the track{where + ' m' if where else ''}, with gaps recorded:"
            " what depends on the place alone repeats there at every speed"
        )
    if variable == "time":
        return (
            "repeat one run after a pause and once again at another place: what depends on time alone follows the"
            " clock, not the track"
        )
    return (
        f"runs that cover {variable}{where} (SI) slowly and quickly, driven and coasting: what depends on {variable}"
        " alone repeats there"
    )
