# SPDX-License-Identifier: Apache-2.0
"""A channel beside the motion is one declaration and one function: all commands, bags and nodes take it from there."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros import cli
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import CHANNEL, INDEX, INSTRUMENTS, STATES
from inductrack_ros.data import load_campaign, read_csv
from inductrack_ros.monitoring.monitor import SEEN, Monitor

ROOT = Path(__file__).resolve().parents[1]
RUNS = ["surge_rate=17,sway=0.001", "surge_rate=30,drive_current=0", "surge_rate=25"]
SCALE = 1.03


def recipe() -> str:
    """The channel of CONTRIBUTING.md, as a file of a user's own; renamed, for who follows the recipe has it twice."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    block = next(b for b in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "@channel" in b)
    own = textwrap.dedent(block).replace("from . import", "from inductrack_ros.core.channels import")
    return own.replace("top_load", "own_load").replace("load cell", "own cell")


def in_a_process_of_its_own(code: str, channels: str, **options) -> subprocess.CompletedProcess:
    """Python that starts with ``channels`` in the environment, as a user's command does."""
    environment = os.environ | {"INDUCTRACK_CHANNELS": channels}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, **options)


def rig(folder: Path, channel: str) -> Path:
    """A rig with pose, twist and the channel, whose sensor reads 3 % too much."""
    file = folder / "rig.yaml"
    others = {f"measured.{name}.rate": 0.0 for name in INSTRUMENTS}
    rates = others | {"measured.pose.rate": 200.0, "measured.twist.rate": 200.0, f"measured.{channel}.rate": 100.0}
    lines = [f"{n}: {v}" for n, v in rates.items()]
    lines += [f'effects: ["sensor_scale:{channel}"]', f'"sensor_scale:{channel}": {{scale: {SCALE}}}', "seed: 5"]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def follow(folder: Path, channel: str) -> None:
    """Take a channel through the commands, from `simulate` to `diagnose` and the monitor."""
    model, runs = str(rig(folder, channel)), [f"--run={run}" for run in RUNS]
    common = ["simulate", "--model", model, *runs, "--duration", "0.5", "--rate", "400"]
    assert cli.main([*common, "--output", str(folder / "csv")]) == 0
    assert cli.main([*common, "--bags", "--output", str(folder / "bags")]) == 0
    csv, bags = (load_campaign(folder / name) for name in ("csv", "bags"))
    assert csv.channels == bags.channels == (*STATES, channel) and not csv.notes and not bags.notes
    for one, other in zip(csv.runs, bags.runs, strict=True):
        assert one.samples(channel)[0] == pytest.approx(other.samples(channel)[0], abs=1e-9)
        assert one.samples(channel)[1] == pytest.approx(other.samples(channel)[1], rel=1e-9)
        assert 49 <= len(one.samples(channel)[1]) <= 51

    assert cli.main(["check", str(folder / "csv"), "--output", str(folder / "check")]) == 0
    found = json.loads((folder / "check" / "check.json").read_text())["findings"]
    assert not [f for f in found if f.get("channel") == channel], found

    assert cli.main(["compare", str(folder / "csv"), "--output", str(folder / "compare")]) == 0
    times, values = csv.runs[0].samples(channel)
    predicted = np.interp(times, *read_csv(folder / "compare" / "run_00.predicted.csv").samples(channel))
    off = np.median(values / predicted)
    assert off == pytest.approx(SCALE, abs=0.01)
    assert CHANNEL[channel].title in (folder / "compare" / "report.html").read_text(encoding="utf-8")

    assert cli.main(["fit", str(folder / "bags"), "--model", model, "--output", str(folder / "fit")]) == 0
    fitted = Model.load(folder / "fit" / "model.yaml").parameters["eta"]
    assert fitted == pytest.approx(Model.default().parameters["eta"], rel=2e-3)

    assert cli.main(["diagnose", str(folder / "csv"), "--output", str(folder / "diagnose")]) == 0
    answer = json.loads((folder / "diagnose" / "diagnosis.json").read_text())
    scale = answer["parameters"].get(f"sensor_scale:{channel}.scale", {"value": np.nan, "std": np.nan})
    assert answer["verdict"] == "missing_effect" and answer["effects"] == [f"sensor_scale:{channel}"], answer
    assert scale["std"] < 3e-3 and scale["value"] == pytest.approx(SCALE, abs=5 * scale["std"])

    right, wrong = (
        watched(Model.load(model), Model.load(model), channel),
        watched(Model.load(model), Model.default(), channel),
    )
    assert right.status() == (True, "model fits") and right.noise_found[INDEX[channel]] == pytest.approx(1.0, abs=0.15)
    assert wrong.noise_found[INDEX[channel]] > 3.0 or not wrong.status()[0]


