# SPDX-License-Identifier: Apache-2.0
"""Idea: a force on two variables is found as a product, chosen because it foretells runs that it has not seen, and
comes back as a law of both; where one variable is enough, it stays at one."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.core.effects.stand_in import VARIABLES, basis, entries
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis import answer
from inductrack_ros.diagnosis.closed import add_closed
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.factor import Factor
from inductrack_ros.diagnosis.laws.code import Written, module_text
from inductrack_ros.diagnosis.laws.forms import FORMS, Range, unit_of
from inductrack_ros.diagnosis.laws.propose import propose_laws
from inductrack_ros.diagnosis.laws.structure import laid
from inductrack_ros.diagnosis.moves import State, Task
from inductrack_ros.diagnosis.pairs import add_pair
from inductrack_ros.diagnosis.strategy import add_unknown

sys.path.insert(0, str(Path(__file__).parent))
from independent.campaigns import write_campaign

FORM = {f.name: f for f in FORMS}


def searched(tmp_path, name):
    """The search for a force of any shape, on one variable and then on two, in runs of a rig that hides a law."""
    truth, task, one = on_one_variable(tmp_path, name, clear=600)
    return truth, task, one, add_pair(task, one)


def on_one_variable(tmp_path, name, clear):
    """A law that a rig hides, as clear as said, and what the search for a force on one variable finds."""
    truth = write_campaign(tmp_path / "rig", 1, names=[(name, None)], design="coasting", faint=clear / 2, clear=clear)
    campaign = load_campaign(tmp_path / "rig")
    problem, base, _ = base_fit(replace(campaign, runs=campaign.runs[:7]), Model.default())
    task = Task(problem)
    return truth["unknown"][0]["law"], task, add_unknown(task, State(base))


def test_a_force_on_two_variables_comes_back_as_a_law_of_both(tmp_path):
    """A bump at one place, in proportion to sway: a lateral magnet that pulls the harder the nearer the cradle is."""
    truth, task, _, state = searched(tmp_path, "law_sway_bump_surge_sway")
    unknown = answer.unknown_of(state, task.problem)
    assert unknown.channel == "sway" and unknown.depends_on == ("surge", "sway")
    found = propose_laws(task, state, unknown, task.problem.sigma)
    best = next(law for law in found.proposed if law.name == "proposed_bump_sway_on_surge_times_sway")
    for parameter, true in truth["parameters"].items():
        value, std, _ = best.parameters[parameter]
        assert abs(value - true) < 4 * std < 0.5 * abs(true), parameter
    assert best.parameters["force"][2] == "N/m" and best.formula.endswith("· x") and "times sway" in best.words
    # where the data are: pairs of both variables that runs went through
    assert unknown.seen.shape[1] == 2 and np.ptp(unknown.seen[:, 0]) > 20 and np.abs(unknown.seen[:, 1]).max() < 0.02


def test_a_faint_force_on_two_variables_is_found_as_a_closed_form(tmp_path):
    """A bump times sway pays as three numbers, where a table times sway does not."""
    truth, task, none = on_one_variable(tmp_path, "law_sway_bump_surge_sway", clear=80)
    assert not none.stands_in and not add_pair(task, none).stands_in
    state = add_closed(task, none)
    assert answer.unknown_of(state, task.problem).depends_on == ("surge", "sway")
    found = propose_laws(task, state, answer.unknown_of(state, task.problem), task.problem.sigma)
    best = next(law for law in found.proposed if law.name == "proposed_bump_sway_on_surge_times_sway")
    for parameter, true in truth["parameters"].items():
        value, std, _ = best.parameters[parameter]
        assert abs(value - true) < 4 * std < 4 * abs(true), parameter


@pytest.mark.nightly
def test_a_force_on_one_variable_stays_on_one(tmp_path):
    """No product takes the place of what a single variable says."""
    _, task, one, state = searched(tmp_path, "law_sway_cubic_sway")
    assert one.stands_in and state.fit is one.fit
    assert answer.unknown_of(state, task.problem).depends_on == ("sway",)


@pytest.mark.parametrize("power, text", [(1, "surge_rate * ("), (2, "surge_rate * surge_rate * (")])
def test_the_written_product_is_the_law(tmp_path, power, text):
    """The written effect, the table that carries it in a fit, and the law say the same, in the units that are said."""
    factor = Factor("surge_rate", power, 17.0)
    law = Written(FORM["line"], "roll", "roll", {"force": 0.3, "slope": -2.0}, Range(-0.01, 0.01), factor=factor)
    (tmp_path / "laws.py").write_text(module_text([law]), encoding="utf-8")
    assert text in (tmp_path / "laws.py").read_text()
    spec = importlib.util.spec_from_file_location("product_written", tmp_path / "laws.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    u, v = np.linspace(-0.008, 0.008, 7), np.linspace(5.0, 30.0, 7)
    got = [getattr(module, law.name).function(a, b, 0.3, -2.0) for a, b in zip(u, v, strict=True)]
    np.testing.assert_allclose(got, (0.3 - 2.0 * u) * v**power)
    table = {"variable": float(VARIABLES.index("roll"))} | factor.parameters | laid(law)
    carried = entries(table, {"roll": u, "surge_rate": v}, int(table["knots"])) @ np.array(table["values"])
    np.testing.assert_allclose(carried, got, rtol=1e-6)  # between the table's ends
    assert Factor.of(table) == factor and law.name.endswith("times_surge_rate" + ("_squared" if power == 2 else ""))
    raised = "²" if power == 2 else ""
    assert unit_of(law.form, "force", "roll", "roll", factor) == ("N·m/(m/s)²" if power == 2 else "N·m·s/m")
    assert unit_of(law.form, "slope", "roll", "roll", factor).endswith("/rad") and raised in law.unit("slope")


def test_a_stand_in_of_two_variables_flies_as_it_is_fitted():
    """The compiled force is what the fit's columns say."""
    rng = np.random.default_rng(0)
    values = tuple(rng.normal(size=9))
    about = {"variable": 3.0, "start": -0.005, "step": 0.00125, "knots": 9.0, "values": values}
    about |= Factor("surge_rate", 2, 20.0).parameters
    model = Model.create(effects={"stand_in_roll": about})
    x = model.initial_state(surge_rate=25.0, roll=0.002)
    force = model.wrenches(x, 0.0, 0.0)["stand_in_roll"][3]
    along = {v: np.array([x[k]]) for k, v in enumerate(VARIABLES[:8])}
    assert force == pytest.approx((entries(about, along, 9) @ np.array(values))[0])
    assert force == pytest.approx((basis(np.array([0.002]), -0.005, 0.00125, 9) @ np.array(values))[0] * (25 / 20) ** 2)
