# SPDX-License-Identifier: Apache-2.0
"""1. One run of 3 s with touchdown: ours, what a user would write, and the limit; all as exact as the golden trajectory
asks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.core.state import STATES

from . import limit, peers
from .timing import in_turn, ratios, spread

GOLDEN = Path(__file__).parents[2] / "test" / "data" / "golden" / "launch_15p5.csv"
CURRENT = 7000.0
BEFORE, AFTER = 1e-6, 1e-5  # m and rad, allowed until an array first touches, and after
LADDER = tuple(10.0**-k for k in np.arange(5.0, 13.1, 0.5))


def problem() -> tuple[Model, np.ndarray, np.ndarray, np.ndarray]:
    """Model, golden table, state and times of the run."""
    golden = np.genfromtxt(GOLDEN, delimiter=",", names=True)
    return Model.default(), golden, np.array([golden[s][0] for s in STATES]), np.ascontiguousarray(golden["time"])


def errors(states: np.ndarray, golden: np.ndarray, touched: np.ndarray) -> tuple[float, float]:
    """Largest error of the four coordinates before the first contact and after."""
    off = np.max([np.abs(states[:, i] - golden[s]) for i, s in enumerate(STATES[:4])], axis=0)
    return float(off[~touched].max()), float(off[touched].max())


def exact_enough(
    solve: Callable[[float], np.ndarray], judge: Callable[[np.ndarray], tuple[float, float]]
) -> float | None:
    """The loosest relative tolerance with which a solver is as exact as is asked."""
    for rtol in LADDER:
        before, after = judge(solve(rtol))
        if before < BEFORE and after < AFTER:
            return rtol
    return None


def measure(quick: bool) -> dict:
    """Times, ratios and errors."""
    model, golden, state, times = problem()
    P = model.vector[:22].copy()
    ours = model.simulate(times, state, CURRENT)
    touched = np.logical_or.accumulate(ours.outputs[:, 8:11].min(axis=1) < 0)

    def judge(states: np.ndarray) -> tuple[float, float]:
        return errors(states, golden, touched)

    fast: dict[str, Callable[[], np.ndarray]] = {"ours": lambda: model.simulate(times, state, CURRENT).states}
    if limit.compiler():
        fast["C, -O3"] = lambda: limit.run(P, state, times)[:, :8]
    slow: dict[str, Callable[[], np.ndarray]] = {"ours": fast["ours"]}
    tolerances = {}
    for name, (solve, method) in peers.solvers().items():
        rtol = exact_enough(lambda r, s=solve, m=method: s(m, peers.compiled, P, state, times, r), judge)
        if rtol is None:
            tolerances[name] = None
            continue
        for label, function in (("plain Python", peers.right_hand_side), ("numba", peers.compiled)):
            task = lambda s=solve, m=method, f=function, r=rtol: s(m, f, P, state, times, r)  # noqa: E731
            slow[f"{name}, {label}"] = task
            tolerances[f"{name}, {label}"] = rtol
    quickly = in_turn(fast, 10 if quick else 40)
    slowly = in_turn(slow, 3 if quick else 7)
    rows = {
        name: {"seconds": spread(t), "errors": judge((fast | slow)[name]())}
        for name, t in {**slowly, **quickly}.items()
    }
    for name, value in tolerances.items():
        rows.setdefault(name, {})["rtol"] = value
    return {
        "rows": rows,
        "times_ours": {**ratios(slowly, "ours"), **ratios(quickly, "ours")},
        "evaluations": limit.evaluations(P, state, times) if limit.compiler() else None,
    }


def table(found: dict) -> list[str]:
    """Markdown."""
    lines = [
        (
            "| one run of 3 s, touchdown after 1.2 s | time (ms): median, least … most | times ours (best over best; by"
            " rounds) | error before / after contact (m) |"
        ),
        "|---|---|---|---|",
    ]
    order = sorted(
        (n for n in found["rows"] if "seconds" in found["rows"][n]), key=lambda n: found["rows"][n]["seconds"]["median"]
    )
    for name in order:
        row = found["rows"][name]
        s, ratio = row["seconds"], found["times_ours"].get(name)
        rtol = f" (rtol {row['rtol']:.0e})" if row.get("rtol") else ""
        times = "1" if ratio is None else f"{ratio['best']:.3g} ({ratio['min']:.3g} … {ratio['max']:.3g})"
        lines.append(
            f"| {name}{rtol} | {1e3 * s['median']:.3g}, {1e3 * s['min']:.3g} … {1e3 * s['max']:.3g} | {times} |"
            f" {row['errors'][0]:.0e} / {row['errors'][1]:.0e} |"
        )
    lines += [
        f"| {n} | not exact enough at any tolerance | | |" for n, r in found["rows"].items() if "seconds" not in r
    ]
    return lines
