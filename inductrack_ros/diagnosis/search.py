"""Which set of effects: full refits in simulation, best first, until what is left is noise.

At each size the best few sets are grown by every candidate (a quick refit that keeps the initial states' derivatives, then a full one for
the best), so that two effects are found even where the best single one is neither of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.fit import Fit, approach, fit, fit_from_scratch
from ..estimation.problem import Linearisation, Problem
from ..workers import Cluster, Threads
from .candidates import Candidate, Screened, effect_columns, screen, switch_columns, visible
from .gate import Gate, Projector, check
from .signatures import responses

#: Candidates that get one step of a refit at first and later, several, and a refit to convergence; sets kept at each size.
QUICK_FIRST, QUICK_LATER, SEVERAL, FULL, BEAM = 24, 12, 8, 4, 2
#: A refit that leaves so many times the noise's χ² may only be stuck: it is done over growing horizons too.
ROUGH = 1.5
#: What a candidate must promise beyond the best to be worth another try.
MARGIN = 6.6
#: Effects whose signatures, the nuisance projected out, are as parallel as this are tried in each other's place.
ALIKE = 0.95


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
    """Refits over one campaign, each set of effects once; candidates are spread over ``workers``."""

    def __init__(self, problem: Problem, base: Fit, tell: Callable[[str], None] = lambda _: None, workers: Threads | Cluster | None = None):
        self.problem, self.base, self.tell = problem, base, tell
        self.workers = workers or Threads(problem.threads)
        self.single = problem.subset(range(len(problem.runs)))
        self.single.threads = 1  # candidates are spread over the threads instead of runs
        self.trials: dict[frozenset[str], Trial] = {frozenset(base.structure.effects): Trial(base, base.structure.effects, True)}
        self.screens: dict[frozenset[str], list[Screened]] = {}
        self.gates: dict[frozenset[str], Gate] = {}
        self.looked: dict[frozenset[str], Trial] = {}
        self.grown: set[frozenset[str]] = set()

    def __reduce__(self):
        return Search, (self.problem, self.base)  # all that a refit elsewhere needs

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
        """The trial with one more effect, for the ``limit`` most promising candidates; best first, the best of them refitted.

        The field narrows: one step for all, a few more for `SEVERAL`, convergence for `FULL`. Those that could still
        win, by what they promise to first order, but whose refit is stuck far from it, start from scratch.
        """
        screened = self.screened(trial)[:limit]
        field = [t for t in self.map(lambda s: self._first_step(trial, s), screened) if t]
        field.sort(key=lambda t: t.chi2)
        field[:SEVERAL] = sorted(self.map(lambda t: self._further(t, 2), field[:SEVERAL]), key=lambda t: t.chi2)
        field[:FULL] = sorted(self.map(lambda t: self._further(t, 10), field[:FULL]), key=lambda t: t.chi2)
        field += self._from_scratch(trial, [s.candidate for s in self._stuck(trial, screened, field)])
        field.sort(key=lambda t: t.chi2)
        for t in field:
            self.keep(t)
        field = [t for t in field if self.trials[frozenset(t.names)] is t]
        self.grown.add(frozenset(trial.names))
        return field

    def rivals(self, trial: Trial, name: str) -> list[Trial]:
        """Trials with another effect in the place of one of a trial's, best first."""
        parent = self.without(trial, name)
        key = frozenset(parent.names)
        if key not in self.grown:
            self.grow(parent, QUICK_LATER)
        found = [t for k, t in self.trials.items() if k > key and len(k) == len(key) + 1 and name not in k]
        for candidate in self._alike(trial, name):
            if not any(candidate.name in t.names and t.chi2 < trial.chi2 + MARGIN for t in found):
                for t in self._from_scratch(parent, [candidate]):
                    self.keep(t)
                    found.append(t)
        return sorted(found, key=lambda t: t.chi2)

    def _alike(self, trial: Trial, name: str) -> list[Candidate]:
        """Candidates that would do to the measurements what one effect of a trial does."""
        f = trial.fit
        mine = [k for k, full in enumerate(f.structure.free) if full.rpartition(".")[0] == name]
        project = Projector(self.problem, f, leave=mine)
        parts = [part.by_theta[:, mine] for part in f.linear] if mine else switch_columns(self.problem, f, responses(self.problem, f), name)
        own = visible(project, parts)
        own /= np.linalg.norm(own, axis=0)
        found = []
        for s in self.screened(trial):
            other = visible(project, s.columns)
            cosines = own.T @ (other / np.linalg.norm(other, axis=0))
            if cosines.size and np.linalg.norm(cosines, 2) > ALIKE:
                found.append(s.candidate)
        return found

    def map(self, task: Callable, items: Sequence) -> list:
        """``task`` of every item, over the workers."""
        return self.workers.map(task, items)

    def keep(self, trial: Trial) -> None:
        """Remember a trial, the better of two with the same effects."""
        key = frozenset(trial.names)
        old = self.trials.get(key)
        if old is None or (trial.full, -trial.chi2) > (old.full, -old.chi2):
            self.trials[key] = trial

    def _first_step(self, trial: Trial, screened: Screened) -> Trial | None:
        """One step of a refit from each of the candidate's starts; the best."""
        candidate = screened.candidate
        self.tell(" + ".join([*trial.names, candidate.name]))
        best: Fit | None = None
        for start in candidate.starts:
            structure, theta = trial.fit.widened(candidate.name, start)
            known = None if start or not candidate.parameters else _beside(trial.fit.linear, screened.columns)
            new = fit(self.single, structure, trial.fit.states, theta, 1, tolerance=0.5, reuse=trial.fit.linear, linear=known)
            if best is None or new.chi2 < best.chi2:
                best = new
        return Trial(best, (*trial.names, candidate.name), False, trial.occam) if best is not None and np.isfinite(best.chi2) else None

    def _stuck(self, trial: Trial, screened: Sequence[Screened], field: Sequence[Trial]) -> list[Screened]:
        """Candidates to be started from scratch: all where nothing comes near the noise, else those held far from their promise."""
        reached = {t.names[-1]: t.chi2 for t in reversed(field)}
        best = min(reached.values(), default=np.inf)
        if not best < ROUGH * trial.fit.samples:
            return list(screened)
        return [s for s in screened if trial.chi2 - s.promise < best - MARGIN and reached.get(s.candidate.name, np.inf) > trial.chi2 - 0.5 * s.promise]

    def is_rough(self, fit: Fit) -> bool:
        """Whether a fit leaves far more than noise."""
        return not fit.chi2 < ROUGH * fit.samples

    def _from_scratch(self, trial: Trial, candidates: Sequence[Candidate]) -> list[Trial]:
        """The trial with one more effect, fitted over growing horizons from each start; the `SEVERAL` best there over all, best first."""

        def starts(candidate: Candidate) -> list[Fit]:
            self.tell(" + ".join([*trial.names, candidate.name]) + " from scratch")
            found = []
            for start in candidate.starts:
                found += [near for near in [approach(self.single, *trial.fit.widened(candidate.name, start))] if near]
            return sorted(found, key=lambda f: f.chi2)[:1]

        near = [(fits[0], c.name) for fits, c in zip(self.map(starts, candidates), candidates, strict=True) if fits]
        near.sort(key=lambda found: found[0].chi2)
        whole = self.map(lambda found: fit(self.single, found[0].structure, found[0].states, found[0].theta), near[:SEVERAL])
        trials = [Trial(f, (*trial.names, name), True, trial.occam) for f, (_, name) in zip(whole, near, strict=False) if np.isfinite(f.chi2)]
        return sorted(trials, key=lambda t: t.chi2)

    def _settled(self, f: Fit) -> Fit:
        """A refit of all runs to convergence with all derivatives fresh, from where a fit stands or, where that is stuck, from scratch."""
        new = fit(self.problem, f.structure, f.states, f.theta, iterations=15)
        if self.is_rough(new):
            new = min(new, fit_from_scratch(self.problem, f.structure, f.theta), key=lambda f: f.chi2)
        return new

    def _further(self, trial: Trial, iterations: int) -> Trial:
        """More steps of a quick refit."""
        f = trial.fit
        new = fit(self.single, f.structure, f.states, f.theta, iterations, tolerance=0.1, reuse=f.linear)
        return Trial(new, trial.names, False, trial.occam)

    def finish(self, trial: Trial) -> Trial:
        """A trial refitted to convergence with all derivatives fresh."""
        if trial.full:
            return trial
        done = Trial(self._settled(trial.fit), trial.names, True, trial.occam)
        self.keep(done)
        return self.trials[frozenset(trial.names)]

    def without(self, trial: Trial, name: str) -> Trial:
        """The trial refitted with one effect taken out."""
        names = tuple(n for n in trial.names if n != name)
        key = frozenset(names)
        if key in self.trials and self.trials[key].full:
            return self.trials[key]
        structure = trial.fit.structure.minus(name)
        keep = [trial.fit.structure.free.index(f) for f in structure.free]
        before, after = (sum(n.startswith("stand_in") for n in some) for some in (trial.names, names))
        occam = trial.occam * after / before if before else 0.0
        new = Trial(self._settled(replace(trial.fit, structure=structure, theta=trial.fit.theta[keep])), names, True, occam)
        self.keep(new)
        return self.trials[key]

    def part(self, trial: Trial, names: Sequence[str]) -> Trial:
        """The trial with only these of its effects, fitted."""
        for name in trial.names:
            if name not in names:
                trial = self.without(trial, name)
        return trial


def _beside(linear: Sequence[Linearisation], columns: Sequence[np.ndarray]) -> list[Linearisation]:
    """A fit's linearisation with a candidate's columns beside its own."""
    return [replace(part, by_theta=np.hstack([part.by_theta, c])) for part, c in zip(linear, columns, strict=True)]
