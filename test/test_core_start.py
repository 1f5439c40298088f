# SPDX-License-Identifier: Apache-2.0
"""Effects that carry states start from the run's own conditions: its drive current, its pulses, wherever it is run."""

import csv
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.cli import main
from inductrack_ros.core.model import Model, Pulses
from inductrack_ros.data import load_campaign
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure
from inductrack_ros.nodes.drive import PulseQueue
from inductrack_ros.nodes.simulation import Simulation

START = {"surge_rate": 22.0}


@pytest.fixture(scope="module")
def slow():
    return Model.create(effects=["slow_drive"], effect_files=[Path(__file__).with_name("own_effects.py")])


def travel(model, current, **settled):
    run = model.simulate([0.0, 0.3], model.initial_state(**START), current, **settled)
    return run["surge"][-1]


def test_a_run_without_current_starts_without_thrust(slow):
    """Coasting, an effect that delays the thrust does nothing at all; driven by half, it starts on half."""
    assert travel(slow, 0.0) == pytest.approx(travel(Model.default(), 0.0), abs=1e-9)
    steady = {current: travel(slow, current) for current in (0.0, 3500.0, 7000.0)}
    assert steady[3500.0] == pytest.approx(0.5 * (steady[0.0] + steady[7000.0]), abs=0.02)
    assert steady[7000.0] > steady[0.0] + 0.3  # m: what a start from 7000 A would have added


def test_simulate_starts_from_the_current_it_is_given(slow, tmp_path):
    slow.save(tmp_path / "model.yaml")
    out = tmp_path / "run.csv"
    given = [
        "--model",
        str(tmp_path / "model.yaml"),
        "--initial",
        "surge_rate=22",
        "--duration",
        "0.3",
        "--drive-current",
        "0",
    ]
    assert main(["simulate", *given, "--output", str(out)]) == 0
    with out.open() as stream:
        last = list(csv.DictReader(stream))[-1]
    assert float(last["surge"]) == pytest.approx(travel(slow, 0.0), abs=1e-6)


def test_fits_and_comparisons_start_from_each_runs_current(slow, tmp_path):
    (tmp_path / "coast.csv").write_text("time,surge\n0,0\n0.3,6\n")
    (tmp_path / "drive.csv").write_text("time,surge\n0,0\n0.3,6\n")
    (tmp_path / "campaign.yaml").write_text(
        "runs: [{file: coast.csv, drive_current: 0.0}, {file: drive.csv, drive_current: 7000.0}]\n"
    )
    structure = Structure(slow, ())
    problem = Problem(load_campaign(tmp_path), slow, {"surge": 1e-3})
    for i, current in enumerate((0.0, 7000.0)):
        x = slow.initial_state(drive_current=current, **START)
        ends = problem.simulate(structure, i, np.zeros((1, 0)), x[None])[0, -1, 0]
        assert ends == pytest.approx(slow.simulate([0.0, 0.3], x, current)["surge"][-1], abs=1e-9)


def test_the_node_starts_from_its_own_drive(slow):
    for model, expected in (
        (slow.with_changes({"drive_current": 0.0}), travel(slow, 0.0)),
        (slow.with_changes(drive="pulses"), travel(slow.with_changes(drive="pulses"), 0.0)),
    ):
        node = Simulation(model, START, 500.0, PulseQueue(1000, 2e4, 6e-4))
        for _ in range(150):
            node.tick()
        assert node.x[0] == pytest.approx(expected, abs=1e-6)


def test_a_pulse_that_burns_at_the_start_counts(slow):
    """Settled on the thrust of a pulse at its peak, not on the averaged law's."""
    pulsed = slow.with_changes(drive="pulses")
    pulses = Pulses(np.array([-3e-4]), np.array([0.0]), np.array([7000.0]))
    x = pulsed.initial_state(**START)
    without = pulsed.with_changes(effects={}).quantities(x, pulses=pulses)["thrust"]
    assert pulsed.with_effect_states(x, pulses=pulses)[8:].max() == pytest.approx(without) and without > 100.0
