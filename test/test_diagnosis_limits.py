# SPDX-License-Identifier: Apache-2.0
"""The run that a diagnosis proposes stays within the limits that the campaign gives, from its start to its end."""

from dataclasses import replace

import numpy as np
import pytest

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import GAPS
from inductrack_ros.data import load_campaign, write_csv
from inductrack_ros.data.limits import Limits
from inductrack_ros.diagnosis import experiment
from inductrack_ros.estimation import shooting
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure
from inductrack_ros.workers import Threads

NARROW = "limits: {surge_rate: [12, 24], drive_current: [0, 5000], surge: [0, 40]}\n"


def written(folder, limits=""):
    model = Model.create(effects={"aerodynamic_drag": {"drag_area": 0.1}})
    times, noise = np.arange(101) / 200.0, np.random.default_rng(0)
    text = limits + "noise_std: {surge: 0.0005, heave: 0.00003}\nruns:\n"
    for i, speed in enumerate((22.0, 26.0)):
        run = model.simulate(times, model.initial_state(surge_rate=speed), 0.0)
        columns = {
            "surge": run["surge"] + 5e-4 * noise.standard_normal(101),
            "heave": run["heave"] + 3e-5 * noise.standard_normal(101),
        }
        write_csv(folder / f"run_{i}.csv", times, columns)
        text += f"  - {{file: run_{i}.csv, drive_current: 0.0}}\n"
    (folder / "campaign.yaml").write_text(text)
    return folder


@pytest.fixture(autouse=True)
def short_menu(monkeypatch):
    """Twelve runs in place of 288."""
    monkeypatch.setattr(experiment, "SPEEDS", (12.0, 20.0, 26.0))
    monkeypatch.setattr(experiment, "CURRENTS", (0.0, 7000.0))
    monkeypatch.setattr(experiment, "DURATIONS", (1.0,))
    monkeypatch.setattr(experiment, "OFFSETS", ((0.0, 0.0, 0.0),))


@pytest.fixture(scope="module")
def question(tmp_path_factory):
    """A problem with the fit of one drag and of another, which the runs cannot tell apart."""
    campaign = load_campaign(written(tmp_path_factory.mktemp("rig"), NARROW))
    problem = Problem(campaign, Model.default(), campaign.noise_std)
    fits = {
        n: shooting.fit(problem, Structure(problem.model, ("eta",)).plus(n))
        for n in ("aerodynamic_drag", "viscous_drag")
    }
    return problem, fits


def proposed(question, limits):
    problem, fits = question
    problem = problem.subset([0, 1])
    problem.limits = limits
    return problem, *experiment.propose(
        problem,
        Threads().map,
        fits["aerodynamic_drag"],
        {"viscous_drag": fits["viscous_drag"]},
        {"aerodynamic_drag": ("viscous_drag",)},
        (),
    )


def test_the_proposed_run_stays_within_them(question, monkeypatch):
    limits = question[0].limits
    monkeypatch.setattr(experiment, "ENOUGH", 1e9)  # the whole menu is tried
    # The longest and fastest.
    for told in ("_expected", "_separation"):
        monkeypatch.setattr(experiment, told, lambda made, *_: float(len(made.runs[0].y) + made.runs[0].guess[4]))
    _, _, free = proposed(question, Limits())
    assert not limits.allow("surge_rate", free.speed)
    problem, words, run = proposed(question, limits)
    model = question[1]["aerodynamic_drag"].model
    start = model.initial_state(surge_rate=run.speed, drive_current=run.current)
    start[2:4] += run.offsets[0], run.offsets[2]
    start[1] += run.offsets[1]
    flown = model.simulate(np.arange(0.0, run.duration, 0.004), start, run.current)
    assert (
        limits.allow("surge_rate", flown["surge_rate"])
        and limits.allow("surge", flown["surge"])
        and limits.allow("drive_current", run.current)
    )
    assert min(flown[g].min() for g in GAPS) > 0
    assert f"start at {run.speed:g} m/s" in words


def test_contact_only_where_it_is_asked_for(question, monkeypatch):
    # The slowest: it lands.
    for told in ("_expected", "_separation"):
        monkeypatch.setattr(experiment, told, lambda made, *_: 1.0 / made.runs[0].guess[4])
    ranges = {"surge_rate": (0.0, 24.0), "drive_current": (0.0, 1000.0)}
    monkeypatch.setattr(
        experiment, "menu", lambda limits, name, usual: (12.0, 24.0) if name == "surge_rate" else (0.0,)
    )
    monkeypatch.setattr(experiment, "SHORT", ())
    _, words, run = proposed(question, Limits(ranges, False))
    assert run is None and "no run within" in words  # coasting for a second, both land
    _, _, run = proposed(question, Limits(ranges, True))
    assert run.speed == 12.0


def test_where_nothing_within_them_helps_it_is_said(question):
    _, words, run = proposed(question, Limits({"surge_rate": (20.0, 20.5)}, False))
    assert run is None and words == "no run within the campaign's limits sets apart what is open"


def test_the_real_separation_chooses_within_them(question):
    limits = question[0].limits
    _, words, run = proposed(question, limits)
    assert run is not None and limits.allow("surge_rate", run.speed) and limits.allow("drive_current", run.current), (
        words
    )


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ("limits: {surge_rat: [9, 30]}\n", "line 1: limits: unknown key 'surge_rat'; did you mean 'surge_rate'?"),
        (
            "limits: {surge_rate: [30, 9]}\n",
            r"line 1: limits: surge_rate must be \[least, most\], two numbers that rise",
        ),
        ("limits: {surge_rate: 30}\n", r"surge_rate must be \[least, most\]"),
        ("limits: {surge_rate: [a, 9]}\n", r"surge_rate must be \[least, most\]"),
        ("limits: {drive_current: [-5, 9]}\n", "drive_current = -5 is out of range"),
        ("limits: {contact: perhaps}\n", "contact must be true or false"),
        ("limits: [9, 30]\n", "must be `key: value` lines"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(tmp_path, limits, said):
    with pytest.raises(InputError, match=said):
        load_campaign(written(tmp_path, limits))


def test_they_are_read(tmp_path):
    campaign = load_campaign(written(tmp_path, NARROW))
    assert campaign.limits == Limits(
        {"surge_rate": (12.0, 24.0), "drive_current": (0.0, 5000.0), "surge": (0.0, 40.0)}, False
    )
    assert replace(campaign, name="x").limits == campaign.limits
