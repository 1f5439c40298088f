# SPDX-License-Identifier: Apache-2.0
"""Forces of any shape on two variables: a smooth function of one times a power of another (v²·roll, gap × speed, place
× time), chosen by cross-validation over runs.

All of it is linear algebra at one linearisation of the model without such a force. Each run is foretold by all others:
a table is judged by how much more probable it makes what they did not see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..estimation.blocks import Blocks, blocks_of
from ..estimation.kalman import LinearRun, log_determinant
from ..estimation.problem import Problem
from ..estimation.scores import shares_in
from ..estimation.shooting import ANEW, Fit, all_histories, linearise_all
from .factor import FACTORS, Factor
from .laws.forms import ALONG
from .moves import State, Task, law_price, shaken, smoothed_anew, with_law, without
from .screening import FINE_SHARES, Asked, Spans, columns_of, products, spans_of, tables_over
from .settings import FINE, MEDIUM, TWINS
from .smooth import Smooth

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
    runs = all_histories(problem, f)
    spans = spans_of(runs)

    def finely(spans: Spans, factor: Factor | None = None) -> list[Asked]:
        return tables_over(spans, lambda v: (MEDIUM, FINE) if v in ALONG else (MEDIUM,), factor)

    singles, rough = finely(spans), products(runs, on)
    promised = promises(problem, f, systems, on, [*singles, *rough])
    alone, of_two = promised[: len(singles)], promised[len(singles) :]
    best = [p.asked for p in sorted(of_two, key=lambda p: -p.gain)[: 2 * REFITTED]]
    finer = [t for a in best for t in finely({a.variable: spans[a.variable]}, a.factor)]
    found = sorted(promises(problem, f, systems, on, finer), key=lambda p: -p.unseen) if finer else []
    known, known_unseen = max(alone, key=lambda p: p.gain), max(alone, key=lambda p: p.unseen)
    kept = [p for p in found if p.unseen > known_unseen.unseen and p.gain > max(known.gain, law_price())][:REFITTED]
    return [_refitted(task, plain, on, p, known_unseen) for p in kept]


def _refitted(task: Task, plain: State, on: str, p: Promise, known: Promise) -> State:
    new = smoothed_anew(task, with_law(task, plain, p.asked.law(on, p.table, p.gain, p.power)))
    return new.told(
        f"times {p.asked.factor.label if p.asked.factor else ''}: takes {p.unseen:.0f} off runs left out, the best on"
        f" one variable ({known.asked.variable}) {known.unseen:.0f}"
    )


# ---------------------------------------------------------------- cross-validation


def promises(
    problem: Problem, fit: Fit, systems: Sequence[LinearRun], on: str, tables: Sequence[Asked]
) -> list[Promise]:
    """What each of some tables of a force on a coordinate promises at a fit, at the power of the disturbances that
    suits it."""
    (without,) = blocks_of(problem, fit, systems, [fit.power])
    _, plain = Blocks.together(without).projected(fit)
    alone = _unseen(fit, [r.nuisance for r in without], without, np.zeros((0, 0)))
    powers = shares_in(fit.power, on, FINE_SHARES)
    told = blocks_of(
        problem, fit, systems, powers, lambda i: columns_of(problem, fit, i, on, tables), [t.count for t in tables]
    )
    found: list[list[Promise]] = [[] for _ in tables]
    for power, runs in zip(powers, told, strict=True):
        equations, deviance = Blocks.together(runs).projected(fit)
        for k, (asked, (gram, score)) in enumerate(zip(tables, equations, strict=True)):
            table = asked.smoothest(gram, score, problem.samples)
            prior = max(np.trace(gram) / len(gram), 1e-12) / problem.samples * np.eye(len(gram))
            prior += table.smoothness.weight * table.smoothness.bending(len(gram))
            unseen = _unseen(fit, [r.gram(k) for r in runs], runs, prior)
            found[k].append(Promise(asked, table, power, plain - deviance + table.promise, alone - unseen))
    return [max(of_table, key=lambda p: p.gain) for of_table in found]


def _unseen(fit: Fit, grams: Sequence[np.ndarray], runs: Sequence[Blocks], smooth: np.ndarray) -> float:
    """Twice the negative log density of each run that all others foretell, summed; ``grams`` (1 + g + l, 1 + g + l) of
    each, ``smooth`` (l, l) is the table's prior. What the others leave open counts: a run at a place where no other has
    been foretells nothing."""
    g = len(fit.theta)
    whole = np.sum(grams, axis=0)
    prior = np.zeros((len(whole) - 1,) * 2)
    prior[:g, :g], prior[g:, g:] = fit.structure.precision, smooth
    pull = np.concatenate([fit.structure.precision @ (fit.structure.centre - fit.theta), np.zeros(len(smooth))])

    def left(gram: np.ndarray) -> float:
        A, b = gram[1:, 1:] + prior, pull - gram[1:, 0]
        scale = 1.0 / np.sqrt(np.diag(A))
        values, modes = np.linalg.eigh(A * np.outer(scale, scale))
        values = np.maximum(values, LEAST)
        along = modes.T @ (scale * b)
        return float(gram[0, 0] - np.sum(along**2 / values) + np.sum(np.log(values)) - 2.0 * np.sum(np.log(scale)))

    all_runs = left(whole)
    return sum(all_runs - left(whole - gram) + log_determinant(r.tally) for gram, r in zip(grams, runs, strict=True))
