"""Laws in the place of a table by either estimator: over nodes, or simulated from end to end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..estimation import shooting
from ..estimation.fit import Fit, fit
from . import errors
from .law_result import Laws
from .moves import State, Task
from .propose_laws import Estimator, propose_laws
from .race import Trial
from .result import Step, Unknown
from .search import Search
from .settings import REFIT_STEPS


def laws_of_nodes(task: Task, state: State, unknown: Unknown | None, sigma: np.ndarray) -> Laws | None:
    """Laws for the force of any shape at the end of the search over nodes; None where there is none, or the search was broken off."""
    name = next((n for n in state.added if n.startswith("stand_in")), None)
    if name is None or unknown is None or state.stopped:
        return None
    problem, others = task.problem, tuple(n for n in state.added if n != name)
    estimator = Estimator(
        lambda structure, theta: shooting.fit(problem, structure, replace(state.fit.point, theta=theta), REFIT_STEPS),
        lambda f: f.deviance - f.structure.surprise(f.theta),
        lambda f, shown: errors.step_of(problem, f, sigma, (*others, *shown)),
        problem.samples,
    )
    return propose_laws(estimator, state.fit, name, dict(state.freedom)[name], unknown.at, task.tell)


def laws_from_end_to_end(search: Search, chosen: Trial, unknown: Unknown | None, step: Callable[[Fit, tuple[str, ...]], Step]) -> Laws | None:
    """Laws for the force of any shape of a fit from end to end; None where there is none, or it leaves so much that its table says little."""
    name = next((n for n in chosen.names if n.startswith("stand_in")), None)
    if name is None or unknown is None or not unknown.at.size or chosen.fit.rough:
        return None
    problem, f = search.problem, chosen.fit
    estimator = Estimator(
        lambda structure, theta: fit(problem, structure, f.states, theta, settle=True), lambda f: f.chi2, step, f.samples,
    )  # fmt: skip
    return propose_laws(estimator, f, name, chosen.freedom.get(name, 0.0), unknown.at, search.tell)
