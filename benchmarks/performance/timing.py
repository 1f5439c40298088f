# SPDX-License-Identifier: Apache-2.0
"""Fair times on a machine that others use too: tasks take turns, and what is reported is their ratio."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path

#: A turn lasts at least so long (s), so that short tasks do not each begin in the caches that another has filled.
TURN = 0.02


def in_turn(
    tasks: Mapping[str, Callable[[], object]], repeats: int, clock: Callable[[], float] = time.thread_time
) -> dict[str, list[float]]:
    """Times (s) of each task, ``repeats`` rounds in which each has its turn, after one that does not count."""
    counts = dict.fromkeys(tasks, 1)
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for turn in range(repeats + 1):
        for name, task in tasks.items():
            began = clock()
            for _ in range(counts[name]):
                task()
            lasted = clock() - began
            if turn:
                times[name].append(lasted / counts[name])
            else:
                counts[name] = max(1, round(TURN / max(lasted, 1e-6)))
    return times


def spread(values: list[float]) -> dict[str, float]:
    """Median, least and largest."""
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def ratios(times: Mapping[str, list[float]], ours: str) -> dict[str, dict[str, float]]:
    """How many times longer than ours each took: round by round, for the machine's moods fall on both, and the ``best``
    of all."""
    return {
        n: spread([a / b for a, b in zip(t, times[ours], strict=True)]) | {"best": min(t) / min(times[ours])}
        for n, t in times.items() if n != ours
    }  # fmt: skip


def machine() -> dict[str, object]:
    """What the figures were taken on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    name = next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.processor()
    )
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "load before": round(os.getloadavg()[0], 1),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{p: version(p) for p in ("numpy", "scipy", "numba")},
    }
