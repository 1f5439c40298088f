"""Idea: what first order promises is right where it must be: at the first sample, over the beginnings of runs, for twins."""

import numpy as np
import pytest
from test_diagnosis_input import simulated

from inductrack_ros.core.effects.stand_in import ACTS_ON, basis
from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.deterministic import base_fit
from inductrack_ros.diagnosis.search import Search
from inductrack_ros.diagnosis.signatures import VARIABLES
from inductrack_ros.diagnosis.smooth import covering, smoothest
from inductrack_ros.estimation.fit import fit


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


def test_one_sided_differences_say_the_same_way(problem_and_fit):
    problem, fit = problem_and_fit
    at = fit.structure, fit.theta, fit.states
    for quick, central in zip(problem.linearise(*at, one_sided=True), problem.linearise(*at), strict=True):
        assert np.array_equal(quick.residual, central.residual) and np.array_equal(quick.by_theta, central.by_theta)
        assert np.linalg.norm(quick.by_state - central.by_state) < 0.01 * np.linalg.norm(central.by_state)  # an impact jumps


@pytest.mark.parametrize("what", ACTS_ON)
def test_the_response_to_a_table_is_what_the_simulation_does(problem_and_fit, what):
    """Of a force in each coordinate and of a share of the thrust, over the first moments, before runs tip over."""
    problem, base = problem_and_fit[0].within(0.1), problem_and_fit[1]
    table = {"variable": 0.0, "start": 0.0, "step": 0.5, "knots": 8.0, "values": (0.0,) * 8}
    structure, theta = base.widened(f"stand_in_{what}", table, [f"values[{i}]" for i in range(8)])
    mine = structure.tables[f"stand_in_{what}"]
    parts = problem.linearise(structure, theta, base.states)
    nothing = problem.residuals(structure, theta, base.states)
    moved = theta.copy()
    moved[mine] += [0.0, 0.3, 0.1, -0.2, 0.3, 0.1, 0.2, 0.0]
    for part, before, after in zip(parts, nothing, problem.residuals(structure, moved, base.states), strict=True):
        told = part.by_theta[:, mine] @ (moved - theta)[mine]
        assert np.linalg.norm(before - after - told) < 0.02 * np.linalg.norm(told)


def test_a_table_is_as_smooth_as_the_data_say():
    """A straight law is given next to no freedom, a narrow peak what it needs; either is found within its noise."""
    rng = np.random.default_rng(0)
    u = rng.uniform(0, 31, 4000)
    columns = basis(u, 0.0, 1.0, 32)
    straight, peak = 0.2 * u, 5 * np.exp(-(((u - 12) / 1.5) ** 2))
    found = [smoothest("stand_in_heave", columns, law + rng.standard_normal(u.size)) for law in (straight, peak)]
    inner = (u > 2) & (u < 29)
    for law, table in zip((straight, peak), found, strict=True):
        assert np.abs(columns @ table.values - law)[inner].max() < 0.5
    assert found[0].weight > 1e3 * found[1].weight
    assert 0 < found[0].occam < found[1].occam


def test_a_table_promises_nothing_where_the_responses_left_all_bounds():
    with np.errstate(over="ignore", invalid="ignore"):
        table = smoothest("stand_in_heave", np.eye(50)[:, :33] * 1e150, np.ones(50))
    assert not table.promise > 0


def test_a_table_is_laid_anew_where_runs_go_beyond_it(problem_and_fit):
    problem, base = problem_and_fit
    variable = VARIABLES.index("surge_rate")
    values = tuple(0.1 * np.arange(33.0))  # a straight law of 0.4 N per m/s, but for the last of the splines
    table = {"variable": float(variable), "start": 20.0, "step": 0.25, "knots": 33.0, "values": values}
    structure, theta = base.widened("stand_in_sway", table, [f"values[{i}]" for i in range(33)])
    short = fit(problem, structure, base.states, theta, iterations=0)
    wide, longer = covering(problem, short, "stand_in_sway")
    laid = wide.with_theta(longer).effects["stand_in_sway"]
    speeds = np.linspace(18.5, 33, 50)
    force = basis(speeds, laid["start"], laid["step"], 33) @ np.array(laid["values"])[:33]
    assert force == pytest.approx(0.4 * (speeds - 20.0), abs=0.1)
    again = fit(problem, wide, base.states, longer, iterations=0)
    assert covering(problem, again, "stand_in_sway")[0] is wide
