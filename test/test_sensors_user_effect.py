# SPDX-License-Identifier: Apache-2.0
"""A sensor effect of the user's, with two parameters and a state, does the same in node, fit, compare, diagnosis and
monitor."""

import json

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped

from inductrack_ros.cli import main
from inductrack_ros.core.model import Model
from inductrack_ros.core.rig import Rig
from inductrack_ros.core.state import COORDINATES, INDEX, OUTPUTS, RATES
from inductrack_ros.data import write_csv
from inductrack_ros.monitoring.monitor import Monitor
from inductrack_ros.nodes.topics import nanoseconds_of

SOURCE = """
from inductrack_ros.core.effects import Parameter, effect


@effect(
    changes="measured",
    parameters={
        "share": Parameter(0.0, "", -2.0, 2.0, "share of the reading that creeps", "guess", typical=0.05),
        "speed": Parameter(20.0, "1/s", 0.1, 1e3, "how fast it creeps", "guess", typical=5.0),
    },
    states={"crept": "measured"},
)
def creeping(measured, crept, share, speed):
    \"\"\"A sensor of which a share creeps after the rest.\"\"\"
    return measured + share * (crept - measured), speed * (measured - crept)
"""
TRUTH = {"share": 0.25, "speed": 30.0}
CHANNELS = ("surge", "sway", "heave", "roll")


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """An effect file, and a campaign of four runs whose heave sensor creeps, as the node would have measured it. In
    ``two`` is one of two of them."""
    folder = tmp_path_factory.mktemp("creeping")
    file = folder / "creeping.py"
    file.write_text(SOURCE)
    model = Model.create(effects={"creeping:heave": TRUTH}, effect_files=[file])
    times = np.arange(401) / 400.0
    lines = []
    for i, (speed, sway, heave) in enumerate(
        [(18.0, 1e-3, -4e-3), (22.0, -1e-3, -2e-3), (26.0, 5e-4, -4e-3), (30.0, 1e-3, -3e-3)]
    ):
        run = model.simulate(times, model.initial_state(surge_rate=speed, sway=sway, heave=heave), 0.0)
        ticks = Rig({"measured.pose.rate": 400.0, "measured.twist.rate": 0.0}, model, i)
        samples = [
            s
            for t, row in zip(times, run.outputs, strict=True)
            for s in ticks.step(t, row, 1 / 400)
            if s.sensor == "pose"
        ]
        table = {c: np.array([s.reading[c] for s in samples]) for c in CHANNELS}
        write_csv(folder / f"run_{i}.csv", np.array([s.time for s in samples]), table)
        lines.append(f"  - {{file: run_{i}.csv, drive_current: 0.0}}")
    noise = "noise_std: {surge: 5.0e-4, sway: 3.0e-5, heave: 3.0e-5, roll: 1.0e-4}"
    (folder / "campaign.yaml").write_text("\n".join([noise, "runs:", *lines, ""]))
    (folder / "two").mkdir()
    two = [line.replace("file: ", "file: ../") for line in lines[::2]]
    (folder / "two" / "campaign.yaml").write_text("\n".join([noise, "runs:", *two, ""]))
    return folder, file, model


def test_compare_predicts_with_it_and_not_without(rig, tmp_path):
    folder, file, model = rig
    model.save(folder / "model.yaml")
    for name, given in (("with", ["--model", str(folder / "model.yaml")]), ("without", [])):
        assert main(["compare", str(folder), "--output", str(tmp_path / name), "--effects", str(file), *given]) == 0
    right, wrong = (json.loads((tmp_path / n / "comparison.json").read_text()) for n in ("with", "without"))
    assert right["channels"]["heave"] == pytest.approx(1.0, abs=0.1)
    assert wrong["channels"]["heave"] > 2.0


@pytest.mark.long
def test_diagnosis_finds_it_and_its_parameters(rig, tmp_path):
    folder, file, _ = rig
    assert main(["diagnose", str(folder / "two"), "--output", str(tmp_path / "out"), "--effects", str(file)]) == 0
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["verdict"] == "missing_effect"
    assert found["effects"] == ["creeping:heave"]
    for name, truth in TRUTH.items():
        entry = found["parameters"][f"creeping:heave.{name}"]
        assert abs(entry["value"] - truth) < 4 * entry["std"] and entry["std"] < 0.3 * truth


