# SPDX-License-Identifier: Apache-2.0
"""`simulate --measured` and `--run`: what a rig's sensors would deliver, as CSV, bag or campaign."""

import json

import numpy as np
import pytest

from inductrack_ros.cli import main
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.data.bags import read_bag
from inductrack_ros.data.csv_files import read_csv

MODEL = """/**:
  ros__parameters:
    effects: ['sensor_lag:heave', viscous_drag]
    viscous_drag: {coefficient: 0.5}
    'sensor_lag:heave': {time_constant: 0.006}
    seed: 3
    measured:
      heave: {noise: 0.0}
      sway: {bias: 0.001, delay: 0.004, noise: 1.0e-9}
      imu: {rate: 50.0}
      gap_top: {dropout: 0.5}
      gap_left: {rate: 0.0}
"""
FLIGHT = ["--initial", "surge_rate=17,sway=0.002,heave=-0.004", "--duration", "0.6"]


def tolerance(channel):
    """An Imu's reading comes back through the measured roll, a Range's through a number of 32 bits."""
    return 5e-3 if channel.endswith("acceleration") else 1e-8 if channel.startswith("gap") else 1e-9


def simulate(tmp_path, *arguments, model=MODEL):
    (tmp_path / "model.yaml").write_text(model)
    return main(["simulate", "--model", str(tmp_path / "model.yaml"), *map(str, arguments)])


def test_a_csv_holds_what_the_sensors_deliver(tmp_path, capsys):
    assert simulate(tmp_path, "--measured", *FLIGHT, "--output", tmp_path / "run.csv") == 0
    assert "seed 3" in capsys.readouterr().out
    run = read_csv(tmp_path / "run.csv")
    model = Model.load(tmp_path / "model.yaml")
    truth = model.simulate(run.times, model.initial_state(surge_rate=17.0, sway=2e-3, heave=-4e-3))
    surge = run["surge"] - truth["surge"]
    assert surge.std() == pytest.approx(5e-4, rel=0.15) and abs(surge.mean()) < 1e-4
    # A lag of τ: what is read follows, reading + τ · its rate is the truth.
    follows = run["heave"] + 0.006 * np.gradient(run["heave"], run.times)
    assert np.abs(follows - truth["heave"])[3:-3].max() < 0.02 * np.ptp(truth["heave"])
    late = np.interp(run.times - 0.004, run.times, truth["sway"]) + 1e-3
    assert np.abs(run["sway"] - late).max() < 1e-5
    counts = {c: len(run.samples(c)[0]) for c in run.channels}
    assert counts["surge_acceleration"] == 31 and counts["gap_right"] == 61 and 20 <= counts["gap_top"] <= 41
    assert "gap_left" not in run.channels


def test_a_bag_holds_the_same_beside_the_truth(tmp_path):
    for output in ("run.csv", "bag"):
        assert simulate(tmp_path, "--measured", *FLIGHT, "--output", tmp_path / output) == 0
    csv, bag = read_csv(tmp_path / "run.csv"), read_bag(tmp_path / "bag")
    assert set(bag.channels) == set(csv.channels)
    for channel in csv.channels:
        (times, values), (stamps, read) = csv.samples(channel), bag.samples(channel)
        assert np.abs(times - stamps).max() < 1e-9
        assert np.abs(values - read).max() < tolerance(channel) * max(1.0, np.abs(values).max())
    topics = {name: f"/inductrack/{name}" for name in ("pose", "twist", "gap_top", "gap_left")} | {
        "imu": None,
        "gap_right": None,
    }
    truth = read_bag(tmp_path / "bag", topics)
    assert np.abs(truth["surge"] - np.interp(truth.times, *csv.samples("surge"))).max() > 1e-4  # without noise
    assert "gap_left" in truth.channels


def test_the_seed_makes_the_noise(tmp_path):
    texts = []
    for seed in ([], ["--seed", 3], ["--seed", 4]):
        assert simulate(tmp_path, "--measured", *FLIGHT, *seed, "--output", tmp_path / "run.csv") == 0
        texts.append((tmp_path / "run.csv").read_text())
    assert texts[0] == texts[1] != texts[2]


