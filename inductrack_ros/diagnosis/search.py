"""Which set of effects: full refits in simulation, best first, until what is left is noise.

At each size the best few sets are grown by every candidate (a quick refit that keeps the initial states' derivatives, then a full one for
the best), so that two effects are found even where the best single one is neither of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ..estimation.anew import each_run_anew
from ..estimation.fit import ROUGH, Fit, fit, fit_from_scratch, growing, rough_fit
from ..estimation.problem import Linearisation, Problem
from ..estimation.structure import Structure
from ..workers import Cluster, Threads
from .candidates import WAVES, Candidate, Screened, first_order, names, switch_columns, visible
from .gate import Gate, Projector
from .look import Look
from .race import SEVERAL, Start, Trial, race

#: Candidates in a later effect's place that get one step of a refit; those refitted to convergence.
QUICK_LATER, FULL = 12, 4
#: What a candidate must promise beyond the best to be worth another try.
MARGIN = 6.6
#: Effects that, the nuisance projected out, do to the measurements what another does, as parallel as this, are tried in its place.
ALIKE = 0.95
#: So many of the pairs, and of the triples, that come nearest to an effect are tried in its place.
NEAREST = 6
#: What is left of an effect at each step while another takes its place.
SHARES = (0.9, 0.7, 0.3, 0.0)


class Search:
    """Refits over one campaign, each set of effects once; candidates are spread over ``workers``."""

    def __init__(self, problem: Problem, base: Fit, tell: Callable[[str], None] = lambda _: None, workers: Threads | Cluster | None = None):
        self.problem, self.base, self.tell = problem, base, tell
        self.workers = workers or Threads(problem.threads)
        self.single = problem.subset(range(len(problem.runs)))
        self.single.threads = 1  # candidates are spread over the threads instead of runs
        self.trials: dict[frozenset[str], Trial] = {frozenset(base.structure.effects): Trial(base, base.structure.effects, True)}
        self.looks: dict[tuple, tuple[Trial, Look]] = {}
        self.beginnings: dict[tuple, tuple[Trial, list[Look]]] = {}
        self.sought: dict[tuple, tuple[Trial, None]] = {}
        self.reduced: dict[tuple, tuple[Trial, None]] = {}
        self.anew: dict[tuple, tuple[Trial, Fit]] = {}
        self.ended: dict[tuple, tuple[Trial, Fit]] = {}
        self.grown: set[frozenset[str]] = set()

    def __reduce__(self):
        return Search, (self.problem, self.base)  # all that a refit elsewhere needs

    def under(self, problem: Problem, base: Fit) -> Search:
        """The search under a problem that differs by its noise levels: what is known is weighted anew, and fitted anew where it is asked for."""
        other = Search(problem, base, self.tell, self.workers)
        weighted = {key: replace(t, fit=t.fit.weighted(problem, self.problem.sigma), full=False) for key, t in self.trials.items()}
        other.trials, other.grown = weighted | other.trials, set(self.grown)
        return other

    def look(self, trial: Trial) -> Look:
        """What a trial leaves."""
        return self._once(self.looks, trial, lambda: Look.at(self.problem, trial.fit))

    def near(self, trial: Trial) -> list[Look]:
        """What a trial that leaves far more than noise leaves over the beginnings of the runs, the most telling first.

        The longest over which it leaves a little more than noise, for there the runs have not yet been thrown off what they would do
        with the missing effect and first order holds, and the next, over which it leaves far more.
        """
        return self._once(self.beginnings, trial, lambda: self._near(trial))

    def reach(self, trial: Trial) -> float:
        """How far into the runs (s) a trial gets before it leaves far more than noise."""
        return self.near(trial)[-1].problem.length

    def _once(self, known: dict, trial: Trial, make: Callable, *of: str):
        key = (frozenset(trial.names), *of)
        if key not in known or known[key][0] is not trial:
            known[key] = trial, make()
        return known[key][1]

    def _near(self, trial: Trial) -> list[Look]:
        f, states, theta, looks = trial.fit, None, trial.fit.theta, []
        smooth = None
        for horizon in growing(self.problem)[:-1] if f.rough else ():
            part = self.problem.within(horizon)
            over = rough_fit(part, f.structure, states, theta)
            if over.rough:  # far off, perhaps, what whole runs made of it
                over = min(over, rough_fit(part, f.structure), key=lambda o: o.chi2)
            if over.rough:
                looks = [Look.at(part, over)] if np.isfinite(over.chi2) else []
                break
            smooth, states, theta = (part, over), over.states, over.theta
        if smooth and not (look := Look.at(*smooth)).gate.adequate:
            looks.insert(0, look)
        return looks or [self.look(trial)]

    def screened(self, trial: Trial) -> list[Screened]:
        """Candidates' standing at a trial's fit."""
        return self.look(trial).screened

    def gate(self, trial: Trial) -> Gate:
        """Whether a trial leaves nothing but noise."""
        return self.look(trial).gate

    def judged(self, trial: Trial) -> tuple[Trial, Gate]:
        """A trial and whether it leaves nothing but noise; one that leaves little more has each run's initial state sought anew first."""
        trial = self.converged(trial)
        if trial.fit.rough or self.gate(trial).adequate:
            return trial, self.gate(trial)
        trial = self._once_refitted(self.anew, trial, lambda: each_run_anew(self.problem, trial.fit))
        return trial, self.gate(trial)

    def converged(self, trial: Trial) -> Trial:
        """A trial that may be an answer, fitted on if it only ran out of steps: in curved valleys they are short, and its intervals are wrong there."""
        if trial.fit.converged or trial.stands_in or not trial.fit.leaves_noise:
            return trial
        f = trial.fit
        return self._once_refitted(self.ended, trial, lambda: fit(self.problem, f.structure, f.states, f.theta, settle=True))

    def _once_refitted(self, known: dict, trial: Trial, refit: Callable[[], Fit]) -> Trial:
        """A trial with another fit in place of its own, made once for both."""
        new = self._once(known, trial, refit)
        if new is trial.fit:
            return trial
        refitted = replace(trial, fit=new, full=True)
        self.keep(refitted)
        self._once(known, refitted, lambda: new)
        return refitted

    def grow(self, trial: Trial, limit: int, against: Trial | None = None) -> list[Trial]:
        """The trial with one more effect, for the ``limit`` most promising candidates; best first, the best of them refitted.

        Only what comes near a trial that is known already is wanted where there is one ``against`` them.
        Those that could still win, by what they promise to first order, but whose refit is stuck far from it, start from scratch.
        """
        screened = self.screened(trial)[:limit]
        field = [] if trial.fit.hopeless else self._from_there(trial, screened)
        field += self._from_scratch(trial, self._stuck(trial, screened, field), against)
        if trial.fit.hopeless and all(t.fit.rough for t in field) and not (against and not against.fit.rough):
            field += self._from_there(trial, screened)  # a wrong model, perhaps, more than runs that were thrown off
        field.sort(key=lambda t: t.chi2)
        for t in field:
            self.keep(t)
        field = [t for t in field if self.trials[frozenset(t.names)] is t]
        self.grown.add(frozenset(trial.names))
        return field

    def _from_there(self, trial: Trial, screened: Sequence[Screened]) -> list[Trial]:
        """The trial with one more effect, refitted from where it stands: one step for all, a few more for `SEVERAL`, convergence for `FULL`."""
        field = [t for t in self.map(lambda s: self._first_step(trial, s), screened) if t]
        field.sort(key=lambda t: t.chi2)
        field[:SEVERAL] = sorted(self.map(lambda t: self._further(t, 2), field[:SEVERAL]), key=lambda t: t.chi2)
        field[:FULL] = sorted(self.map(lambda t: self._further(t, 10), field[:FULL]), key=lambda t: t.chi2)
        return field

    def rivals(self, trial: Trial, name: str) -> list[Trial]:
        """Trials with another effect in the place of one of a trial's, sought for; best first."""
        parent = self.without(trial, name)
        self._once(self.sought, trial, lambda: self._seek_rivals(trial, name, parent), name)
        return self.siblings(trial, name)

    def siblings(self, trial: Trial, name: str) -> list[Trial]:
        """Trials known with another effect, not a stand-in, in the place of one of a trial's; best first."""
        rest = frozenset(trial.names) - {name}
        found = ((k - rest, t) for k, t in self.trials.items() if k > rest and len(k) == len(rest) + 1 and name not in k)
        return sorted((t for (other,), t in found if not other.startswith("stand_in")), key=lambda t: t.chi2)

    def _seek_rivals(self, trial: Trial, name: str, parent: Trial) -> None:
        key = frozenset(parent.names)
        if key not in self.grown:
            self.grow(parent, QUICK_LATER, trial)

        def found(s: Screened) -> bool:
            return key | {s.candidate.name} in self.trials and self.trials[key | {s.candidate.name}].chi2 < trial.chi2 + MARGIN

        alike = [(s, size) for s, size in self._alike(trial, name) if not found(s)]
        for s, size in alike:
            self._exchange(trial, name, [s], size)
        left = [s.candidate for s, _ in alike if not found(s)]
        for t in self._from_scratch(parent, left, trial) if left else ():
            self.keep(t)

    def _alike(self, trial: Trial, name: str) -> list[tuple[Screened, np.ndarray]]:
        """Candidates that would do to the measurements what one effect of a trial does, and the size (p,) at which they would."""
        project, wanted, standing = self.beside(trial, name)
        return [
            (s, _size_of(project, [s], wanted))
            for s, columns in standing
            if self._act_alike(name, s.candidate.name) or np.linalg.norm(np.linalg.qr(columns)[0].T @ wanted) > ALIKE * np.linalg.norm(wanted)
        ]

    def _together_alike(self, trial: Trial, name: str, count: int) -> list[tuple[tuple[Screened, ...], np.ndarray]]:
        """Sets of ``count`` candidates that would together do what one effect of a trial does, and the size (p,) at which they would;
        the best `NEAREST`."""
        project, wanted, standing = self.beside(trial, name)
        seen = [(s, np.linalg.qr(columns)[0]) for s, columns in standing if columns.shape[1] and s.candidate.name != WAVES]
        edges = np.cumsum([0] + [q.shape[1] for _, q in seen])
        together = np.hstack([q for _, q in seen])
        gram, told = together.T @ together, together.T @ wanted / np.linalg.norm(wanted)
        shares = []
        for some in combinations(range(len(seen)), count):
            mine = np.concatenate([np.arange(edges[i], edges[i + 1]) for i in some])
            shares.append((told[mine] @ np.linalg.lstsq(gram[np.ix_(mine, mine)], told[mine], rcond=1e-9)[0], tuple(seen[i][0] for i in some)))
        best = sorted((s for s in shares if s[0] > ALIKE**2), key=lambda s: -s[0])[:NEAREST]
        return [(some, _size_of(project, some, wanted)) for _, some in best]

    def beside(self, trial: Trial, name: str) -> tuple[Projector, np.ndarray, list[tuple[Screened, np.ndarray]]]:
        """What one effect of a trial does to the measurements (N,), and what (N, p) each candidate would, the other nuisance projected out."""
        f = trial.fit
        mine = [k for k, full in enumerate(f.structure.free) if full.rpartition(".")[0] == name]
        project = Projector(self.problem, f, leave=mine)
        seen = self.screened(trial)
        hidden = set(names(self.problem, f.structure)) - {s.candidate.name for s in seen} - {WAVES}  # behind the effect itself, perhaps
        responses = self.look(trial).responses if hidden or not mine else []
        if mine:
            made = [part.by_theta @ (f.theta - f.weakened(name, 0.0))[:, None] for part in f.linear]
        else:
            made = switch_columns(self.problem, f, responses, name)
        wanted = project(project.stack(made))[:, 0]
        return project, wanted, [(s, visible(project, s.columns)) for s in [*seen, *first_order(self.problem, f, responses, sorted(hidden), project)]]

    def _act_alike(self, one: str, other: str) -> bool:
        """Whether two effects change the same quantity, as the thrust: after an impact first order may no longer see that they are one."""
        known = self.base.structure.model.known_effects
        first, second = (known[n.partition(":")[0]] for n in (one, other))
        return first.replaces and second.replaces and first.targets == second.targets and not first.of_channel

    def recognise(self, trial: Trial, name: str) -> list[Trial]:
        """Trials with a known effect that does the same to the measurements in the place of one of a trial's; best first."""
        for screened, size in self._alike(trial, name):
            self._exchange(trial, name, [screened], size)
        return self.siblings(trial, name)

    def recognise_together(self, trial: Trial, name: str, count: int) -> list[Trial]:
        """Trials with ``count`` known effects that together do the same to the measurements in the place of one of a trial's."""
        found = [self._exchange(trial, name, some, size) for some, size in self._together_alike(trial, name, count)]
        return [t for t in found if t]

    def _exchange(self, trial: Trial, name: str, others: Sequence[Screened], size: np.ndarray) -> Trial | None:
        """Try candidates in the place of a trial's effect from where the trial stands, for a start from scratch may end elsewhere.

        The effect is held at ever less of its size, the rest fitted beside it; each step sets out along the last. Where any of them
        is there or not, it is one step.
        """
        f = trial.fit
        rest, known = f.narrowed(name)

        def with_others(structure: Structure) -> Structure:
            for s in others:
                structure = structure.plus(s.candidate.name, {} if s.candidate.name == WAVES else s.candidate.starts[0])
            return structure

        states, theta, before = f.states, np.append(known, with_others(rest).start[len(known) :]), 1.0
        way, ways = np.zeros(len(theta)), [np.zeros(8)] * len(states)
        if sum(s.candidate.parameters for s in others) == len(size):  # not a wave's, whose columns are sines and cosines
            way[len(known) :] = size
        gradual = len(rest.free) < len(f.structure.free) and all(s.candidate.parameters for s in others)
        for share in SHARES if gradual else SHARES[-1:]:
            given = before - share
            structure = replace(rest, model=f.structure.with_theta(f.weakened(name, share))) if share else rest
            starts = [x + given * w for x, w in zip(states, ways, strict=True)]
            new = fit(self.problem, with_others(structure), starts, theta + given * way, iterations=5, settle=True)
            if new.rough and not f.rough:
                return None
            way, ways = (new.theta - theta) / given, [(x - old) / given for x, old in zip(new.states, states, strict=True)]
            states, theta, before = new.states, new.theta, share
        new = fit(self.problem, new.structure, states, theta, settle=True)
        if not np.isfinite(new.chi2):
            return None
        names = (*(n for n in trial.names if n != name), *(s.candidate.name for s in others))
        self.keep(Trial(new, names, True, {n: price for n, price in trial.freedom.items() if n != name}))
        return self.trials[frozenset(names)]

    def map(self, task: Callable, items: Sequence) -> list:
        """``task`` of every item, over the workers."""
        return self.workers.map(task, items)

    def keep(self, trial: Trial) -> None:
        """Remember a trial, the better of two with the same effects; of two that are as good the one that was refitted in full."""
        key = frozenset(trial.names)
        old = self.trials.get(key)
        if old is None or trial.cost < old.cost + MARGIN * (trial.full - old.full):
            self.trials[key] = trial

    def _first_step(self, trial: Trial, screened: Screened) -> Trial | None:
        """One step of a refit from each of the candidate's starts; the best."""
        candidate = screened.candidate
        self.tell(" + ".join([*trial.names, candidate.name]))
        best: Fit | None = None
        for start in candidate.starts:
            structure, theta = trial.fit.widened(candidate.name, start)
            known = None if start or not candidate.parameters else _widened(trial.fit.linear, screened.columns)
            new = fit(self.single, structure, trial.fit.states, theta, 1, tolerance=0.5, reuse=trial.fit.linear, linear=known)
            if best is None or new.chi2 < best.chi2:
                best = new
        return Trial(best, (*trial.names, candidate.name), False, trial.freedom) if best is not None and np.isfinite(best.chi2) else None

    def _stuck(self, trial: Trial, screened: Sequence[Screened], field: Sequence[Trial]) -> list[Candidate]:
        """Candidates to be started from scratch: where nothing comes near the noise those that promise most, of the beginnings
        of the runs too, else those held far from their promise."""
        reached = {t.names[-1]: t.chi2 for t in reversed(field)}
        best = min(reached.values(), default=np.inf)
        if best < ROUGH * trial.fit.samples:
            held = (s for s in screened if trial.chi2 - s.promise < best - MARGIN and reached.get(s.candidate.name, np.inf) > trial.chi2 - 0.5 * s.promise)
            return [s.candidate for s in held]
        near = self.near(trial)
        left = near[-1].fit.chi2 - max((s.promise for s in near[-1].screened), default=0.0)
        most = len(screened) if left < ROUGH * near[-1].fit.samples else SEVERAL  # not any of them alone, then
        found: dict[str, Candidate] = {}
        for s in [s for rank in zip(*(look.screened for look in near), screened, strict=False) for s in rank][: most * len(near)]:
            name, known = s.candidate.name, found.get(s.candidate.name)
            found[name] = replace(known, starts=(*known.starts, *(x for x in s.candidate.starts if x not in known.starts))) if known else s.candidate
        return list(found.values())

    def race(self, starts: Sequence[Start], against: Trial | None = None) -> list[Trial]:
        """Refits from scratch (`race.race`), spread over the workers."""
        return race(self.problem if len(starts) == 1 else self.single, starts, self.map, self.tell, against)

    def _from_scratch(self, trial: Trial, candidates: Sequence[Candidate], against: Trial | None = None) -> list[Trial]:
        """The trial with one more effect, fitted over growing horizons from each start; best first."""
        near = self.near(trial)[0].fit  # what whole runs made of the parameters may be far off

        def start(name: str, values: Mapping[str, float]) -> Start:
            names = (*trial.names, name)
            return Start(names, *near.widened(name, values), near.states, trial.freedom, " + ".join(names))

        return self.race([start(c.name, values) for c in candidates for values in c.starts], against)

    def _settled(self, f: Fit) -> Fit:
        """A refit of all runs to convergence with all derivatives fresh, from where a fit stands or, where that is stuck, from scratch."""
        new = fit(self.problem, f.structure, f.states, f.theta, iterations=15)
        if new.rough:
            new = min(new, fit_from_scratch(self.problem, f.structure, f.theta, thorough=False), key=lambda f: f.chi2)
        return new

    def _further(self, trial: Trial, iterations: int) -> Trial:
        """More steps of a quick refit."""
        f = trial.fit
        new = fit(self.single, f.structure, f.states, f.theta, iterations, tolerance=0.1, reuse=f.linear)
        return Trial(new, trial.names, False, trial.freedom)

    def finish(self, trial: Trial) -> Trial:
        """A trial refitted to convergence with all derivatives fresh."""
        if trial.full:
            return trial
        done = Trial(self._settled(trial.fit), trial.names, True, trial.freedom)
        self.keep(done)
        return self.trials[frozenset(trial.names)]

    def without(self, trial: Trial, name: str) -> Trial:
        """The trial refitted with one effect taken out."""
        key = frozenset(trial.names) - {name}
        if key not in self.trials or not self.trials[key].full or trial.stands_in:  # whose shape may be another by now
            self._once(self.reduced, trial, lambda: self._take_out(trial, name), name)
        return self.trials[key]

    def _take_out(self, trial: Trial, name: str) -> None:
        names = tuple(n for n in trial.names if n != name)
        structure, theta = trial.fit.narrowed(name)
        new = Trial(self._settled(replace(trial.fit, structure=structure, theta=theta)), names, True, {n: price for n, price in trial.freedom.items() if n != name})
        self.keep(new)

    def part(self, trial: Trial, names: Sequence[str]) -> Trial:
        """The trial with only these of its effects, fitted."""
        for name in trial.names:
            if name not in names:
                trial = self.without(trial, name)
        return trial


def _size_of(project: Projector, others: Sequence[Screened], wanted: np.ndarray) -> np.ndarray:
    """The size (p,) at which candidates come nearest to a vector (N,)."""
    columns = np.hstack([project(project.stack(s.columns)) for s in others])
    return np.linalg.lstsq(columns, wanted, rcond=1e-6)[0]


def _widened(linear: Sequence[Linearisation], columns: Sequence[np.ndarray]) -> list[Linearisation]:
    """A fit's linearisation with a candidate's columns beside its own."""
    return [replace(part, by_theta=np.hstack([part.by_theta, c])) for part, c in zip(linear, columns, strict=True)]
