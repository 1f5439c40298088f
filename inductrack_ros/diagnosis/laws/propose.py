# SPDX-License-Identifier: Apache-2.0
"""From the table of an unknown force to laws: all forms against the table, the best refitted in full in its place,
ranked by evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from ...core.model import Model
from ...estimation import shooting
from ...estimation.shooting import Fit
from ..errors import step_of
from ..moves import State, Task
from ..result import Unknown
from ..screening import asked_of
from ..settings import NEAR, REFIT_STEPS, TWINS
from . import words
from .code import FILE, Written, module_text
from .fitting import LEVEL, Table, fitted
from .forms import Range
from .result import Laws, ProposedLaw
from .structure import LawStructure

#: Forms that are refitted in full: the best few, of those that the table alone does not turn down beyond this p-value
#: (a table is a first-order statement, so the refit is to have the last word).
REFITTED, HOPELESS = 4, 1e-9


def propose_laws(task: Task, state: State, unknown: Unknown | None, sigma: np.ndarray) -> Laws | None:
    """Laws in the place of the force of any shape at the end of a search; None where there is none, or the search was
    broken off.

    ``unknown`` is its curve, ``sigma`` (c,) the noise over which errors are told.
    """
    name = next((n for n in state.added if n.startswith("stand_in")), None)
    if name is None or unknown is None or state.stopped:
        return None
    fit, samples = state.fit, task.problem.samples
    occam = dict(state.freedom)[name]
    table = table_of(task, fit, name)
    screened = fitted(table, samples)
    tried = [s for s in screened if s.p_value > HOPELESS and s.cost < screened[0].cost + NEAR][:REFITTED] or screened[
        :1
    ]
    task.tell(f"closed forms in place of the table: {', '.join(s.form.title for s in tried)}")
    written = [
        Written(s.form, table.acts_on, table.variable, s.parameters, table.range, factor=table.factor) for s in tried
    ]
    found: list[tuple[Fit, Written, ProposedLaw]] = []
    for law, screen in zip(written, tried, strict=True):
        new = in_place(task, fit, name, law)
        excess = _misfit(new) - _misfit(fit)
        price = screen.price + 2.0 * float(np.log(len(screened)))
        found.append((new, law, _judged(new, law, excess, table.seen, occam - price, unknown.at)))
    found.sort(key=lambda f: -f[2].evidence)
    holding = [f for f in found if f[2].p_value > LEVEL]
    holding = [f for f in holding if f[2].evidence > holding[0][2].evidence - TWINS]
    best = (holding or found)[0]
    task.tell(f"how well {best[2].title} predicts runs left out")
    shown = (*(n for n in state.added if n != name), best[2].name)
    step = step_of(task.problem, best[0], sigma, shown)
    first = replace(best[2], reduced_chi2=step.reduced_chi2, heldout_nrmse=step.heldout_nrmse)
    if not holding:
        return Laws(len(screened), nearest=first)
    proposed = (first, *(f[2] for f in holding[1:]))
    code = module_text([_documented(w, law) for (_, w, _), law in zip(holding, proposed, strict=True)], HEADER)
    settles = _settles([f[1] for f in holding], [f[0] for f in holding])
    return Laws(len(screened), proposed, None, settles, _model_with(best[0], name, first), code, best[0])


HEADER = """Laws proposed by a diagnosis for a force that no known effect explains. PROPOSED: they describe these data; nobody has shown that they
are the physics. Edit them as you like, then

    inductrack diagnose CAMPAIGN --effects proposed_effects.py --output DIR     # they compete with all known effects
    inductrack add NAME CAMPAIGN --effects proposed_effects.py --output DIR     # one of them, whatever competes
"""  # noqa: E501


def table_of(task: Task, fit: Fit, name: str) -> Table:
    """What the data say of a stand-in's table at a fit."""
    gram, score = asked_of(task.problem, fit, shooting.linearise_all(task.problem, fit), name)
    return Table.of(name.removeprefix("stand_in_"), fit.structure.model.effects[name], gram, score)


def _misfit(fit: Fit) -> float:
    """Twice the negative log likelihood, what priors add taken out."""
    return fit.deviance - fit.structure.surprise(fit.theta)


def in_place(task: Task, fit: Fit, name: str, law: Written) -> Fit:
    """Everything refitted with the law in the table's place, from where the fit and the law's own fit to the table
    stand."""
    structure = LawStructure.of(fit.structure, name, law)
    theta = structure.start.copy()
    own = dict(zip(fit.structure.free, fit.theta, strict=True))
    for k, n in enumerate(structure.free):
        theta[k] = own.get(n, theta[k])
    return shooting.fit(task.problem, structure, replace(fit.point, theta=theta), REFIT_STEPS)


def _judged(new: Fit, law: Written, excess: float, seen: int, saved: float, at: np.ndarray) -> ProposedLaw:
    """A refitted law whose misfit exceeds by ``excess`` that of a table of which ``seen`` numbers are known; ``saved``:
    what it costs less."""
    values, deviations = _own(new.values, law.name), _own(new.deviations, law.name)
    p = float(stats.chi2.sf(max(excess, 0.0), max(seen - law.form.count, 1))) if np.isfinite(excess) else 0.0
    return ProposedLaw(
        law.name, law.form.title, words.formula(law),
        {n: (values[n], deviations[n], law.unit(n)) for n in law.form.names},
        words.reading(law, values, deviations), float(saved - excess), p, law.force(at, values),
    )  # fmt: skip


def _own(values: Mapping[str, float], name: str) -> dict[str, float]:
    return {n.removeprefix(f"{name}."): v for n, v in values.items() if n.startswith(f"{name}.")}


def _documented(written: Written, law: ProposedLaw) -> Written:
    """The law with its refitted values and its evidence in words."""
    lines = [
        f"Proposed: {law.words}.",
        "",
        (
            f"    Twice the log evidence over a table of any shape: {law.evidence:.0f}. Seen from"
            f" {written.covered.low:.4g} to {written.covered.high:.4g} of {written.variable};"
        ),
        "    beyond that nothing is known.",
        "    ",
    ]
    return replace(written, values={p: v for p, (v, _, _) in law.parameters.items()}, words="\n".join(lines))


def _model_with(fit: Fit, name: str, law: ProposedLaw) -> Model:
    """The fitted model with the law as an effect of the file beside it, wherever the folder goes."""
    effects = {n: v for n, v in fit.model.effects.items() if n != name} | {
        law.name: {p: v for p, (v, _, _) in law.parameters.items()}
    }
    return replace(fit.model, effects=effects, effect_files=(*fit.model.effect_files, FILE))


def _settles(laws: Sequence[Written], fits: Sequence[Fit]) -> str:
    """Where the laws that data cannot tell apart differ most, half the range beyond them included."""
    if len(laws) < 2:
        return ""
    r: Range = laws[0].covered
    u = np.linspace(r.low - 0.5 * r.length, r.high + 0.5 * r.length, 401)
    if laws[0].variable in ("surge", "time", "surge_rate", "drive"):
        u = u[u >= 0.0]
    first, second = (law.force(u, _own(f.values, law.name)) for law, f in zip(laws[:2], fits[:2], strict=True))
    where = float(u[np.argmax(np.abs(first - second))])
    beyond = " (these did not)" if not r.low <= where <= r.high else ""
    return (
        f"Runs that dwell near {words.CALLED[laws[0].variable]} = {where:.3g}{beyond} would tell the first two apart."
    )
