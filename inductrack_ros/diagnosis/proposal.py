"""An answer proposed by multiple shooting, for the deterministic search to judge before it looks any further.

Every run being held to its data, the search of `strategy` is not thrown off by what the model lacks, and takes seconds where
refits of whole runs take minutes. What it proposes is refitted deterministically from where it stands and passes the same gate.
"""

from __future__ import annotations

from ..estimation import shooting
from ..estimation.fit import fit
from . import strategy
from .race import Trial
from .search import Search
from .unknown import penalised


def propose(search: Search, root: Trial) -> Trial | None:
    """The proposed answer as a trial, or None where nothing is proposed; its rivals are kept in ``search`` as well."""
    problem = search.problem
    base = shooting.fit(problem, root.fit.structure)
    if not base.converged:  # impacts that steps do not get past: what they leave would look like a cause
        return None
    search.tell("what is missing, every run held to its data")
    found = strategy.search(problem, base, search.tell)
    if not found.added:
        return None
    trials = [_trial(search, root, found)]
    search.keep(trials[0])
    for name in [n for n in found.added if not trials[0].stands_in]:
        search.tell(f"what could stand in the place of {name}")
        trials += [_trial(search, root, rival) for rival in strategy.rivals(problem, found, name)]
        search.grown.add(frozenset(trials[0].names) - {name})
    for trial in trials[1:]:
        search.keep(trial)
    return min(trials, key=lambda t: penalised(search, t))


def _trial(search: Search, root: Trial, state: strategy.State) -> Trial:
    """A state refitted deterministically from where it stands."""
    refitted = fit(search.problem, state.fit.structure, state.fit.states, state.fit.theta, settle=True)
    return Trial(refitted, (*root.names, *state.added), True, dict(state.freedom))
