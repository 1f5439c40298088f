# SPDX-License-Identifier: Apache-2.0
"""Idea: the pulses of a perfect controller. They peak as the centre passes their coils, do what the averaged drive
says, are no noise to the look at the data, and drive the runs that are proposed."""

from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.checks import look
from inductrack_ros.core.firing import pulses_of
from inductrack_ros.core.model import Model
from inductrack_ros.data import Campaign, Run
from inductrack_ros.diagnosis import experiment
from inductrack_ros.diagnosis.experiment import propose
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.shooting import fit
from inductrack_ros.estimation.structure import Structure

NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4, "surge_rate": 0.01, "surge_acceleration": 0.05}
CURRENT = 3500.0


@pytest.fixture(scope="module")
def model():
    return Model.create(drive="pulses")


@pytest.mark.parametrize("speed", [12.0, 20.0])
def test_each_coil_fires_as_the_centre_passes(model, speed):
    start = model.initial_state(surge_rate=speed)
    pulses = pulses_of(model, start, 1.0, CURRENT)
    middles = pulses.times + 0.5 * model.parameters["pulse_length"]
    inside = middles < 1.0
    places = model.simulate(middles[inside], start, pulses=pulses, start=0.0)["surge"]
    assert places == pytest.approx(pulses.coils[inside] * model.parameters["wavelength"] / 2, abs=2e-5)
    assert (np.diff(pulses.coils) == 1).all() and inside.sum() > 50
    averaged = Model.default().simulate(np.array([0.0, 0.25]), start, drive_current=CURRENT)["surge_rate"][-1]
    coasting = model.simulate(np.array([0.0, 0.25]), start)["surge_rate"][-1]
    driven = model.simulate(np.array([0.0, 0.25]), start, pulses=pulses)["surge_rate"][-1]
    assert driven - coasting == pytest.approx(averaged - coasting, rel=0.1)


def test_a_cradle_at_rest_is_not_driven(model):
    assert len(pulses_of(model, np.zeros(8), 1.0, CURRENT).times) == 0


def campaign_of(model: Model, duration: float = 0.6) -> Campaign:
    rng = np.random.default_rng(3)
    runs = []
    for speed in (18.0, 24.0):
        start = model.initial_state(surge_rate=speed)
        start[1:4] += 1e-3, 5e-4, 3e-3
        times, pulses = np.arange(0.0, duration, 2e-3), pulses_of(model, start, duration, CURRENT)
        made = model.simulate(times, start, pulses=pulses)
        values = np.column_stack([made[c] for c in NOISE])
        values += rng.standard_normal(values.shape) * list(NOISE.values())
        name = f"at_{speed:g}"
        runs.append(Run(name, Path(name), tuple(NOISE), times, values, times, CURRENT, pulses=pulses))
    return Campaign("pulsed", Path("pulsed"), tuple(runs), NOISE)


def test_pulses_are_neither_noise_nor_a_hum(model):
    campaign = campaign_of(model, 1.2)
    thrusts = campaign.runs[0]["surge_acceleration"]
    assert np.std(np.diff(thrusts)) > 50 * NOISE["surge_acceleration"]
    assert [f.line for f in look(campaign, model)] == []


def test_a_run_proposed_for_a_pulsed_drive_is_driven(model, monkeypatch):
    rig = Model.create(drive="pulses", effects={"aerodynamic_drag": {"drag_area": 0.2}})
    problem = Problem(campaign_of(rig), model, NOISE)
    fits = {n: fit(problem, Structure(model, ()).plus(n)) for n in ("aerodynamic_drag", "viscous_drag")}
    monkeypatch.setattr(experiment, "SPEEDS", (30.0,))
    monkeypatch.setattr(experiment, "CURRENTS", (CURRENT,))
    monkeypatch.setattr(experiment, "DURATIONS", (1.0,))
    words, run = propose(
        problem, lambda f, them: [f(x) for x in them], fits["aerodynamic_drag"],
        {"viscous_drag": fits["viscous_drag"]}, {}, (),
    )  # fmt: skip
    assert run.current == CURRENT and "3500 A" in words


def test_no_run_is_said_to_settle_what_is_alike_in_motion(model, monkeypatch):
    """Of resistance and inductance only the ratio shows. A refit that pulses and seconds of flight lead astray would
    tell them apart by dozens of sigmas."""
    rig = Model.create(drive="pulses", effects={"track_resistance": {"relative_change": 0.03}})
    problem = Problem(campaign_of(rig), model, NOISE)
    one, other = (
        fit(problem, Structure(model, ("eta", "gamma")).plus(n)) for n in ("track_resistance", "track_inductance")
    )
    monkeypatch.setattr(experiment, "SPEEDS", (42.0,))
    monkeypatch.setattr(experiment, "CURRENTS", (CURRENT,))
    monkeypatch.setattr(experiment, "DURATIONS", (3.0,))
    twins = {"track_resistance": ("track_inductance",)}
    words, run = propose(problem, lambda f, them: [f(x) for x in them], one, {"track_inductance": other}, twins, ())
    assert run.least < 2.0 and "Only their ratio shows in motion" in words
