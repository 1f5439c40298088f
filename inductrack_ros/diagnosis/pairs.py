# SPDX-License-Identifier: Apache-2.0
"""Forces of any shape on two variables: a smooth function of one times a power of another (v²·roll, gap × speed, place
× time), chosen by cross-validation over runs.

All of it is linear algebra at one linearisation of the model without such a force. Each run is foretold by all others:
a table is judged by how much more probable it makes what they did not see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.effects.stand_in import over
from ..estimation.kalman import Columns, LinearRun, log_determinant, run_filter
from ..estimation.likelihood import tally
from ..estimation.linear import acting, force_columns, histories
from ..estimation.problem import Problem
from ..estimation.processes import augmented
from ..estimation.scores import shares_in, widened
from ..estimation.shooting import ANEW, Fit, linearise_all
from .factor import FACTORS, Factor, factors_of
from .laws.forms import ALONG
from .moves import State, Task, law_price, shaken, smoothed_anew, with_law, without
from .screening import FINE_SHARES, Asked, Law, spans_of
from .settings import COARSE, FINE, MEDIUM, TWINS
from .smooth import Smooth, smoothest_of

#: Products that are laid on a finer table and refitted.
REFITTED = 2
#: A product is to be this much cheaper than a force on one variable: then chance does not choose it.
SURER = TWINS + 2.0 * float(np.log(len(FACTORS) + 2))

#: Least eigenvalue of normal equations with a unit diagonal: what is below is rounding.
LEAST = 1e-14


@dataclass(frozen=True)
class Promise:
    """What a table promises: fitted to all runs, twice its log evidence, and what it takes off the deviance of runs
    left out."""

    asked: Asked
    table: Smooth
    power: np.ndarray
    gain: float
    unseen: float


def add_pair(task: Task, state: State) -> State:
    """Put a force on two variables in the place of one on one variable, or add it where none was found, if it costs
    less and predicts runs that it has not seen better."""
    name = next((n for n in state.added if n.startswith("stand_in")), None)
    if name == "stand_in_thrust" or len(task.problem.runs) < 2:
        return state
    if name and Factor.of(state.fit.model.effects[name]):
        return state
    plain = without(task, state, name, ANEW) if name else state
    if plain.fit.lost:
        return state
    systems = linearise_all(task.problem, plain.fit)
    lacking = [name.removeprefix("stand_in_")] if name else shaken(task, plain, systems)
    tried = [t for on in lacking for t in _tried(task, plain, systems, on)]
    if not tried:
        return state
    best = min(tried, key=lambda s: s.cost(task))
    if best.cost(task) + SURER < state.cost(task):
        return best
    return state.told(f"no force on two variables is cheaper than what was found ({_factor(best)} was tried)")


def _factor(state: State) -> str:
    found = [Factor.of(state.fit.model.effects[n]) for n in state.added if n.startswith("stand_in")]
    return ", ".join(f.label for f in found if f)


def _tried(task: Task, plain: State, systems: Sequence[LinearRun], on: str) -> list[State]:
    """The state with the best products on a coordinate, where one predicts unseen runs better than any force on one
    variable does."""
    problem, f = task.problem, plain.fit
    task.say(f"forces in {on} on two variables")
    runs = [histories(d, path) for d, path in zip(problem.runs, f.paths, strict=True)]
    spans = spans_of(runs)
    singles = [t for v, s in spans.items() for t in _tables(v, s, None, (MEDIUM, FINE) if v in ALONG else (MEDIUM,))]
    rough = [
        t for factor in factors_of(on, runs, spans) for v, s in spans.items() if v != factor.variable
        for t in _tables(v, s, factor, (MEDIUM,) if v in ALONG else (COARSE,))
    ]  # fmt: skip
    promised = promises(problem, f, systems, on, [*singles, *rough])
    alone, products = promised[: len(singles)], promised[len(singles) :]
    best = sorted(products, key=lambda p: -p.gain)[: 2 * REFITTED]
    finer = [
        t
        for p in best
        for t in _tables(
            p.asked.variable,
            spans[p.asked.variable],
            p.asked.factor,
            (MEDIUM, FINE) if p.asked.variable in ALONG else (MEDIUM,),
        )
    ]
    found = sorted(promises(problem, f, systems, on, finer), key=lambda p: -p.unseen)
    known, known_unseen = max(alone, key=lambda p: p.gain), max(alone, key=lambda p: p.unseen)
    kept = [p for p in found if p.unseen > known_unseen.unseen and p.gain > max(known.gain, law_price())][:REFITTED]
    return [_refitted(task, plain, on, p, known_unseen) for p in kept]


def _refitted(task: Task, plain: State, on: str, p: Promise, known: Promise) -> State:
    a = p.asked
    law = Law(on, a.variable, a.start, a.step, p.table, p.gain, p.power, a.factor.parameters if a.factor else {})
    new = smoothed_anew(task, with_law(task, plain, law))
    return new.told(
        f"times {a.factor.label if a.factor else ''}: takes {p.unseen:.0f} off runs left out, the best on one variable"
        f" ({known.asked.variable}) {known.unseen:.0f}"
    )


def _tables(variable: str, span: tuple[float, float], factor: Factor | None, sizes: Sequence[int]) -> list[Asked]:
    return [Asked(variable, *over(*span, n), factor) for n in sizes]


# ---------------------------------------------------------------- cross-validation


@dataclass(frozen=True)
class Told:
    """What one run tells at a power: ``grams`` of residual, nuisance and the entries of each table, (1 + g + l, 1 + g +
    l), and the ``tally`` of its innovations' variances."""

    grams: Sequence[np.ndarray]
    tally: np.ndarray


