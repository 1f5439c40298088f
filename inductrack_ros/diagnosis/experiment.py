# SPDX-License-Identifier: Apache-2.0
"""The run, or the two, that would settle what is open: T-optimal design over a menu (Atkinson and Fedorov).

For each run of the menu the truth is taken to be the chosen model. Each rival gets its best chance: the run's initial
state and the rival's parameters are refitted within what is known of them. The difference that remains is its
separation in sigmas. No run leaves the limits that the campaign gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.firing import pulses_of
from ..core.model import Model
from ..core.state import GAPS, INDEX, MOTION, STATES
from ..data.limits import Limits
from ..data.measurement import Run
from ..estimation import fit as deterministic
from ..estimation.problem import Problem, lay_out
from ..estimation.shooting import Fit
from ..estimation.structure import Structure
from .result import Proposal, Unknown

SPEEDS = (12.0, 16.0, 20.0, 26.0, 34.0, 42.0)
CURRENTS = (0.0, 3500.0, 7000.0)
OFFSETS = ((0.0, 0.0, 0.0), (1e-3, 3e-3, 4e-3))  # heave over equilibrium, sway (m), roll (rad)
DURATIONS = (1.0, 3.0)
#: A rig with limits may have to end a run sooner.
SHORT = (0.3,)
RATE = 250.0
#: A run that sets every rival apart by so many sigmas settles the question.
SETTLED = 3.0
#: Runs of which pairs are looked at: those that tell the most alone.
PAIRED = 5
#: Runs that set every rival apart by so many sigmas will do; no wilder ones are looked at then.
ENOUGH = 8.0


def propose(
    problem: Problem,
    at_once: Callable[[Callable, Sequence], list],
    chosen: Fit,
    rivals: Mapping[str, Fit],
    twins: Mapping[str, tuple[str, ...]],
    unknown: Unknown | None,
    undetermined: Sequence[str],
) -> tuple[str | None, Proposal | None]:
    """The next run in words, and in numbers where it is one of the menu; None where none helps.

    ``undetermined`` parameters, which the runs so far say nothing about, would be free to fit the next one.
    """
    if not rivals:
        return (None if unknown is None else _look_closer(unknown)), None

    def tried(run: tuple) -> Proposal | None:
        speed, current, offsets, duration, contact = run
        if (made := made_run(problem, chosen.model, speed, current, offsets, duration, contact)) is None:
            return None
        return Proposal(
            speed,
            current,
            offsets,
            duration,
            {n: _separation(made[0], [made[1]], f, undetermined) for n, f in rivals.items()},
        )

    best, most = None, 0.0
    tried_all: list[Proposal] = []
    limits = problem.limits
    speeds, currents = menu(limits, "surge_rate", SPEEDS), menu(limits, "drive_current", CURRENTS)
    durations = (*SHORT, *DURATIONS) if limits.ranges else DURATIONS
    # The gentlest first.
    for contact, duration, current, offsets in product(
        (False, True) if limits.contact else (False,), durations, currents, OFFSETS
    ):
        found = at_once(tried, [(speed, current, offsets, duration, contact) for speed in speeds])
        for proposal in [p for p in found if p is not None]:
            tried_all.append(proposal)
            if (apart := min(proposal.sigmas.values())) > most:
                best, most = proposal, apart
        if most > ENOUGH:
            break
    if best is None:
        return ("no run within the campaign's limits sets apart what is open" if limits.ranges else None), None
    gains = ", ".join(f"{n} by {s:.1f} sigmas" for n, s in best.sigmas.items())
    if min(best.sigmas.values()) < SETTLED and (two := pair(problem, at_once, chosen, rivals, tried_all, undetermined)):
        gains = ", ".join(f"{n} by {s:.1f} sigmas" for n, s in two.sigmas.items())
        return f"no single run settles it, two do: {two.words}: together they set apart {gains}", two
    if min(best.sigmas.values()) < SETTLED:
        return (
            f"no single run of this kind settles it; the best ({best.words}) sets apart {gains}. {_other_means(twins)}",
            best,
        )
    return f"{best.words}: sets apart {gains}", best


def pair(
    problem: Problem,
    at_once: Callable[[Callable, Sequence], list],
    chosen: Fit,
    rivals: Mapping[str, Fit],
    tried: Sequence[Proposal],
    undetermined: Sequence[str],
) -> Proposal | None:
    """Two of the runs that together set every rival apart by `SETTLED` sigmas; None where none of those looked at do.

    A rival that is fitted to both at once has one set of parameters for them, so it is at least as far off as the two
    separations say together, √(a² + b²), and further where the runs pull at different parameters."""
    told = sorted(tried, key=lambda p: -sum(s**2 for s in p.sigmas.values()))[:PAIRED]

    def together(both: tuple[Proposal, Proposal]) -> Proposal | None:
        runs = [
            made_run(problem, chosen.model, p.speed, p.current, p.offsets, p.duration, contact)
            for p in both
            for contact in ((False, True) if problem.limits.contact else (False,))
        ]
        found = [made for made in runs if made is not None]
        if len(found) != 2:
            return None
        joint = problem.subset([0])
        joint.runs, joint.variances = tuple(single.runs[0] for single, _ in found), ()
        starts = [start for _, start in found]
        sigmas = {n: _separation(joint, starts, f, undetermined) for n, f in rivals.items()}
        return replace(both[0], sigmas=sigmas, second=replace(both[1], sigmas={}))

    found = [p for p in at_once(together, list(combinations(told, 2))) if p is not None]
    best = max(found, key=lambda p: min(p.sigmas.values()), default=None)
    return best if best is not None and min(best.sigmas.values()) >= SETTLED else None


def menu(limits: Limits, name: str, usual: Sequence[float]) -> tuple[float, ...]:
    """As many values as usual, spread over the rig's limits where it has any."""
    if name not in limits.ranges:
        return tuple(usual)
    low, high = limits.ranges[name]
    return tuple(min(max(float(f"{v:.3g}"), low), high) for v in np.linspace(low, high, len(usual)))


def made_run(
    problem: Problem, model: Model, speed, current, offsets, duration, contact: bool
) -> tuple[Problem, np.ndarray] | None:
    """A run of the menu as the chosen model has it, and its exact start; None where it is not to be had with (without)
    contact."""
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
    single = problem.subset([0])
    single.variances = ()
    # As in the runs so far.
    given = {s: float(start[i]) for i, s in enumerate(STATES) if all(s in d.run.initial_state for d in problem.runs)}
    run = Run("proposal", Path("proposal"), problem.channels, times, values, times, current, given, pulses)
    single.runs = (lay_out(run, model, problem.channels, problem.dof),)
    exact = start[:8].copy()
    single.runs = (replace(single.runs[0], y=_read(single, model, exact), guess=exact),)
    return single, exact


def _separation(made: Problem, starts: Sequence[np.ndarray], rival: Fit, undetermined: Sequence[str]) -> float:
    """√χ² that a rival is left with on the runs made, after refitting their initial states and, as far as the runs so
    far leave room, its parameters."""
    prior = rival.structure.knowing(rival.theta, rival.covariance, undetermined)
    theta = prior.centre

    def left(g: deterministic.Fit) -> float:
        return float(np.sqrt(max(g.chi2 + prior.surprise(g.theta), 0.0)))

    near = left(deterministic.fit(made, prior, starts, theta, iterations=10, tolerance=0.1))
    # It may only have been stuck.
    return near if near < ENOUGH else min(near, left(deterministic.fit_from_scratch(made, prior, theta)))


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


def _look_closer(unknown: Unknown) -> str:
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
