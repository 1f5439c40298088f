# SPDX-License-Identifier: Apache-2.0
"""A sweep over the bare ensemble: what starts, statistics and maps cost on top of flying. Prints ratios of times taken
in turn.

    python benchmarks/sweep.py                    # 100,000 runs of 3 s, on all cores: minutes
    python benchmarks/sweep.py --runs 5000 --effects viscous_drag

The bare ensemble flies the same runs from starts that are known, in blocks of the same size, and throws its outputs
away."""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.core.state import INDEX
from inductrack_ros.estimation.ensemble import ensemble
from inductrack_ros.sweep.axes import read_axes
from inductrack_ros.sweep.starts import on_equilibrium
from inductrack_ros.sweep.sweep import BLOCK, TOGETHER, Plan, sweep
from inductrack_ros.workers import Threads


def nothing(out: np.ndarray) -> np.ndarray:
    """All that is kept of the bare ensemble's outputs (jobs, n, 15)."""
    return out[:, -1, 0].copy()


def bare(plan: Plan, states: np.ndarray) -> None:
    """The runs of the plan from known ``states`` (runs, 8), of which nothing is asked."""
    currents = np.tile(plan.axes[1].values, len(plan.axes[0].values))
    for rows in np.array_split(np.arange(plan.points), -(-plan.points // BLOCK)):
        ensemble(plan.model, plan.times, states[rows], {"drive_current": currents[rows]}, Threads(), nothing)


def starts(plan: Plan) -> np.ndarray:
    """Where the runs start, (runs, 8), found before any clock runs."""
    speeds = np.repeat(plan.axes[0].values, len(plan.axes[1].values))
    states = np.zeros((plan.points, 8))
    states[:, INDEX["surge_rate"]] = speeds
    P = np.tile(plan.model.vector, (TOGETHER, 1))
    return np.concatenate(
        [
            on_equilibrium(plan.model, states[i : i + TOGETHER], P[: len(states[i : i + TOGETHER])])
            for i in range(0, len(states), TOGETHER)
        ]
    )


def measured(plan: Plan, rounds: int) -> str:
    """One line of ratios."""
    states = starts(plan)
    tasks = {"sweep": lambda: sweep(plan), "bare": lambda: bare(plan, states)}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            began = time.perf_counter(), time.process_time()
            task()
            times[name].append((time.perf_counter() - began[0], time.process_time() - began[1]))
    wall, work = ([a[k] / b[k] for a, b in zip(times["sweep"], times["bare"], strict=True)] for k in (0, 1))
    rate = plan.points / min(t[0] for t in times["sweep"])
    return (
        f"{plan.points} runs of {plan.duration:g} s, sweep over bare ensemble: {np.median(wall):.2f} by the clock "
        f"({min(wall):.2f} to {max(wall):.2f}), {np.median(work):.2f} in processor time; {rate:.0f} runs a second"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--effects", nargs="*", default=[])
    given = parser.parse_args()
    side = int(np.sqrt(given.runs))
    model = Model.create(effects=given.effects)
    _ = model.lanes  # compiled before any clock runs, as is what this sweep takes
    sweep(Plan(model, read_axes(["surge_rate=12:30:600"], model)[1], {}, 0.3))
    for name, speeds, currents in (("half touch down", "10:40", "0:7000"), ("all fly", "20:40", "6500:7000")):
        _, axes = read_axes(
            [f"surge_rate={speeds}:{side}", f"drive_current={currents}:{-(-given.runs // side)}"], model
        )
        print(f"{name}: {measured(Plan(model, axes, {}), given.rounds)}", flush=True)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
