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
from inductrack_ros.core.effects import catalogue
from inductrack_ros.core.effects.stand_in import parameters as table_over
from inductrack_ros.core.inlining import inlined
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


#: Effects by how they get into a lane. As text in the loop of the equations: on a parameter, on forces, on the track's
#: height, with two functions, with states. Called in a loop of their own: with a power, a library function, a table.
WRITTEN = {
    "track_resistance": {"relative_change": 0.2},
    "sliding_friction": {"coefficient": 0.2},
    "track_slope": {"angle": 0.02},
    "viscous_drag": {"coefficient": 1.0},
    "guideway_waviness": {"amplitude": 2e-4, "wavelength": 1.5},
    "flexible_mode": {"frequency": 30.0, "damping_ratio": 0.05, "mass_ratio": 0.2},
}
CALLED = {
    "drive_droop": {"fraction_per_pulse": 1e-3},
    "joint_step": {"height": 1e-4, "place": 10.0},
    "stand_in_heave": {**table_over("time", 0.0, 0.5), "knots": 4.0, "values": (0.0, 3.0, -2.0, 1.0)},
}


@pytest.mark.parametrize("effects", [WRITTEN, CALLED], ids=["written", "called"])
def test_effects_fly_in_lanes(monkeypatch, effects):
    model = Model.default().with_changes(effects=effects)
    states, scattered, _ = many_runs.draw(model, 17.5, 99)
    first = next(n for n in model.kernel.parameters if n.partition(".")[0] in effects)
    scattered[first] = model.vector[model.kernel.parameters.index(first)] * np.linspace(0.5, 1.5, 99)
    apart = ensemble(model, TIMES, states, scattered)
    monkeypatch.setattr(module, "MANY_WITH_EFFECTS", 1)
    together = ensemble(model, TIMES, states, scattered)
    flew = (apart[:, :, 8:11].min(axis=(1, 2)) > lanes.CLEAR).mean()
    assert 0.2 < flew < 0.95
    assert np.abs(together - apart)[:, :, :4].max() < 1e-8
    del scattered[first]
    for name in effects:  # each of them does something
        others = model.with_changes(effects={n: values for n, values in effects.items() if n != name})
        assert np.abs(ensemble(others, TIMES, states, scattered) - apart)[:, :, :4].max() > 1e-5, name


def test_lanes_with_effects_are_faster(monkeypatch):
    """Measured: four times. `guideway_waviness` asks for short steps, and only a run that stays clear stays in a
    lane."""
    model = Model.default().with_changes(effects=WRITTEN)
    states, scattered, _ = many_runs.draw(model, 25.0, 48)

    def run(many):
        monkeypatch.setattr(module, "MANY_WITH_EFFECTS", many)
        return ensemble(model, TIMES, states, scattered)

    times = in_turn({"lanes": lambda: run(1), "scalar": lambda: run(97)}, 5, time.process_time)
    assert ratios(times, "lanes")["scalar"]["best"] > 1.5


#: What a loop over lanes cannot hold: a power that is no number, functions beyond exp, sin and cos, tables.
REFUSED = ("drive_droop", "joint_step", "skin_friction_drag", "stand_in")


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if not e.of_sensor])
def test_a_text_in_the_place_of_a_call_gives_the_same(name):
    rng, item = np.random.default_rng(0), catalogue()[name]
    for number, part in enumerate(item.parts):
        returned = len(part.targets) + (len(item.states) if number == len(item.parts) - 1 else 0)
        results = [f"r{k}" for k in range(returned)]
        lines = inlined(part.function, [f"v[{k}]" for k in range(len(part.arguments))], results, "own_")
        if lines is None:
            assert name.startswith(REFUSED)
            continue
        assert not name.startswith(REFUSED)
        for scale in (1e-3, 1.0, 30.0):
            v = scale * rng.standard_normal(len(part.arguments))
            names = {"v": v.tolist(), "exp": math.exp, "sin": math.sin, "cos": math.cos, "sqrt": math.sqrt}
            try:
                wanted = part.function(*v.tolist())
            except (ZeroDivisionError, ValueError, OverflowError):
                continue
            exec("\n".join(lines), names)
            assert np.allclose([names[r] for r in results], wanted, rtol=1e-14, atol=0)
