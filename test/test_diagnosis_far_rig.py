# SPDX-License-Identifier: Apache-2.0
"""A rig that is not the paper's: one degree of freedom, a shape factor twenty times smaller, a sensor that reads to 0.1
mm.

The data come from a few lines of scipy, apart from the library: a plate over coils whose mean force falls as
exp(−z/z0), with a linear damping, let go from below its place of rest."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp

from inductrack_ros.checks.finding import WARNING, Finding
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis import strategy
from inductrack_ros.diagnosis.diagnose import base_fit, diagnose
from inductrack_ros.diagnosis.leads import best_lead
from inductrack_ros.diagnosis.moves import State, Task

MASS, GRAVITY, FALL, REST, DAMPING = 0.107, 9.81, 5.3e-3, 11.3e-3, 0.8  # kg, m/s², m, m, N·s/m
NOMINAL_GAP = 10e-3


def plate(folder, read, noise_std, warming=0.0, curl=0.0):
    """Write the campaign; ``read`` is what the sensor makes of the true height over the nominal gap (m).

    Its force fades by the part ``warming`` within a second, and falls with height as if ``curl`` of it came from
    something smaller."""

    def slope(t, y):
        lift = (1 - curl) * np.exp((REST - y[0]) / FALL) + curl * np.exp((REST - y[0]) / (0.5 * FALL))
        return [y[1], GRAVITY * (lift * (1 - warming * (1 - np.exp(-t))) - 1) - DAMPING / MASS * y[1]]

    times = np.arange(0, 1.7, 0.01)
    height = solve_ivp(slope, (0, 1.7), [3.7e-3, 0.0], t_eval=times, rtol=1e-10, atol=1e-12).y[0]
    rows = zip(times, read(height - NOMINAL_GAP), strict=True)
    (folder / "plate.csv").write_text("time,heave\n" + "".join(f"{t:.3f},{h:.7f}\n" for t, h in rows))
    (folder / "rig.yaml").write_text(
        yaml.safe_dump({"wavelength": 4 * np.pi * FALL, "mass": MASS, "width_side": 0.0, "dof": 1})
    )
    run = {"file": "plate.csv", "drive_current": 0.0, "initial_state": {"surge": 0.0, "surge_rate": 20.0}}
    description = {"name": "plate", "dof": 1, "model": "rig.yaml", "free": ["eta"], "runs": [run], **noise_std}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(description))
    return load_campaign(folder)


def worse(folder):
    """A plate whose lift is not the model's: damping is all that a catalogue has of it."""
    return plate(folder, lambda height: np.round(height, 4), {"noise_std": {"heave": 3e-5}}, warming=0.05, curl=0.3)


def check(found):
    assert found.verdict == "missing_effect" and found.effects == ("heave_damping",)
    value, deviation = found.parameters["heave_damping.coefficient"]
    assert value == pytest.approx(DAMPING, abs=4 * deviation) and deviation < 0.03 * DAMPING
    assert found.steps[0].reduced_chi2 > 100 * found.steps[-1].reduced_chi2


@pytest.mark.nightly
def test_damping_of_a_plate_is_found_from_far_off(tmp_path):
    campaign = plate(tmp_path, lambda height: np.round(height, 4), {"noise_std": {"heave": 3e-5}})
    check(diagnose(campaign, Model.load(campaign.model)))


def test_noise_is_taken_anew_once_the_misfit_is_gone(tmp_path):
    """Ringing at a hundred samples a second looks like noise until it is explained."""
    noise = 3e-5 * np.random.default_rng(1).standard_normal(170)
    campaign = plate(tmp_path, lambda height: height + noise, {})
    found = diagnose(campaign, Model.load(campaign.model))
    check(found)
    assert found.noise["heave"] == pytest.approx(3e-5, rel=0.2)


@pytest.mark.nightly
def test_damping_is_found_beside_a_wrong_law_of_lift(tmp_path):
    """A force in heave on heave is what is wrong; the search finds it, and a harmonic besides that only helps it
    along."""
    campaign = plate(tmp_path, lambda height: np.round(height, 4), {"noise_std": {"heave": 3e-5}}, curl=0.2)
    found = diagnose(campaign, Model.load(campaign.model))
    assert found.verdict == "unknown_effect" and found.unknown.channel == "heave"
    value, deviation = found.parameters["heave_damping.coefficient"]
    assert value == pytest.approx(DAMPING, abs=4 * deviation)
    assert found.effects == ("heave_damping",)


@pytest.mark.nightly
def test_damping_is_named_and_something_is_left(tmp_path):
    found = diagnose(worse(tmp_path), Model.load(tmp_path / "rig.yaml"))
    assert found.verdict == "unknown_effect" and found.effects[:1] == ("heave_damping",)