def test_fit_frees_its_parameters(rig, tmp_path):
    folder, _, model = rig
    model.with_changes(effects={"creeping:heave": {"share": 0.1, "speed": 20.0}}).save(folder / "near.yaml")
    free = "eta,gamma,creeping:heave.share,creeping:heave.speed"
    assert (
        main(
            [
                "fit",
                str(folder),
                "--model",
                str(folder / "near.yaml"),
                "--free",
                free,
                "--output",
                str(tmp_path / "fit"),
            ]
        )
        == 0
    )
    fitted = Model.load(tmp_path / "fit" / "model.yaml").effects["creeping:heave"]
    assert fitted["share"] == pytest.approx(0.25, rel=0.1) and fitted["speed"] == pytest.approx(30.0, rel=0.2)


def test_the_node_measures_with_it(rig, ros, tmp_path):
    """All of the reading creeps at 5/s: what it has gained is five times the integral of what it lacked."""
    _, _, model = rig
    model.with_changes(effects={"creeping:heave": {"share": 1.0, "speed": 5.0}}).save(tmp_path / "model.yaml")
    true, read = (ros.listen(PoseStamped, f"/inductrack/{topic}") for topic in ("pose", "measured/pose"))
    given = (
        "listeners:=1",
        "initial_state:='surge_rate=25,heave=-0.004'",
        "drive_current:=0.0",
        "measured.heave.noise:=0.0",
    )
    ros.start(
        "sim", "--ros-args", "--params-file", str(tmp_path / "model.yaml"), *(word for g in given for word in ("-p", g))
    )
    ros.wait(lambda: len(read) > 250 and len(true) > 250, "half a second of poses")

    def heave(messages):
        return {nanoseconds_of(m.header.stamp): m.pose.position.z for m in messages}

    true, read = heave(true), heave(read)
    stamps = np.array(sorted(true.keys() & read.keys()))
    lacked = np.array([true[s] - read[s] for s in stamps.tolist()])
    reading = np.array([read[s] for s in stamps.tolist()])
    gained = 5.0 * np.concatenate([[0.0], np.cumsum(0.5 * (lacked[1:] + lacked[:-1]) * np.diff(stamps) / 1e9)])
    assert lacked[0] == 0.0 and np.abs(lacked).max() > 1e-4
    assert np.abs(reading - reading[0] - gained).max() < 0.01 * np.ptp(reading)


def judged(rig, model):
    """The monitor's verdict on what the node's sensors measure of a coasting run of three seconds."""
    _, _, truth = rig
    times = np.arange(1501) / 500.0
    run = truth.simulate(times, truth.initial_state(surge_rate=25.0, sway=1e-3, heave=-4e-3), 0.0)
    ticks = Rig({}, truth, 7)
    noise = np.array([ticks.values[f"measured.{c}.noise"] for c in (*COORDINATES, *RATES)])
    monitor = Monitor(model.with_changes(parameters={"drive_current": 0.0}), noise)
    for t, row in zip(times, run.outputs, strict=True):
        for s in ticks.step(t, row, 1 / 500):
            values = np.array([*s.reading.values()])
            if s.sensor == "pose":
                monitor.pose(round(s.time * 1e9), values)
            elif s.sensor == "twist":
                monitor.twist(round(s.time * 1e9), values)
        monitor.windows()
    return monitor.status()


def test_monitor_reads_with_it(rig):
    _, file, model = rig
    assert judged(rig, model) == (True, "model fits")
    holds, sentence = judged(rig, Model.create(effect_files=[file]))
    assert not holds and "heave" in sentence


def test_parameters_of_the_model_and_the_truth_may_be_asked_for(tmp_path):
    """Crosstalk of roll into a sensor whose scale is the nominal gap."""
    file = tmp_path / "crosstalk.py"
    file.write_text(
        "from inductrack_ros.core.effects import Parameter, effect\n\n@effect(changes='measured', parameters={'gain':"
        " Parameter(0.0, 'm', -1.0, 1.0, 'gain')})\ndef crosstalk(measured, roll, nominal_gap, time, gain):\n    return"
        " measured + gain * roll / nominal_gap + 0.0 * time\n"
    )
    model = Model.create(effects={"crosstalk:sway": {"gain": 1e-4}}, effect_files=[file])
    run = np.zeros(len(OUTPUTS))
    run[INDEX["sway"]], run[INDEX["roll"]] = 1e-3, 0.02
    (sample,) = (s for s in Rig({"measured.sway.noise": 0.0}, model, 0).step(0.0, run, 0.002) if s.sensor == "pose")
    assert sample.reading["sway"] == pytest.approx(1e-3 + 1e-4 * 0.02 / 0.01)
