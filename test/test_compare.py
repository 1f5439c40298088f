# SPDX-License-Identifier: Apache-2.0
"""Comparison of a model with measurements: a right one is at the noise, a wrong one is shown where it is wrong."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from inductrack_ros.compare import compare
from inductrack_ros.comparison.files import to_json, write_results
from inductrack_ros.comparison.result import rms
from inductrack_ros.comparison.stretches import nice_edges
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign, write_csv

NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}
RUNS = ((15.5, 0.002, 7000.0), (22.0, -0.003, 0.0))
OWN = Path(__file__).with_name("own_effects.py")


def make_campaign(
    folder: Path,
    model: Model,
    duration: float = 0.6,
    given: bool = False,
    noise: bool = True,
    channels=tuple(NOISE),
    holes: int = 0,
    step: float = 0.002,
    rounded: float = 0.0,
    noise_std=NOISE,
) -> Path:
    """A campaign of `RUNS` that ``model`` really made, seen through noisy sensors."""
    random = np.random.default_rng(4)
    folder.mkdir(parents=True)
    entries = []
    for i, (speed, sway, current) in enumerate(RUNS):
        times = np.arange(0, duration, step)
        state = model.initial_state(surge_rate=speed, sway=sway)
        truth = model.simulate(times, state, current, further=True)
        columns = {c: truth[c] + random.normal(0, noise_std[c], times.size) for c in channels}
        if rounded:
            columns["heave"] = np.round(columns["heave"] / rounded) * rounded
        if holes:
            columns["heave"][::holes] = np.nan
        write_csv(folder / f"run_{i}.csv", times, columns)
        entry = {"file": f"run_{i}.csv", "drive_current": current}
        if given:
            entry["initial_state"] = {
                "surge_rate": speed,
                "sway": sway,
                "heave": float(state[2]),
                "surge": 0.0,
                "roll": 0.0,
            }
            entry["initial_state"] |= {"sway_rate": 0.0, "heave_rate": 0.0, "roll_rate": 0.0}
        entries.append(entry)
    stated = {"noise_std": {c: noise_std[c] for c in channels}} if noise else {}
    (folder / "campaign.yaml").write_text(yaml.safe_dump({"name": "made <here>", "runs": entries, **stated}))
    return folder


@pytest.fixture(scope="module")
def dragged(tmp_path_factory) -> Path:
    """A campaign of a cradle with air drag that the default model does not know."""
    model = Model.create(effects={"aerodynamic_drag": {"drag_area": 0.05}})
    return make_campaign(tmp_path_factory.mktemp("dragged") / "campaign", model)


@pytest.mark.parametrize("given", [True, False])
def test_the_model_that_made_the_data_is_at_the_noise(tmp_path, given):
    result = compare(load_campaign(make_campaign(tmp_path / "c", Model.default(), given=given)), Model.default())
    assert result.error == pytest.approx(1.0, abs=0.05)
    assert all(e == pytest.approx(1.0, abs=0.1) for e in result.errors.values())
    assert all(r.holds_for is None for r in result.runs)
    assert all((r.estimated == ()) == given for r in result.runs)


def test_a_missing_drag_shows_in_the_open_loop_of_surge(dragged):
    result = compare(load_campaign(dragged), Model.default())
    assert result.worst_channel == "surge"
    assert result.errors["surge"] > 10
    assert result.errors["sway"] < 0.1 * result.errors["surge"]
    assert all(0.1 < r.holds_for < 0.5 for r in result.runs)
    improved = compare(load_campaign(dragged), Model.create(effects={"aerodynamic_drag": {"drag_area": 0.05}}))
    assert improved.error == pytest.approx(1.0, abs=0.05)


def test_a_patch_on_the_track_shows_at_its_place_when_restarted(tmp_path):
    made = make_campaign(tmp_path / "c", Model.create(effects=["patch"], effect_files=[OWN]))
    result = compare(load_campaign(made), Model.default())
    places = [s for s in result.stretches if s.by == "place"]
    worst = max(places, key=lambda s: s.restarted)
    assert worst.low <= 5.0 <= worst.high
    assert max(worst.restarted_errors, key=worst.restarted_errors.get) == "heave"
    far = [s.restarted for s in places if s.high < 3.0 or s.low > 7.0]
    assert max(far) < 1.2 < 3.0 < worst.restarted


def test_stretches_cover_the_samples_once(dragged):
    result = compare(load_campaign(dragged), Model.default())
    samples = sum(len(r.run.times) for r in result.runs)
    for by in ("speed", "gap", "place", "contact"):
        stretches = [s for s in result.stretches if s.by == by]
        assert sum(s.samples for s in stretches) == samples
        total = np.sqrt(sum(s.samples * s.error**2 for s in stretches) / sum(s.samples for s in stretches))
        assert total == pytest.approx(result.error, rel=1e-9)


def test_predictions_have_the_measured_times_and_channels(tmp_path):
    campaign = load_campaign(make_campaign(tmp_path / "c", Model.default(), holes=3, channels=("surge", "heave")))
    out = tmp_path / "out"
    out.mkdir()
    write_results(compare(campaign, Model.default()), out)
    for run in campaign.runs:
        measured = list(csv.reader(run.file.open()))
        predicted = list(csv.reader((out / f"{run.name}.predicted.csv").open()))
        assert predicted[0] == measured[0]
        assert [float(r[0]) for r in predicted[1:]] == [float(r[0]) for r in measured[1:]]
        assert all(cell for row in predicted for cell in row)


def test_the_json_is_plain_and_complete(dragged, tmp_path):
    result = compare(load_campaign(dragged), Model.default())
    write_results(result, tmp_path)
    read = json.loads((tmp_path / "comparison.json").read_text())
    assert read == json.loads(json.dumps(to_json(result), allow_nan=False))
    assert read["runs"][0]["estimated"] == [
        "surge",
        "sway",
        "heave",
        "roll",
        "surge_rate",
        "sway_rate",
        "heave_rate",
        "roll_rate",
    ]
    assert read["noise_std"]["heave"] == {"value": 3e-5, "given": True}
    assert {s["by"] for s in read["stretches"]} >= {"speed", "gap", "place", "contact"}


def test_a_late_sensor_is_predicted_late(tmp_path):
    late = Model.create(effects={"sensor_delay:heave": {"delay": 0.004}})
    result = compare(load_campaign(make_campaign(tmp_path / "c", Model.default())), late)
    r = result.runs[0]
    column = r.run.channels.index("heave")
    assert np.isnan(r.sigmas[:2, column]).all() and np.isfinite(r.sigmas[2:, column]).all()
    assert np.isfinite(r.predicted).all()


@pytest.mark.parametrize("step", [1, 5])
def test_noise_is_estimated_where_it_is_not_given(tmp_path, step):
    """Also at 100 Hz, where the motion bends between samples, and with a model that is not quite right."""
    made = make_campaign(tmp_path / "c", Model.default(), duration=1.0, noise=False, holes=7, step=0.002 * step)
    result = compare(load_campaign(made), Model.create({"eta": 0.731}))
    assert not result.noise_given
    for channel, estimate in result.noise.items():
        assert estimate == pytest.approx(NOISE[channel], rel=0.25 if step > 1 else 0.1)


def test_a_sensor_that_rounds_is_no_better_than_its_steps(tmp_path):
    made = make_campaign(tmp_path / "c", Model.default(), noise=False, channels=("surge", "heave"), rounded=1e-3)
    result = compare(load_campaign(made), Model.default())
    assert 0.2e-3 < result.noise["heave"] < 0.5e-3


def test_a_channel_without_noise_asks_for_it(tmp_path):
    folder = tmp_path / "c"
    folder.mkdir()
    write_csv(folder / "a.csv", np.arange(0, 1, 0.01), {"surge": np.arange(0, 10, 0.1), "heave": np.zeros(100)})
    (folder / "campaign.yaml").write_text("runs: [{file: a.csv, drive_current: 0}]\nnoise_std: {surge: 1.0e-3}\n")
    with pytest.raises(InputError, match=r"heave is 0 in every sample: the sensor is dead .*; leave the channel out"):
        compare(load_campaign(folder), Model.default())


@pytest.mark.parametrize(
    ("low", "high", "about"), [(0.0, 39.7, 8), (-3e-5, 0.0071, 8), (12.0, 12.0, 8), (1e5, 1.1e5, 14)]
)
def test_edges_are_round_and_few(low, high, about):
    edges = nice_edges(np.linspace(low, high, 500), about)
    assert 2 <= len(edges) <= about + 1
    step = edges[1] - edges[0]
    assert edges[0] <= low + 0.1 * step and edges[-1] >= high - 0.1 * step
    assert np.allclose(np.diff(edges), edges[1] - edges[0])


def test_rms_ignores_what_was_not_measured():
    assert rms(np.array([3.0, np.nan, -4.0])) == pytest.approx(np.sqrt(12.5))
    assert np.isnan(rms(np.array([np.nan])))
    assert rms(np.array([np.inf, 1.0])) == np.inf
