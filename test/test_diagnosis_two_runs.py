# SPDX-License-Identifier: Apache-2.0
"""Two runs at once where none settles the question alone, and the run that determines a parameter best."""

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis_limits import NARROW, written

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign, write_csv
from inductrack_ros.diagnosis import experiment
from inductrack_ros.diagnosis.diagnose import diagnose
from inductrack_ros.diagnosis.sharpen import sharpen
from inductrack_ros.estimation import shooting
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure
from inductrack_ros.workers import Threads

AREA = "aerodynamic_drag.drag_area"


@pytest.fixture(autouse=True)
def short_menu(monkeypatch):
    monkeypatch.setattr(experiment, "SPEEDS", (12.0, 20.0, 26.0))
    monkeypatch.setattr(experiment, "CURRENTS", (0.0, 7000.0))
    monkeypatch.setattr(experiment, "DURATIONS", (1.0,))
    monkeypatch.setattr(experiment, "OFFSETS", ((0.0, 0.0, 0.0), (5e-4, 1e-3, 2e-3)))


def fitted(campaign, name):
    problem = Problem(campaign, Model.default(), campaign.noise_std)
    return problem, shooting.fit(problem, Structure(problem.model, ("eta",)).plus(name))


@pytest.fixture(scope="module")
def question(tmp_path_factory):
    campaign = load_campaign(written(tmp_path_factory.mktemp("rig"), NARROW))
    problem, drag = fitted(campaign, "aerodynamic_drag")
    return campaign, problem, drag, fitted(campaign, "viscous_drag")[1]


def asked(problem, drag, viscous):
    rivals, twins = {"viscous_drag": viscous}, {"aerodynamic_drag": ("viscous_drag",)}
    return experiment.propose(problem, Threads().map, drag, rivals, twins, ())


def test_two_runs_where_none_settles_it_alone(question, monkeypatch):
    _, problem, drag, viscous = question
    alone = asked(problem, drag, viscous)[1]
    one = min(alone.sigmas.values())
    monkeypatch.setattr(experiment, "SETTLED", 1.05 * one)
    words, two = asked(problem, drag, viscous)
    assert two.second is not None and "no single run settles it, two do" in words
    assert f"{two.second.words}: together" in words and two.to_json()["second"]["surge_rate"] == two.second.speed
    both = []
    for run in (two, two.second):
        assert problem.limits.allow("surge_rate", run.speed) and problem.limits.allow("drive_current", run.current)
        made = experiment.made_run(
            problem, drag.model, experiment.MenuRun(run.speed, run.current, run.offsets, run.duration)
        )
        both.append(experiment._separation(made, drag, viscous, ()))
    together = two.sigmas["viscous_drag"]
    assert max(both) <= one * 1.001 and together >= 1.05 * one
    assert together > 0.97 * np.hypot(*both)  # one set of parameters for both runs
    monkeypatch.setattr(experiment, "SETTLED", 100.0 * one)
    assert "no single run of this kind settles it" in asked(problem, drag, viscous)[0]


def test_the_run_that_determines_a_parameter_best_does_so(question, tmp_path):
    """Made and fitted with the others, it leaves the parameter as uncertain as was told."""
    campaign, problem, drag, _ = question
    words, run = sharpen(problem, Threads().map, drag, AREA)
    told = run.std_after[AREA]
    assert f"standard deviation of {AREA} from" in words and told < 0.85 * drag.deviations[AREA]
    first = run if run.second is None else None
    model, noise = drag.model, np.random.default_rng(5)
    runs = []
    for k, one in enumerate([run] if first else [run, run.second]):
        assert problem.limits.allow("surge_rate", one.speed) and problem.limits.allow("drive_current", one.current)
        start = model.initial_state(surge_rate=one.speed, drive_current=one.current)
        start[[2, 1, 3]] += one.offsets
        times = np.arange(0.0, one.duration, 1 / experiment.RATE)
        flown = model.simulate(times, start, one.current)
        assert flown["gap_top"].min() > 0 and problem.limits.allow("surge", flown["surge"])
        columns = {c: flown[c] + campaign.noise_std[c] * noise.standard_normal(len(times)) for c in ("surge", "heave")}
        write_csv(tmp_path / f"next_{k}.csv", times, columns)
        runs.append(f"  - {{file: next_{k}.csv, drive_current: {one.current}}}\n")
    (tmp_path / "campaign.yaml").write_text("noise_std: {surge: 0.0005, heave: 0.00003}\nruns:\n" + "".join(runs))
    more = load_campaign(tmp_path)
    _, after = fitted(replace(campaign, runs=(*campaign.runs, *more.runs)), "aerodynamic_drag")
    assert after.deviations[AREA] == pytest.approx(told, rel=0.3)


def test_a_campaign_asks_for_it(tmp_path):
    folder = written(tmp_path, "sharpen: gamma\n" + NARROW)
    times, model, noise = np.arange(101) / 200.0, Model.default(), np.random.default_rng(1)
    for i, (speed, current) in enumerate(((22.0, 0.0), (18.0, 7000.0))):
        run = model.simulate(times, model.initial_state(surge_rate=speed), current)
        size = {"surge": 5e-4, "heave": 3e-5}
        write_csv(
            folder / f"run_{i}.csv", times, {c: run[c] + s * noise.standard_normal(101) for c, s in size.items()},
            overwrite=True,
        )  # fmt: skip
    text = (
        (folder / "campaign.yaml")
        .read_text()
        .replace("run_1.csv, drive_current: 0.0", "run_1.csv, drive_current: 7000.0")
    )
    (folder / "campaign.yaml").write_text("dof: [surge, heave]\n" + text)
    result = diagnose(load_campaign(folder), model)
    assert result.verdict == "adequate" and "standard deviation of gamma from" in result.next_experiment
    assert result.proposal.to_json()["std_after"]["gamma"] < result.parameters["gamma"][1]
    (folder / "campaign.yaml").write_text(text.replace("sharpen: gamma", "sharpen: mass"))
    note = [n for n in diagnose(load_campaign(folder), model).notes if n.startswith("sharpen")]
    assert note and "'mass' is not among the fitted parameters" in note[0]
    (folder / "campaign.yaml").write_text(text.replace("sharpen: gamma", "sharpen: gamm"))
    with pytest.raises(InputError, match="line 1: sharpen: unknown parameter 'gamm'; did you mean 'gamma'?"):
        load_campaign(folder)
