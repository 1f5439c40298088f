# SPDX-License-Identifier: Apache-2.0
"""What differs from run to run: coordinates that are held, conditions, inputs measured in time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent import simulator as other
from test_data_bags import EPOCH, GOOD, point, poses, record

from inductrack_ros import cli
from inductrack_ros.compare import compare
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import as_dof
from inductrack_ros.data import campaign_keys, load_campaign, read_bag, write_csv
from inductrack_ros.estimation import shooting
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure

TIMES = np.arange(300) / 500
OWN = Path(__file__).with_name("own_effects.py")


def rig(folder: Path, flown: dict, keys: str = "", noise=3e-5, seed=1) -> Path:
    """A campaign of runs by name: (model, initial state, drive current, further keys of the run)."""
    rng = np.random.default_rng(seed)
    folder.mkdir(exist_ok=True)
    lines = [keys, "noise_std: {surge: 3.0e-5, heave: 3.0e-5}", "runs:"]
    for name, (model, start, current, more) in flown.items():
        run = model.simulate(TIMES, model.initial_state(**start), current)
        write_csv(
            folder / f"{name}.csv", TIMES, {c: run[c] + rng.normal(0, noise, len(TIMES)) for c in ("surge", "heave")}
        )
        lines.append(f"- {{file: {name}.csv, drive_current: {current}{more}}}")
    (folder / "campaign.yaml").write_text("\n".join(lines) + "\n")
    return folder


# ---------------------------------------------------------------- coordinates that are held


def test_a_list_of_coordinates_is_a_number_where_there_is_one():
    assert (
        as_dof(["heave", "surge"]) == 2 and as_dof(("surge", "sway", "heave", "roll")) == 4 and as_dof(["heave"]) == 1
    )
    assert as_dof(["heave", "surge", "roll"]) == ("surge", "heave", "roll") and as_dof(2) == 2
    for nonsense in (3, True, 2.0, [], ["surge", "surge"], ["pitch"], "surge", None):
        assert as_dof(nonsense) is None


def test_only_what_is_named_moves(tmp_path):
    model = Model.create(dof=["surge", "roll"])
    start = model.initial_state(surge_rate=15.0, sway=1e-3, heave=-0.0047, roll=0.01)
    end = model.simulate(TIMES, start, 7000.0).states[-1]
    assert end[1] == start[1] and end[2] == start[2] and end[0] > 5 and end[3] != start[3]
    model.save(tmp_path / "model.yaml")
    assert Model.load(tmp_path / "model.yaml") == model
    with pytest.raises(InputError, match="dof = .* must be 1, 2, 4 or a list of surge, sway, heave, roll"):
        Model.create(dof=["surge", "pitch"])


def test_a_cart_without_magnets_and_contact(tmp_path):
    """Coasting on a rig that does not float: surge alone, slowed by a force that grows with speed."""
    plain = {"contact_stiffness": 0.0, "peak_field": 0.0, "mass": 2.0}
    model = Model.create(plain, {"viscous_drag": {"coefficient": 0.8}}, dof=["surge"])
    run = model.simulate(TIMES, model.initial_state(surge_rate=3.0), 0.0)
    assert run["surge_rate"][-1] == pytest.approx(3.0 * np.exp(-0.4 * TIMES[-1]), rel=1e-6)
    folder = rig(
        tmp_path / "rig",
        {"a": (model, {"surge_rate": 3.0}, 0, ""), "b": (model, {"surge_rate": 2.0}, 0, "")},
        "dof: [surge]",
    )
    for name in ("a", "b"):
        table = (folder / f"{name}.csv").read_text().splitlines()
        (folder / f"{name}.csv").write_text("\n".join(line.rpartition(",")[0] for line in table) + "\n")
    campaign = load_campaign(folder)
    assert campaign.dof == ("surge",)
    assert compare(campaign, model).error < 1.2


# ---------------------------------------------------------------- conditions


def test_a_condition_takes_the_place_of_a_parameter_in_its_run(tmp_path):
    light, heavy = Model.create({"mass": 9.0}), Model.create({"mass": 9.42})
    start = {"surge_rate": 18.0}
    flown = {
        "light": (light, start, 7000.0, ", conditions: {mass: 9.0}"),
        "heavy": (heavy, start, 7000.0, ", conditions: {mass: 9.42}"),
    }
    campaign = load_campaign(rig(tmp_path / "rig", flown))
    assert [run.conditions for run in campaign.runs] == [{"mass": 9.0}, {"mass": 9.42}]
    assert compare(campaign, Model.default()).errors["surge"] < 3.0
    without = load_campaign(rig(tmp_path / "without", {n: (m, s, i, "") for n, (m, s, i, _) in flown.items()}))
    assert compare(without, Model.default()).errors["surge"] > 50.0


def test_a_condition_reaches_the_effect_that_asks_for_it(tmp_path):
    model = Model.create(effects={"warm_track": {"coefficient": 0.004}}, effect_files=[OWN])
    hot = Model.create({"resistance": model.parameters["resistance"] * 1.08})  # 40 °C
    cold = Model.default()
    flown = {
        "hot": (hot, {"surge_rate": 18.0}, 0, ", conditions: {track_temperature: 40.0, humidity: 0.3}"),
        "cold": (cold, {"surge_rate": 18.0}, 0, ""),
    }
    campaign = load_campaign(rig(tmp_path / "rig", flown))
    assert compare(campaign, model).error < 1.2 < 5.0 < compare(campaign, Model.default()).error
    structure = Structure(model, ())
    problem = Problem(campaign, model, {"surge": 3e-5, "heave": 3e-5})
    column = model.kernel.parameters.index("track_temperature")
    assert [problem.vectors(structure, i, structure.start[None])[0, column] for i in (0, 1)] == [40.0, 20.0]
    unused = "condition 'humidity' is not used: neither the model nor an effect asks for it"
    assert campaign.against(model).remarks == (unused, "cold: no condition 'track_temperature'; 20 is taken")
    # An effect that may be found missing asks for it.
    assert campaign.against(Model.default()).remarks[1] == "cold: no condition 'track_temperature'; 20 is taken"
    told = model.with_changes(conditions={"track_temperature": 35.0})
    assert campaign.against(told).remarks[1] == "cold: no condition 'track_temperature'; 35 is taken"
    problem = Problem(campaign, told, {"surge": 3e-5, "heave": 3e-5})
    assert [problem.vectors(Structure(told, ()), i, structure.start[None])[0, column] for i in (0, 1)] == [40.0, 35.0]


def test_conditions_of_a_model_are_kept_and_checked(tmp_path):
    model = Model.create(effects={"track_temperature": {"coefficient": 0.004}}, conditions={"track_temperature": 45.0})
    model.save(tmp_path / "model.yaml")
    assert Model.load(tmp_path / "model.yaml") == model == Model.from_mapping(model.to_mapping())
    x = model.initial_state(surge_rate=20.0)
    warm = Model.create({"resistance": 1.5e-3 * 1.1})
    assert model.wrenches(x)["total"] == pytest.approx(warm.wrenches(x)["total"], rel=1e-12)
    with pytest.raises(
        InputError, match="conditions.track_temprature: no effect asks for it; did you mean 'track_temperature'"
    ):
        Model.from_mapping({"conditions.track_temprature": 3.0})
    with pytest.raises(
        InputError, match="conditions.mass: it is a parameter of the model, set that|conditions.mass: no effect"
    ):
        Model.from_mapping({"conditions.mass": 3.0})
    with pytest.raises(InputError, match="conditions.track_temperature = 'warm' is not a finite number"):
        Model.from_mapping({"conditions.track_temperature": "warm"})


def test_a_campaign_is_flown_under_its_conditions(tmp_path):
    """What `simulate --run` writes under conditions, `compare` reads under the same ones."""
    (tmp_path / "truth.yaml").write_text("effects: [track_temperature]\ntrack_temperature: {coefficient: 0.004}\n")
    runs = [f"--run=surge_rate=18,drive_current=0,track_temperature={t}" for t in (10, 60)]
    cli.main(
        [
            "simulate",
            "--model",
            str(tmp_path / "truth.yaml"),
            *runs,
            "--duration",
            "0.5",
            "--seed",
            "1",
            "--output",
            str(tmp_path / "rig"),
        ]
    )
    campaign = load_campaign(tmp_path / "rig")
    assert [run.conditions for run in campaign.runs] == [{"track_temperature": 10.0}, {"track_temperature": 60.0}]
    assert (
        compare(campaign, Model.load(tmp_path / "truth.yaml")).error
        < 1.2
        < 3.0
        < compare(campaign, Model.default()).error
    )


# ---------------------------------------------------------------- inputs


def test_inputs_of_a_csv_and_of_a_bag(tmp_path):
    (tmp_path / "run.csv").write_text(
        "time,surge,I [kA],v\n" + "".join(f"{t},{15 * t},{7 + t},{1}\n" for t in TIMES[:50])
    )
    (tmp_path / "campaign.yaml").write_text("inputs: {drive_current: I, wind: v}\nruns: [{file: run.csv}]\n")
    campaign = load_campaign(tmp_path)
    times, current = campaign.runs[0].inputs["drive_current"]
    assert current == pytest.approx(7000 + 1e3 * TIMES[:50]) and times == pytest.approx(TIMES[:50])
    assert campaign.runs[0].drive_current == pytest.approx(7049.0)
    notes = campaign.against(Model.default()).notes
    assert (
        notes[0] == "input 'wind' is read and not used: the model takes only drive_current as it was measured in time"
    )
    assert "run: drive_current was measured from 7000 to 7098 A; the drive follows it" in notes

    bag = record(
        tmp_path / "bag",
        {GOOD: poses(3), "/bus": [point(EPOCH + 2_000_000, 3.5, -1), point(EPOCH + 4_000_000, 4.5, -1)]},
    )
    times, values = read_bag(bag, inputs={"wind": "/bus:point.x"}).inputs["wind"]
    assert times == pytest.approx([0.002, 0.004]) and values.tolist() == [3.5, 4.5]
    with pytest.raises(InputError, match="/bus:point.w: no number there .* has header, point"):
        read_bag(bag, inputs={"wind": "/bus:point.w"})
    with pytest.raises(InputError, match="inputs: /buss:point.x: no such topic in the bag; did you mean '/bus'"):
        read_bag(bag, inputs={"wind": "/buss:point.x"})


def flown_with(current: np.ndarray, speed: float, times: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """States (n, 8) of the other simulator's rig, whose current changes from sample to sample: in a staircase through
    the middle of each interval."""
    state = np.array([0.0, 0.0, other.equilibrium_heave(speed, parameters), 0.0, speed, 0.0, 0.0, 0.0])
    states = [state]
    for step, amperes in zip(np.diff(times), 0.5 * (current[1:] + current[:-1]), strict=True):
        states.append(other.simulate(np.array([0.0, step]), states[-1], amperes, parameters)[0][-1, :8])
    return np.array(states)


@pytest.mark.parametrize("given", ["", ", drive_current: 100.0"])
def test_a_measured_current_drives_the_model_as_it_was_measured(tmp_path, given):
    """A bus that sags and recovers. With the mean current the speed would be off by far more than its noise."""
    times, parameters = np.arange(0.0, 1.2, 0.002), other.rig(eta=0.7295, gamma=3.9298)
    current = 7000.0 + 3000.0 * np.sin(2 * np.pi * times / 0.8)
    states = flown_with(current, 20.0, times, parameters)
    rng = np.random.default_rng(3)
    columns = {c: states[:, k] + 3e-5 * rng.standard_normal(len(times)) for k, c in ((0, "surge"), (2, "heave"))}
    write_csv(tmp_path / "run.csv", times, columns | {"bus": current})
    keys = "noise_std: {surge: 3.0e-5, heave: 3.0e-5}\ndof: [surge, heave]\ninputs: {drive_current: bus}\n"
    (tmp_path / "campaign.yaml").write_text(f"{keys}runs: [{{file: run.csv{given}}}]\n")
    campaign = load_campaign(tmp_path)
    assert any("the drive follows it" in note for note in campaign.notes)
    assert any("100 A in campaign.yaml" in note for note in campaign.notes) == bool(given)
    model = Model.create({"eta": 0.7295, "gamma": 3.9298})
    followed = compare(campaign, model)
    assert followed.runs[0].error < 1.1
    mean = compare(replace(campaign, runs=tuple(replace(run, inputs={}) for run in campaign.runs)), model)
    assert mean.runs[0].error > 10.0

    problem = Problem(campaign, model, {"surge": 3e-5, "heave": 3e-5})
    fitted = shooting.fit(problem, Structure(model, ("eta", "gamma")))
    for name, value in (("eta", 0.7295), ("gamma", 3.9298)):
        assert fitted.values[name] == pytest.approx(value, abs=4 * fitted.deviations[name]), name
        assert fitted.deviations[name] < 1e-3 * value


# ---------------------------------------------------------------- the table of keys


def test_the_table_of_keys_is_the_readers():
    page = (Path(__file__).parent.parent / "docs" / "campaigns.md").read_text(encoding="utf-8")
    assert campaign_keys.table() in page