def test_a_campaign_in_one_line(tmp_path, capsys):
    """Its own model predicts it, the paper's does not; nothing in it gives the effects away but truth.yaml."""
    runs = [
        "--run",
        "surge_rate=18,sway=0.001",
        "--run",
        "surge_rate=24,heave=-0.004,drive_current=0",
        "--run",
        "surge_rate=28,drive_current=3500",
    ]
    assert (
        simulate(
            tmp_path,
            *runs,
            "--duration",
            0.4,
            "--seed",
            5,
            "--output",
            tmp_path / "rig",
            model=MODEL.replace("noise: 0.0", "noise: 3.0e-5").replace("1.0e-9", "3.0e-5"),
        )
        == 0
    )
    campaign = load_campaign(tmp_path / "rig")
    assert [r.drive_current for r in campaign.runs] == [7000.0, 0.0, 3500.0] and campaign.noise_std["heave"] == 3e-5
    assert "gap_left" not in campaign.noise_std and campaign.model is None
    errors = {}
    for name, given in (("truth", ["--model", str(tmp_path / "rig" / "truth.yaml")]), ("paper", [])):
        assert main(["compare", str(tmp_path / "rig"), *given, "--output", str(tmp_path / name)]) == 0
        errors[name] = json.loads((tmp_path / name / "comparison.json").read_text())["error_over_noise"]
    assert errors["truth"] == pytest.approx(1.0, abs=0.1) and errors["paper"] > 2.0
    assert simulate(tmp_path, *runs, "--output", tmp_path / "rig") == 2  # an existing one is left alone
    assert "exists already" in capsys.readouterr().err


def test_a_campaign_of_bags(tmp_path):
    assert (
        simulate(
            tmp_path,
            "--run",
            "surge_rate=18",
            "--run",
            "surge_rate=22",
            "--bags",
            "--duration",
            0.1,
            "--output",
            tmp_path / "rig",
        )
        == 0
    )
    assert [r.name for r in load_campaign(tmp_path / "rig").runs] == ["run_00", "run_01"]


def test_sensors_that_are_passed_over_are_said(tmp_path, capsys):
    assert simulate(tmp_path, *FLIGHT, "--output", tmp_path / "run.csv") == 0
    assert "show with --measured only" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("model", "arguments", "said"),
    [
        (MODEL.replace("noise: 0.0", "noize: 0.0"), ["--measured"], "did you mean 'measured.heave.noise'?"),
        (
            MODEL.replace("dropout: 0.5", "dropout: 1.5"),
            ["--measured"],
            "measured.gap_top.dropout = 1.5 is out of range",
        ),
        (MODEL, ["--measured", "--seed", "-1"], "--seed -1: must lie in"),
        (MODEL, ["--run", "surge_rate=17", "--initial", "surge_rate=17"], "leave --initial out"),
        (MODEL, ["--run", "surge_rate=17,drive_current=-5"], "drive_current = -5 is out of range"),
        (MODEL, ["--run", "speed=17"], "unknown name 'speed'"),
        (MODEL, ["--bags"], "--bags: is for a campaign"),
        (MODEL, ["--run", "surge_rate=17", "--output", "rig.csv"], "with --run a folder is written"),
        (
            (
                "measured: {pose: {rate: 0.0}, twist: {rate: 0.0}, imu: {rate: 0.0}, gap_top: {rate: 0.0}, gap_left:"
                " {rate: 0.0}, gap_right: {rate: 0.0}}"
            ),
            ["--measured"],
            "deliver nothing",
        ),
    ],
)
def test_what_is_refused(tmp_path, capsys, model, arguments, said):
    output = [] if "--output" in arguments else ["--output", tmp_path / ("rig" if "--run" in arguments else "run.csv")]
    assert simulate(tmp_path, *arguments, *output, model=model) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not (tmp_path / "rig").exists() and not (tmp_path / "run.csv").exists()
