# SPDX-License-Identifier: Apache-2.0
"""From where the search ended to what a `Diagnosis` says: rivals, limits, what is unknown, and the model of each set of
effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from scipy import stats

from ..core.effects.stand_in import VARIABLES, basis, covered
from ..estimation import columns
from ..estimation.likelihood import Point
from ..estimation.problem import Problem
from ..estimation.processes import IMPACT
from ..estimation.shooting import Fit, all_histories, fit
from . import background
from .candidates import WAVES
from .factor import Factor
from .laws.result import Laws
from .moves import State, Task
from .result import Limit, Rival, Test, Unknown
from .screening import Screening
from .settings import POWER, REFIT_STEPS

#: A standard deviation of this many typical sizes means that the data say nothing of an effect.
NOTHING_SAID = 100.0
#: Tests that a report lists.
LISTED = 12
#: Places at which runs have been that a report shows beside an unknown force, about.
SEEN = 600


def subsets(task: Task, state: State, base: Fit) -> dict[tuple[str, ...], Fit]:
    """The fit of every subset of what was added, from none to all; after a search that was stopped only of those on its
    way."""
    found = {(): base, state.added: state.fit}
    for size in range(1, len(state.added)):
        for kept in [state.added[:size]] if state.stopped else combinations(state.added, size):
            found[kept] = _with_some(task.problem, state.fit, base, [n for n in state.added if n not in kept])
    return found


def _with_some(problem: Problem, f: Fit, base: Fit, gone: Sequence[str]) -> Fit:
    """A fit without some of its effects, from the trajectories of the model as it was: these follow the data, and
    forgive blows, whatever is missing."""
    structure = f.structure
    for name in gone:
        structure = structure.minus(name)
    theta, paths = f.theta[[f.structure.free.index(n) for n in structure.free]], base.paths
    if structure.model.carries_states:
        paths = columns.all_carried(problem, structure, paths)
    return fit(problem, structure, Point(theta, paths, base.power, base.processes), REFIT_STEPS)


def with_laws(state: State, laws: Laws | None) -> dict[tuple[str, ...], Fit]:
    """The fit with the best law in the place of the force of any shape; none where no law is proposed."""
    if laws is None or not laws.proposed or laws.fit is None:
        return {}
    return {(*state.known, laws.proposed[0].name): laws.fit}


def settled_base(task: Task, state: State, base: Fit) -> Fit:
    """The model as it was, beside what log and rig do in the answer."""
    if not state.added:
        return state.fit
    if base.processes != state.fit.processes:
        processes = tuple(p for p in base.processes if p.kind == IMPACT) + tuple(
            p for p in state.fit.processes if p.kind != IMPACT
        )
        base = fit(task.problem, base.structure, replace(base.point, processes=processes), REFIT_STEPS)
    return base


def rivals_of(state: State, where: Mapping[str, Mapping[str, Mapping[str, float]]]) -> tuple[Rival, ...]:
    """Every candidate of every round of the search that added something, with the fall of the deviance that it
    promised."""
    found = []
    after_each = [*(beside for beside, _ in state.rounds[1:]), state.added]
    for (beside, screening), after in zip(state.rounds, after_each, strict=True):
        if not (taken := set(after) - set(beside)):
            continue
        plain = screening.scores.plain
        singles = sorted((s for s in screening.sets if len(s.members) == 1), key=lambda s: s.deviance)
        best = max(plain - singles[0].deviance, 1e-9) if singles else 1.0
        for s in singles:
            member, fall = s.members[0], plain - s.deviance
            chosen = member.name in taken
            f = state.fit if chosen else state.rival_fits.get(member.name) if after == state.added else None
            own = {n: v for n, v in f.values.items() if n.startswith(f"{member.name}.") and "[" not in n} if f else {}
            words = "chosen" if chosen else "refitted: the data cannot tell it from the chosen"
            if not f:
                share = 100 * max(fall, 0.0) / best
                words = f"not refitted: to first order it explains {share:.0f} % of what the best would"
            rival = Rival(
                member.name, beside, fall, member.price(screening.family), own,
                {n: f.deviations[n] for n in own} if f else {}, chosen, words,
                where.get(member.name, {}) if chosen else {}, f is not None,
            )  # fmt: skip
            found.append(rival)
    return tuple(found)


def limits_of(state: State, screening: Screening) -> tuple[Limit, ...]:
    """The smallest size of each effect with a size of its own that would have been found in `POWER` of such
    campaigns."""
    structure, found = state.fit.structure, dict[str, Limit]()
    first = len(structure.free)
    for label, candidate in screening.candidates.items():
        e = screening.scores.unbounded.expected([label])
        if candidate.name in found or not e.size.size or candidate.start and candidate.name != WAVES:
            continue
        deviation = float(np.sqrt(max(e.covariance[0, 0], 0.0)))
        wide = structure.plus(candidate.name, candidate.start)
        if not 0.0 < deviation < NOTHING_SAID or len(wide.free) == first:
            continue
        size = (np.sqrt(candidate.price(screening.family)) + stats.norm.ppf(POWER)) * deviation * wide.scale[first]
        declared = wide.declarations[first]
        neutral = 0.0 if candidate.name == WAVES or np.isinf(declared.default) else declared.to_fit(declared.default)
        value = declared.from_fit(neutral + size) - (declared.default if declared.fit_as == "x" else 0.0)
        parameter = wide.free[first].rpartition(".")[2]
        found[candidate.name] = Limit(candidate.name, parameter, declared.unit, float(value))
    return tuple(sorted(found.values(), key=lambda x: x.name))


def tests_of(screening: Screening) -> tuple[tuple[Test, ...], float]:
    """The score tests of all candidates beside the answer, most telling first, and the p-value of the first, all
    counted."""
    tests = []
    for label in screening.candidates:
        e = screening.scores.unbounded.expected([label])
        fall, dof = screening.scores.plain - e.deviance, max(e.size.size, 1)
        tests.append(
            Test(f"score of {label}", float(max(fall, 0.0)), dof, float(stats.chi2.logsf(max(fall, 0.0), dof)))
        )
    tests.sort(key=lambda t: t.log_p)
    p = min(1.0, len(tests) * float(np.exp(tests[0].log_p))) if tests else 1.0
    return tuple(tests[:LISTED]), p


def unknown_of(state: State, problem: Problem) -> Unknown | None:
    """The curve of the force of any shape in an answer, with its 95 % band and where the runs have been; None where
    there is none."""
    name = next((n for n in state.added if n.startswith("stand_in")), None)
    if name is None:
        return None
    found = curve_of(state.fit, name)
    variables = [VARIABLES[int(state.fit.model.effects[name]["variable"])]]
    variables += [found.factor.variable] if found.factor else []
    runs = all_histories(problem, state.fit)
    seen = np.concatenate([np.column_stack([r[v] for v in variables]) for r in runs])
    return replace(found, seen=seen[:: max(1, len(seen) // SEEN)])


def curve_of(f: Fit, name: str) -> Unknown:
    """The curve of a fit's stand-in over its table, with its 95 % band."""
    table, mine = f.model.effects[name], f.structure.tables[name]
    count = int(table["knots"])
    u = np.linspace(*covered(table["start"], table["step"], count), 400)
    shapes = basis(u, table["start"], table["step"], count)
    scale = f.structure.scale[mine]
    covariance = f.covariance[np.ix_(mine, mine)] * np.outer(scale, scale)
    band = 1.96 * np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", shapes, covariance, shapes), 0.0))
    variable = VARIABLES[int(table["variable"])]
    found = Unknown.of(name.removeprefix("stand_in_"), variable, u, shapes @ np.array(table["values"]), band)
    factor = Factor.of(table)
    return found if factor is None else found.times(factor)


def sigma_found(task: Task, state: State, rounded: Mapping[str, float]) -> np.ndarray:
    """Noise by channel (c,) as the answer has it: white and coloured together; that of rounded readings is their
    rounding."""
    sigma = task.problem.sigma.copy()
    for c, channel in enumerate(task.problem.channels):
        kinds = (background.WHITE, background.COLOURED)
        sizes = {p.kind: p.size for p in state.fit.processes if p.on == channel and p.kind in kinds}
        if sizes:
            white = 0.0 if background.WHITE in sizes else 1.0
            sigma[c] *= float(np.sqrt(np.sum(np.square(list(sizes.values()))) + white))
        if channel in rounded:
            sigma[c] /= np.sqrt(background.ALIKE)
    return sigma
