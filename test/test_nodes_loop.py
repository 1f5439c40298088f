# SPDX-License-Identifier: Apache-2.0
"""The loop as a user closes it: the package's own nodes fly and record runs, which are then compared and diagnosed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from inductrack_ros import cli

DRAG = 0.05  # m²; switched on in `sim`, unknown to the model that diagnoses
LOCKSTEP = ("-p", "lockstep:=true")
MODEL = "/**:\n  ros__parameters:\n    drive: pulses\n"


def fly(ros, bag: Path, speed: float, seconds: float, *more: str) -> None:
    """Record a run of `sim` and `track_controller`, which holds its speed, in lockstep."""
    recorder = ros.start("record", "-o", str(bag), "-d", str(seconds), "--stamp", "header")
    controller = ros.start(
        "track_controller", "--ros-args", "-p", "mode:=speed", "-p", f"target_speed:={speed}", *LOCKSTEP
    )
    start = ("-p", f"initial_state:='surge_rate={speed}'", "-p", f"seed:={int(speed)}", "-p", "listeners:=2")
    sim = ros.start("sim", "--ros-args", "-p", "drive:=pulses", *start, *LOCKSTEP, *more)
    assert recorder.wait() == 0, recorder.output
    assert controller.stop() == 0 and sim.stop() == 0


@pytest.fixture
def campaign(ros, tmp_path) -> Path:
    """Three runs with air drag at three held speeds, of which the unstable ones drift by metres in open loop."""
    folder = tmp_path / "rig"
    folder.mkdir()
    for speed in (16.0, 20.0, 24.0):
        fly(
            ros,
            folder / f"run_{speed:.0f}",
            speed,
            1.0,
            "-p",
            "effects:=['aerodynamic_drag']",
            "-p",
            f"aerodynamic_drag.drag_area:={DRAG}",
        )
    (folder / "model.yaml").write_text(MODEL)
    (folder / "true.yaml").write_text(
        f"{MODEL}    effects: [aerodynamic_drag]\n    aerodynamic_drag: {{drag_area: {DRAG}}}\n"
    )
    (folder / "campaign.yaml").write_text("model: model.yaml\nruns: [{file: run_16}, {file: run_20}, {file: run_24}]\n")
    return folder


def test_runs_that_our_nodes_flew_are_predicted_and_diagnosed(campaign, tmp_path):
    assert (
        cli.main(
            ["compare", str(campaign), "--model", str(campaign / "true.yaml"), "--output", str(tmp_path / "compare")]
        )
        == 0
    )
    compared = json.loads((tmp_path / "compare" / "comparison.json").read_text())
    assert compared["error_over_noise"] < 1.1
    assert all(run["holds_for"] is None for run in compared["runs"])

    assert (
        cli.main(
            ["diagnose", str(campaign), "--model", str(campaign / "true.yaml"), "--output", str(tmp_path / "complete")]
        )
        == 0
    )
    complete = json.loads((tmp_path / "complete" / "diagnosis.json").read_text())
    assert (complete["verdict"], complete["effects"]) == ("adequate", [])

    assert cli.main(["diagnose", str(campaign), "--output", str(tmp_path / "lacking")]) == 0
    lacking = json.loads((tmp_path / "lacking" / "diagnosis.json").read_text())
    assert (lacking["verdict"], lacking["effects"]) == ("missing_effect", ["aerodynamic_drag"])
    size = lacking["parameters"]["aerodynamic_drag.drag_area"]
    assert abs(size["value"] - DRAG) < 3 * size["std"] + 1e-5
