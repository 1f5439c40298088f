# SPDX-License-Identifier: Apache-2.0
"""The command line as a user meets it: what it writes, what it refuses, and that nothing half-written is left."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import LONG, PATIENCE, bounded
from test_compare import make_campaign

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import STATES
from inductrack_ros.data import read_bag, read_csv


@pytest.fixture(scope="module")
def campaign(tmp_path_factory) -> Path:
    return make_campaign(tmp_path_factory.mktemp("cli") / "campaign", Model.default(), duration=0.3, given=True)


def fails(capsys, *arguments: object) -> str:
    """Run a command that must fail with status 2 and one line on stderr; returns the line."""
    try:
        status = cli.main([str(a) for a in arguments])
    except SystemExit as ended:
        status = ended.code
    captured = capsys.readouterr()
    assert status == 2, captured
    assert captured.out == ""
    assert captured.err.count("\n") == 1 and captured.err.startswith("inductrack")
    return captured.err


@pytest.mark.parametrize("arguments", [[], ["simulate"], ["compare"]])
def test_help_says_what_to_give(capsys, arguments):
    with pytest.raises(SystemExit) as ended:
        cli.main([*arguments, "-h"])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    assert "--output" in out if arguments else "simulate" in out and "compare" in out


def test_help_needs_no_compiler():
    code = (
        "import sys; from inductrack_ros import cli\n"
        "try: cli.main(['compare', '-h'])\nexcept SystemExit: pass\nassert 'numba' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_simulate_writes_all_states_on_the_equilibrium_heave(tmp_path, capsys):
    assert cli.main(["simulate", "--duration", "0.5", "--rate", "200", "--output", str(tmp_path / "run.csv")]) == 0
    run = read_csv(tmp_path / "run.csv")
    assert run.channels == STATES
    assert len(run.times) == 101 and run.times[-1] == 0.5
    assert run["surge_rate"][0] == 15.5
    assert run["heave"][0] == pytest.approx(4.36748e-3 - 0.010, abs=1e-8)
    assert "101 samples" in capsys.readouterr().out
    assert os.listdir(tmp_path) == ["run.csv"]


def test_simulate_says_what_happened(tmp_path, capsys):
    """The paper's launch ends on the track, the README's first example flies."""
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    example = re.search(r"^inductrack (simulate .*?) --output", readme, re.M)[1].split()

    def said(*arguments: str) -> list[str]:
        assert cli.main([*arguments, "--output", str(tmp_path / "run.csv")]) == 0
        return capsys.readouterr().out.splitlines()

    (flight,) = said(*example)
    run = read_csv(tmp_path / "run.csv")
    travel, speed = run["surge"][-1], run["surge_rate"][-1]
    assert f"flew {travel:.1f} m, from {run['surge_rate'][0]:.1f} to {speed:.1f} m/s, top gap " in flight
    assert "touched" not in flight
    landing, why = said("simulate", "--duration", "3")
    run = read_csv(tmp_path / "run.csv")
    slow = run.times[np.flatnonzero(run["surge_rate"] > 0.1)[-1] + 1]
    assert re.search(
        rf"flew 1\d\.\d m, touched down at 1\.\d+ s with .* m/s, at rest since {slow:.2f} s after ", landing
    )
    thrust, drag = map(
        float, re.fullmatch(r"It slowed down from the start: (.*) N of thrust against (.*) N of drag\.", why).groups()
    )
    assert 0 < thrust < drag
    assert said("simulate", "--initial", "surge_rate=17")[1].startswith("It sped up")
    assert (
        "began in contact with the track, at rest since"
        in said("simulate", "--initial", "surge_rate=2", "--drive-current", "0")[0]
    )
    assert (
        "began in contact with the track, at rest throughout"
        in said("simulate", "--initial", "surge_rate=0", "--drive-current", "0")[0]
    )


def test_simulate_takes_model_state_and_current(tmp_path):
    model = Model.create({"eta": 0.75}, effects={"aerodynamic_drag": {"drag_area": 0.02}})
    model.save(tmp_path / "model.yaml")
    cli.main(
        [
            "simulate",
            "--model",
            str(tmp_path / "model.yaml"),
            "--initial",
            "surge_rate=20, sway=0.003,heave=-0.005",
            "--drive-current",
            "0",
        ]
        + ["--duration", "0.2", "--output", str(tmp_path / "run.csv")]
    )
    run = read_csv(tmp_path / "run.csv")
    expected = model.simulate(run.times, model.initial_state(surge_rate=20.0, sway=0.003, heave=-0.005), 0.0)
    assert np.array_equal(run.values, expected.states)


def test_simulate_writes_a_bag_with_the_same_run(tmp_path):
    common = ["simulate", "--duration", "0.1", "--output"]
    cli.main([*common, str(tmp_path / "bag")])
    cli.main([*common, str(tmp_path / "run.csv")])
    bag, text = read_bag(tmp_path / "bag"), read_csv(tmp_path / "run.csv")
    assert bag.channels == STATES
    assert np.allclose(bag.values, text.values, atol=1e-12)


def test_an_existing_csv_is_replaced_and_a_bag_is_not(tmp_path, capsys):
    (tmp_path / "run.csv").write_text("old")
    cli.main(["simulate", "--duration", "0.1", "--output", str(tmp_path / "run.csv")])
    assert len(read_csv(tmp_path / "run.csv").times) == 51
    (tmp_path / "bag").mkdir()
    capsys.readouterr()
    assert "exists already" in fails(capsys, "simulate", "--duration", "0.1", "--output", tmp_path / "bag")
    assert os.listdir(tmp_path / "bag") == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--initial", "surge_rat=15"], "did you mean 'surge_rate'?"),
        (["--initial", "surge_rate"], "is not NAME=NUMBER"),
        (["--initial", "sway=1,sway=2"], "given twice"),
        (["--initial", "sway=nan"], "not a finite number"),
        (["--duration", "0"], "must be above 0"),
        (["--duration", "inf"], "must be above 0"),
        (["--rate", "-1"], "must be above 0"),
        (["--duration", "1e9"], "samples"),
        (["--duration", "soon"], "invalid float value"),
        (["--drive-current", "-5"], "out of range"),
        (["--model", "nowhere.yaml"], "no such file"),
        (["--modle", "x"], "unrecognized arguments"),
    ],
)
def test_simulate_refuses_in_one_line(tmp_path, capsys, arguments, said):
    assert said in fails(capsys, "simulate", "--output", tmp_path / "run.csv", *arguments)
    assert os.listdir(tmp_path) == []


def test_simulate_refuses_a_folder_that_is_not_there(tmp_path, capsys):
    assert "create it first" in fails(capsys, "simulate", "--output", tmp_path / "no" / "run.csv")


def test_simulate_refuses_pulses_nobody_fires(tmp_path, capsys):
    Model.create(drive="pulses").save(tmp_path / "model.yaml")
    assert "controller" in fails(
        capsys, "simulate", "--model", tmp_path / "model.yaml", "--output", tmp_path / "run.csv"
    )


def test_compare_writes_what_it_promises(tmp_path, campaign, capsys):
    out = tmp_path / "a" / "results"
    assert cli.main(["compare", str(campaign), "--output", str(out)]) == 0
    assert sorted(os.listdir(out)) == ["comparison.json", "report.html", "run_0.predicted.csv", "run_1.predicted.csv"]
    said = capsys.readouterr().out.splitlines()
    assert len(said) <= 3 and said[-1] == str(out / "report.html")


def test_compare_keeps_what_else_stands_in_the_folder(tmp_path, campaign):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "report.html").write_text("old")
    cli.main(["compare", str(campaign), "--output", str(tmp_path)])
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "report.html").read_text().startswith("<!doctype html>")


@pytest.mark.parametrize("broken", ["campaign", "model", "file", "own"])
def test_compare_leaves_no_trace_when_it_refuses(tmp_path, campaign, capsys, broken):
    (tmp_path / "file").write_text("a file")
    (tmp_path / "model.yaml").write_text("etta: 1.0")
    out = {"file": tmp_path / "file", "own": campaign}.get(broken, tmp_path / "new" / "out")
    extra = ["--model", tmp_path / "model.yaml"] if broken == "model" else []
    before = sorted(campaign.iterdir())
    said = fails(capsys, "compare", tmp_path / "none" if broken == "campaign" else campaign, *extra, "--output", out)
    words = {
        "campaign": "no such folder",
        "model": "did you mean 'eta'?",
        "file": "is a file",
        "own": "campaign's own folder",
    }
    assert words[broken] in said
    assert sorted(os.listdir(tmp_path)) == ["file", "model.yaml"]
    assert sorted(campaign.iterdir()) == before


def test_what_fails_half_way_leaves_the_old_results(tmp_path, campaign, capsys, monkeypatch):
    (tmp_path / "report.html").write_text("old")

    def stop(*_):
        raise InputError("run_1.csv: cannot be simulated")

    monkeypatch.setattr("inductrack_ros.reports.compare_report.compare_report", stop)
    assert "cannot be simulated" in fails(capsys, "compare", campaign, "--output", tmp_path)
    assert os.listdir(tmp_path) == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "old"
    assert [p.name for p in tmp_path.parent.glob(f".{tmp_path.name}.*")] == []


def test_a_read_only_folder_is_refused(tmp_path, campaign, capsys):
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    tmp_path.chmod(0o500)
    assert "cannot be written" in fails(capsys, "compare", campaign, "--output", tmp_path)


def test_interrupted_it_says_so_and_leaves_nothing(tmp_path, campaign):
    code = (
        "import sys, time\nimport inductrack_ros.compare as compare\nfrom inductrack_ros import cli\n"
        "def slow(*_):\n    print('working', flush=True)\n    time.sleep(60)\n"
        "compare.compare = slow\nsys.exit(cli.main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", code, "compare", str(campaign), "--output", str(tmp_path / "out")]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "working\n"
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert errors == "inductrack compare: interrupted; nothing was written\n"
    assert os.listdir(tmp_path) == []


@pytest.fixture(scope="module")
def dragged(tmp_path_factory) -> Path:
    model = Model.create({"eta": 0.74}, effects={"aerodynamic_drag": {"drag_area": 0.05}})
    return make_campaign(tmp_path_factory.mktemp("cli") / "dragged", model, duration=0.5)


def test_add_shows_what_an_effect_gains(tmp_path, dragged, capsys):
    out = tmp_path / "out"
    assert cli.main(["add", "aerodynamic_drag", str(dragged), "--output", str(out)]) == 0
    assert sorted(os.listdir(out)) == ["diagnosis.json", "model.yaml", "report.html"]
    assert capsys.readouterr().out.startswith("Adding aerodynamic drag lowers the error from ")
    found = json.loads((out / "diagnosis.json").read_text())
    assert found["effects"] == ["aerodynamic_drag"]
    assert found["parameters"]["aerodynamic_drag.drag_area"]["value"] == pytest.approx(0.05, rel=0.05)
    assert found["steps"][0]["reduced_chi2"] > 2 > 1.2 > found["steps"][1]["reduced_chi2"]
    improved = Model.load(out / "model.yaml")
    assert list(improved.effects) == ["aerodynamic_drag"]
    assert improved.parameters["eta"] == pytest.approx(0.74, rel=0.01)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        ("aerodynamic_drg", "did you mean 'aerodynamic_drag'?"),
        ("sensor_delay:gap_top", "needs a channel"),
        ("stand_in_heave", "not known"),
    ],
)
def test_add_refuses_in_one_line(tmp_path, campaign, capsys, effect, said):
    assert said in fails(capsys, "add", effect, campaign, "--output", tmp_path / "out")
    assert os.listdir(tmp_path) == []


def test_diagnose_writes_the_contract(tmp_path, dragged, capsys):
    out = tmp_path / "out"
    assert cli.main(["diagnose", str(dragged), "--output", str(out)]) == 0
    assert sorted(os.listdir(out)) == ["diagnosis.json", "model.yaml", "report.html"]
    assert 2 <= len(capsys.readouterr().out.splitlines()) <= 3
    found = json.loads((out / "diagnosis.json").read_text())
    keys = ("verdict", "effects", "parameters", "indistinguishable", "unknown", "next_experiment", "steps")
    assert tuple(found)[:7] == keys
    assert found["verdict"] == "missing_effect"
    assert set(found["parameters"]["eta"]) == {"value", "std"}
    assert set(found["steps"][0]) == {"effects", "reduced_chi2", "heldout_nrmse"}
    comparison = tmp_path / "comparison"
    assert cli.main(["compare", str(dragged), "--model", str(out / "model.yaml"), "--output", str(comparison)]) == 0
    assert json.loads((comparison / "comparison.json").read_text())["error_over_noise"] < 1.1


#: The command line, which stands still once it has said that it tries an effect: else a busy machine may press Ctrl-C
#: when the search is over.
STANDS = """
import os, signal, sys
from inductrack_ros import cli, progress