def promises(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], on: str, tables: Sequence[Asked]
) -> list[Promise]:
    """What each table of a force on a coordinate promises at a fit, at the power of the disturbances that suits it."""
    runs = [histories(d, path) for d, path in zip(problem.runs, fit.paths, strict=True)]

    def columns(i: int) -> Columns:
        entries = np.hstack([t.entries(runs[i]) for t in tables])
        forces = acting(problem, fit.structure, i, fit.theta, fit.paths[i], on, entries)
        return force_columns(problem.runs[i], problem.sigma, fit.model, forces)

    parts = problem.for_runs(columns) if tables else []
    without = _told(problem, fit, systems, [], [0], fit.power)
    plain = _deviance(fit, without)
    alone = _unseen(fit, [t.grams[0] for t in without], [t.tally for t in without], np.zeros((0, 0)))
    found: list[list[Promise]] = [[] for _ in tables]
    for power in shares_in(fit.power, on, FINE_SHARES):
        every = _told(problem, fit, systems, parts, [t.count for t in tables], power)
        for k, asked in enumerate(tables):
            mine = [Told([t.grams[k]], t.tally) for t in every]
            found[k].append(_promise(fit, mine, problem.samples, power, asked, (plain, alone)))
    return [max(of_table, key=lambda p: p.gain) for of_table in found]


def _told(
    problem: Problem,
    fit: Fit,
    systems: Sequence[LinearRun],
    parts: Sequence[Columns],
    widths: Sequence[int],
    power: np.ndarray,
) -> list[Told]:
    edges = np.cumsum([0, *widths])
    g = 1 + len(fit.theta)

    def one(i: int) -> Told:
        system = augmented(problem, fit.structure, i, widened(systems[i], parts[i : i + 1]), fit.processes)
        filtered = run_filter(system, power, smooth=False)
        w = filtered.scored(system)
        small = w[:, :g].T @ w[:, :g]
        grams = []
        for a, b in zip(g + edges[:-1], g + edges[1:], strict=True):
            cross, own = w[:, :g].T @ w[:, a:b], w[:, a:b].T @ w[:, a:b]
            grams.append(np.block([[small, cross], [cross.T, own]]))
        return Told(grams, tally(problem, i, filtered, system))

    return problem.for_runs(one)


def _promise(
    fit: Fit, told: Sequence[Told], samples: int, power: np.ndarray, asked: Asked, before: tuple[float, float]
) -> Promise:
    """A table's promise at one power; ``before``: the deviance without it, of all runs and of runs left out."""
    g = len(fit.theta)
    whole = np.sum([t.grams[0] for t in told], axis=0)
    prior, pull = fit.structure.precision, _pull(fit)
    inverse = np.linalg.pinv(whole[1 : 1 + g, 1 : 1 + g] + prior, rcond=1e-14, hermitian=True)
    cross, own = whole[1 : 1 + g, 1 + g :], whole[1 + g :, 1 + g :]
    gram = own - cross.T @ inverse @ cross
    score = -whole[0, 1 + g :] - cross.T @ inverse @ (pull - whole[1 : 1 + g, 0])
    table = smoothest_of(gram, score, samples, asked.variable in ALONG)
    smooth = max(np.trace(gram) / len(gram), 1e-12) / samples * np.eye(len(gram))
    smooth += table.smoothness.weight * table.smoothness.bending(len(gram))
    unseen = _unseen(fit, [t.grams[0] for t in told], [t.tally for t in told], smooth)
    gain = before[0] - _deviance(fit, told) + table.promise
    return Promise(asked, table, power, gain, before[1] - unseen)


def _pull(fit: Fit) -> np.ndarray:
    return fit.structure.precision @ (fit.structure.centre - fit.theta)


def _deviance(fit: Fit, told: Sequence[Told]) -> float:
    """The deviance without a table, at the nuisance's best."""
    g = len(fit.theta)
    whole = np.sum([t.grams[0] for t in told], axis=0)
    b = _pull(fit) - whole[1 : 1 + g, 0]
    inverse = np.linalg.pinv(whole[1 : 1 + g, 1 : 1 + g] + fit.structure.precision, rcond=1e-14, hermitian=True)
    return float(whole[0, 0] - b @ inverse @ b) + log_determinant(np.sum([t.tally for t in told], axis=0))


def _unseen(fit: Fit, grams: Sequence[np.ndarray], tallies: Sequence[np.ndarray], smooth: np.ndarray) -> float:
    """Twice the negative log density of each run that all others foretell, summed; ``smooth`` (l, l) is the table's
    prior. What the others leave open counts: a run at a place where no other has been foretells nothing."""
    g = len(fit.theta)
    whole = np.sum(grams, axis=0)
    prior = np.zeros((len(whole) - 1,) * 2)
    prior[:g, :g], prior[g:, g:] = fit.structure.precision, smooth
    pull = np.concatenate([_pull(fit), np.zeros(len(smooth))])

    def left(gram: np.ndarray) -> float:
        A, b = gram[1:, 1:] + prior, pull - gram[1:, 0]
        scale = 1.0 / np.sqrt(np.diag(A))
        values, modes = np.linalg.eigh(A * np.outer(scale, scale))
        values = np.maximum(values, LEAST)
        along = modes.T @ (scale * b)
        return float(gram[0, 0] - np.sum(along**2 / values) + np.sum(np.log(values)) - 2.0 * np.sum(np.log(scale)))

    all_runs = left(whole)
    return sum(all_runs - left(whole - gram) + log_determinant(lot) for gram, lot in zip(grams, tallies, strict=True))
