# SPDX-License-Identifier: Apache-2.0
"""5. How cost grows: processor time over runs, samples and candidates, which should be linear; memory over a bag's
length."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.moves import State, Task, refitted
from inductrack_ros.diagnosis.screening import screen
from inductrack_ros.estimation.ensemble import ensemble
from inductrack_ros.estimation.shooting import linearise_all

from .many_runs import SPEEDS, TIMES, draw
from .refits import CAMPAIGN

PLOT = Path(__file__).parents[2] / "docs" / "growth.svg"


def _seconds(task, repeats: int) -> float:
    """Least processor time of some."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        task()
        times.append(time.process_time() - began)
    return min(times)


def _exponent(sizes: list[float], costs: list[float]) -> float:
    """Slope in a double logarithmic plot: 1 where cost is proportional."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def measure(quick: bool, bag_seconds: float | None = None) -> dict:
    """Sizes, costs and exponents."""
    model, found = Model.default(), {}
    repeats = 3 if quick else 5
    states, parameters, _ = draw(model, SPEEDS["all touch down"], 4000)
    sizes = [500, 1000, 2000, 4000]  # all of them fly side by side, which fewer do not
    found["runs"] = (
        sizes,
        [
            _seconds(lambda n=n: ensemble(model, TIMES, states[:n], {k: v[:n] for k, v in parameters.items()}), repeats)
            for n in sizes
        ],
    )
    # Each row a step: fewer are not cheaper.
    times = [np.linspace(0.0, 3.0, n) for n in (1501, 3001, 6001, 12001, 24001)]
    found["samples of a run"] = (
        [t.size for t in times],
        [_seconds(lambda t=t: model.simulate(t, states[0]), 3 * repeats) for t in times],
    )
    problem, base, _ = base_fit(load_campaign(CAMPAIGN), model)
    state, systems = State(base), linearise_all(problem, base)
    screening = screen(problem, base, systems)
    single = [s for s in screening.sets if len(s.members) == 1 and not s.members[0].start]
    counts = [2, 4, 8, 16]

    def steps(n: int) -> None:
        for s in single[:n]:
            refitted(Task(problem), state, s, screening.family, 1)

    steps(counts[-1])  # what is done but once is not what grows
    found["candidates, a step of a refit each"] = counts, [_seconds(lambda n=n: steps(n), 1) for n in counts]
    result = {"cost": {n: {"sizes": s, "seconds": c, "exponent": _exponent(s, c)} for n, (s, c) in found.items()}}
    if not quick:
        long = bag_seconds or 120.0
        result["memory"] = {str(seconds): _memory(seconds) for seconds in (long / 16, long / 4, long)}
    return result


def _memory(seconds: float) -> dict[str, float]:
    """Peak memory (MB) of a process that records a bag of pose and twist at 1 kHz, of one that reads it and of one that
    plays it."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        command = [sys.executable, str(Path(__file__).with_name("bag_memory.py"))]
        peaks = {}
        for what in ("record", "read", "play"):
            said = subprocess.run(
                [*command, what, str(bag), str(seconds)], check=True, capture_output=True, text=True
            ).stdout
            peaks[what] = float(said.split()[-1])
        return peaks


def plot(found: dict, path: Path = PLOT) -> None:
    """The costs as a picture, if matplotlib is here."""
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
        from matplotlib.ticker import FuncFormatter
    except ImportError:
        return
    axes = Figure(figsize=(6.4, 4.0), layout="constrained").add_subplot()
    most = 1.0
    for (name, c), marker in zip(found["cost"].items(), "os^", strict=True):
        more, longer = np.array(c["sizes"]) / c["sizes"][0], np.array(c["seconds"]) / c["seconds"][0]
        axes.plot(
            more, longer, marker=marker, label=f"{name}, {c['sizes'][0]} to {c['sizes'][-1]}: slope {c['exponent']:.2f}"
        )
        most = max(most, more[-1])
    axes.plot([1, most], [1, most], "k--", linewidth=1, label="slope 1: twice as many, twice as long")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="times as many as the fewest",
        ylabel="times the processor time of the fewest",
        title="How cost grows",
    )
    ticks = 2 ** np.arange(round(np.log2(most)) + 1)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks(ticks)
        axis.set_ticks([], minor=True)
        axis.set_major_formatter(FuncFormatter("{:g}".format))
    axes.grid(color="0.9")
    axes.legend(frameon=False)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": PLOT.name}):
        axes.figure.savefig(path, metadata={"Date": None})


def table(found: dict) -> list[str]:
    """Markdown."""
    lines = ["| processor time (s) over | sizes and times | exponent |", "|---|---|---|"]
    for name, c in found["cost"].items():
        pairs = ", ".join(f"{n}: {s:.3g}" for n, s in zip(c["sizes"], c["seconds"], strict=True))
        lines.append(f"| {name} | {pairs} | {c['exponent']:.2f} |")
    if memory := found.get("memory"):
        lines += [
            "",
            "| bag at 1 kHz, pose and twist | peak memory (MB) recording | reading | playing |",
            "|---|---|---|---|",
        ]
        lines += [
            f"| {float(s):g} s | {m['record']:.0f} | {m['read']:.0f} | {m['play']:.0f} |" for s, m in memory.items()
        ]
    return lines
