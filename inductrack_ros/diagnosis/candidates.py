# SPDX-License-Identifier: Apache-2.0
"""Known effects that could be missing, and what each would do to every run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from ..core.effects import Effect, catalogue
from ..estimation import columns
from ..estimation.blocks import Blocks, blocks_of
from ..estimation.kalman import Columns, LinearRun
from ..estimation.linear import force_columns
from ..estimation.problem import Problem
from ..estimation.scores import TWO_SHARES, scores, shares_of
from ..estimation.shooting import Fit, outputs_of
from ..estimation.structure import Structure
from . import placed, unheard
from .settings import LEVEL

#: The effect that is sought at every wavelength, from this many metres up, and how many of the best wavelengths are
#: candidates.
WAVES = "guideway_waviness"
SHORTEST_WAVE, WAVE_STARTS, HIGHEST_WAVE = catalogue()[WAVES].parameters["wavelength"].fit_from, 2, 1e-3
TOTALS = ("force_surge", "force_sway", "force_heave", "moment_roll")
#: Columns that are whitened together: a bound on memory alone.
AT_ONCE = 120


@dataclass(frozen=True)
class Candidate:
    """An effect that could be missing: its name, where its parameters start, how many parameters and independent tries
    it stands for."""

    label: str
    name: str
    start: Mapping[str, float] = field(default_factory=dict)
    parameters: int = 1
    tries: int = 1
    sized: tuple[str, ...] = ()  # beside a start that leaves the size open, the parameter that each column is of
    unheard: tuple[np.ndarray, ...] = ()  # by run, the readings (m,) that its sensor would not respond to

    def price(self, family: int) -> float:
        """Fall of the deviance that chance reaches in `LEVEL` of campaigns with ``family`` candidates."""
        return float(stats.chi2.isf(LEVEL / (family * self.tries), max(self.parameters, 1)))


def names(problem: Problem, structure: Structure) -> list[str]:
    """Full names of all effects not yet in the structure, as far as they can matter in these runs."""
    averaged = all(d.averaged for d in problem.runs)
    found = []
    for name, item in structure.model.known_effects.items():
        if item.screened and not (item.only and (item.only == "averaged") != averaged):
            found += [f"{name}:{c}" for c in problem.channels] if item.of_channel else [name]
    return [n for n in found if n not in structure.effects]


def sought(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], wavy: bool
) -> tuple[dict[str, Candidate], dict[str, list[Columns]]]:
    """All candidates and, for each, what it would do to every run."""
    effect = {n: fit.model.known_effects[n.partition(":")[0]] for n in names(problem, fit.structure)}
    somewhere = [n for n in effect if placed.is_placed(effect[n])]
    at_once = {n: start for n in effect if (start := _of_readings(problem, effect[n], n))}
    wanted = [n for n in effect if n not in (WAVES, *somewhere, *at_once)]
    candidates = {n: Candidate(n, n, {}, len(effect[n].parameters)) for n in wanted}
    told = columns.told_by_forces(problem, fit)
    parts = columns.of_parameters(problem, fit, [n for n in wanted if effect[n].parameters], told)
    parts |= {n: columns.of_switch(problem, fit, n) for n in wanted if not effect[n].parameters}
    follows = wavy and not fit.exact  # a plant that nothing shakes does not follow its readings
    for n, start in at_once.items():
        dead = unheard.unheard(problem, fit, n, start) if follows else ()
        candidates[n] = Candidate(n, n, start, len(start), unheard=dead if any(d.any() for d in dead) else ())
        parts[n] = columns.of_switch(problem, fit, n, start)
    started = _waves(problem, fit, systems) if wavy and WAVES in effect else []
    covered = placed.ranges([outputs_of(problem, fit, i) for i in range(len(problem.runs))]) if somewhere else {}
    for name in somewhere:
        started += _placed(problem, fit, systems, name, covered, told)
    candidates |= {c.label: c for c, _ in started}
    return candidates, parts | {c.label: part for c, part in started}


def _of_readings(problem: Problem, effect: Effect, name: str) -> Mapping[str, float]:
    """Where the parameters of a sensor's effect start as its readings say; empty where it is asked for while it
    vanishes."""
    channel = name.partition(":")[2]
    if not channel or not effect.starts:
        return {}
    mine = problem.channels.index(channel)
    return effect.starts(np.concatenate([d.y[d.channel == mine] for d in problem.runs]))[0]


# ---------------------------------------------------------------- effects at a place


def _placed(
    problem: Problem,
    fit: Fit,
    systems: Sequence[LinearRun],
    name: str,
    covered: Mapping[str, tuple[float, float]],
    told: Sequence[columns.Told],
) -> list[tuple[Candidate, list[Columns]]]:
    """An effect at the best few of the starts that it declares for runs that cover these ranges: it shows nothing of
    them while it vanishes."""
    item = fit.model.known_effects[name]
    asked = placed.tried(item, covered)
    if not asked.starts:
        return []
    plain = Structure(fit.model, ())

    def columns_of(starts: Sequence[int]) -> list[list[Columns]]:
        """What each of some starts would do to every run."""
        rows = [r for k in starts for r in asked.of(k)]
        wide, thetas = placed.thetas(plain, np.empty(0), name, [asked.rows[r][2] for r in rows])
        every = columns.of_thetas(problem, fit, wide, thetas, np.array([asked.rows[r][3] for r in rows]), told)
        edges = np.cumsum([0] + [len(asked.of(k)) for k in starts])
        return [[c.some(slice(a, b)) for c in every] for a, b in zip(edges[:-1], edges[1:], strict=True)]

    promised = np.empty(len(asked.starts))
    for some in np.array_split(np.arange(len(promised)), max(1, -(-len(asked.rows) // AT_ONCE))):
        wanted = {str(k): parts for k, parts in zip(some, columns_of(some.tolist()), strict=True)}
        of_some = scores(problem, fit, wanted, systems, shares=TWO_SHARES)
        promised[some] = [of_some.expected([str(k)]).deviance for k in some]
    best = np.argsort(promised, kind="stable")[:WAVE_STARTS].tolist()
    found = []
    for k, parts in zip(best, columns_of(best), strict=True):
        own = tuple(asked.rows[r][1] for r in asked.of(k))
        start = {p: float(v) for p, v in asked.starts[k].items()}
        found.append((Candidate(f"{name}@{k}", name, start, len(item.parameters), len(asked.starts), own), parts))
    return found


# ---------------------------------------------------------------- waves of the track


def _waves(problem: Problem, fit: Fit, systems: Sequence[LinearRun]) -> list[tuple[Candidate, list[Columns]]]:
    """Waviness at every wavelength the runs can tell apart: the best few, with amplitude and phase to start from."""
    stiffness = problem.for_runs(lambda i: _track_stiffness(problem, fit, i))
    reach = max(float(np.ptp(path[:, 0])) for path in fit.paths)
    fastest = max(float(np.abs(path[:, 4]).max()) for path in fit.paths)
    spacing = max(float(np.median(np.diff(d.grid))) for d in problem.runs)
    shortest = max(SHORTEST_WAVE, 2.5 * fastest * spacing)
    if reach < shortest:
        return []
    numbers = np.arange(1, max(2, int(reach / shortest * 1.5)) + 1) / (1.5 * reach)

    def parts(i: int, some: np.ndarray) -> Columns:
        phase = 2 * np.pi * np.outer(fit.paths[i][:, 0], some)
        height = np.stack([np.sin(phase), np.cos(phase)], axis=2).reshape(len(phase), -1)
        forces = stiffness[i][:, :, None] * height[:, None, :]
        return force_columns(problem.runs[i], problem.sigma, fit.model, forces)

    tried = []
    for some in np.array_split(numbers, max(1, 2 * len(numbers) // AT_ONCE)):
        powers, widths = shares_of(fit.power, TWO_SHARES), [2] * len(some)
        for runs in blocks_of(problem, fit, systems, powers, lambda i, some=some: parts(i, some), widths):
            equations, deviance = Blocks.together(runs).projected(fit)
            for nu, (gram, score) in zip(some, equations, strict=True):
                held = 1e-9 * np.trace(gram) * np.eye(2) + 1e-12 * np.eye(2)
                size = np.linalg.lstsq(gram + held, score, rcond=None)[0]
                tried.append((deviance - score @ size, nu, size))
    tried.sort(key=lambda t: t[0])
    found: list[tuple[Candidate, list[Columns]]] = []
    taken: list[float] = []
    for _, nu, (a, b) in tried:
        if all(abs(nu - other) > 1.5 / reach for other in taken):
            taken.append(nu)
            start = {
                "amplitude": min(float(np.hypot(a, b)), HIGHEST_WAVE),
                "wavelength": float(1 / nu),
                "phase": float(np.arctan2(b, a)),
            }
            candidate = Candidate(f"{WAVES}@{1 / nu:.3g}", WAVES, start, 3, 2 * len(numbers))
            found.append((candidate, [parts(i, np.array([nu])) for i in range(len(problem.runs))]))
        if len(found) == WAVE_STARTS:
            break
    return found


def _track_stiffness(problem: Problem, fit: Fit, i: int) -> np.ndarray:
    """Generalised force per height of the track, (n, 4), along a run: minus its derivative by heave."""
    h = 1e-5
    above, below = (columns.quantities(problem, fit, i, TOTALS, raised) for raised in (h, -h))
    return (below - above) / (2 * h)
