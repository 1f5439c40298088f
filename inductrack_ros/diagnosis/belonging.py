# SPDX-License-Identifier: Apache-2.0
"""Whether one run does not belong to the others: the rig was another one then.

Known effects may explain it. Where none does, it is left out and the search begins anew. That comes before a force of
any shape is sought: a table finds room for such a run wherever that run alone has been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..checks import SET_ASIDE, WARNING, Finding
from ..estimation.likelihood import maximise_evidence
from ..estimation.processes import RUN_TO_RUN, Process
from ..estimation.shooting import linearise_all
from . import background
from .errors import of_runs, own_thetas
from .moves import State, Task

BAD_RUN = "bad_run"


def odd_by(task: Task, state: State, p: Process) -> Finding | None:
    """The one run but for which a parameter that differs from run to run is the same in all; None where there is
    none."""
    problem, f = task.problem, state.fit
    if len(problem.runs) <= background.FEWEST_RUNS:
        return None
    at = f.structure.free.index(p.on)
    own = np.array([theta[at] for theta in own_thetas(problem, f)])
    odd = int(np.argmax(np.abs(own - np.median(own))))
    rest = [i for i in range(len(problem.runs)) if i != odd]
    point, part = of_runs(f, rest), problem.subset(rest)
    plain = linearise_all(part, point, f.structure)
    fewer = replace(point, processes=tuple(q for q in point.processes if q != p))
    with_it, without = (
        maximise_evidence(part, f.structure, plain, x, background.PASSES).evidence.deviance for x in (point, fewer)
    )
    if without - with_it >= background.price(part, task.given, (p,)):
        return None
    run = problem.runs[odd].run.name
    text = f"{run} does not belong to the others: with it left out, {p.on} is the same in every run"
    remedy = "look what was different then, or repeat it"
    return Finding(BAD_RUN, WARNING, text, remedy, run=run, size={"parameter": p.on})


def odd_run(task: Task, state: State) -> Finding | None:
    """The run that does not belong, to be set aside; None where all belong."""
    for p in state.fit.processes:
        if p.kind == RUN_TO_RUN and (odd := odd_by(task, state, p)):
            return replace(odd, severity=SET_ASIDE, text=f"{odd.text}, so it was left out")
    return None