def watched(rig: Model, model: Model, channel: str) -> Monitor:
    """A monitor with this model after 2 s of a rig that coasts, whose noise is as declared."""
    from inductrack_ros.core.sensors import Sensors

    noise, rng = {c: CHANNEL[c].noise for c in SEEN}, np.random.default_rng(4)
    monitor, times = (
        Monitor(model.with_changes({"drive_current": 0.0}), np.array([noise[c] for c in SEEN])),
        (np.arange(801) / 400.0),
    )
    run = rig.simulate(times, rig.initial_state(surge_rate=35.0, drive_current=0.0), 0.0, further=True)
    sensors = Sensors.of(rig)
    read = {c: sensors.read(c, times, times, run.outputs[None])[0] for c in (*STATES, channel)}
    for k, time in enumerate(times):
        stamp = int(round(1e9 * time))
        values = {c: read[c][k] + noise[c] * rng.standard_normal() for c in read}
        monitor.pose(stamp, np.array([values[c] for c in STATES[:4]]))
        monitor.twist(stamp, np.array([values[c] for c in STATES[4:]]))
        monitor.further(CHANNEL[channel].sensor, stamp, np.array([values[channel]]))
        monitor.windows()
    return monitor


# ---------------------------------------------------------------- the commands


def test_a_channel_of_the_package_goes_through_all_commands(tmp_path):
    follow(tmp_path, "coil_current")


@pytest.mark.nightly
def test_a_channel_of_a_user_goes_through_all_commands(tmp_path):
    file = tmp_path / "load.py"
    file.write_text(recipe(), encoding="utf-8")
    code = f"import sys; sys.path.insert(0, {str(ROOT / 'test')!r}); from pathlib import Path; import test_channels;"
    done = in_a_process_of_its_own(f"{code} test_channels.follow(Path({str(tmp_path)!r}), 'own_load')", str(file))
    assert done.returncode == 0, done.stderr[-3000:]


def test_the_coil_current_is_that_of_the_equations():
    model = Model.default()
    state = model.initial_state(surge_rate=20.0)
    q, p = model.quantities(state), model.parameters
    omega = 2 * np.pi / p["wavelength"] * 20.0
    flux = p["eta"] * p["peak_field"] * p["wavelength"] / (2 * np.pi) * q["overlap"]
    expected = abs(1j * omega * flux / (p["resistance"] + 1j * omega * p["inductance"]))
    assert q["coil_current"] == pytest.approx(expected, rel=1e-12)
    with pytest.raises(KeyError, match="further=True"):
        model.simulate(np.array([0.0, 0.3]), state)["coil_current"]
    run = model.simulate(np.array([0.0, 0.3]), state, further=True)
    assert run["coil_current"][1] == pytest.approx(model.quantities(run.states[1])["coil_current"], rel=1e-9)


def test_coils_have_no_averaged_current():
    model = Model.create(track="coils", coil_options={"track_length": 20.0})
    run = model.simulate(np.array([0.0, 0.02]), model.initial_state(surge_rate=20.0), further=True)
    assert np.isnan(run["coil_current"]).all() and np.isfinite(run.states).all()


# ---------------------------------------------------------------- a declaration


HEAD = "from inductrack_ros.core.channels import channel\n\n"


def declared(name: str, options: str = "noise=1.0, span=1.0", asks: str = "gap_top", gives: str = "gap_top") -> str:
    """Text that declares a channel."""
    return f"@channel(unit='N', {options})\ndef {name}({asks}):\n    return {gives}\n\n\n"


