# SPDX-License-Identifier: Apache-2.0
"""Drawn dirt has the size that the truth says, by this generator's own arithmetic."""

import io

import numpy as np
import pytest
import yaml

from independent import campaigns, clarity, dirt, plans, whitened
from independent import simulator as sim

TIMES = np.arange(4000) / 500
PLAN = {"channels": plans.POSE, "noise": {c: plans.NOISE[c] for c in plans.POSE}, "rate": 500.0}
SIGMA = np.array([PLAN["noise"][c] for c in plans.POSE])
RUNS = [{"times": TIMES[:500], "start": np.zeros(8), "drive_current": 7000.0}] * 6


def soiled(name, seed=1):
    """A dirt and what it makes of true readings that are all zero, in units of the stated noise."""
    rng = np.random.default_rng(seed)
    one = dirt.drawn(rng, PLAN, RUNS, [name])
    dirt.set_limits(one, [np.zeros((9, 4))], PLAN)
    return one[0], dirt.on_readings(rng, TIMES, np.zeros((len(TIMES), 4)), PLAN, one, 0) / SIGMA


def columns(one):
    return [plans.POSE.index(c) for c in one["channels"]]


def test_spikes_are_as_many_and_as_large_as_said():
    one, log = soiled("spikes", 3)
    far = np.abs(log[:, columns(one)]) > 9
    assert far.mean() == pytest.approx(one["share"], rel=0.3)
    assert np.abs(log).max() < 66


def test_rounded_readings_are_multiples_of_the_step():
    one, log = soiled("rounding")
    for c, step in one["steps"].items():
        k = plans.POSE.index(c)
        readings = log[:, k] * SIGMA[k]
        assert np.abs(readings / step - np.round(readings / step)).max() < 1e-6


@pytest.mark.parametrize("seed", [1, 2])
def test_coloured_noise_forgets_itself_in_the_time_said(seed):
    one, log = soiled("coloured", seed)
    x = log[:, columns(one)[0]]
    assert np.std(x) == pytest.approx(1, rel=0.2)
    assert -0.002 / np.log(np.corrcoef(x[1:], x[:-1])[0, 1]) == pytest.approx(one["time"], rel=0.4)


def test_hum_has_its_frequency_and_amplitude():
    one, log = soiled("hum")
    x = log[:, columns(one)[0]]
    tone = 2 * np.mean(x * np.exp(-2j * np.pi * one["frequency"] * TIMES))
    assert abs(tone) == pytest.approx(one["amplitude"], rel=0.2)


def test_lost_cells_are_lost_in_stretches():
    one, log = soiled("dropouts")
    lost = np.isnan(log[:, columns(one)[0]])
    assert 0.3 * one["share"] < lost.mean() < 1.2 * one["share"]
    assert lost.sum() / (np.diff(lost.astype(int)) == 1).sum() > 0.3 * one["length"] * 500


@pytest.mark.parametrize("name", ["shaken", "shaken_coloured"])
def test_a_shaking_force_has_the_impulse_said(name):
    rng = np.random.default_rng(3)
    one = dirt.DIRTS[name](rng, PLAN, RUNS)
    span = 0.5
    groups = [dirt.kicks(rng, span, one)[1] for _ in range(150)]
    for c, size in one["sizes"].items():
        k = dirt.COORDINATES.index(c)
        impulses = [g[:, 4 + k].sum() * dirt.INERTIA[k] for g in groups]
        assert np.std(impulses) == pytest.approx(size * np.sqrt(span), rel=0.2)


def test_kicks_reach_the_motion():
    start = np.array([0, 0, -0.004, 0, 20.0, 0, 0, 0])
    jump = np.zeros((1, 8))
    jump[0, 5] = 1e-3
    plain, _ = sim.simulate([0.1, 0.1001], start, 0.0, sim.rig())
    kicked, _ = sim.simulate([0.1, 0.1001], start, 0.0, sim.rig(), kicks=(np.array([0.1]), jump))
    assert kicked[0, 5] - plain[0, 5] == pytest.approx(1e-3, rel=1e-6)
    assert kicked[1, 1] - plain[1, 1] == pytest.approx(1e-7, rel=1e-3)


@pytest.mark.parametrize("names", [["shaken", "coloured"], ["jitter"], ["shaken_coloured", "rounding"]])
def test_the_best_observer_is_left_with_white_noise(names):
    """The filter that says how clear an effect is in dirt: true starts and rig, nothing hidden, unit innovations."""
    contents, truth, _ = campaigns.draw_campaign(7, kind="nothing", design="coasting", dirts=names)
    plan, eta, gamma = truth["plan"], truth["parameters"]["eta"], truth["parameters"]["gamma"]
    tables = [
        np.genfromtxt(io.StringIO(contents[r["file"]]), delimiter=",", skip_header=1)
        for r in yaml.safe_load(contents["campaign.yaml"])["runs"][:3]
    ]
    starts = [np.array([s[c] for c in sim.STATE_CHANNELS]) for s in truth["initial_states"]]
    runs = [{"times": t[:, 0], "start": s, "drive_current": 0.0} for t, s in zip(tables, starts[:3], strict=True)]
    plain = clarity.Experiment(runs, plan["channels"], plan["noise"], eta, gamma)
    best = whitened.Experiment(plain, truth["dirt"])
    left = []
    for k, (table, predicted) in enumerate(zip(tables, plain.predict([]), strict=True)):
        rest = table[:, 1:] / plain.noise - predicted.reshape(table[:, 1:].shape)
        left.append(whitened.innovations(np.ascontiguousarray(rest), *best.filters[k]))
    left = np.concatenate(left)
    left = left[np.isfinite(left).all(axis=1)]
    assert len(left) > 200
    assert np.mean(left**2) == pytest.approx(1, abs=0.1)
    assert np.abs([np.corrcoef(x[1:], x[:-1])[0, 1] for x in left.T]).max() < 4.5 / np.sqrt(len(left))


def test_a_dirty_campaign_and_its_clean_twin_differ_by_the_dirt_alone():
    dirty, clean = (
        campaigns.draw_campaign(32001, kind="dirty_complete", design="coasting", twin=twin) for twin in (False, True)
    )
    assert dirty[1]["parameters"] == clean[1]["parameters"]
    assert dirty[1]["initial_states"] == clean[1]["initial_states"]
    assert dirty[1]["dirt"] and not clean[1]["dirt"]
    assert dirty[0]["campaign.yaml"] == clean[0]["campaign.yaml"] and dirty[0]["run_00.csv"] != clean[0]["run_00.csv"]
