# SPDX-License-Identifier: Apache-2.0
"""`track: coils` as users meet it: `simulate`, measured campaigns, the node, and what cannot take it."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseStamped
from std_srvs.srv import Trigger

from inductrack_ros.cli import main
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.data.csv_files import read_csv
from inductrack_ros.nodes.topics import nanoseconds_of

RIG = """/**:
  ros__parameters:
    track: coils
    mutual_inductance: [2.0e-7, 1.0e-7]
    failed_coils: [120, 121]
    damaged_coils: [200]
    damage_factor: 3.0
    track_length: 60.0
    seed: 4
    measured: {heave: {noise: 1.0e-6}}
"""
FLIGHT = "surge_rate=20,sway=0.001"


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(RIG)
    return path


def test_a_simulated_run_is_that_of_the_coils(rig, tmp_path, capsys):
    output = tmp_path / "run.csv"
    asked = ["--model", str(rig), "--initial", FLIGHT, "--duration", "0.3", "--output", str(output)]
    assert main(["simulate", *asked]) == 0
    assert "flew 7.0 m" in capsys.readouterr().out
    run, model = read_csv(output), Model.load(rig)
    truth = model.simulate(run.times, model.initial_state(surge_rate=20.0, sway=1e-3))
    assert run["heave"] == pytest.approx(truth["heave"], abs=1e-9)
    averaged = Model.default().simulate(run.times, truth.states[0])
    assert np.abs(truth["heave"] - averaged["heave"]).max() > 1e-4


def test_a_measured_campaign_says_what_flew(rig, tmp_path):
    folder = tmp_path / "campaign"
    runs = ["--run", FLIGHT + ",drive_current=0", "--run", "surge_rate=25"]
    assert main(["simulate", "--model", str(rig), *runs, "--duration", "0.2", "--output", str(folder)]) == 0
    campaign = load_campaign(folder)
    assert [run.drive_current for run in campaign.runs] == [0.0, 7000.0]
    truth = Model.load(folder / "truth.yaml")
    assert truth == Model.load(rig)
    start = truth.initial_state(surge_rate=20.0, sway=1e-3, drive_current=0.0)
    times, heave = campaign.runs[0].samples("heave")
    assert np.std(heave - truth.simulate(times, start, 0.0)["heave"]) < 5e-6


def test_a_coil_off_the_track_is_one_line(rig, tmp_path, capsys):
    rig.write_text(RIG.replace("[120, 121]", "[120, 7801]"))
    output = tmp_path / "run.csv"
    assert main(["simulate", "--model", str(rig), "--output", str(output)]) == 2
    said = capsys.readouterr().err.strip()
    assert "failed_coils: coil 7801 is off the track, whose coils are 0 to 7800" in said and "\n" not in said
    assert not output.exists()


@pytest.mark.parametrize("command", ["compare", "diagnose", "fit", "sweep"])
def test_what_only_the_averaged_law_can_do_says_so(command, rig, tmp_path, capsys):
    times = np.arange(0.0, 0.2, 0.01)
    rows = "".join(f"{t},{20 * t},{-0.005 + 1e-4 * np.sin(20 * t)}\n" for t in times)
    (tmp_path / "run.csv").write_text("time,surge,heave\n" + rows)
    (tmp_path / "campaign.yaml").write_text(yaml.safe_dump({"runs": [{"file": "run.csv", "drive_current": 0.0}]}))
    given = ["--over", "surge_rate=18:22:3"] if command == "sweep" else [str(tmp_path)]
    output = tmp_path / "report"
    assert main([command, *given, "--model", str(rig), "--output", str(output)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and "track: coils can be simulated" in said[0]
    assert not output.exists()


@pytest.mark.nightly
def test_what_averaging_leaves_out_is_named_or_left_open(tmp_path):
    """Six runs off the track over the paper's short arrays, whose lift and drag no constant factor turns into the
    averaged law's. The averaged model must not pass for complete, nor be completed by what is not there."""
    rig, folder, output = tmp_path / "rig.yaml", tmp_path / "campaign", tmp_path / "diagnosis"
    off = "".join(f"    measured.{s}.rate: 0.0\n" for s in ("twist", "imu", "gap_top", "gap_right", "gap_left"))
    rig.write_text(f"/**:\n  ros__parameters:\n    track: coils\n    track_length: 100.0\n    seed: 11\n{off}")
    model, flights = Model.load(rig), []
    for i, (speed, current) in enumerate(((17, 7000), (26, 0), (24, 7000), (30, 0), (33, 3500), (40, 0))):
        heave = model.initial_state(surge_rate=float(speed), drive_current=float(current))[2] + (-4e-4, 4e-4)[i % 2]
        aside = f"heave={heave:.6f},sway={1e-3 * (i % 3 - 1)},roll={3e-3 * (i % 2)}"
        flights += ["--run", f"surge_rate={speed},drive_current={current},{aside}"]
    asked = ["--model", str(rig), *flights, "--duration", "0.5", "--output", str(folder)]
    assert main(["simulate", *asked]) == 0
    assert main(["diagnose", str(folder), "--output", str(output)]) == 0
    answer = json.loads((output / "diagnosis.json").read_text())
    left_open = answer["verdict"] == "unknown_effect" and answer["unknown"]["channel"] in ("surge", "heave")
    assert left_open or "coil_current_dynamics" in answer["effects"], answer
    assert not [name for name in answer["effects"] if name.startswith("sensor_")], answer


def test_the_node_flies_over_coils(rig, ros):
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    words = ["--ros-args", "--params-file", str(rig), "-p", f"initial_state:='{FLIGHT}'"]
    sim = ros.start("sim", *words, "-p", "paused:=true", "-p", "rate:=500.0", "-p", "publish_clock:=true")
    sim.wait_for("track: coils")
    ros.connect("/inductrack/sim")
    model = Model.load(rig)
    x = model.initial_state(surge_rate=20.0, sway=1e-3)
    for step in range(20):
        ros.call(Trigger, "/inductrack/sim/step")
        x = model.advance(x, step / 500.0, (step + 1) / 500.0)
    ros.wait(lambda: poses and nanoseconds_of(poses[-1].header.stamp) == 40_000_000, "the pose after the last step")
    assert len(poses) >= 20  # one after each step; the first, before them, may have gone before we listened
    assert poses[-1].pose.position.x == pytest.approx(x[0], abs=1e-9)
    assert poses[-1].pose.position.z == pytest.approx(x[2], abs=1e-9)
    refused = ros.set_parameter("/inductrack/sim", "wavelength", 0.11)
    assert not refused.successful  # the currents in flight are those of coils where they stand
    assert ros.set_parameter("/inductrack/sim", "resistance", 1.6e-3).successful
    assert sim.stop() == 0


def test_the_node_refuses_a_coil_off_the_track(rig, ros):
    sim = ros.start("sim", "--ros-args", "--params-file", str(rig), "-p", "damaged_coils:=[8000]")
    assert sim.wait() == 2
    assert "coil 8000 is off the track" in sim.output and len(sim.output.strip().splitlines()) == 1
