"""Initial states sought anew, run by run: a fit of a run with impacts has many minima, and steps do not lead from one to another."""

from __future__ import annotations

import numpy as np

from .fit import Fit, chi_square, fit, fit_from_scratch, growing, rough_fit, within_bounds
from .problem import STATE_PRIOR, Problem
from .structure import Structure

#: A fall of a run's χ² that no step of a converged fit would still have won.
BETTER = 1.0
#: Initial states drawn from what each beginning of a run says of them; the best so many take a few steps, the best of these go on.
DRAWS, SEVERAL, FEW = 32, 8, 2


def each_run_anew(problem: Problem, f: Fit) -> Fit:
    """The fit with every run's initial state sought anew beside its parameters, refitted if one fares better for it.

    An impact that a run has on the wrong side of a sample, or once too often, traps it: no step away from there is better. What the run's
    beginnings, ever longer, leave open holds the states from which it is not. A run that leaves no more than noise is not trapped.
    """
    held = Structure(f.model, ())

    def task(i: int) -> np.ndarray:
        data, now = problem.runs[i], chi_square([f.linear[i].residual])
        if now < data.y.size:
            return f.states[i]
        alone = problem.subset([i])
        alone.threads = 1
        found = min(fit_from_scratch(alone, held), _drawn(alone, held, f.states[i]), key=lambda f: f.chi2)
        return found.states[0] if found.chi2 < now - BETTER else f.states[i]

    states = problem.for_runs(task)
    if all(x is old for x, old in zip(states, f.states, strict=True)):
        return f
    return min(f, fit(problem, f.structure, states, f.theta, iterations=15), key=lambda f: f.chi2)


def _drawn(alone: Problem, held: Structure, state: np.ndarray) -> Fit:
    """The best fit of one run by itself from initial states drawn from what its beginnings leave open about ``state``."""
    rng = np.random.default_rng(0)
    starts = []
    for horizon in growing(alone):
        near = rough_fit(alone.within(horizon), held, [state])
        part = near.linear[0]
        _, _, by_state = within_bounds(part)
        free = part.free_states
        values, vectors = np.linalg.eigh(by_state.T @ by_state + np.diag(STATE_PRIOR[free] ** -2.0))
        drawn = np.tile(near.states[0], (DRAWS, 1))
        drawn[:, free] += rng.standard_normal((DRAWS, len(free))) / np.sqrt(values) @ vectors.T
        starts.append(drawn)
    states = np.vstack(starts)
    nothing = np.zeros((len(states), 0))
    data = alone.runs[0]
    read = alone.predict(held, 0, nothing, alone.simulate(held, 0, nothing, states))
    cost = [chi_square([r]) for r in (data.y - read) / alone.sigma[data.channel]]
    best = [fit(alone, held, [states[k]], iterations=3, tolerance=0.1) for k in np.argsort(cost)[:SEVERAL]]
    return min((fit(alone, held, f.states) for f in sorted(best, key=lambda f: f.chi2)[:FEW]), key=lambda f: f.chi2)
