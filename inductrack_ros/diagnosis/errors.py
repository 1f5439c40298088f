# SPDX-License-Identifier: Apache-2.0
"""How far fitted models miss, open loop: what the report shows of every step, and the error on runs left out of the
fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.state import INDEX
from ..estimation.likelihood import Point, maximise_evidence
from ..estimation.problem import Problem, RunData
from ..estimation.processes import RUN_TO_RUN
from ..estimation.shooting import Fit, fit, linearise_all, outputs_of
from ..estimation.structure import Structure
from .result import RunTraces, Step
from .settings import REFIT_STEPS

#: Of so many runs one is left out of the fit when errors on unseen runs are wanted.
LEFT_OUT = 4


def predicted(problem: Problem, f: Fit) -> list[np.ndarray]:
    """What every run would read (m,), simulated from its fitted start to its end; parameters that differ from run to
    run are its own."""
    thetas = own_thetas(problem, f)

    def one(i: int) -> np.ndarray:
        out = problem.simulate(f.structure, i, thetas[i][None], f.states[i][None])
        return problem.predict(f.structure, i, thetas[i][None], out)[0]

    return problem.for_runs(one)


def own_thetas(problem: Problem, f: Fit) -> list[np.ndarray]:
    """Theta (g,) of every run: the fit's, and what differs from run to run beside it."""
    if not any(p.kind == RUN_TO_RUN for p in f.processes):
        return [f.theta] * len(problem.runs)
    settled = maximise_evidence(problem, f.structure, linearise_all(problem, f), f.point, 1)
    found = []
    for smooth in settled.smooth:
        theta, at = f.theta.copy(), len(f.model.active_states)
        for p in f.processes:
            if p.kind == RUN_TO_RUN:
                theta[f.structure.free.index(p.on)] += smooth.deviations[0, at]
            at += p.states
        found.append(theta)
    return found


def residuals(problem: Problem, f: Fit, sigma: np.ndarray) -> list[np.ndarray]:
    """Open-loop errors of every run (m,) over a noise by channel (c,)."""
    return [(d.y - p) / sigma[d.channel] for d, p in zip(problem.runs, predicted(problem, f), strict=True)]


def step_of(problem: Problem, f: Fit, sigma: np.ndarray, shown: tuple[str, ...]) -> Step:
    """Errors with a set of effects: on all runs, and on every fourth when the fit saw only the others."""
    r = residuals(problem, f, sigma)
    seen, out = left_out(problem)
    held, held_errors = np.nan, {}
    if seen:
        inner = fit(problem.subset(seen), f.structure, of_runs(f, seen), REFIT_STEPS // 2)
        left, structure = problem.subset(out), Structure(inner.model, ())
        point = of_runs(f, out)
        start = replace(point, theta=np.empty(0), processes=tuple(p for p in point.processes if p.kind != RUN_TO_RUN))
        rest = residuals(left, fit(left, structure, start, REFIT_STEPS // 2), sigma)
        held, held_errors = rms(np.concatenate(rest)), by_channel(left, rest)
    whole = rms(np.concatenate(r))
    by_run = {d.run.name: rms(x) for d, x in zip(problem.runs, r, strict=True)}
    return Step(shown, whole**2, held, by_channel(problem, r), held_errors, by_run)


def left_out(problem: Problem) -> tuple[list[int], list[int]]:
    """The runs that a fit sees when errors on unseen ones are wanted, and those: every `LEFT_OUT`-th."""
    out = list(range(LEFT_OUT // 2, len(problem.runs), LEFT_OUT)) or [len(problem.runs) - 1]
    return [i for i in range(len(problem.runs)) if i not in out], out


def of_runs(f: Fit, which: Sequence[int]) -> Point:
    """Where a fit stands in some of the runs."""
    return replace(f.point, paths=tuple(f.paths[i] for i in which))


def rms(r: np.ndarray) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    r = r[np.isfinite(r)]
    return float(np.sqrt(np.mean(r**2))) if r.size else float("nan")


def by_channel(problem: Problem, r: Sequence[np.ndarray]) -> dict[str, float]:
    """Root mean square of all runs' residuals by channel."""
    number = np.concatenate([d.channel for d in problem.runs])
    whole = np.concatenate(r)
    return {c: rms(whole[number == i]) for i, c in enumerate(problem.channels)}


def where_won(problem: Problem, before: Fit, after: Fit, sigma: np.ndarray) -> dict[str, dict[str, float]]:
    """Where the error fell: parts of the fall of its square by run, by stretch of speed and of gap, and by contact."""
    first, last = residuals(problem, before, sigma), residuals(problem, after, sigma)
    falls = [np.nan_to_num(a**2 - b**2) for a, b in zip(first, last, strict=True)]
    total = sum(f.sum() for f in falls) or 1.0
    speed = np.concatenate(
        [path[d.row, INDEX["surge_rate"]] for d, path in zip(problem.runs, after.paths, strict=True)]
    )
    gap = np.concatenate([_gaps(problem, after, i)[d.row] for i, d in enumerate(problem.runs)])
    fall = np.concatenate(falls)
    stretches = {"speed": (speed, 1.0, "m/s"), "gap": (gap, 1e3, "mm")}
    where: dict[str, dict[str, float]] = {
        "run": {d.run.name: float(f.sum() / total) for d, f in zip(problem.runs, falls, strict=True)}
    }
    for name, (values, scale, unit) in stretches.items():
        edges = np.unique(np.round(scale * np.quantile(values, [0, 0.25, 0.5, 0.75, 1]), 1))
        inside = [
            (scale * values >= low) & (scale * values <= high) for low, high in zip(edges[:-1], edges[1:], strict=True)
        ]
        labels = [f"{low + 0:g}–{high + 0:g} {unit}" for low, high in zip(edges[:-1], edges[1:], strict=True)]
        where[name] = {label: float(fall[mine].sum() / total) for label, mine in zip(labels, inside, strict=True)}
    where["contact"] = {"touching": float(fall[gap < 0].sum() / total), "free": float(fall[gap >= 0].sum() / total)}
    return where


def _gaps(problem: Problem, f: Fit, i: int) -> np.ndarray:
    """The smallest gap (n,) along a run, m."""
    return np.nan_to_num(outputs_of(problem, f, i)[:, 8:11]).min(axis=1)


def traces_of(problem: Problem, fits: Mapping[tuple[str, ...], Fit]) -> tuple[RunTraces, ...]:
    """Every run as measured and as each fitted set of effects predicts it, for the report's switches."""
    every = {subset: predicted(problem, f) for subset, f in fits.items()}
    traces = []
    for i, data in enumerate(problem.runs):
        read = {
            s: {c: column(data, p[i], k) for k, c in enumerate(problem.channels) if c in data.run.channels}
            for s, p in every.items()
        }
        measured = {c: data.run[c] for c in data.run.channels}
        traces.append(RunTraces(data.run.name, data.run.driven, data.run.times, measured, read))
    return tuple(traces)


def column(data: RunData, read: np.ndarray, channel: int) -> np.ndarray:
    """A channel's predictions (n,) at the run's samples out of all (m,); NaN where it was not measured."""
    found = np.full(len(data.run.times), np.nan)
    mine = data.channel == channel
    found[np.searchsorted(data.run.times, data.time[mine])] = read[mine]
    return found
