# SPDX-License-Identifier: Apache-2.0
"""A real dask cluster of two workers on loopback, one of which is killed in the middle of the work.

Idea: what comes back must be what this machine alone gives, to the last bit: through a user's effect that the workers
have no file of, and whatever happens to a worker.
"""

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import LONG, bounded
from threadpoolctl import threadpool_info

from inductrack_ros import workers as workers_module
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.moves import State, Task, all_refitted
from inductrack_ros.diagnosis.screening import screen
from inductrack_ros.estimation.ensemble import ensemble
from inductrack_ros.estimation.shooting import linearise_all
from inductrack_ros.sweep.axes import read_axes
from inductrack_ros.sweep.sweep import Plan, sweep
from inductrack_ros.workers import workers

CAMPAIGN = Path(__file__).parent / "data" / "practice" / "p7_sensor"
TIMES = np.linspace(0, 1.0, 401)
EFFECT = '''
from inductrack_ros.core.effects import Parameter, effect

@effect(adds="force_surge", parameters={"size": Parameter(0.0, "N", -10.0, 10.0, "size")})
def push(surge, size):
    """Pushes here and there."""
    return size * surge
'''


#: A worker that dies is started again, and given up where that takes so long: 15 s by default, which a busy machine
#: needs. Two that are given up leave a cluster without workers, whose work stands for ever.
RESTART = {"distributed.deploy.lost-worker-timeout": "1h"}


@pytest.fixture(scope="module")
def scheduler():
    """Address of a scheduler with two workers, each a process of one thread, of as much memory as there is."""
    distributed = pytest.importorskip("dask.distributed")
    import dask

    with dask.config.set(RESTART), bounded("the start of a cluster", LONG):
        cluster = distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, memory_limit=0
        )
    with dask.config.set(RESTART):
        yield cluster.scheduler_address
        with bounded("the end of a cluster", LONG):
            cluster.close()


@pytest.fixture(autouse=True)
def in_bounded_time():
    """dask waits for ever where nobody works."""
    with bounded("an answer of the cluster", LONG):
        yield


class Deadly:
    """Workers of a cluster, the first of which to come to the given task is killed there, with SIGKILL."""

    def __init__(self, cluster, marker: Path, at: int):
        self.cluster, self.marker, self.at = cluster, marker, at

    def map(self, task, items):
        at, marker = self.at, self.marker

        def work(numbered):
            number, item = numbered
            if number == at and not marker.exists():
                marker.touch()
                os.kill(os.getpid(), signal.SIGKILL)
            return task(item)

        return self.cluster.map(work, list(enumerate(items)))


@pytest.mark.parametrize("side_by_side", [False, True])
def test_an_ensemble_with_a_killed_worker(scheduler, tmp_path, monkeypatch, side_by_side):
    monkeypatch.setattr("inductrack_ros.estimation.ensemble.MANY", 300 if side_by_side else 301)
    rng = np.random.default_rng(1)
    states = np.zeros((300, 8))
    states[:, 2], states[:, 4] = -0.005, rng.uniform(14.0, 20.0, 300)
    parameters = {"eta": rng.uniform(0.7, 0.75, 300), "drive_current": rng.uniform(0.0, 7000.0, 300)}
    model = Model.default()
    here = ensemble(model, TIMES, states, parameters)
    with workers(scheduler) as cluster:
        there = ensemble(model, TIMES, states, parameters, Deadly(cluster, tmp_path / "killed", at=7))
    assert (tmp_path / "killed").exists()
    assert np.array_equal(here, there)
    one = model.with_changes({n: v[250] for n, v in parameters.items()}).simulate(TIMES, states[250])
    assert (
        np.allclose(here[250], one.outputs, rtol=0, atol=1e-9)
        if side_by_side
        else np.array_equal(here[250], one.outputs)
    )


def test_a_sweep_under_conditions(scheduler):
    """Starts, runs and what is read off them, on the workers; the model's conditions travel with it."""
    model = Model.create(effects={"track_temperature": {"coefficient": 3.9e-3}}, conditions={"track_temperature": 80.0})
    _, axes = read_axes(["surge_rate=14:22:5"], model)
    plan = Plan(model, axes, {}, duration=0.3)
    here = sweep(plan)
    with workers(scheduler) as cluster:
        there = sweep(plan, cluster)
    for name, values in here.values.items():
        assert np.array_equal(values, there.values[name], equal_nan=True), name
    cold = sweep(Plan(model.with_changes(conditions={}), axes, {}, duration=0.3))
    assert (cold.values["travel"] != here.values["travel"]).all()


def test_the_refits_of_a_diagnosis_with_a_killed_worker(scheduler, tmp_path):
    campaign = load_campaign(CAMPAIGN)
    problem, base, _ = base_fit(replace(campaign, runs=campaign.runs[:3]), Model.default())
    state, systems = State(base), linearise_all(problem, base)
    screening = screen(problem, base, systems)
    sets = [s for s in screening.sets if len(s.members) == 1][:3]
    here = all_refitted(Task(problem), state, sets, screening.family)
    with workers(scheduler) as cluster:
        hands = Deadly(cluster, tmp_path / "killed", at=1)
        there = all_refitted(Task(problem, workers=hands), state, sets, screening.family)
    assert (tmp_path / "killed").exists()
    assert len(here) == 3
    for a, b in zip(here, there, strict=True):
        assert (a.added, a.fit.deviance, a.fit.theta.tolist()) == (b.added, b.fit.deviance, b.fit.theta.tolist())
        assert np.array_equal(a.fit.covariance, b.fit.covariance)


def test_effect_files_travel_with_the_model(scheduler, tmp_path):
    """The workers get the text the model was made of, not a file, and split no small matrix over threads."""
    path = tmp_path / "mine.py"
    path.write_text(EFFECT)
    model = Model.create(effects={"push": {"size": 3.0}}, effect_files=[path])

    def task(size):
        path.unlink(missing_ok=True)
        push = model.with_changes(effects={"push": {"size": size}}).known_effects["push"].function
        return push(2.0, size), max((p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"), default=1)

    with workers(scheduler) as cluster:
        assert cluster.map(task, [3.0, 5.0]) == [(6.0, 1), (10.0, 1)]
    assert not path.exists()


def test_workers_that_are_gone_for_good_are_told(scheduler, monkeypatch):
    """Their work would stand for ever."""
    monkeypatch.setattr(workers_module, "GONE", 0.5)
    monkeypatch.setattr(workers_module, "LOOK", 0.1)
    with workers(scheduler) as cluster:
        there = iter([{"tcp://one": 1}])  # at the first look
        monkeypatch.setattr(cluster.client, "nthreads", lambda: next(there, {}))
        with pytest.raises(InputError, match="all workers have been gone for 0.5 s; start them again"):
            cluster.map(time.sleep, [5.0])


def test_what_is_wrong_is_told(scheduler, monkeypatch):
    with pytest.raises(InputError, match="--scheduler tcp://127.0.0.1:9: nothing answers there; start one"):
        monkeypatch.setattr(workers_module, "PATIENCE", 0.5)
        with workers("tcp://127.0.0.1:9"):
            pass
    monkeypatch.setattr(workers_module, "_versions", lambda: ("numpy 0.1",))
    with (
        workers(scheduler) as cluster,
        pytest.raises(InputError, match="worker on .* numpy 0.1 here, not there; install the same"),
    ):
        cluster.map(abs, [1])
