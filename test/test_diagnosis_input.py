# SPDX-License-Identifier: Apache-2.0
"""Idea: data that cannot support a diagnosis get one that says so; never a stack trace, never a confident guess."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.data.measurement import Run
from inductrack_ros.diagnosis.diagnose import diagnose

CHANNELS = ("surge", "sway", "heave", "roll")
NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}


def simulated(speeds, seconds=0.4, rate=250.0, current=0.0, model=None, seed=0, scale=1.0) -> Campaign:
    """A small campaign of the library's own model: enough for what is said about data, not for whether a diagnosis is
    right."""
    model = model or Model.default()
    rng = np.random.default_rng(seed)
    runs = []
    for i, speed in enumerate(speeds):
        start = model.initial_state(surge_rate=speed)
        start[[1, 2, 3]] += rng.uniform(-1, 1, 3) * (2e-3, 5e-4, 2e-3)
        times = np.arange(0, seconds, 1 / rate)
        truth = model.simulate(times, start, drive_current=current)
        values = np.column_stack([truth[c] + scale * NOISE[c] * rng.standard_normal(times.size) for c in CHANNELS])
        runs.append(Run(f"run_{i}", Path(f"run_{i}.csv"), CHANNELS, times, values, times, current))
    return Campaign("small", Path("small"), tuple(runs), NOISE)


def test_a_complete_model_is_adequate_and_says_what_could_hide():
    found = diagnose(simulated([18, 22, 27, 33], seconds=0.6), Model.default())
    assert found.verdict == "adequate"
    assert found.effects == ()
    limits = {x.name: x.size for x in found.limits}
    assert 0 < limits["heave_damping"] < 100
    assert 0 < limits["aerodynamic_drag"] < 1
    assert any("gamma cannot be determined" in n for n in found.notes)  # coasting only
    assert any("coasting runs only" in n for n in found.notes)


def test_runs_too_short_for_a_test_of_whiteness_may_be_adequate():
    """Forty samples of a channel in a run."""
    assert diagnose(simulated([18, 22, 27, 33, 38], rate=100.0), Model.default()).verdict == "adequate"


def test_too_few_samples():
    campaign = simulated([20.0], seconds=0.05)
    with pytest.raises(InputError, match="needs at least"):
        diagnose(campaign, Model.default())


def test_one_run_at_one_speed_is_said():
    found = diagnose(simulated([20.0]), Model.default())
    assert any("only 1 run" in n for n in found.notes)
    found = diagnose(simulated([20.0, 20.1]), Model.default())
    assert any("one speed" in n for n in found.notes)


def test_a_dead_sensor_is_named():
    campaign = simulated([20.0, 25.0])
    runs = [replace(r, values=np.where(np.array(CHANNELS) == "roll", 0.001, r.values)) for r in campaign.runs]
    with pytest.raises(InputError, match="roll is 0.001 in every sample"):
        diagnose(replace(campaign, runs=tuple(runs)), Model.default())


def test_runs_that_disagree_are_named():
    """A magnet was changed between two runs and the others."""
    weak = Model.default().with_changes({"eta": 0.735})
    one, other = simulated([18, 22, 27, 33]), simulated([24], model=weak, seed=5)
    odd = replace(other.runs[0], name="after_the_change")
    found = diagnose(replace(one, runs=(*one.runs, odd)), Model.default())
    assert found.verdict == "adequate"
    assert [(f.kind, f.run) for f in found.findings if f.kind in ("bad_run", "run_to_run")] == [
        ("bad_run", "after_the_change")
    ]


def test_no_speed_is_one_line():
    campaign = simulated([20.0, 25.0])
    runs = [replace(r, channels=CHANNELS[1:], values=r.values[:, 1:]) for r in campaign.runs]
    with pytest.raises(InputError, match="nothing tells the speed"):
        diagnose(replace(campaign, runs=tuple(runs)), Model.default())


def test_misstated_noise_is_said_not_explained():
    found = diagnose(simulated([18, 22, 27, 33], seconds=0.6, scale=0.5), Model.default())
    assert found.verdict == "adequate"
    ratios = [f.size["ratio"] for f in found.findings if f.kind == "noise_differs"]
    assert ratios == pytest.approx([0.5] * len(CHANNELS), rel=0.05)


def test_practice_campaign_loads_where_the_tests_expect_it():
    assert len(load_campaign(Path(__file__).parent / "data" / "practice" / "p1_nothing").runs) == 12
