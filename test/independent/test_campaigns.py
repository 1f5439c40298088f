# SPDX-License-Identifier: Apache-2.0
"""Blind campaigns are what their truth says, and the clarity given is the one a real refit finds."""

import io
import json

import numpy as np
import pytest
import yaml

from independent import campaigns, clarity, hidden_effects, hiding, laws, plans
from independent import simulator as sim


def reduced_chi2(contents, truth, states):
    """Of the files against the noiseless truth, samples before the first contact; states: one start per run."""
    config = yaml.safe_load(contents["campaign.yaml"])
    rigs = sim.rig(eta=truth["parameters"]["eta"], gamma=truth["parameters"]["gamma"])
    noise = truth["plan"]["noise"]
    deviations = []
    for run, start in zip(config["runs"], states, strict=True):
        table = np.genfromtxt(io.StringIO(contents[run["file"]]), delimiter=",", names=True)
        channels = list(table.dtype.names[1:])
        start = [start[name] for name in sim.STATE_CHANNELS]
        values, contact = sim.measure(table["time"], start, run["drive_current"], rigs, channels)
        for i, channel in enumerate(channels):
            deviations.append(((table[channel] - values[:, i]) / noise[channel])[table["time"] < contact])
    stacked = np.concatenate(deviations)
    return np.nanmean(stacked**2), np.isfinite(stacked).sum()


def test_nothing_hidden_leaves_noise():
    contents, truth, heldout = campaigns.draw_campaign(12, kind="nothing", design="mixed")
    exact = [run["initial_state"] for run in yaml.safe_load(heldout["campaign.yaml"])["runs"]]
    for files, states in ((contents, truth["initial_states"]), (heldout, exact)):
        chi2, n = reduced_chi2(files, truth, states)
        assert abs(chi2 - 1) < 5 * np.sqrt(2 / n)
    assert truth["verdict"] == "adequate" and truth["effects"] == []


def test_same_seed_same_campaign():
    assert campaigns.draw_campaign(4) == campaigns.draw_campaign(4)


def test_written_files(tmp_path):
    truth = campaigns.write_campaign(tmp_path / "blind", 5, kind="sensor", design="mixed")
    assert json.loads((tmp_path / "blind.truth.json").read_text())["effects"] == truth["effects"]
    config = yaml.safe_load((tmp_path / "blind" / "campaign.yaml").read_text())
    assert all((tmp_path / "blind" / run["file"]).exists() for run in config["runs"])
    assert "initial_state" not in config["runs"][0]
    assert "initial_state" in yaml.safe_load((tmp_path / "blind.heldout" / "campaign.yaml").read_text())["runs"][0]
    assert truth["effects"][0].startswith("sensor_") and ":" in truth["effects"][0]


@pytest.mark.parametrize("kind", campaigns.KINDS)
def test_verdict_of_each_kind(kind):
    _, truth, _ = campaigns.draw_campaign(20, kind=kind, design="mixed")
    expected = {"nothing": "adequate", "unknown": "unknown_effect"}.get(kind, "missing_effect")
    assert truth["verdict"] == expected
    assert len(truth["effects"]) == {"single": 1, "two": 2, "three": 3, "sensor": 1}.get(kind, len(truth["effects"]))


@pytest.mark.parametrize("name", ["heave_damping", "track_slope", "drive_droop"])
def test_clarity_is_what_a_refit_finds(name):
    """The linear signal_after_nuisance against a Gauss-Newton refit of the effect-free model."""
    rng = np.random.default_rng(1)
    plan = {**plans.draw_plan(rng, "mixed"), "channels": plans.POSE, "noise": plans.NOISE, "length": 0.8}
    runs = plans.draw_runs(rng, plan, sim.rig(), 6)
    experiment = clarity.Experiment(runs, plan["channels"], plan["noise"], 0.7295, 3.9298)
    effect = hiding.draw_effect(rng, name, experiment, lambda past: experiment.nuisance([]), 25.0)
    linear = clarity.signals(experiment, [effect])[0]["signal_after_nuisance"]
    assert linear == pytest.approx(25, rel=0.2)  # sized at zero strength, measured at the truth
    assert clarity.refit(experiment, experiment.predict([effect]), []) == pytest.approx(linear, rel=0.1)