def test_what_predicts_a_far_rig_best_is_the_lead(tmp_path):
    """The lift falls otherwise with height and fades in time: beside a shaken plant a dozen effects promise more."""
    campaign = worse(tmp_path)
    problem, base, _ = base_fit(campaign, Model.load(campaign.model))
    start = State(base)
    lead = best_lead(Task(problem, ("heave",)), start)
    assert lead.added == ("heave_damping",) and "open-loop" in lead.log[-1]
    promised = lead.rounds[-1][1].singles
    assert [s.members[0].name for s in promised].index("heave_damping") > 3


def test_where_more_is_missing_than_may_be_added_the_lead_is_named(tmp_path, monkeypatch):
    campaign = worse(tmp_path)
    problem, base, _ = base_fit(campaign, Model.load(campaign.model))
    filled = lambda task, state: replace(state, far=True, log=("more would pay",))  # noqa: E731
    monkeypatch.setattr(strategy, "ADDING", (("known effects", filled),))
    found = strategy.search(Task(problem, ("heave",)), State(base))
    assert found.added == ("heave_damping",) and found.far and found.verdict == "unknown_effect"
    assert found.log[0] == "more would pay" and "open-loop" in found.log[1]


def test_a_lead_that_leaves_noise_is_the_answer(tmp_path, monkeypatch):
    """What else is missing is asked beside it."""
    noise = 3e-5 * np.random.default_rng(1).standard_normal(170)
    campaign = plate(tmp_path, lambda height: height + noise, {"noise_std": {"heave": 3e-5}})
    problem, base, _ = base_fit(campaign, Model.load(campaign.model))
    asked = []

    def filled(task, state):
        asked.append(state.added)
        return state if state.added else replace(state, far=True)

    monkeypatch.setattr(strategy, "ADDING", (("known effects", filled),))
    monkeypatch.setattr(strategy, "REVISING", ())
    found = strategy.search(Task(problem, ("heave",)), State(base))
    assert found.added == ("heave_damping",) and not found.far and found.verdict == "missing_effect"
    assert asked == [(), ("heave_damping",)]


def test_what_promises_much_and_keeps_none_says_that_something_is_missing(tmp_path, monkeypatch):
    """No stage adds anything, and the scores still promise a thousand times what chance would."""
    campaign = worse(tmp_path)
    problem, base, _ = base_fit(campaign, Model.load(campaign.model))
    monkeypatch.setattr(strategy, "ADDING", ())
    monkeypatch.setattr(strategy, "REVISING", ())
    found = strategy.search(Task(problem, ("heave",)), State(base))
    assert found.far and found.verdict == "unknown_effect" and found.added == ("heave_damping",)
    assert "promises much" in found.log[0] and "open-loop" in found.log[1]


def test_a_ctrl_c_while_a_lead_is_sought_ends_the_search(monkeypatch):
    def interrupted(task, state, rival):
        raise KeyboardInterrupt

    filled = lambda task, state: replace(state, far=True)  # noqa: E731
    monkeypatch.setattr(strategy, "ADDING", (("known effects", filled),))
    monkeypatch.setattr(strategy, "best_lead", interrupted)
    assert strategy.search(Task(None), State(None)).stopped == "interrupted"


def test_an_answer_of_more_effects_than_are_sought_is_in_doubt(tmp_path, monkeypatch):
    """A set that is added last may lead beyond the most: its effects are then only like what is missing."""
    campaign = worse(tmp_path)
    problem, base, _ = base_fit(campaign, Model.load(campaign.model))
    many = ("dead_coils", "joint_step", "heave_spring", "sensor_saturation:heave")
    monkeypatch.setattr(strategy, "ADDING", (("known effects", lambda task, state: replace(state, added=many)),))
    monkeypatch.setattr(strategy, "REVISING", ())
    monkeypatch.setattr(strategy, "last_screened", lambda task, state: state)
    found = strategy.search(Task(problem, ("heave",)), State(base))
    assert found.added == ("heave_damping",) and found.far and found.verdict == "unknown_effect"
    assert found.log[0].startswith("4 effects are more than 3") and "open-loop" in found.log[1]


@pytest.mark.parametrize("predicts", [False, True])
def test_one_effect_that_predicts_better_is_named_where_the_rig_is_unlike_the_model(tmp_path, monkeypatch, predicts):
    """The look at the data saw that no small effect makes the difference: several are then held against one."""
    campaign = worse(tmp_path)
    problem, base, _ = base_fit(campaign, Model.load(campaign.model))
    task = Task(problem, ("heave",), (Finding("unlike", WARNING, "heave moves by other forces", channel="heave"),))
    found_first = replace(best_lead(task, State(base)) if predicts else State(base), added=("one", "other"), far=False)
    monkeypatch.setattr(strategy, "ADDING", (("known effects", lambda task, state: found_first),))
    monkeypatch.setattr(strategy, "REVISING", ())
    monkeypatch.setattr(strategy, "last_screened", lambda task, state: state)
    monkeypatch.setattr(strategy, "unkept", lambda state: "")
    found = strategy.search(task, State(base))
    assert found.added == (("one", "other") if predicts else ("heave_damping",))
