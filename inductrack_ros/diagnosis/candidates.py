"""The rivals: every screened effect of the catalogue and of the user's files, every sensor fault on every channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ..core.effects import FORCES as TOTALS
from ..core.effects import Effect, catalogue
from ..estimation.fit import Fit
from ..estimation.problem import Linearisation, Problem
from ..estimation.structure import Structure
from . import placed
from .gate import Projector
from .signatures import RunResponse

#: A candidate whose fall in χ² is this improbable by chance, all tries of the family counted, is significant.
LEVEL = 0.01
#: The effect that is sought at every wavelength, from this many metres up.
WAVES = "guideway_waviness"
SHORTEST_WAVE = catalogue()[WAVES].parameters["wavelength"].fit_from
#: How many of the best wavelengths are tried in full, and the highest wave (m) they start from: the field changes by a sixth there, so
#: first order says no more, and far higher ones keep the runs in contact, which takes long to simulate.
WAVE_STARTS, HIGHEST_START = 3, 1e-3


@dataclass(frozen=True)
class Candidate:
    """An effect that could be missing: name, where its parameters may start, and how many independent tries it stands for."""

    name: str
    starts: tuple[Mapping[str, float], ...]
    tries: int
    parameters: int

    def threshold(self, family: int) -> float:
        """Fall in χ² that chance reaches in `LEVEL` of campaigns with ``family`` candidates."""
        return float(stats.chi2.isf(LEVEL / (family * self.tries), max(self.parameters, 1)))


@dataclass(frozen=True)
class Screened:
    """A candidate's first-order standing at a fit: the fall in χ² it promises, its signature columns (m_i, l) per run."""

    candidate: Candidate
    promise: float
    columns: list[np.ndarray]
    deviation: float  # of its first parameter, in fit units


def names(problem: Problem, structure: Structure) -> list[str]:
    """Full names of all candidates not yet in the structure, as far as they can matter in these runs."""
    averaged = all(d.averaged for d in problem.runs)
    found = []
    for name, item in structure.model.known_effects.items():
        if not item.screened:
            continue
        if item.only and (item.only == "averaged") != averaged:
            continue
        if item.of_channel:
            found += [f"{name}:{c}" for c in problem.channels]
        else:
            found.append(name)
    return [n for n in found if n not in structure.effects]


def screen(problem: Problem, fit: Fit, responses: Sequence[RunResponse], project: Projector | None = None) -> list[Screened]:
    """Score test of every candidate at a fit, best promise first; those the data cannot see at all are left out."""
    project = project or Projector(problem, fit)
    wanted = names(problem, fit.structure)
    known = fit.structure.model.known_effects
    apart = [n for n in wanted if placed.is_placed(known[n.partition(":")[0]])]
    result = [s for s in first_order(problem, fit, responses, [n for n in wanted if n not in (WAVES, *apart)], project) if np.isfinite(s.deviation)]
    result += [s for n in apart for s in _screen_placed(problem, fit, responses, project, n)]
    if WAVES in wanted:
        result += _screen_waves(problem, fit, responses, project)
    return sorted(result, key=lambda s: -s.promise)


def first_order(problem: Problem, fit: Fit, responses: Sequence[RunResponse], wanted: Sequence[str], project: Projector) -> list[Screened]:
    """Standing of candidates other than waves; of one the data cannot see beside the fit's effects, no promise and no end of a deviation."""
    known = fit.structure.model.known_effects
    parameters = {name: known[name.partition(":")[0]].parameters for name in wanted}
    starts = {n: _starts(problem, known, n) for n in wanted}
    columns = _columns_at_vanishing(problem, fit, [n for n in wanted if parameters[n] and starts[n] == ({},)])
    columns |= {n: _change(problem, fit, n, starts[n][0]) for n in wanted if starts[n] != ({},)}
    columns |= {n: switch_columns(problem, fit, responses, n) for n in wanted if not parameters[n]}
    standing = {n: _standing(project, parts) or (0.0, np.inf) for n, parts in columns.items()}
    return [Screened(Candidate(n, starts[n], 1, len(parameters[n])), standing[n][0], parts, standing[n][1]) for n, parts in columns.items()]