WRONG = {
    "no file": (None, "no such file"),
    "none in it": ("x = 1\n", "no @channel function in it"),
    "syntax": ("def f(:\n", "channel file {file}, line 1: SyntaxError"),
    "taken": (HEAD + declared("heave"), "'heave' is the name of another channel"),
    "taken by a sensor": (HEAD + declared("load", "noise=1.0, span=1.0, sensor='imu'"), "'imu' is the name"),
    "noise": (HEAD + declared("load", "noise=0.0, span=1.0"), "noise = 0.0; give a number above 0"),
    "message": (HEAD + declared("load", "noise=1.0, span=1.0, message='Wrench'"), "give a type such as"),
    "one field twice": (
        HEAD + "".join(declared(f"load_{i}", "noise=1.0, span=1.0, sensor='cell'") for i in "ab"),
        "field 'point.x' is another channel's",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_declaration_is_one_line(tmp_path, name):
    text, expected = WRONG[name]
    file = tmp_path / "mine.py"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    done = in_a_process_of_its_own("import inductrack_ros.core.state", str(file))
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("error: INDUCTRACK_CHANNELS: ") and expected.format(file=file) in done.stderr


def test_what_a_channel_may_ask_for(tmp_path):
    code = "from inductrack_ros import cli; import sys; sys.exit(cli.main(['simulate', '--output', sys.argv[1]]))"
    for text, expected in (
        (
            declared("load", asks="gap_topp", gives="gap_topp"),
            "'gap_topp', which is not there; did you mean 'gap_top'?",
        ),
        (declared("load", asks="force_heave", gives="0.0"), "the sum of all forces"),
        (declared("omega"), "the name of a quantity of the model"),
        (declared("load", gives="str(gap_top)"), "channel 'load'"),
    ):
        file = tmp_path / "mine.py"
        file.write_text(HEAD + text, encoding="utf-8")
        code_ = code.replace("sys.argv[1]", repr(str(tmp_path / "run.csv")))
        done = in_a_process_of_its_own(code_, str(file))
        told = [line for line in done.stderr.splitlines() if not line.startswith("compiling")]
        assert done.returncode == 2 and len(told) == 1 and expected in told[0], done.stderr
        assert f"{file}, line 3" in told[0] and not (tmp_path / "run.csv").exists()


def test_columns_and_units_of_a_declared_channel(tmp_path):
    file, table = tmp_path / "load.py", tmp_path / "run.csv"
    file.write_text(recipe(), encoding="utf-8")
    table.write_text(
        "time,surge [mm],own cell (kN),Coil Current [mA]\n" + "".join(f"{t},{t},0.1,{t}\n" for t in range(3))
    )
    code = (
        "from inductrack_ros.data import read_csv; import sys\n"
        f"run = read_csv({str(table)!r})\n"
        "print(run.channels, run['own_load'].tolist(), run.notes)"
    )
    done = in_a_process_of_its_own(code, str(file))
    assert "('surge', 'coil_current', 'own_load') [100.0, 100.0, 100.0]" in done.stdout, done.stdout + done.stderr
    assert "converted to SI: surge from mm, own_load from kN, coil_current from mA" in done.stdout


# ---------------------------------------------------------------- nodes


def test_sim_and_monitor_speak_of_a_further_channel(ros):
    from geometry_msgs.msg import PointStamped, PoseStamped

    measured = ros.listen(PointStamped, "/inductrack/measured/coil_current")
    residual = ros.listen(PointStamped, "/inductrack/residual/coil_current")
    poses = ros.listen(PoseStamped, "/inductrack/pose")
    ros.start("monitor", "--ros-args", "-p", "reliability:=reliable").wait_for("windows of")
    ros.start(
        "sim", "--ros-args", "-p", "initial_state:=surge_rate=16.1", "-p", "measured.coil_current.rate:=100.0",
        "-p", "listeners:=1",
    )  # fmt: skip
    ros.wait(lambda: len(measured) > 50 and len(residual) > 20, "the coil's current and its residual")
    model, by_stamp = Model.default(), {(m.header.stamp.sec, m.header.stamp.nanosec): m for m in poses}
    first = measured[0]
    assert (first.header.stamp.sec, first.header.stamp.nanosec) in by_stamp
    expected = model.quantities(model.initial_state(surge_rate=16.1))["coil_current"]
    assert np.mean([m.point.x for m in measured[:20]]) == pytest.approx(expected, rel=0.01)
    assert np.std([m.point.x for m in residual]) == pytest.approx(CHANNEL["coil_current"].noise, rel=0.5)
