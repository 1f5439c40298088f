# SPDX-License-Identifier: Apache-2.0
"""Idea: an unknown force becomes a law. The right form is found for tables of known truth, none is claimed for what is
no form of the list, the written effect is the law that was fitted, and a campaign of the independent simulator gives
back its spring."""

import ast
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.core.effects.stand_in import basis, over, parameters
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis import answer
from inductrack_ros.diagnosis.closed import price_of
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.laws.code import Written, module_text
from inductrack_ros.diagnosis.laws.fitting import Table, fitted, likely
from inductrack_ros.diagnosis.laws.forms import FORMS, Range, forms_on, unit_of
from inductrack_ros.diagnosis.laws.propose import propose_laws
from inductrack_ros.diagnosis.laws.words import quantity
from inductrack_ros.diagnosis.moves import State, Task, law_price, with_law
from inductrack_ros.diagnosis.screening import laws
from inductrack_ros.diagnosis.settings import FINE, MEDIUM, TWINS
from inductrack_ros.diagnosis.smooth import WEIGHTS, _turns, smoothest_of
from inductrack_ros.estimation.shooting import linearise_all
from inductrack_ros.estimation.structure import Smoothness

sys.path.insert(0, str(Path(__file__).parent))
from independent.campaigns import write_campaign

SAMPLES = 3000
FORM = {f.name: f for f in FORMS}


def table(acts_on, variable, u, force, noise, intervals=24, seed=0):
    """What samples of a force with noise say of its table."""
    low, step, count = over(u.min(), u.max(), intervals)
    B = basis(u, low, step, count)
    y = force + noise * np.random.default_rng(seed).standard_normal(len(u))
    return Table.of(acts_on, parameters(variable, low, step), B.T @ B / noise**2, B.T @ y / noise**2)


LAWS = [
    ("heave", "surge", (0, 20), "bump", {"force": -12.0, "place": 8.0, "width": 0.9}),
    ("sway", "sway", (-4e-3, 4e-3), "cubic", {"coefficient": -2e8}),
    ("surge", "surge_rate", (12, 34), "power", {"coefficient": -0.02, "power": 1.5}),
    ("heave", "surge_rate", (12, 34), "ramp", {"slope": 0.8, "threshold": 21.0}),
    ("heave", "time", (0, 1.5), "sine", {"force": 2.0, "wavelength": 0.3, "phase": 0.5}),
    ("sway", "sway_rate", (-0.3, 0.3), "saturation", {"force": -3.0, "width": 0.03}),
    ("roll", "sway", (-4e-3, 4e-3), "dead_zone", {"slope": 900.0, "clearance": 1.5e-3}),
    ("thrust", "surge", (0, 20), "sine", {"force": 0.04, "wavelength": 3.0, "phase": 1.0}),
    ("surge", "surge", (0, 46), "sine", {"force": 4.0, "wavelength": 1.3, "phase": 1.0}),  # 35 waves: slots, joints
]


@pytest.mark.parametrize("acts_on, variable, covered, name, truth", LAWS)
def test_the_right_form_is_found_with_its_parameters(acts_on, variable, covered, name, truth):
    u = np.random.default_rng(1).uniform(*covered, SAMPLES)
    force = FORM[name].value(u, truth)
    of_table = table(
        acts_on, variable, u, force, 0.3 * np.std(force), FINE if variable in ("surge", "time") else MEDIUM
    )
    found = likely(fitted(of_table, SAMPLES), TWINS)
    assert name in [f.form.name for f in found] and len(found) <= 3
    mine = next(f for f in found if f.form.name == name)
    for parameter, value in truth.items():
        assert abs(mine.parameters[parameter] - value) < 4 * mine.deviations[parameter], parameter


@pytest.mark.parametrize("shape", ["two bumps", "chirp", "quintic"])
def test_no_form_is_claimed_for_what_is_none(shape):
    u = np.random.default_rng(2).uniform(0, 20, SAMPLES)
    x = u / 20
    force = {
        "two bumps": np.exp(-(((x - 0.3) / 0.05) ** 2)) - 0.8 * np.exp(-(((x - 0.7) / 0.08) ** 2)),
        "chirp": np.sin(2 * np.pi * (x + 3 * x**2)),
        "quintic": np.polynomial.chebyshev.chebval(2 * x - 1, [0, 0.2, 0.5, 1.0, -0.7, 1.0]),
    }[shape]
    assert not likely(fitted(table("heave", "surge", u, force, 0.3 * np.std(force), 60), SAMPLES), TWINS)