said = []
def shown(words, **options):
    print(words, **options)
    if "drag" in words and not said:
        said.append(words)
        os.kill(os.getpid(), signal.SIGSTOP)
progress.print = shown
sys.exit(cli.main(sys.argv[1:]))
"""


def test_long_work_says_what_it_does_and_what_was_kept(tmp_path):
    """On a terminal: a line of what is being done; after Ctrl-C in the search, what was found until then."""
    practice = Path(__file__).parent / "data" / "practice" / "p3_coast"
    campaign = tmp_path / "p3_coast"
    campaign.mkdir()
    described = yaml.safe_load((practice / "campaign.yaml").read_text())
    described["runs"] = [run | {"file": str(practice / run["file"])} for run in described["runs"][:3]]
    (campaign / "campaign.yaml").write_text(yaml.safe_dump(described))
    pid, terminal = pty.fork()
    if pid == 0:
        os.environ["COLUMNS"] = "100"
        os.execv(
            sys.executable, [sys.executable, "-c", STANDS, "diagnose", str(campaign), "--output", str(tmp_path / "out")]
        )
    said, interrupted = b"", False
    with bounded("the end of a diagnosis", LONG), contextlib.suppress(OSError):  # the other end is closed, to Linux
        while piece := os.read(terminal, 4096):
            said += piece
            if b"drag" in said and not interrupted:  # an effect is being tried
                assert os.WIFSTOPPED(os.waitpid(pid, os.WUNTRACED)[1])
                interrupted = os.write(terminal, b"\x03") == 1
                os.kill(pid, signal.SIGCONT)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == 130, said.decode()
    lines = said.decode().replace("\r", "\n").replace("\x1b[2K", "").split("\n")
    lines = [line for line in lines if line]
    assert any(re.match(r"\[ +\d+ s\] fitting what is known", line) for line in lines)
    assert lines[-1] == f"inductrack diagnose: interrupted; what was found until then was kept in {tmp_path / 'out'}"
    result = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert any(note.startswith("interrupted") for note in result["notes"])
    assert "Interrupted while searching. Best found until then" in (tmp_path / "out" / "report.html").read_text()
    assert Model.load(tmp_path / "out" / "model.yaml").parameters["eta"] != 0.7295
