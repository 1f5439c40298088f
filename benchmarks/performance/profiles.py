# SPDX-License-Identifier: Apache-2.0
"""Where the time goes: ``python -m performance.profiles fit|diagnosis|node [SECONDS]``, shares of processor time by
function.

One thread, so that the profiler sees all of it. Of compiled functions only the whole is seen.
"""

from __future__ import annotations

import cProfile
import os
import pstats
import sys
import tempfile
import time
from pathlib import Path

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import base_fit, diagnose
from inductrack_ros.estimation.horizons import fit_from_scratch
from inductrack_ros.nodes.domain import claim_domain
from inductrack_ros.workers import Threads

from .node import Listener, Node

CAMPAIGN = Path(__file__).parents[2] / "test" / "data" / "practice" / "p7_sensor"
SHOWN = 12


def table(stats: pstats.Stats) -> str:
    """Functions by their own time (%), with calls."""
    rows = sorted(
        ((t, calls, Path(where[0]).name, where[2]) for where, (_, calls, t, _, _) in stats.stats.items()), reverse=True
    )
    total = sum(t for t, *_ in rows)
    lines = [f"| of {total:.1f} s | calls | function |", "|---|---|---|"]
    return "\n".join(
        lines + [f"| {100 * t / total:.0f} % | {calls} | {file} {name} |" for t, calls, file, name in rows[:SHOWN]]
    )


def main() -> None:
    """Profile what is named."""
    what = sys.argv[1]
    if what == "node":
        print(table(pstats.Stats(_node(float(sys.argv[2]) if len(sys.argv) > 2 else 10.0))))
        return
    os.cpu_count = lambda: 1  # what spreads runs over threads asks this
    campaign, model = load_campaign(CAMPAIGN), Model.default()
    model.kernel  # noqa: B018 (compiled before)
    problem, base, _ = base_fit(campaign, model)
    task = {
        "fit": lambda: fit_from_scratch(problem, base.structure),
        "diagnosis": lambda: diagnose(campaign, model, workers=InLine(1)),
    }[what]
    profiler = cProfile.Profile(time.thread_time)
    profiler.runcall(task)
    print(table(pstats.Stats(profiler)))


class InLine(Threads):
    """No threads at all."""

    def map(self, task, items):
        return [task(i) for i in items]


def _node(seconds: float) -> str:
    """The file of a profile of `sim` at 1 kHz, its start included."""
    import rclpy

    with claim_domain():
        rclpy.init()
        listener = Listener(rclpy, rclpy.create_node("profiles"))
        file = Path(tempfile.mkdtemp()) / "profile"
        with Node(
            listener,
            sys.executable,
            "-m",
            "cProfile",
            "-o",
            file,
            "-m",
            "inductrack_ros.nodes.sim",
            "--ros-args",
            "-p",
            "rate:=1000",
        ):
            listener.take(seconds)
        rclpy.shutdown()
    return str(file)


if __name__ == "__main__":
    main()
