# SPDX-License-Identifier: Apache-2.0
"""Four trajectories that another simulator made from the same equations (RK4 at 10 µs), reproduced to micrometres.

Idea: the integrator takes steps a hundred times longer and locates contacts; whatever it does, the path must be this
one: 1 µm (and 1 µrad) until an array first touches, 10 µm after. The sizes of the steps must not matter.
"""

from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.core.model import Model
from inductrack_ros.core.state import COORDINATES, GAPS, STATES

FOLDER = Path(__file__).parent / "data" / "golden"
CASES = {  # drive current (A), effects, whether it touches the track
    "launch_15p5": (7000.0, [], True),
    "sway_4mm": (7000.0, [], True),
    "coast_30_roll": (0.0, [], True),
    "coil_current_dynamics_22": (4200.0, ["coil_current_dynamics"], False),
}


def errors(name, rows=slice(None), **options):
    """Largest difference of the four coordinates (m, rad) before and after first contact."""
    current, effects, _ = CASES[name]
    golden = np.genfromtxt(FOLDER / f"{name}.csv", delimiter=",", names=True)[rows]
    start = np.array([golden[state][0] for state in STATES])
    run = Model.create(effects=effects).simulate(golden["time"], start, current, **options)
    difference = np.max([np.abs(run[c] - golden[c]) for c in COORDINATES], axis=0)
    touched = np.logical_or.accumulate(np.min([run[g] for g in GAPS], axis=0) < 0)
    return difference[~touched].max(), difference[touched].max(initial=0.0), touched.any()


@pytest.mark.parametrize("name", CASES)
def test_golden(name):
    before, after, touched = errors(name)
    assert before < 1e-6
    assert after < 10e-6
    assert touched == CASES[name][2]


@pytest.mark.parametrize("name", CASES)
def test_short_steps_give_the_same(name):
    before, after, _ = errors(name, longest_step=2e-5)
    assert before < 1e-6
    assert after < 10e-6


def test_rows_far_apart_give_the_same():
    """Steps and contacts are found by the integrator, not by where rows are asked for."""
    before, after, touched = errors("sway_4mm", rows=slice(0, None, 500))
    assert touched
    assert before < 1e-6
    assert after < 10e-6


def test_a_slightly_different_model_is_told_apart():
    """The bound means something: one per mille of η already breaks it."""
    golden = np.genfromtxt(FOLDER / "coast_30_roll.csv", delimiter=",", names=True)
    start = np.array([golden[state][0] for state in STATES])
    run = Model.create({"eta": 0.7295 * 1.001}).simulate(golden["time"], start, 0.0)
    assert np.abs(run["surge"] - golden["surge"]).max() > 1e-4


def test_advance_in_small_pieces_is_the_same_path():
    """The real-time loop's steps end where `simulate` goes, through contact as well."""
    golden = np.genfromtxt(FOLDER / "launch_15p5.csv", delimiter=",", names=True)
    model = Model.default()
    x = model.with_effect_states([golden[state][0] for state in STATES])
    worst = 0.0
    for row in range(1, 700):
        x = model.advance(x, golden["time"][row - 1], golden["time"][row], 7000.0)
        worst = max(worst, *(abs(x[i] - golden[c][row]) for i, c in enumerate(COORDINATES)))
    assert golden["heave"][699] < -0.0099
    assert worst < 10e-6


def test_a_brush_between_two_steps_is_not_missed():
    """An array that touches for less than a step, a micrometre deep, and leaves again: found as with 5 µs steps."""
    model = Model.create(dof=1)
    times = np.arange(0, 0.4, 0.002)
    touched = 0
    for lower in np.linspace(0.0, 4e-6, 30):  # above the height from which it swings down to 0.01 µm off the track
        start = np.array([0, 0, -0.0037204025912457735 + lower, 0, 12.0, 0, 0, 0])
        run = model.simulate(times, start, 0.0)
        fine = model.simulate(times, start, 0.0, longest_step=5e-6)
        assert np.abs(run["heave"] - fine["heave"]).max() < 1e-7
        touched += fine["gap_top"].min() < 0
    assert touched > 3


def wild(parameters=None, effects=(), speed=20.0, current=0.0, seconds=0.25):
    """Largest difference (m, rad) of a run from the same in steps of 4 µs."""
    model = Model.create(parameters, effects)
    times = np.linspace(0, seconds, 26)
    x = model.initial_state(surge_rate=speed)
    x[1:4] += [1e-3, 5e-4, 2e-3]
    x = model.with_effect_states(x[:8])
    run, fine = (model.simulate(times, x, current, longest_step=s) for s in (1.0, 4e-6))
    assert np.isfinite(run.outputs).all()
    return np.abs(run.states[:, :4] - fine.states[:, :4]).max()


@pytest.mark.parametrize(
    ("parameters", "speed"),
    [
        ({"peak_field": 3.0}, 20.0),  # lift thirty times the weight: the bounce is far faster than at the equilibrium
        ({"mass": 0.1, "roll_inertia": 1e-3}, 20.0),
        ({"contact_stiffness": 1e9}, 5.0),
        ({"contact_damping": 1e6}, 5.0),
        ({"roll_inertia": 1e-4}, 20.0),
        ({"wavelength": 0.01, "inductance": 1.8e-8}, 20.0),
    ],
)
def test_steps_suit_parameters_far_from_the_papers(parameters, speed):
    assert wild(parameters, speed=speed) < 2e-6


@pytest.mark.parametrize("speed", [40.0, 150.0])
def test_steps_suit_the_coil_current(speed):
    assert wild(effects=["coil_current_dynamics"], speed=speed) < 1e-8
