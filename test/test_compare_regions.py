# SPDX-License-Identifier: Apache-2.0
"""Where a model fails, in words: regions that the runs cannot tell apart are named together, others are not."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from test_compare import make_campaign

from inductrack_ros.compare import compare
from inductrack_ros.comparison.outstanding import Region, outstanding
from inductrack_ros.comparison.result import RunComparison
from inductrack_ros.comparison.stretches import stretches
from inductrack_ros.core.model import Model
from inductrack_ros.data import Run, load_campaign
from inductrack_ros.reports.compare_report import compare_report, model_words

N = 400


def run_of(speed: np.ndarray, gap: np.ndarray, place: np.ndarray, bad: np.ndarray, seed: int) -> RunComparison:
    """A run whose restarted error is noise, and four times that where ``bad``."""
    random = np.random.default_rng(seed)
    times = np.arange(N) * 0.002
    sigmas = random.standard_normal((N, 1)) * np.where(bad, 4.0, 1.0)[:, None]
    run = Run(f"run_{seed}", Path("run.csv"), ("heave",), times, np.zeros((N, 1)), times)
    conditions = {"speed": speed, "gap": gap, "place": place, "contact": np.zeros(N)}
    return RunComparison(run, {"surge_rate": float(speed[0])}, (), np.zeros((N, 1)), sigmas, sigmas, conditions, None)


def found(runs: list[RunComparison]):
    return outstanding(runs, stretches(tuple(runs)), ("heave",))


def test_what_runs_cannot_tell_apart_is_named_together():
    """One run gains speed while its gap opens: above 34 m/s is above 6 mm. A second at other gaps tells them apart."""
    rise = np.linspace(0.0, 1.0, N)
    speed, gap, place = 30 + 8 * rise, 4e-3 + 4e-3 * rise, 20 * rise
    one = run_of(speed, gap, place, speed > 34, 0)
    both = found([one])
    assert {r.by for r in both.regions} == {"speed", "gap", "place"} and both.channel == "heave"
    limits = {r.by: (r.low, r.high) for r in both.regions}
    assert limits["speed"] == (34.0, None) and limits["gap"] == (pytest.approx(6e-3), None)
    assert both.inside == pytest.approx(4.0, rel=0.1) and both.outside == pytest.approx(1.0, abs=0.1)
    other = run_of(speed, gap[::-1], place + 20, speed > 34, 1)
    assert found([one, other]).regions == (Region("speed", 34.0, None),)


def test_nothing_is_named_where_all_is_noise_or_all_is_wrong():
    rise = np.linspace(0.0, 1.0, N)
    for bad in (np.zeros(N, bool), np.ones(N, bool)):
        assert found([run_of(30 + 8 * rise, 4e-3 + 4e-3 * rise, 20 * rise, bad, 3)]) is None
    without = replace(run_of(30 + 8 * rise, 4e-3 * rise, 20 * rise, rise > 0.5, 3), restarted=None)
    assert found([without]) is None


def test_the_page_names_the_regions_and_a_refitted_model(tmp_path):
    rise = np.linspace(0.0, 1.0, N)
    bad = run_of(30 + 8 * rise, 4e-3 + 4e-3 * rise, 20 * rise, rise > 0.5, 0)
    made = compare(load_campaign(make_campaign(tmp_path / "c", Model.default(), duration=0.3)), Model.default())
    assert model_words(made) == "Model: the paper's model, no effect added."
    wrong = replace(made, runs=tuple(replace(r, sigmas=9 * r.sigmas) for r in made.runs), outstanding=found([bad]))
    page = compare_report(wrong)
    sentence = re.search(r"Most goes wrong (.*?)</strong>", page)[1]
    where, apart = sentence.split(" (")
    assert apart == "these runs cannot tell which), in heave"
    assert set(re.split(", | or ", where)) == {"above 34 m/s", "at a top gap above 6 mm", "beyond 10 m of the track"}
    refitted = replace(made, model=Model.create({"eta": 0.75}, effects={"aerodynamic_drag": {}}))
    assert (
        model_words(refitted)
        == "Model: aerodynamic drag added to the paper's model, refitted: eta 0.75 instead of 0.7295."
    )


def test_a_campaign_with_a_model_of_its_own_is_not_called_refitted(tmp_path):
    folder = make_campaign(tmp_path / "c", Model.create({"mass": 8.0}), duration=0.3)
    Model.create({"mass": 8.0}).save(folder / "rig.yaml")
    text = yaml.safe_load((folder / "campaign.yaml").read_text()) | {"model": "rig.yaml"}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(text))
    campaign = load_campaign(folder)
    result = compare(campaign, campaign.load_model())
    assert model_words(result) == "Model: the campaign's model, no effect added."
    assert (
        model_words(replace(result, model=Model.create({"mass": 8.5})))
        == "Model: the campaign's model, no effect added, refitted: mass 8.5 instead of 8."
    )


def test_pulses_are_not_called_coasting():
    from inductrack_ros.core.model import Pulses

    run = run_of(*[np.ones(N)] * 3, np.zeros(N, bool), 0).run
    pulsed = replace(run, pulses=Pulses(np.array([0.0, 0.1]), np.array([1, 2]), np.array([7e3, -7e3])))
    assert (
        run.driven == "coasting"
        and replace(run, drive_current=7000.0).driven == "7000 A"
        and pulsed.driven == "2 pulses"
    )
