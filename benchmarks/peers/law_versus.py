# SPDX-License-Identifier: Apache-2.0
"""The package and its peers side by side, on tables whose law is known."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from inductrack_ros.diagnosis.laws.forms import Form, Range

from .law_judge import Force, nearness, of_form
from .laws import LAW_PEERS, Statement, ask

#: What the tables call the package's first law and the smooth curve that all begin from.
MINE, CURVE = "this package", "the smooth table itself"
HEAD = ["", "formula given", "right form", "off the law in the range: median", "beyond: median", "terms, median",
        "processor time, median / longest (s)"]  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """A proposed ``force``, its number of ``terms`` (0: it is a table), what it is called, and the time it took (s)."""

    force: Force
    terms: int
    text: str
    cpu: float


@dataclass(frozen=True)
class Judged:
    """An answer held against the law: how far it is off, in parts of the law, in the range and beyond; whether it is of
    its form (None where that is not asked)."""

    off: float
    beyond: float
    right: bool | None
    terms: int
    text: str
    cpu: float


#: A table's answers by who gave them; None where no formula was given.
Row = Mapping[str, Judged | None]


def asked(statement: Statement) -> dict[str, Answer]:
    """The peers' answers. Raises `SystemExit` where they are not installed."""
    found = {}
    for name, title in LAW_PEERS.items():
        began = time.process_time()
        try:
            formula = ask(name, statement)
        except ImportError as error:
            raise SystemExit(f"--peers: {error}; pip install -e '.[benchmark]'") from error
        found[title] = Answer(formula, len(formula.terms), formula.text, time.process_time() - began)
    return found


def judged(answers: Mapping[str, Answer | None], law: Force, form: Form | None, variable: str, r: Range) -> Row:
    """All answers against the law, which is of the ``form`` or of none that is known."""

    def one(a: Answer) -> Judged:
        right = of_form(a.force, form, variable, r) if form is not None and a.terms else None
        return Judged(*nearness(a.force, law, variable, r), right, a.terms, a.text, a.cpu)

    return {name: None if a is None else one(a) for name, a in answers.items()}


def line(row: Row) -> str:
    """The answers to one table in a line each."""
    told = []
    for name, a in row.items():
        if a is None:
            told.append(f"  {name}: no formula")
        else:
            right = {True: "right form, ", False: "OTHER FORM, ", None: ""}[a.right]
            told.append(
                f"  {name}: {right}off {_percent(a.off)}, beyond {_percent(a.beyond)}; {a.cpu:.1f} s; {a.text[:200]}"
            )
    return "\n".join(told)


def table(rows: Sequence[Row], title: str) -> list[str]:
    """The lines of a Markdown table, one for the package and for each peer; none where there are no rows."""
    if not rows:
        return []
    lines = [[title, *HEAD[1:]], ["---"] * len(HEAD)]
    for name in rows[0]:
        here = [a for row in rows if (a := row[name]) is not None]
        right = [a.right for a in here if a.right is not None]
        lines.append(
            [
                name,
                f"{len(here)} of {len(rows)}",
                f"{sum(right)} of {len(rows)}" if right else "",
                *(_median([getattr(a, what) for a in here]) for what in ("off", "beyond")),
                f"{np.median([a.terms for a in here]):.0f}" if here and here[0].terms else "",
                f"{np.median([a.cpu for a in here]):.1f} / {max(a.cpu for a in here):.1f}" if here else "",
            ]
        )  # fmt: skip
    return [f"| {' | '.join(x)} |" for x in lines]


def _median(parts: list[float]) -> str:
    return _percent(float(np.median(parts))) if parts else ""


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %" if part < 10 else f"{part:.2g} times"