def test_known_twins_imitate_each_other():
    """effects.md's algebra: array asymmetry and a bias of the sway sensor are the same to first order."""
    _, truth, _ = campaigns.draw_campaign(12, "single", "mixed", [("array_asymmetry", None)], clear=60.0, twins=True)
    numbers = truth["clarity"]["array_asymmetry"]
    assert numbers["imitations"]["sensor_bias:sway"] < 0.1 * numbers["signal_after_nuisance"]


@pytest.mark.parametrize("name", ["dead_coils", "joint_step", "track_temperature", "sensor_lag"])
def test_effects_of_november_are_drawn_from_the_whole_catalogue(name):
    """They show as clearly as asked, on runs of warm and cold days; without `whole` a seed's campaign is what it
    was."""
    channel = "heave" if name.startswith("sensor_") else None
    contents, truth, _ = campaigns.draw_campaign(
        31, "single", "coasting", [(name, channel)], faint=40.0, clear=60.0, whole=True
    )
    shown = truth["clarity"][f"{name}:{channel}" if channel else name]["signal_after_nuisance"]
    assert 20 < shown < 120
    days = [run["conditions"]["track_temperature"] for run in yaml.safe_load(contents["campaign.yaml"])["runs"]]
    assert np.ptp(days) > 10
    assert "conditions" not in campaigns.draw_campaign(31, "nothing", "coasting")[0]["campaign.yaml"]


@pytest.mark.parametrize(
    "name", [*hidden_effects.CATALOGUE, *hidden_effects.OUTSIDE, *hidden_effects.PLANT, *laws.LAWS]
)
def test_every_effect_can_be_drawn(name):
    """The simulator has the fields each entry of the tables sets."""
    row = hidden_effects.table_of(name)
    effect = hidden_effects.with_size(name, row["limits"][0], 1.0, row["shapes"](np.random.default_rng(0), 20.0))
    clarity.rig_of(0.73, 3.9, [effect])


@pytest.mark.parametrize("name", ["law_roll_linear_roll_surge_rate", "law_sway_dead_zone_sway", "law_heave_step_time"])
def test_a_law_acts_on_its_coordinate_as_it_is_told(name):
    """Size times form times the second variable, over the inertia, by arithmetic of this test."""
    t, state = 0.4, np.array([3.0, 2e-3, -4e-3, 5e-3, 24.0, 0.02, 0.03, 0.1, 0, 0, 0, 0])
    effect = hidden_effects.with_size(
        name, 0.5, 1.0, hidden_effects.table_of(name)["shapes"](np.random.default_rng(0), 20)
    )
    with_it, without = np.empty(12), np.empty(12)
    sim.derivative(t, state, 0.0, clarity.rig_of(0.73, 3.9, [effect])[0], with_it)
    sim.derivative(t, state, 0.0, clarity.rig_of(0.73, 3.9, [])[0], without)
    told = laws.told(name, effect["parameters"])["parameters"]
    expected = {
        "law_roll_linear_roll_surge_rate": lambda: -0.5 * (5e-3 / 2e-3) * (24.0 / 20.0) ** 2 / 0.091,
        "law_sway_dead_zone_sway": lambda: told["slope"] * (2e-3 - told["clearance"]) / 9.3,
        "law_heave_step_time": lambda: 0.5 * told["force"] * (1 + np.tanh((t - told["place"]) / told["width"])) / 9.3,
    }[name]()
    at = {"roll": 7, "sway": 5, "heave": 6}[hidden_effects.table_of(name)["channel"]]
    assert expected != 0 and with_it[at] - without[at] == pytest.approx(expected, rel=1e-9)
    assert np.delete(with_it - without, at) == pytest.approx(np.zeros(11), abs=1e-12)
