# SPDX-License-Identifier: Apache-2.0
"""Fast by ratios taken in one run: times alone say more of the machine than of the program.

Idea: bounds far from what is measured (docs/performance.md), so that only a lost factor trips them, and on the check
    that sees smaller losses, that it does see them."""

import gc
import json
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from performance import __main__ as benchmark
from performance import bag_memory, limit, many_runs, one_run, peers
from performance.timing import in_turn, ratios

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import read_bag
from inductrack_ros.estimation.ensemble import ensemble
from inductrack_ros.nodes import bag

needs_compiler = pytest.mark.skipif(limit.compiler() is None, reason="no C compiler here")


def test_a_run_is_far_faster_than_what_a_user_would_write():
    """Measured: above 20 times LSODA's, whose result is as exact."""
    model, golden, state, times = one_run.problem()
    P = model.vector[:22].copy()
    ours = model.simulate(times, state, one_run.CURRENT)
    touched = np.logical_or.accumulate(ours.outputs[:, 8:11].min(axis=1) < 0)

    def lsoda():
        return peers.scipy_run("LSODA", peers.right_hand_side, P, state, times, 3e-6)

    assert one_run.errors(lsoda(), golden, touched)[0] < one_run.BEFORE
    assert one_run.errors(ours.states, golden, touched)[0] < one_run.BEFORE
    slower = ratios(in_turn({"ours": lambda: model.simulate(times, state, one_run.CURRENT), "LSODA": lsoda}, 5), "ours")
    assert slower["LSODA"]["median"] > 8


@needs_compiler
def test_a_run_comes_near_to_c():
    """Measured: 1.5 times C's time. The C loop takes the same steps, to rounding."""
    model, _, state, times = one_run.problem()
    P = model.vector[:22].copy()
    tasks = {
        "ours": lambda: model.simulate(times, state, one_run.CURRENT).outputs,
        "C": lambda: limit.run(P, state, times),
    }
    assert np.abs(tasks["ours"]() - tasks["C"]()).max() < 1e-9
    assert ratios(in_turn(tasks, 30), "ours")["C"]["median"] > 1 / 4


@needs_compiler
def test_lanes_are_the_same_runs():
    """The vectorised C that the ensemble is measured against does the same work: some fly on, some touch down."""
    model = Model.default()
    states, parameters, P = many_runs.draw(model, 15.5, 2 * many_runs.CHUNK)
    ours = ensemble(model, many_runs.TIMES, states, parameters)
    assert np.abs(ours - many_runs.in_c(P, states, limit.FAST))[:, :, :4].max() < 1e-5


def test_an_ensemble_says_what_does_not_fit():
    model = Model.default()
    states = np.zeros((3, 8))
    with pytest.raises(InputError, match="unknown parameter 'etta'; did you mean 'eta'"):
        ensemble(model, [0.0, 1.0], states, {"etta": np.ones(3)})
    with pytest.raises(InputError, match=r"eta has shape \(2,\); give one value for each of the 3 runs"):
        ensemble(model, [0.0, 1.0], states, {"eta": np.ones(2)})
    with pytest.raises(InputError, match=r"states must be \(runs, 8\)"):
        ensemble(model, [0.0, 1.0], np.zeros((3, 7)))


def test_a_longer_bag_takes_the_memory_of_its_run(tmp_path, monkeypatch):
    """Measured: 1.9 times, open files of a second each in it; 3.5 where numbers were kept as they came and once more in
    order."""
    monkeypatch.setattr(bag, "JOINED", 0)

    def peak(seconds):
        bag_memory.record(tmp_path / str(seconds), seconds)
        gc.collect()
        tracemalloc.start()
        try:
            run = read_bag(tmp_path / str(seconds))
            return np.array(
                [tracemalloc.get_traced_memory()[1], run.times.nbytes + run.stamps.nbytes + run.values.nbytes]
            )
        finally:
            tracemalloc.stop()

    more, held = peak(12) - peak(4)
    assert more < 2.5 * held


def test_the_check_sees_a_quarter():
    before = {"a": 20.0, "b": 0.6, "only there": 1.0}
    assert benchmark.worse({"a": 15.1, "b": 0.46}, before) == []
    assert benchmark.worse({"a": 14.9, "b": 0.7}, before) == ["a: 14.9 times as fast, was 20"]
    stored = json.loads(benchmark.BASELINE.read_text())["ratios"]
    assert {"run: LSODA, plain Python", "fit: least_squares"} <= stored.keys()
