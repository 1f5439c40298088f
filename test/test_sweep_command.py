# SPDX-License-Identifier: Apache-2.0
"""`inductrack sweep` as a user runs it: files whole or none, and one line for what is wrong."""

import re

import numpy as np
import pytest

from inductrack_ros import cli
from inductrack_ros.core.model import Model
from inductrack_ros.core.uncertainty import Uncertainty

QUICK = ("--duration", "0.3", "--rate", "100")


def run(folder, *arguments):
    return cli.main(
        ["sweep", *arguments, *(a for a in QUICK if "--duration" not in arguments), "--output", str(folder / "maps")]
    )


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    path = tmp_path_factory.mktemp("fit") / "model.yaml"
    Model.default().save(path, "fitted", Uncertainty(("eta", "sensor_bias:heave.bias"), np.diag([1e-6, 1e-8])))
    return str(path)


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    (folder / "campaign.yaml").write_text(
        "runs:\n  - {file: slow.csv, drive_current: 0.0, initial_state: {surge_rate: 14.0}}\n  - {file: fast.csv,"
        " drive_current: 7000.0, initial_state: {surge_rate: 28.0}, conditions: {mass: 9.0, weather: 3.0}}\n  - {file:"
        " when_we_know_more.csv, drive_current: 3500.0}\n"
    )
    return str(folder)


def test_a_map_with_planned_runs(tmp_path, capsys, planned):
    xarray = pytest.importorskip("xarray")
    assert (
        run(
            tmp_path,
            "--over",
            "surge_rate=12:30:7",
            "--over",
            "drive_current=0:7000:5",
            "--campaign",
            planned,
            "--duration",
            "1.5",
        )
        == 0
    )
    said = capsys.readouterr().out
    assert (
        re.search(r"Over 1\.5 s \d+ of 35 runs fly clear of the track", said)
        and str(tmp_path / "maps" / "report.html") in said
    )
    assert sorted(p.name for p in (tmp_path / "maps").iterdir()) == ["report.html", "sweep.nc"]
    page = (tmp_path / "maps" / "report.html").read_text()
    assert "Of 3 planned runs 1 touches the track: slow after" in page
    assert "Too little is known of when_we_know_more to draw" in page and "not used: weather" in page
    with xarray.open_dataset(tmp_path / "maps" / "sweep.nc") as back:
        assert back["planned_run"].values.tolist() == ["slow", "fast", "when_we_know_more"]
        assert back["planned_at_surge_rate"].values[:2].tolist() == [14.0, 28.0] and np.isnan(
            back["planned_at_surge_rate"].values[2]
        )
        model = Model.default().with_changes({"mass": 9.0})
        flown = model.simulate(np.arange(751) / 500.0, model.initial_state(surge_rate=28.0))
        assert back["planned_travel"].values[1] == pytest.approx(flown["surge"][-1], rel=1e-9)


def test_an_axis_that_changes_nothing_is_said(tmp_path, capsys):
    """A wave of no height has any length."""
    assert run(tmp_path, "--over", "guideway_waviness.wavelength=0.5,1", "--over", "surge_rate=20,30") == 0
    assert (
        "Nothing changes along guideway_waviness.wavelength: the model's other values leave it without effect."
        in capsys.readouterr().out
    )


def test_draws_by_one_axis(tmp_path, capsys, fitted):
    assert run(tmp_path, "--over", "surge_rate=14:40:5", "--model", fitted, "--samples", "6") == 0
    page = (tmp_path / "maps" / "report.html").read_text()
    assert (
        "6 draws" in page
        and "<code>eta</code>" in page
        and "bias" not in page.split("Uncertainty</h2>")[1].split("</table>")[0]
    )


