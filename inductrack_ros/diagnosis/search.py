"""Which set of effects: full refits in simulation, best first, until what is left is noise.

At each size the best few sets are grown by every candidate (a quick refit that keeps the initial states' derivatives, then a full one for
the best), so that two effects are found even where the best single one is neither of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.fit import Fit, chi_square, fit, fit_from_scratch, growing
from ..estimation.problem import Linearisation, Problem
from ..estimation.structure import Structure
from ..workers import Cluster, Threads
from .candidates import Candidate, Screened, switch_columns, visible
from .gate import Gate, Projector
from .look import Look

#: Candidates that get one step of a refit at first and later, several, and a refit to convergence; sets kept at each size.
QUICK_FIRST, QUICK_LATER, SEVERAL, FULL, BEAM = 24, 12, 8, 4, 2
#: A refit that leaves so many times the noise's χ² may only be stuck: it is done over growing horizons too.
ROUGH = 1.5
#: What a candidate must promise beyond the best to be worth another try.
MARGIN = 6.6
#: A refit over a short horizon that another beats by so much in χ² is not the one sought.
BEATEN = 25.0
#: Entries of a table that the data tell less than this part of the best known one about are not seen.
SEEN = 1e-3
#: Growing horizons are never closer than this (s).
LEAST = 0.06
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
    def stands_in(self) -> bool:
        """Whether a force of any shape is among its effects."""
        return any(n.startswith("stand_in") for n in self.names)

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
        self.looks: dict[frozenset[str], tuple[Trial, Look]] = {}
        self.nears: dict[frozenset[str], tuple[Trial, Look]] = {}
        self.grown: set[frozenset[str]] = set()

    def __reduce__(self):
        return Search, (self.problem, self.base)  # all that a refit elsewhere needs

    def look(self, trial: Trial) -> Look:
        """What a trial leaves."""
        key = frozenset(trial.names)
        if key not in self.looks or self.looks[key][0] is not trial:
            self.looks[key] = trial, Look.at(self.problem, trial.fit)
        return self.looks[key][1]

    def near(self, trial: Trial) -> Look:
        """What a trial leaves over the shortest of the growing horizons where that is far more than noise.

        There the runs have not yet been thrown off what they would do with the missing effect, and first order still holds.
        """
        key = frozenset(trial.names)
        if key not in self.nears or self.nears[key][0] is not trial:
            self.nears[key] = trial, self._near(trial)
        return self.nears[key][1]

    def _near(self, trial: Trial) -> Look:
        f, states, theta = trial.fit, None, trial.fit.theta
        for horizon in growing(self.problem)[:-1] if self.is_rough(f) else ():
            part = self.problem.within(horizon)
            over = fit(part, f.structure, states, theta, 8, tolerance=1.0, settle=True)
            if np.isfinite(over.chi2) and self.is_rough(over):
                return Look.at(part, over)
            states, theta = over.states, over.theta
        return self.look(trial)

    def screened(self, trial: Trial) -> list[Screened]:
        """Candidates' standing at a trial's fit."""
        return self.look(trial).screened

    def gate(self, trial: Trial) -> Gate:
        """Whether a trial leaves nothing but noise."""
        return self.look(trial).gate

    def grow(self, trial: Trial, limit: int) -> list[Trial]:
        """The trial with one more effect, for the ``limit`` most promising candidates; best first, the best of them refitted.

        The field narrows: one step for all, a few more for `SEVERAL`, convergence for `FULL`. Those that could still
        win, by what they promise to first order, but whose refit is stuck far from it, start from scratch.
        """
        screened = self.screened(trial)[:limit]
        field: list[Trial] = []
        if not trial.fit.hopeless:
            field = [t for t in self.map(lambda s: self._first_step(trial, s), screened) if t]
            field.sort(key=lambda t: t.chi2)
            field[:SEVERAL] = sorted(self.map(lambda t: self._further(t, 2), field[:SEVERAL]), key=lambda t: t.chi2)
            field[:FULL] = sorted(self.map(lambda t: self._further(t, 10), field[:FULL]), key=lambda t: t.chi2)
        field += self._from_scratch(trial, self._stuck(trial, screened, field))
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
        for screened, size in self._alike(trial, name):
            known = self.trials.get(key | {screened.candidate.name})
            if known is None or known.chi2 > trial.chi2 + MARGIN:
                for t in self._from_scratch(parent, [screened.candidate]):
                    self.keep(t)
                self._exchange(trial, name, screened, size)
        found = [t for k, t in self.trials.items() if k > key and len(k) == len(key) + 1 and name not in k and not t.stands_in]
        return sorted(found, key=lambda t: t.chi2)

    def _alike(self, trial: Trial, name: str) -> list[tuple[Screened, np.ndarray]]:
        """Candidates that would do to the measurements what one effect of a trial does, and the size (p,) at which they would."""
        f = trial.fit
        mine = [k for k, full in enumerate(f.structure.free) if full.rpartition(".")[0] == name]
        project = Projector(self.problem, f, leave=mine)
        if mine:
            parts = [part.by_theta[:, mine] for part in f.linear]
            nothing = self.base.structure.plus(name).start[-len(mine) :]
            made = [part @ (f.theta[mine] - nothing)[:, None] for part in parts]
        else:
            made = parts = switch_columns(self.problem, f, self.look(trial).responses, name)
        own = visible(project, parts)
        own /= np.linalg.norm(own, axis=0)
        wanted = project(project.stack(made))[:, 0]
        found = []
        for s in self.screened(trial):
            other = visible(project, s.columns)
            cosines = own.T @ (other / np.linalg.norm(other, axis=0))
            if cosines.size and np.linalg.norm(cosines, 2) > ALIKE:
                found.append((s, np.linalg.lstsq(project(project.stack(s.columns)), wanted, rcond=1e-6)[0]))
        return found

    def _exchange(self, trial: Trial, name: str, screened: Screened, size: np.ndarray) -> None:
        """Try a candidate in the place of a trial's effect from where the trial stands, for a start from scratch may end elsewhere."""
        f, candidate = trial.fit, screened.candidate
        rest = f.structure.minus(name)
        structure = rest.plus(candidate.name)
        theta = structure.start.copy()
        theta[: len(rest.free)] = [x for x, full in zip(f.theta, f.structure.free, strict=True) if full in rest.free]
        if candidate.parameters == len(size):  # not a wave's, whose columns are sines and cosines
            theta[len(rest.free) :] += size
        new = fit(self.problem, structure, f.states, theta, settle=True)
        if np.isfinite(new.chi2):
            self.keep(Trial(new, (*(n for n in trial.names if n != name), candidate.name), True, trial.occam))

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

    def _stuck(self, trial: Trial, screened: Sequence[Screened], field: Sequence[Trial]) -> list[Candidate]:
        """Candidates to be started from scratch: where nothing comes near the noise those that promise most, of the beginnings
        of the runs too, else those held far from their promise."""
        reached = {t.names[-1]: t.chi2 for t in reversed(field)}
        best = min(reached.values(), default=np.inf)
        if best < ROUGH * trial.fit.samples:
            held = (s for s in screened if trial.chi2 - s.promise < best - MARGIN and reached.get(s.candidate.name, np.inf) > trial.chi2 - 0.5 * s.promise)
            return [s.candidate for s in held]
        near = self.near(trial)
        left = near.fit.chi2 - max((s.promise for s in near.screened), default=0.0)
        most = len(screened) if left < ROUGH * near.fit.samples else SEVERAL  # not any of them alone, then
        found: dict[str, Candidate] = {}
        for s in [s for pair in zip(near.screened, screened, strict=False) for s in pair][:most]:
            name, known = s.candidate.name, found.get(s.candidate.name)
            found[name] = replace(known, starts=(*known.starts, *(x for x in s.candidate.starts if x not in known.starts))) if known else s.candidate
        return list(found.values())

    def is_rough(self, fit: Fit) -> bool:
        """Whether a fit leaves far more than noise."""
        return not fit.chi2 < ROUGH * fit.samples

    def _from_scratch(self, trial: Trial, candidates: Sequence[Candidate]) -> list[Trial]:
        """The trial with one more effect, fitted over growing horizons from each start; best first."""
        starts = [(c.name, *trial.fit.widened(c.name, start), trial.occam, c.name) for c in candidates for start in c.starts]
        return self.race(trial, starts)

    def race(self, trial: Trial, starts: Sequence[tuple[str, Structure, np.ndarray, float, str]]) -> list[Trial]:
        """The trial with one more effect, fitted over growing horizons from ``starts`` (name, structure,
        theta, occam, label); best first.

        Over each horizon those drop out that others beat there by more than chance could; over all the field narrows as in `grow`.
        """
        problem = self.problem if len(starts) == 1 else self.single
        field: list[Trial] = []

        def start(part: Problem, name: str, structure: Structure, theta: np.ndarray, occam: float, label: str) -> Trial:
            self.tell(f"{' + '.join([*trial.names, label])} from scratch")
            return Trial(fit(part, structure, None, theta, 8, tolerance=1.0, settle=True), (*trial.names, name), False, occam)

        def over(t: Trial, part: Problem, iterations: int, tolerance: float = 0.02, settle: bool = False) -> Trial:
            theta = _continued(part, t.fit) if t.stands_in else t.fit.theta
            return replace(t, fit=fit(part, t.fit.structure, t.fit.states, theta, iterations, tolerance, settle=settle))

        def ranked(trials: Sequence[Trial]) -> list[Trial]:
            return sorted((t for t in trials if np.isfinite(t.chi2)), key=lambda t: t.chi2 + t.occam)

        def apart(field: Sequence[Trial]) -> list[Trial]:
            """Without those far from the noise where one is near it, and only the first where none is."""
            near = [t for t in field if not self.is_rough(t.fit)]
            return near or list(field[:FULL])

        reached, horizons = 0.0, growing(problem)
        while horizons:
            part = problem.within(horizons[0])
            again = lambda t, part=part: over(t, part, 8, 1.0, True)  # noqa: E731
            new = ranked(self.map(again, field) if reached else self.map(lambda s, part=part: start(part, *s), starts))
            if new and self.is_rough(new[0].fit):
                if len(field) in range(1, FULL + 1) and horizons[0] - reached > LEAST:  # too far at once
                    horizons.insert(0, 0.5 * (reached + horizons[0]))
                    continue
                new = ranked(self.map(again, new[:FULL]))
            field = new
            if not field or self.is_rough(field[0].fit):  # none of them alone: longer horizons would only tell the same
                break
            field = [t for i, t in enumerate(apart(field)) if i < SEVERAL or t.chi2 + t.occam < field[0].chi2 + field[0].occam + BEATEN]
            reached = horizons.pop(0)
        field = ranked({(t.names, t.fit.model.effects[t.names[-1]].get("variable")): t for t in reversed(field)}.values())[:SEVERAL]
        alone = bool(field) and not self.is_rough(field[0].fit)
        for count, iterations in ((SEVERAL, 4), (FULL, 10), (BEAM, 30)) if alone else ((FULL, 4), (BEAM, 10)):
            field = apart(field)
            field[:count] = ranked(self.map(lambda t, most=iterations: over(t, problem, most), field[:count]))
        return [replace(t, full=k < BEAM) for k, t in enumerate(field)]

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


def _continued(problem: Problem, f: Fit) -> np.ndarray:
    """Theta to go on from over a longer horizon: the tables as they are or constant beyond what the data have seen, whichever predicts better."""
    theta = f.theta.copy()
    for columns in f.structure.tables.values():
        told = sum(np.nansum(part.by_theta[:, columns] ** 2, axis=0) for part in f.linear)
        seen = np.flatnonzero(told > SEEN * told.max())
        if seen.size:
            nearest = seen[np.abs(np.arange(len(columns))[:, None] - seen).argmin(axis=1)]
            theta[columns] = f.theta[columns][nearest]
    return min(f.theta, theta, key=lambda t: chi_square(problem.residuals(f.structure, t, f.states)))


def _beside(linear: Sequence[Linearisation], columns: Sequence[np.ndarray]) -> list[Linearisation]:
    """A fit's linearisation with a candidate's columns beside its own."""
    return [replace(part, by_theta=np.hstack([part.by_theta, c])) for part, c in zip(linear, columns, strict=True)]
