# SPDX-License-Identifier: Apache-2.0
"""What a small cause does to a run, told from the forces at its nodes where these tell, is what an integration of every
piece gives."""

from pathlib import Path

import numpy as np
import pytest
from test_estimation_shooting import NOISE, TICK

from inductrack_ros.core.model import Model
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.data.measurement import Run
from inductrack_ros.estimation import columns
from inductrack_ros.estimation.linear import THETA_STEP, near_track
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.run_model import RunModel
from inductrack_ros.estimation.structure import Structure

#: On a force in contact alone, on all of the way, on a parameter, and at places where the cradle passes and where not.
EFFECTS = {
    "sliding_friction": {},
    "viscous_drag": {},
    "track_resistance": {},
    "dead_coils": {"place": 2.0},
    "dead_coils@far": {"place": 80.0},
}


@pytest.fixture(scope="module")
def landing():
    """A problem with one run that touches down and skids, its trajectory (n, 8), and where that touches."""
    model = Model.default()
    times = np.arange(401) * TICK
    outputs = model.simulate(times, model.initial_state(surge_rate=12.0), 0.0).outputs
    path = np.zeros((len(times), len(model.kernel.states)))
    path[:, :8] = outputs[:, :8]
    run = Run("run", Path("run"), tuple(NOISE), times, outputs[:, :4].copy(), times, 0.0)
    problem = Problem(Campaign("rig", Path("rig"), (run,), NOISE), model, NOISE)
    touching = near_track(RunModel(problem, Structure(model, ()), 0), path)
    assert 0.1 < touching.mean() < 0.9
    return problem, path, touching


@pytest.mark.parametrize("name", EFFECTS)
def test_forces_tell_what_an_integration_gives(landing, name):
    problem, path, touching = landing
    effect = name.partition("@")[0]
    wide = Structure(problem.model, ()).plus(effect, EFFECTS[name])
    thetas = np.vstack([wide.start, wide.start + THETA_STEP * np.eye(len(wide.start))])
    about = RunModel(problem, wide, 0), path, thetas, np.full(len(wide.start), THETA_STEP), problem.model.active_states
    told = columns.differences(*about, columns.Told(np.zeros(len(path)), touching))
    whole = columns.differences(*about)
    for some in (slice(0, 4), slice(4, 8)):  # places; rates
        off, size = np.abs(told.inputs - whole.inputs)[:, some], np.abs(whole.inputs[:, some]).max()
        assert off[touching].max() <= 1e-9 * size
        assert off.max() <= 0.02 * size
        assert (size > 0.0) == (name != "dead_coils@far")
    if name == "sliding_friction":  # it does nothing but in contact
        assert np.abs(told.inputs[touching, 4]).max() > 0.0