def test_the_same_seed_gives_the_same_numbers(tmp_path, fitted):
    for name in ("a", "b"):
        assert (
            cli.main(
                [
                    "sweep",
                    "--over",
                    "surge_rate=20,30",
                    "--model",
                    fitted,
                    "--samples",
                    "4",
                    *QUICK,
                    "--output",
                    str(tmp_path / name),
                ]
            )
            == 0
        )
    assert (tmp_path / "a" / "sweep.nc").read_bytes() == (tmp_path / "b" / "sweep.nc").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--over", "surge_rat=10:40:5"), "unknown name 'surge_rat'; did you mean 'surge_rate'?"),
        (("--over", "viscous_drag.coeficient=0:1:5"), "no parameter 'coeficient'; did you mean 'coefficient'?"),
        (("--over", "viscos_drag.coefficient=0:1:5"), "unknown effect 'viscos_drag'; did you mean 'viscous_drag'?"),
        (("--over", "eta=-1:1:5"), "eta = -1 is out of range; it must lie in [0.01, 10]"),
        (("--over", "drive_current=0:2e5:5"), "drive_current = 200000 is out of range"),
        (("--over", "surge_rate=10:40:1"), "an axis of 1 point is no axis"),
        (("--over", "surge_rate=10:40:0"), "an axis of 0 points is no axis"),
        (("--over", "surge_rate=10"), "an axis of 1 point is no axis"),
        (("--over", "surge_rate=10:40"), "is not FROM:TO:COUNT"),
        (("--over", "surge_rate=10:40:3:5"), "is not FROM:TO:COUNT"),
        (("--over", "surge_rate=10:nan:3"), "must be finite"),
        (("--over", "surge_rate=40:10:3"), "FROM must lie below TO"),
        (("--over", "surge_rate=0:10:3:log"), "must lie above 0"),
        (("--over", "surge_rate=10,10,20"), "stands there twice"),
        (("--over", "surge_rate"), "is not NAME=FROM:TO:COUNT"),
        (("--over", "surge_rate=1:2:3", "--over", "surge_rate=1:2:3"), "'surge_rate' is given twice"),
        (("--over", "eta=.5:1:3", "--over", "gamma=1:2:3", "--over", "mass=1:2:3"), "one axis or two"),
        (("--over", "sensor_bias:heave.bias=0:1:3"), "a sensor's, which changes no run"),
        (("--over", "track_temperature=0:40:3"), "no effect of the model asks for it"),
        (
            ("--over", "stand_in_surge.values=0:1:3"),
            "holds a table; name one entry of it, e.g. stand_in_surge.values[0]",
        ),
        (
            ("--over", "surge_rate=10:40:2000", "--over", "drive_current=0:7000:2000"),
            "make 4000000 runs (2000 × 2000 points, 1 runs each); at most",
        ),
        (("--over", "surge_rate=10:40:3", "--samples", "0"), "--samples 0: give 1 or more"),
        (
            ("--over", "surge_rate=10:40:3", "--samples", "5"),
            "carries no covariance; give --model a model.yaml that inductrack fit or diagnose wrote",
        ),
        (("--over", "surge_rate=10:40:3", "--initial", "surge_rate=12"), "surge_rate is an axis of the sweep already"),
        (("--over", "surge_rate=10:40:3", "--initial", "swai=12"), "unknown name 'swai'; did you mean 'sway'?"),
        (("--over", "drive_current=1:40:3", "--drive-current", "12"), "give one of them"),
        (("--over", "surge_rate=10:40:3", "--duration", "0"), "--duration 0: must be above 0 s"),
        (("--over", "surge_rate=10:40:3", "--seed", "-1"), "--seed -1: must lie in"),
        (("--over", "contact_stiffness=0,1", "--initial", "surge_rate=5"), "no point of the sweep can be flown"),
        (("--over", "surge_rate=10:40:3", "--campaign", "/nowhere"), "/nowhere/campaign.yaml: no such file"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(tmp_path, capsys, arguments, said):
    assert run(tmp_path, *arguments) == 2
    told = capsys.readouterr().err
    assert said in told and told.startswith("inductrack sweep: ") and told.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_covariance_of_which_the_runs_depend_on_nothing_is_refused(tmp_path, capsys, fitted):
    assert run(tmp_path, "--over", "eta=0.7:0.8:3", "--model", fitted, "--samples", "5") == 2
    assert "nothing is left to draw; the covariance is of eta, sensor_bias:heave.bias" in capsys.readouterr().err
