"""Idea: what first order promises is right where it must be: at the first sample, over the beginnings of runs, for twins."""

import numpy as np
import pytest
from test_diagnosis_input import simulated

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.search import Search


@pytest.fixture(scope="module")
def problem_and_fit():
    return base_fit(simulated([18, 22, 27, 33], seconds=0.6, current=3500.0), Model.default())[:2]


def test_a_late_surge_is_everything_else_early(problem_and_fit):
    """With the initial state free, only the time between channels counts: the signatures are one, up to their sign."""
    search = Search(*problem_and_fit)
    look = search.look(search.trials[frozenset()])
    columns = {s.candidate.name: look.project(look.project.stack(s.columns))[:, 0] for s in look.screened}
    late = columns["sensor_delay:surge"]
    rest = np.column_stack([columns[f"sensor_delay:{c}"] for c in ("sway", "heave", "roll")])
    early = -rest.sum(axis=1)
    assert late @ early > 0.999 * np.linalg.norm(late) * np.linalg.norm(early)
    assert np.linalg.norm(late) == pytest.approx(np.linalg.norm(early), rel=0.01)


def test_a_shortened_problem_is_the_beginning_of_the_whole(problem_and_fit):
    problem, fit = problem_and_fit
    part = problem.within(0.25)
    assert 0 < part.samples < problem.samples
    short, whole = (p.residuals(fit.structure, fit.theta, fit.states) for p in (part, problem))
    for a, b, data in zip(short, whole, problem.runs, strict=True):
        assert np.array_equal(a, b[data.time <= 0.25])
