# SPDX-License-Identifier: Apache-2.0
"""2. An ensemble of 1,000 runs with different parameters on all cores; the limit is C over lanes with the vectoriser's
options. With effects it is 8,000 runs, and the C code still has none."""

from __future__ import annotations

import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.estimation.ensemble import MANY_WITH_EFFECTS, ensemble

from . import limit
from .timing import in_turn, ratios, spread

RUNS = 1000
TIMES = np.linspace(0.0, 3.0, 301)
CHUNK = 5 * limit.LANES
#: Initial speeds (m/s): from the first all runs touch the track within the 3 s, from the second none does.
SPEEDS = {"all touch down": 14.5, "all fly": 19.0}
#: Some that rigs have and that need no shorter steps: C would take those as well.
EFFECTS: dict[str, dict[str, float]] = {
    "track_resistance": {"relative_change": 0.05},
    "aerodynamic_drag": {"drag_area": 0.01},
    "track_slope": {"angle": 1e-3},
}
SCATTER = {"eta": 0.01, "gamma": 0.01, "mass": 0.005, "resistance": 0.02, "inductance": 0.02}


def draw(model: Model, speed: float, runs: int) -> tuple[np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """States (runs, 8), scattered parameters (runs,) by name, and all of them as the C code takes them (runs, 22)."""
    rng = np.random.default_rng(0)
    parameters = {n: model.parameters[n] * (1 + s * rng.standard_normal(runs)) for n, s in SCATTER.items()}
    states = np.tile(model.initial_state(surge_rate=speed)[:8], (runs, 1))
    states[:, 4] += 0.2 * rng.standard_normal(runs)
    states[:, 1] = 1e-3 * rng.standard_normal(runs)
    P = np.tile(model.vector[:22], (runs, 1))
    for name, values in parameters.items():
        P[:, model.kernel.parameters.index(name)] = values
    return states, parameters, P


def in_c(P: np.ndarray, states: np.ndarray, options: tuple[str, ...]) -> np.ndarray:
    """The C limit on all cores."""
    rows = [slice(i, i + CHUNK) for i in range(0, len(P), CHUNK)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate(list(pool.map(lambda r: limit.ensemble(P[r], states[r], TIMES, options), rows)))


def measure(quick: bool) -> dict:
    """Rates and ratios, by processor time: this machine's cores may not be ours alone."""
    found = {}
    cases = {name: (Model.default(), speed, RUNS // 5 if quick else RUNS) for name, speed in SPEEDS.items()}
    loaded = Model.default().with_changes(effects=EFFECTS)
    cases[f"all fly, with {len(EFFECTS)} effects"] = loaded, SPEEDS["all fly"], MANY_WITH_EFFECTS
    for name, (model, speed, runs) in cases.items():
        states, parameters, P = draw(model, speed, runs)
        tasks = {"ours": lambda m=model, s=states, p=parameters: ensemble(m, TIMES, s, p)}
        if limit.compiler():
            tasks["C, lanes, -O3 -march=native -ffast-math"] = lambda s=states, p=P: in_c(p, s, limit.FAST)
        outputs = {label: task() for label, task in tasks.items()}
        difference = max(float(np.abs(outputs["ours"] - o)[:, :, :4].max()) for o in outputs.values())
        times = in_turn(tasks, 5 if quick else 9, time.process_time)
        walls = in_turn(tasks, 3 if quick else 5, time.perf_counter)
        evaluations = (
            sum(limit.evaluations(P[i], states[i], TIMES) for i in range(20)) / 20 if limit.compiler() else float("nan")
        )
        found[name] = {
            "touch": float((outputs["ours"][:, :, 8:11].min(axis=(1, 2)) < 0).mean()),
            "rows": {
                label: {
                    "seconds": spread(t),
                    "runs_per_second": runs / min(walls[label]),
                    "runs_per_core_second": runs / spread(t)["median"],
                    "evaluations_per_core_second": runs * evaluations / spread(t)["median"],
                }
                for label, t in times.items()
            },
            "times_ours": ratios(times, "ours"),
            "difference": difference,
            "evaluations_per_run": evaluations,
        }
    return found


def table(found: dict) -> list[str]:
    """Markdown."""
    lines = [
        (
            "| 1,000 runs of 3 s (8,000 with effects) | runs per second, all cores | runs per second and core |"
            " right-hand sides per second and core | time over ours (best over best; by rounds) |"
        ),
        "|---|---|---|---|---|",
    ]
    for name, part in found.items():
        for label, row in part["rows"].items():
            ratio = part["times_ours"].get(label)
            text = "1" if ratio is None else f"{ratio['best']:.2f} ({ratio['min']:.2f} … {ratio['max']:.2f})"
            lines.append(
                f"| {name}: {label} | {row['runs_per_second']:,.0f} | {row['runs_per_core_second']:,.0f} |"
                f" {row['evaluations_per_core_second'] / 1e6:.1f}·10⁶ | {text} |"
            )
    return lines
