# SPDX-License-Identifier: Apache-2.0
"""Runs in lanes are those of the scalar kernel, and several times faster where they fly.

Idea: an ensemble of `MANY` runs flies in lanes, its parts, which are fewer, do not. Everything a lane must give back is
in it: touching down, standing, starting in contact, turning, leaving all bounds.
"""

import math
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from performance import many_runs
from performance.timing import in_turn, ratios

from inductrack_ros.core import lanes
from inductrack_ros.core.model import Model
from inductrack_ros.estimation import ensemble as module
from inductrack_ros.estimation.ensemble import MANY, ensemble

TIMES = np.linspace(0.0, 1.5, 61)


@pytest.mark.parametrize(("ours", "theirs"), [(lanes.lane_sin, math.sin), (lanes.lane_cos, math.cos)])
def test_sine_and_cosine(ours, theirs):
    for x in np.concatenate([np.random.default_rng(0).uniform(-1000, 1000, 3000), np.linspace(-2, 2, 3001)]):
        assert abs(ours(x) - theirs(x)) < 2.3e-16


def test_the_exponential():
    for x in np.random.default_rng(0).uniform(-700, 700, 5000):
        assert lanes.lane_exp(x) == pytest.approx(math.exp(x), rel=4.5e-16)
    assert lanes.lane_exp(-1e9) == pytest.approx(0.0, abs=1e-300)


def in_parts(model, times, states, parameters):
    parts = np.array_split(np.arange(len(states)), 2)
    assert len(parts[0]) < MANY
    return np.concatenate([ensemble(model, times, states[p], {n: v[p] for n, v in parameters.items()}) for p in parts])


@pytest.mark.parametrize("dof", [2, 4])
def test_every_run_is_that_of_the_scalar_kernel(dof):
    model = Model.default().with_changes(dof=dof)
    rng = np.random.default_rng(3)
    states, parameters, _ = many_runs.draw(model, 17.0, MANY + 3)
    parameters["drive_current"] = rng.uniform(-3000.0, 7000.0, len(states))
    states[:, 4] = rng.uniform(12.0, 40.0, len(states))
    states[:40, 4] = 0.0  # stand
    states[20:40, 2] = -0.011  # in contact
    states[40:60, 4] = -1.0  # backwards
    states[60:80, 4] = 0.05  # turn soon: driven backwards
    parameters["drive_current"][60:80] = -7000.0
    states[80:90, 4] = 1e9  # leave all bounds
    states[90:95, 2] = 1e8  # far out
    states[95, 2] = np.nan
    together, apart = ensemble(model, TIMES, states, parameters), in_parts(model, TIMES, states, parameters)
    assert np.array_equal(np.isnan(together), np.isnan(apart))
    flew = (apart[:, :, 8:11].min(axis=(1, 2)) > lanes.CLEAR).mean()
    assert 0.2 < flew < 0.8
    with np.errstate(invalid="ignore"):  # those that leave all bounds
        off = np.abs(together - apart)[:, :, :4]
        assert np.nanmax(off[95:]) < 1e-9
        assert np.nanmax(off / (1.0 + np.abs(apart[:, :, :4]))) < 1e-9


def test_a_lane_takes_the_smaller_steps_that_the_scalar_kernel_takes():
    """A field four times as short: the embedded result asks for shorter steps now and then, in some lanes and not in
    others."""
    model = Model.default().with_changes({"peak_field": 0.8, "gravity": 0.5})
    states, parameters, _ = many_runs.draw(model, 19.0, MANY)
    states[:, 3] = np.linspace(0.0, 0.03, MANY)
    together, apart = ensemble(model, TIMES, states, parameters), in_parts(model, TIMES, states, parameters)
    assert np.abs(together - apart)[:, :, :4].max() < 1e-9


def test_lanes_are_faster(monkeypatch):
    """Measured: five times, with registers of 512 bits."""
    model = Model.default()
    states, parameters, _ = many_runs.draw(model, 19.0, 96)

    def run(many):
        monkeypatch.setattr(module, "MANY", many)
        return ensemble(model, many_runs.TIMES, states, parameters)

    times = in_turn({"lanes": lambda: run(1), "scalar": lambda: run(97)}, 5, time.process_time)
    assert ratios(times, "lanes")["scalar"]["best"] > 1.5


def test_a_model_with_an_effect_does_not_fly_in_lanes(monkeypatch):
    model = Model.default().with_changes(effects={"viscous_drag": {}})
    monkeypatch.setattr(module, "MANY", 1)
    states = np.tile(model.initial_state(surge_rate=19.0)[:8], (3, 1))
    drag = np.array([0.0, 1.0, 2.0])
    ends = ensemble(model, TIMES, states, {"viscous_drag.coefficient": drag})[:, -1, 4]
    assert ends[0] > ends[1] > ends[2]
