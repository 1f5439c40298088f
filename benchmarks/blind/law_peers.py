# SPDX-License-Identifier: Apache-2.0
"""What other tools make of the table that a diagnosis found, judged as its first law is.

The peers get the same statement of the data (`peers.laws`) that the package's choice of forms gets. As the package's
laws are, each formula is refitted to all runs in the table's place, its terms' sizes free, and flies the unseen
runs."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from unittest.mock import Mock, patch

import numpy as np
from peers.law_judge import of_form
from peers.law_versus import MINE
from peers.laws import LAW_PEERS, Formula, Statement, ask
from threadpoolctl import threadpool_limits

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.answer import curve_of
from inductrack_ros.diagnosis.laws.code import Written
from inductrack_ros.diagnosis.laws.fitting import Table
from inductrack_ros.diagnosis.laws.forms import FORMS
from inductrack_ros.diagnosis.laws.propose import in_place, table_of
from inductrack_ros.diagnosis.moves import State, Task

from .judge import heldout_error
from .judge_law import INTERVAL, first_law, hidden_law, law_names, with_force


def check() -> None:
    """Raises `SystemExit` where a peer is not installed, before a campaign is diagnosed for nothing."""
    try:
        for name in LAW_PEERS:
            importlib.import_module(f"peers.{name}")
    except ImportError as error:
        raise SystemExit(f"--peers: {error}; pip install -e '.[benchmark]'") from error


@contextmanager
def overheard() -> Iterator[Mock]:
    """Keeps with what a diagnosis asks for laws: the task and the end of the search."""
    module = importlib.import_module("inductrack_ros.diagnosis.diagnose")
    with patch.object(module, "propose_laws", wraps=module.propose_laws) as heard:
        yield heard


def ask_law_peers(heard: Mock, found, truth: dict, heldout: Path) -> dict[str, dict]:
    """The package's first law and the peers' formulas by name: whether each is of the true form (None outside the
    list), its error on unseen runs, text, terms and times (s). Nothing where there is no table."""
    if heard.call_args is None:
        return {}
    task, state = heard.call_args.args[:2]
    name = next((n for n in state.added if n.startswith("stand_in")), None)
    if name is None:
        return {}
    with threadpool_limits(1, "blas"):
        statement = statement_of(task, state, name)
        error_of = partial(heldout_error, heldout, noise=truth["plan"]["noise"])
        right = partial(is_right, table=statement.table, truth=truth)
        refit = partial(refitted, table=statement.table, task=task, state=state, name=name)
        answers = {title: _asked(peer, statement, refit, right, error_of) for peer, title in LAW_PEERS.items()}
    if found.laws is not None and found.laws.proposed:
        form, values = first_law(found)
        mine = {"right": right(partial(form.value, parameters=values)), "text": form.name, "terms": len(form.terms)}
        answers = {MINE: mine, **answers}
    return answers


def statement_of(task: Task, state: State, name: str) -> Statement:
    """What the data say of a stand-in's force at the end of a search."""
    table, curve = table_of(task, state.fit, name), curve_of(state.fit, name)
    size = table.factor.size if table.factor else 1.0
    return Statement(table, curve.at, curve.force / size, curve.band / INTERVAL / size, task.problem.samples)


def is_right(force: Callable[[np.ndarray], np.ndarray], table: Table, truth: dict) -> bool | None:
    """Whether a force in the table's place is the hidden law: coordinate and variables, and of its form."""
    hidden = hidden_law(truth)
    if hidden["law"]["sort"] == "outside":
        return None
    names = law_names(hidden)
    written = [Written(f, table.acts_on, table.variable, {}, table.range, factor=table.factor) for f in FORMS]
    true = [law.form for law in written if law.name in names]
    return any(of_form(force, f, table.variable, table.range) for f in true)


def _asked(
    peer: str,
    statement: Statement,
    refit: Callable[[Formula], tuple[Formula, Model]],
    right: Callable,
    error_of: Callable[[Model], float],
) -> dict:
    """One peer's formula, refitted, judged."""
    times = [time.process_time()]
    try:
        formula = ask(peer, statement)
        times.append(time.process_time())
        formula, model = refit(formula)
        times.append(time.process_time())
        error = error_of(model)
    except Exception as failure:  # a crash is no formula, with a reason
        return {"right": False, "error": None, "text": f"{type(failure).__name__}: {failure}"}
    cpu, refitting = np.diff(times).tolist()
    more = {"text": formula.text, "terms": len(formula.terms), "cpu": cpu, "refit": refitting}
    return {"right": right(formula), "error": error, **more}


def refitted(formula: Formula, table: Table, task: Task, state: State, name: str) -> tuple[Formula, Model]:
    """The formula with the sizes of its terms refitted in the table's place with all else, and the model that has
    it."""
    about = state.fit.model.effects[name]
    law = Written(formula.form, table.acts_on, table.variable, formula.sizes, table.range, factor=table.factor)
    fit = in_place(task, state.fit, name, law)
    sizes = [fit.values[f"{law.name}.{n}"] for n in formula.sizes]
    new = Formula(tuple(zip(sizes, (text for _, text in formula.terms), strict=True)))
    return new, with_force(fit.model, name, about, new.form, new.sizes)
