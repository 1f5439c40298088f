"""Which set of effects: full refits in simulation, best first, until what is left is noise.

At each size the best few sets are grown by every candidate (a quick refit that keeps the initial states' derivatives, then a full one for
the best), so that two effects are found even where the best single one is neither of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ..estimation.fit import Fit, fit
from ..estimation.problem import Problem
from .candidates import Candidate, Screened, effect_columns, screen
from .gate import Gate, Projector, check
from .signatures import responses

#: Candidates that get a quick refit at the first step and later, and of those a full one; sets kept at each size.
QUICK_FIRST, QUICK_LATER, FULL, BEAM = 24, 12, 4, 2


@dataclass(frozen=True)
class Trial:
    """A set of effects, fitted: what it costs in χ² and in parameters."""

    fit: Fit
    names: tuple[str, ...]
    full: bool
    occam: float = 0.0  # what its stand-ins' freedom costs

    @property
    def chi2(self) -> float:
        """χ² of all samples."""
        return self.fit.chi2


class Search:
    """Refits over one campaign, each set of effects once."""

    def __init__(self, problem: Problem, base: Fit, tell: Callable[[str], None] = lambda _: None):
        self.problem, self.base, self.tell = problem, base, tell
        self.single = problem.subset(range(len(problem.runs)))
        self.single.threads = 1  # candidates are spread over the threads instead of runs
        self.trials: dict[frozenset[str], Trial] = {frozenset(base.structure.effects): Trial(base, base.structure.effects, True)}
        self.screens: dict[frozenset[str], list[Screened]] = {}
        self.gates: dict[frozenset[str], Gate] = {}
        self.looked: dict[frozenset[str], Trial] = {}

    def screened(self, trial: Trial) -> list[Screened]:
        """Candidates' standing at a trial's fit."""
        self._look(trial)
        return self.screens[frozenset(trial.names)]

    def gate(self, trial: Trial) -> Gate:
        """Whether a trial leaves nothing but noise."""
        self._look(trial)
        return self.gates[frozenset(trial.names)]

    def _look(self, trial: Trial) -> None:
        """Screen and gate of a trial, which share the linearisation."""
        key = frozenset(trial.names)
        if self.looked.get(key) is not trial:
            runs, project = responses(self.problem, trial.fit), Projector(self.problem, trial.fit)
            self.screens[key] = screen(self.problem, trial.fit, runs, project)
            self.gates[key] = check(self.problem, trial.fit, runs, project, effect_columns(self.screens[key]))
            self.looked[key] = trial

    def grow(self, trial: Trial, limit: int) -> list[Trial]:
        """The trial with one more effect, for the ``limit`` most promising candidates; best first, the best of them fully refitted."""
        standing = self.screened(trial)[:limit]
        quick = self.map(lambda s: self._refit(trial, s.candidate, quick=True), standing)
        best = sorted((t for t in quick if t), key=lambda t: t.chi2)
        full = self.map(self.finish, best[:FULL])
        for t in [*best[FULL:], *full]:
            self._keep(t)
        return sorted([*full, *best[FULL:]], key=lambda t: t.chi2)

    def map(self, task: Callable, items: Sequence) -> list:
        """``task`` of every item, over the threads."""
        with ThreadPoolExecutor(self.problem.threads) as pool:
            return list(pool.map(task, items))

    def _keep(self, trial: Trial) -> None:
        key = frozenset(trial.names)
        old = self.trials.get(key)
        if old is None or trial.chi2 < old.chi2:
            self.trials[key] = trial

    def _refit(self, trial: Trial, candidate: Candidate, quick: bool) -> Trial | None:
        """The best refit over the candidate's starts."""
        self.tell(" + ".join([*trial.names, candidate.name]))
        best: Fit | None = None
        for start in candidate.starts:
            structure = trial.fit.structure.plus(candidate.name, start)
            theta = structure.start.copy()
            theta[: len(trial.fit.theta)] = trial.fit.theta
            reuse = trial.fit.linear if quick else None
            new = fit(self.single, structure, trial.fit.states, theta, iterations=3, tolerance=1.0, reuse=reuse)
            if best is None or new.chi2 < best.chi2:
                best = new
        return Trial(best, (*trial.names, candidate.name), False, trial.occam) if best is not None and np.isfinite(best.chi2) else None

    def finish(self, trial: Trial) -> Trial:
        """A quick trial refitted to convergence."""
        f = trial.fit
        done = Trial(fit(self.single, f.structure, f.states, f.theta, iterations=15), trial.names, True, trial.occam)
        self._keep(done)
        return done

    def without(self, trial: Trial, name: str) -> Trial:
        """The trial refitted with one effect taken out."""
        names = tuple(n for n in trial.names if n != name)
        key = frozenset(names)
        if key in self.trials and self.trials[key].full:
            return self.trials[key]
        structure = trial.fit.structure.minus(name)
        keep = [trial.fit.structure.free.index(f) for f in structure.free]
        new = Trial(fit(self.problem, structure, trial.fit.states, trial.fit.theta[keep], iterations=15), names, True)
        self._keep(new)
        return self.trials[key]
