# SPDX-License-Identifier: Apache-2.0
"""Every effect of a sensor is a candidate: hidden in a campaign that `simulate` makes, it is found, and its size."""

import json

import pytest

from inductrack_ros.cli import main

RUNS = (
    "surge_rate=17,sway=0.0015,heave=-0.004",
    "surge_rate=22,sway=-0.001,heave=-0.003,drive_current=0",
    "surge_rate=26,sway=0.002,roll=0.01,drive_current=0",
    "surge_rate=30,sway=0.001,heave=-0.004,drive_current=3500",
)
POSE_ALONE = (
    "measured: {twist: {rate: 0.0}, imu: {rate: 0.0}, gap_top: {rate: 0.0}, gap_left: {rate: 0.0}, gap_right: {rate:"
    " 0.0}}"
)


def diagnosed(folder, name="", parameter="", value=0.0):
    """What `diagnose` says of four runs of 0.8 s, pose alone, whose sensor has an effect."""
    effect = f"effects: ['{name}']\n'{name}': {{{parameter}: {value}}}\n" if name else ""
    (folder / "secret.yaml").write_text(f"{effect}{POSE_ALONE}\n")
    made = ["simulate", "--model", str(folder / "secret.yaml"), "--seed", "7", "--duration", "0.8", "--rate", "250"]
    assert main([*made, *(word for run in RUNS for word in ("--run", run)), "--output", str(folder / "rig")]) == 0
    assert main(["diagnose", str(folder / "rig"), "--output", str(folder / "out")]) == 0
    return json.loads((folder / "out" / "diagnosis.json").read_text())


@pytest.mark.parametrize(
    ("name", "parameter", "value"),
    [
        ("sensor_lag:heave", "time_constant", 4e-3),
        # As slow as the clock's, and found the same way.
        pytest.param("sensor_drift:heave", "rate", 2e-3, marks=pytest.mark.nightly),
        ("sensor_clock:surge", "rate", 1e-3),
        ("sensor_saturation:sway", "limit", 1.2e-3),
        ("sensor_misalignment", "angle", 0.03),
    ],
)
def test_an_effect_of_a_sensor_is_found(tmp_path, name, parameter, value):
    found = diagnosed(tmp_path, name, parameter, value)
    assert (found["verdict"], found["effects"]) == ("missing_effect", [name])
    size = found["parameters"][f"{name}.{parameter}"]
    assert abs(size["value"] - value) < 4 * size["std"] and size["std"] < 0.1 * abs(value)
    assert found["steps"][-1]["reduced_chi2"] == pytest.approx(1.0, abs=0.1)


def test_a_small_lag_and_a_delay_are_named_together(tmp_path):
    found = diagnosed(tmp_path, "sensor_lag:roll", "time_constant", 1e-3)
    (name,) = found["effects"]
    assert {name, *found["indistinguishable"][name]} == {"sensor_lag:roll", "sensor_delay:roll"}


def test_good_sensors_are_not_blamed(tmp_path):
    assert diagnosed(tmp_path)["verdict"] == "adequate"
