# SPDX-License-Identifier: Apache-2.0
"""3. A fit and a diagnosis of a twelve-run campaign, against `scipy.optimize.least_squares` over our own simulator.

The peer fits what ours fits (free parameters and each run's initial state, with the same weak priors) from the same
start, with its own differences, both on one thread. For the diagnosis it would refit every candidate; some are, and the
rest is reckoned from their mean. All by processor time."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import base_fit, diagnose
from inductrack_ros.diagnosis.moves import State, Task, refitted, settled
from inductrack_ros.diagnosis.screening import screen
from inductrack_ros.estimation.horizons import fit_from_scratch
from inductrack_ros.estimation.problem import STATE_PRIOR, Problem
from inductrack_ros.estimation.shooting import linearise_all
from inductrack_ros.estimation.structure import Structure
from inductrack_ros.workers import Threads

from .timing import in_turn, ratios, spread

#: Sizes of the initial states' changes.
SCALE = np.array([1e-2, 1e-3, 1e-3, 1e-2, 0.1, 0.1, 0.1, 1.0])
CAMPAIGN = Path(__file__).parents[2] / "examples" / "sample_campaign"


def peer(problem: Problem, structure: Structure, theta: np.ndarray, states: list[np.ndarray]) -> tuple[float, int]:
    """χ² that `least_squares` reaches, and how often it asked for all residuals."""
    free = [d.free_states for d in problem.runs]
    edges = np.cumsum([len(theta), *map(len, free)])
    root = np.linalg.cholesky(structure.precision).T
    calls = 0

    start = np.concatenate([theta, *(x[f] for x, f in zip(states, free, strict=True))])
    scale = np.concatenate([np.ones(len(theta)), *(SCALE[f] for f in free)])

    def unpack(u: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        # Every unknown is about 1, as its differences want.
        v = start + (u - 1.0) * scale
        xs = [x.copy() for x in states]
        for x, f, a, b in zip(xs, free, edges[:-1], edges[1:], strict=True):
            x[f] = v[a:b]
        return v[: len(theta)], xs

    def residual(u: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        th, xs = unpack(u)
        parts = [np.nan_to_num(r, nan=0.0, posinf=1e6, neginf=-1e6) for r in problem.residuals(structure, th, xs)]
        priors = [((x - d.guess) / STATE_PRIOR)[f] for x, d, f in zip(xs, problem.runs, free, strict=True)]
        return np.concatenate([*parts, *priors, root @ (th - structure.centre)])

    found = least_squares(residual, np.ones(len(start)), ftol=1e-6, diff_step=1e-4)
    th, xs = unpack(found.x)
    return float(sum(np.nansum(r**2) for r in problem.residuals(structure, th, xs))), calls


@threadpool_limits.wrap(limits=1, user_api="blas")  # a thread that spins takes processor time too
def measure(quick: bool) -> dict:
    """Times, ratios and the χ² reached."""
    campaign, model = load_campaign(CAMPAIGN), Model.default()
    problem, base, _ = base_fit(campaign, model)
    structure = base.structure

    def seconds(task) -> tuple[float, object]:
        began = time.process_time()
        result = task()
        return time.process_time() - began, result

    alone = problem.with_changes(threads=Threads(1))
    guesses = [d.guess for d in problem.runs]
    reached = {}
    times = in_turn({
        "ours": lambda: reached.update(ours=fit_from_scratch(alone, structure)),
        "least_squares": lambda: reached.update(peer=peer(alone, structure, structure.start, guesses)),
    }, 2 if quick else 3, time.process_time)  # fmt: skip
    unknowns = len(base.theta) + sum(len(d.free_states) for d in problem.runs)
    result = {
        "fit": {
            "ours": spread(times["ours"]),
            "chi2": reached["ours"].chi2,
            "peer": spread(times["least_squares"]),
            "peer_chi2": reached["peer"][0],
            "peer_calls": reached["peer"][1],
            "ratio": ratios(times, "ours")["least_squares"]["best"],
            "samples": reached["ours"].samples,
            "unknowns": unknowns,
        }
    }
    if quick:
        return result
    whole, found = seconds(lambda: diagnose(campaign, model))
    state = State(base)
    screening = screen(problem, base, linearise_all(problem, base))
    candidates = {s.members[0].name: s for s in screening.sets if len(s.members) == 1}
    refits = []
    # The most promising: each takes the peer half a minute.
    for name in [n for n, s in candidates.items() if not s.members[0].start][:2]:
        grown = structure.plus(name)
        theta = np.concatenate([base.theta, grown.start[len(base.theta) :]])
        t, (chi2, calls) = seconds(lambda g=grown, th=theta: peer(alone, g, th, list(base.states)))
        ours = settled(Task(problem), refitted(Task(problem), state, candidates[name], screening.family)).fit
        refits.append({"effect": name, "seconds": t, "chi2": chi2, "calls": calls, "our_chi2": ours.chi2})
    # Every candidate once for each effect that is found, and once more to see that none is left.
    rounds = 1 + len(found.effects)
    reckoned = rounds * len(candidates) * float(np.mean([r["seconds"] for r in refits]))
    result["diagnosis"] = {
        "ours": whole,
        "verdict": found.verdict,
        "effects": list(found.effects),
        "candidates": len(candidates),
        "rounds": rounds,
        "refits": refits,
        "peer_reckoned": reckoned,
        "ratio": reckoned / whole,
    }
    return result


def table(found: dict) -> list[str]:
    """Markdown."""
    f = found["fit"]
    lines = [
        f"| twelve runs, {f['samples']:,} samples, {f['unknowns']} unknowns | processor time (s) | times ours | χ² |",
        "|---|---|---|---|",
        f"| fit: ours | {f['ours']['min']:.2f} … {f['ours']['max']:.2f} | 1 | {f['chi2']:.1f} |",
        (
            f"| fit: least_squares, {f['peer_calls']} predictions | {f['peer']['min']:.1f} … {f['peer']['max']:.1f} |"
            f" {f['ratio']:.1f} | {f['peer_chi2']:.1f} |"
        ),
    ]
    if d := found.get("diagnosis"):
        lines += [f"| diagnosis: ours ({', '.join(d['effects']) or d['verdict']}) | {d['ours']:.1f} | 1 | |"]
        lines += [
            f"| least_squares, {r['effect']} | {r['seconds']:.1f} | | {r['chi2']:.1f}"
            + (f" (ours {r['our_chi2']:.1f})" if r["our_chi2"] else "")
            + " |"
            for r in d["refits"]
        ]
        lines += [
            f"| all {d['candidates']} candidates, {d['rounds']} rounds, reckoned from these | {d['peer_reckoned']:.0f}"
            f" | {d['ratio']:.0f} | |"
        ]
    return lines