def _starts(problem: Problem, known: Mapping[str, Effect], name: str) -> tuple[Mapping[str, float], ...]:
    """Where a candidate's parameters may be sought: where it vanishes or, for some of sensors, as the readings say."""
    base, _, channel = name.partition(":")
    if not known[base].starts or not channel:
        return ({},)
    mine = problem.channels.index(channel)
    return tuple(known[base].starts(np.concatenate([d.y[d.channel == mine] for d in problem.runs])))


def _change(problem: Problem, fit: Fit, name: str, start: Mapping[str, float]) -> list[np.ndarray]:
    """Change of the predictions over noise with an effect at a start, (m_i, 1) per run."""
    structure, theta = fit.widened(name, start)
    after = problem.residuals(structure, theta, fit.states)
    return [np.nan_to_num(p.residual - r)[:, None] for p, r in zip(fit.linear, after, strict=True)]


def visible(project: Projector, parts: Sequence[np.ndarray]) -> np.ndarray:
    """Signature columns (N, l) with the nuisance projected out, those that leave nothing of themselves left out."""
    raw = project.stack(parts)
    projected = project(raw)
    size, left = np.linalg.norm(raw, axis=0), np.linalg.norm(projected, axis=0)
    return projected[:, (left > 1e-5 * size) & (left > 1e-6)]  # a shape parameter says nothing while the effect vanishes


def _standing(project: Projector, parts: list[np.ndarray]) -> tuple[float, float] | None:
    """Promised fall in χ² and deviation of the first coefficient; None where the data cannot see it."""
    projected = visible(project, parts)
    if not projected.shape[1]:
        return None
    q, r = np.linalg.qr(projected)
    promise = float(np.sum((q.T @ project.residual) ** 2))
    return promise, float(np.linalg.norm(np.linalg.inv(r), axis=1)[0])


def _columns_at_vanishing(problem: Problem, fit: Fit, wanted: list[str]) -> dict[str, list[np.ndarray]]:
    """Derivative of the predictions over noise by each candidate's parameters where it vanishes, (m_i, p) per run."""
    if not wanted:
        return {}
    wide = fit.structure
    for name in wanted:
        wide = wide.plus(name)
    own = Structure(wide.model, tuple(f for f in wide.free if f not in fit.structure.free))
    base = Structure(fit.structure.with_theta(fit.theta).with_changes(effects={**fit.model.effects, **{n: wide.model.effects[n] for n in wanted}}), own.free)
    no_state_work = [Linearisation(p.residual, p.by_theta, p.by_state, p.free_states) for p in fit.linear]
    parts = problem.linearise(base, base.start, fit.states, reuse=no_state_work)
    return {n: [p.by_theta[:, [k for k, f in enumerate(own.free) if f.rpartition(".")[0] == n]] for p in parts] for n in wanted}


def switch_columns(problem: Problem, fit: Fit, responses: Sequence[RunResponse], name: str) -> list[np.ndarray]:
    """Difference an effect without parameters, switched on (or off, where it is on), makes, (m_i, 1) per run.

    To first order in its force along the run, for the whole of it may throw an unstable run far off; but an effect with states of
    its own is simulated.
    """
    structure = fit.structure
    other = structure.minus(name) if name in structure.effects else structure.plus(name)
    if structure.model.known_effects[name].states:
        after = problem.residuals(other, fit.theta, fit.states)
        return [(p.residual - r)[:, None] for p, r in zip(fit.linear, after, strict=True)]
    columns = []
    for r in responses:
        change = r.quantities(TOTALS, on=other.model.switches) - r.quantities(TOTALS)
        columns.append(r.respond(change[:, :, None]))
    return columns