def equations_of(variable, covered, intervals, force, noise, seed):
    """Normal equations of a table, and that of them alone, from samples of a force with noise."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(*covered, SAMPLES)
    low, step, count = over(*covered, intervals)
    B = basis(u, low, step, count)
    gram, score = B.T @ B / noise**2, B.T @ (force(u) + noise * rng.standard_normal(SAMPLES)) / noise**2
    return gram, score, Table.of("heave", parameters(variable, low, step), gram, score)


def gain_of(table, family=140):
    """The form that gains most beyond what chance would, and how much."""
    whole = float(table.wanted @ table.wanted)
    gains = {f.form.name: whole - f.misfit - price_of(f.form, table, family) for f in fitted(table, SAMPLES)}
    return max(gains.items(), key=lambda one: one[1])


@pytest.mark.parametrize("swings", [False, True])
def test_a_table_promises_its_evidence(swings):
    """Twice the log evidence of Gaussian values, by determinants, at the best of all weights of its roughness."""
    gram, score, _ = equations_of("surge", (0, 20), 60, lambda u: 3.0 * np.sin(2.0 * u), 25.0, seed=1)
    table = smoothest_of(gram, score, SAMPLES, swings)
    unit, turn = np.trace(gram) / len(gram), table.smoothness.turn
    choice = 2.0 * np.log(len(_turns(len(gram)))) if turn else 0.0

    def prior_of(weight):
        return unit / SAMPLES * np.eye(len(gram)) + weight * Smoothness(1.0, turn).bending(len(gram))

    def evidence(weight):
        prior = prior_of(weight)
        gained = np.linalg.slogdet(gram + prior)[1] - np.linalg.slogdet(prior)[1]
        return score @ np.linalg.solve(gram + prior, score) - gained - choice

    best = table.smoothness.weight
    rounding = len(gram) * np.finfo(float).eps * np.linalg.cond(prior_of(best))  # 2e-4; the processor decides how much
    assert bool(turn) == swings
    assert table.promise == pytest.approx(evidence(best), abs=rounding)
    assert all(evidence(unit * w) < table.promise + rounding for w in WEIGHTS[8:28])


def test_a_form_pays_where_its_table_does_not():
    """A narrow bump: the table has 63 values for it, the form three."""
    bump = {"force": -12.0, "place": 8.0, "width": 0.3}
    gram, score, table = equations_of("surge", (0, 20), 60, lambda u: FORM["bump"].value(u, bump), 9.0, seed=1)
    assert smoothest_of(gram, score, SAMPLES).promise < law_price()
    name, gain = gain_of(table)
    assert name == "bump" and gain > 25.0


def test_chance_pays_for_no_form():
    """One campaign in a hundred may; of these the best falls short by what a handful of parameters gain."""
    tables = [("surge", (0, 20), 60), ("sway", (-4e-3, 4e-3), 24)] * 8
    gains = [gain_of(equations_of(*t, np.zeros_like, 1.0, seed=k)[2])[1] for k, t in enumerate(tables)]
    assert -25.0 < max(gains) < 0.0


def test_the_misfit_of_the_true_form_is_chi_square():
    """No prior of the table's smoothness stands in it: what is left has the noise's own distribution."""
    misfits, seen = [], []
    u = np.random.default_rng(3).uniform(-4e-3, 4e-3, 800)
    for seed in range(30):
        found = fitted(table("sway", "sway", u, -2e8 * u**3, 1.0, seed=seed), 800, [FORM["cubic"]])[0]
        misfits.append(found.misfit)
        seen.append(found.dof)
    assert 0.75 < np.sum(misfits) / np.sum(seen) < 1.35


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f.name)
def test_the_written_effect_is_the_law(form, tmp_path):
    """The module that a diagnosis writes, run as plain Python, gives the curve that was fitted, for every variable of
    the form."""
    for variable in form.on:
        acts_on = "thrust" if form in forms_on(variable, "thrust") and variable != "drive" else "sway"
        r = Range(0.0, 20.0) if variable in ("surge", "time", "surge_rate", "drive") else Range(-4e-3, 5e-3)
        values = {t.size: 2.0 for t in form.terms} | {s.name: float(r.starts(s.kind)[2]) for s in form.shapes}
        law = Written(form, acts_on, variable, values, r, "In words.")
        (tmp_path / "laws.py").write_text(module_text([law], "Proposed."), encoding="utf-8")
        spec = importlib.util.spec_from_file_location("laws_written", tmp_path / "laws.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        effect = getattr(module, law.name)
        assert list(effect.parameters) == list(form.names)
        assert [p.unit for p in effect.parameters.values()] == [unit_of(form, p, acts_on, variable) for p in form.names]
        u = np.linspace(r.low, r.high, 13)
        first = (1.0,) if acts_on == "thrust" else ()
        got = np.array([effect.function(*first, float(x), *(values[p] for p in form.names)) for x in u])
        np.testing.assert_allclose(got - (1.0 if first else 0.0), form.value(u, values), rtol=1e-9, atol=1e-9)


def test_every_form_is_arithmetic_alone():
    for term in (t for f in FORMS for t in f.terms):
        names = {n.id for n in ast.walk(ast.parse(term.expression)) if isinstance(n, ast.Name)}
        own = {s.name for f in FORMS if term in f.terms for s in f.shapes}
        assert names <= own | {"u", "math", "abs", "max", "min"}


def test_quantities_read_well():
    assert (
        quantity(-2.031e8, 4.1e6, "N/m³") == "(−2.031 ± 0.041)·10⁸ N/m³"
        or quantity(-2.031e8, 4.1e6, "N/m³") == "(−2.03 ± 0.04)·10⁸ N/m³"
    )
    assert quantity(-12.03, 0.11, "N") == "−12.03 ± 0.11 N"


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    """Laws for a cubic spring in sway that the independent simulator hid, the search for what it acts on left out."""
    folder = tmp_path_factory.mktemp("spring") / "rig"
    truth = write_campaign(folder, 1, names=[("sway_cubic_spring", None)], design="coasting", faint=300, clear=600)
    campaign = load_campaign(folder)
    campaign = replace(campaign, runs=campaign.runs[:5])
    problem, base, _ = base_fit(campaign, Model.default())
    task, state = Task(problem), State(base)
    found = [x for x in laws(problem, base, linearise_all(problem, base), ["sway"]) if x.variable == "sway"]
    state = with_law(task, state, next(f for f in found if f.acts_on == "sway"))
    unknown = answer.unknown_of(state, problem)
    return truth, unknown, propose_laws(task, state, unknown, problem.sigma)


def test_a_hidden_spring_comes_back_as_a_law(spring):
    truth, unknown, found = spring
    best = found.proposed[0]
    assert best.name == "proposed_cubic_sway_on_sway" and best.evidence > 0
    value, std, unit = best.parameters["coefficient"]
    assert unit == "N/m³" and abs(value + truth["unknown"][0]["parameters"]["stiffness"]) < 4 * std
    assert np.abs(best.force - unknown.force)[40:-40].max() < 3 * unknown.band[40:-40].max()
    assert "stop or guide" in best.words and "proposed" in found.code.lower()
    assert [law.p_value > 0.001 for law in found.proposed]


def test_the_law_is_written_and_its_model_runs_it(spring, tmp_path):
    _, _, found = spring
    found.write(tmp_path, "Proposed.")
    model = Model.load(tmp_path / "model_proposed.yaml")
    name = found.proposed[0].name
    assert name in model.effects and not any(e.startswith("stand_in") for e in model.effects)
    value, _, _ = found.proposed[0].parameters["coefficient"]
    x = model.initial_state(surge_rate=20.0, sway=0.002)
    assert model.wrenches(x, 0.0, 0.0)[name][1] == pytest.approx(value * 0.002**3)
