# SPDX-License-Identifier: Apache-2.0
"""Idea: campaigns of an independent simulator with known answers; the verdict, the sizes, and runs the fit never
saw."""

from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import diagnose
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure

PRACTICE = Path(__file__).parent / "data" / "practice"
NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}

ANSWERS = {
    "p1_nothing": ("adequate", {}),
    "p2_contact": ("missing_effect", {"sliding_friction.coefficient": 0.22}),
    "p3_coast": ("missing_effect", {"aerodynamic_drag.drag_area": 0.02}),
    "p4_bounce": ("missing_effect", {"heave_damping.coefficient": 9.0}),
    "p5_two": ("missing_effect", {"track_slope.angle": 0.005, "roll_damping.coefficient": 0.07}),
    "p7_sensor": ("missing_effect", {"sensor_delay:heave.delay": 0.003}),
    "p8_drive": ("missing_effect", {"drive_back_emf.cutoff_speed": 220.0}),
}


def unseen_error(name: str, model: Model) -> float:
    """RMS error over noise on the held-out runs, open loop from their exact initial states."""
    campaign = load_campaign(PRACTICE / f"{name}.heldout")
    problem = Problem(campaign, model, NOISE | dict(campaign.noise_std))
    rest = problem.residuals(Structure(model, ()), np.zeros(0), [d.guess for d in problem.runs])
    rest = np.concatenate(rest)
    return float(np.sqrt(np.nanmean(rest**2)))


@pytest.mark.parametrize(
    "name", [n if n == "p1_nothing" else pytest.param(n, marks=pytest.mark.nightly) for n in ANSWERS]
)
def test_practice(name):
    verdict, parameters = ANSWERS[name]
    found = diagnose(load_campaign(PRACTICE / name), Model.default())
    assert found.verdict == verdict
    assert set(found.effects) == {p.rpartition(".")[0] for p in parameters}
    for parameter, truth in parameters.items():
        value, std = found.parameters[parameter]
        assert abs(value - truth) < 4 * std, parameter
    assert unseen_error(name, found.model) < 1.5
    assert found.indistinguishable == {}
    if found.effects:
        assert found.steps[-1].heldout_nrmse < found.steps[0].heldout_nrmse
        assert found.steps[-1].reduced_chi2 == pytest.approx(1.0, abs=0.05)


@pytest.mark.nightly
def test_an_unknown_is_admitted_and_stood_in_for():
    """A magnetised patch pulls down, 12 N·exp(−((z − 8)/0.6)²): no effect of the catalogue."""
    found = diagnose(load_campaign(PRACTICE / "p6_odd"), Model.default())
    assert found.verdict == "unknown_effect"
    assert found.effects == ()
    assert found.unknown.channel == "heave"
    assert found.unknown.depends_on == ("surge",)
    truth = -12 * np.exp(-(((found.unknown.at - 8) / 0.6) ** 2))
    near = (found.unknown.at > 5) & (found.unknown.at < 12)
    assert np.abs(found.unknown.force - truth)[near].max() < 1.5
    assert found.next_experiment
    assert "stand_in_heave" in found.model.effects
    best = found.laws.proposed[0]
    assert best.name == "proposed_bump_heave_on_surge"
    for parameter, size in {"force": -12.0, "place": 8.0, "width": 0.6}.items():
        value, std, _ = best.parameters[parameter]
        assert abs(value - size) < 4 * std, parameter
    assert best.heldout_nrmse < 1.2
    assert unseen_error("p6_odd", found.model) < 3.0