def _screen_placed(problem: Problem, fit: Fit, responses: Sequence[RunResponse], project: Projector, name: str) -> list[Screened]:
    """An effect at each of its starts: the best few, with the sizes that first order gives them."""
    item = fit.structure.model.known_effects[name]
    asked = placed.tried(item, placed.ranges([r.outputs for r in responses]))
    structure, thetas = placed.thetas(fit.structure, fit.theta, name, asked)
    steps = np.array([row[3] for row in asked.rows])

    def one(i: int) -> np.ndarray:
        out = problem.simulate(structure, i, thetas, np.tile(fit.states[i], (len(thetas), 1)))
        read = problem.predict(structure, i, thetas, out)
        return ((read[1:] - read[0]) / steps[:, None] / problem.sigma[problem.runs[i].channel]).T

    parts = [np.nan_to_num(columns) for columns in problem.for_runs(one)]
    every = project(project.stack(parts))
    found = []
    for k in range(len(asked.starts)):
        mine = [r for r in asked.of(k) if np.linalg.norm(every[:, r]) > 1e-6]
        if not mine:
            continue
        size, *_ = np.linalg.lstsq(every[:, mine], project.residual, rcond=1e-6)
        promise = float(project.residual @ (every[:, mine] @ size))
        sizes = [size[mine.index(r)] if r in mine else 0.0 for r in asked.of(k)]
        found.append((promise, asked.sized(k, item, sizes), [p[:, mine] for p in parts], float(np.linalg.norm(every[:, mine[0]])) ** -1.0))
    found.sort(key=lambda t: -t[0])
    if not found:
        return []
    candidate = Candidate(name, tuple(start for _, start, _, _ in found[:WAVE_STARTS]), len(asked.starts), len(item.parameters))
    return [Screened(candidate, found[0][0], found[0][2], found[0][3])]


def _screen_waves(problem: Problem, fit: Fit, responses: Sequence[RunResponse], project: Projector) -> list[Screened]:
    """Waviness at every wavelength the runs can tell apart: the best few, with amplitude and phase to start from."""
    stiffness = [_track_stiffness(r) for r in responses]
    reach = max(float(np.ptp(r.variables["surge"])) for r in responses)
    speeds = np.concatenate([r.variables["surge_rate"] for r in responses])
    fastest = max(float(np.nanmax(speeds)), 1e-3)
    spacing = max(float(np.median(np.diff(r.data.grid))) for r in responses)
    shortest = max(SHORTEST_WAVE, 2.5 * fastest * spacing)
    inverse = np.arange(1, max(2, int(reach / shortest * 1.5)) + 1) / (1.5 * reach)
    tried = []
    for chunk in np.array_split(inverse, max(1, len(inverse) // 60)):
        parts = []
        for r, k in zip(responses, stiffness, strict=True):
            phase = 2 * np.pi * np.outer(r.variables["surge"], chunk)
            height = np.stack([np.sin(phase), np.cos(phase)], axis=2).reshape(len(phase), -1)
            parts.append(r.respond(k[:, :, None] * height[:, None, :]))
        projected = project(project.stack(parts))
        a, b = projected[:, ::2], projected[:, 1::2]  # sines and cosines
        aa, bb, ab = np.sum(a * a, axis=0), np.sum(b * b, axis=0), np.sum(a * b, axis=0)
        ra, rb = project.residual @ a, project.residual @ b
        for j in np.flatnonzero((np.minimum(aa, bb) > 1e-6) & (aa * bb - ab**2 > 1e-9 * aa * bb)):
            pair = np.linalg.solve([[aa[j], ab[j]], [ab[j], bb[j]]], [ra[j], rb[j]])
            tried.append((float(pair @ [ra[j], rb[j]]), chunk[j], pair, [p[:, 2 * j : 2 * j + 2] for p in parts], aa[j] ** -0.5))
    tried.sort(key=lambda t: -t[0])
    starts: list[Mapping[str, float]] = []
    for _, nu, (a, b), _, _ in tried:
        if all(abs(nu - 1 / s["wavelength"]) > 1.5 / reach for s in starts):
            starts.append({"amplitude": min(float(np.hypot(a, b)), HIGHEST_START), "wavelength": float(1 / nu), "phase": float(np.arctan2(b, a))})
        if len(starts) == WAVE_STARTS:
            break
    if not starts:
        return []
    candidate = Candidate(WAVES, tuple(starts), 2 * len(inverse), 3)
    return [Screened(candidate, tried[0][0], tried[0][3], tried[0][4])]


def _track_stiffness(response: RunResponse) -> np.ndarray:
    """Generalised force per height of the track, (n, 4), along a run: minus its derivative by heave."""
    h = 1e-5
    above, below = (response.quantities(TOTALS, raised) for raised in (h, -h))
    return (below - above) / (2 * h)


def effect_columns(screened: Sequence[Screened]) -> dict[str, list[np.ndarray]]:
    """Signature columns by candidate, for the gate; not those that were picked by looking at the data (waves)."""
    return {s.candidate.name: s.columns for s in screened if s.candidate.tries == 1}

