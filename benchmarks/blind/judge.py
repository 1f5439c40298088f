# SPDX-License-Identifier: Apache-2.0
"""Whether an answer is right, held against the truth file of its campaign."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure

#: What a finding is about, by the keys that truth and answer share.
SUBJECTS = ("channel", "coordinate", "parameter", "run")
#: Findings that speak of log and rig, as a truth has them.
KINDS = (
    "outliers", "coloured_noise", "hum", "quantised", "noise_differs", "time_jitter", "shaken", "run_to_run", "bad_run",
)  # fmt: skip
#: Findings that may come along with a dirt, though they are not what is asked for.
COMPANIONS = {
    "tails": {"outliers", "noise_differs"},
    "noise_by_run": {"noise_differs"},
    "noise_by_channel": {"noise_differs"},
    "rounding": {"noise_differs", "coloured_noise"},
    "coloured": {"noise_differs"},
    "spikes": {"noise_differs"},
    "hum": {"noise_differs"},
    "odd_run": {"run_to_run"},
    "current_differs": {"bad_run"},
    "magnets_differ": {"bad_run"},
    "saturated": {"quantised"},
}


def judge(truth: dict, found) -> dict:
    """Whether a diagnosis is right: the verdict, every effect (or its named twin), the unknown's coordinate and
    variable."""
    named = {n: {n, *found.indistinguishable.get(n, ())} for n in found.effects}
    wanted = list(truth["effects"])
    missed = [w for w in wanted if not any(w in group for group in named.values())]
    extra = [n for n, group in named.items() if not group & set(wanted)]
    right = found.verdict == truth["verdict"] and not missed and not extra
    where = True
    if truth["verdict"] == "unknown_effect" and found.unknown is not None:
        where = any(
            found.unknown.channel == u["channel"] and set(found.unknown.depends_on) & set(u["depends_on"])
            for u in truth["unknown"]
        )
    return {"right": right and where, "missed": missed, "extra": extra, "verdict": found.verdict}


def judge_findings(truth: dict, findings: Iterable) -> dict:
    """How many of the findings that a dirty campaign should give are there, and kinds that are told of what is not."""
    said = [{"kind": f.kind, "channel": f.channel, "run": f.run, **f.size} for f in findings]
    wanted = truth.get("findings", [])
    lost = [w for w in wanted if not any(_same(w, s) for s in said)]
    allowed = {w["kind"] for w in wanted}.union(*(COMPANIONS.get(d["name"], set()) for d in truth.get("dirt", [])))
    more = sorted({s["kind"] for s in said if s["kind"] in KINDS and s["kind"] not in allowed})
    return {"expected": len(wanted), "told": len(wanted) - len(lost), "lost": lost, "not_there": more}


def _same(wanted: dict, said: dict) -> bool:
    """Whether both are of one kind and about the same thing; a parameter may have several names."""
    if wanted["kind"] != said["kind"]:
        return False
    for key in SUBJECTS:
        if key in wanted:
            names = wanted[key] if isinstance(wanted[key], list) else [wanted[key]]
            if said.get(key) not in names:
                return False
    return True


def off(truth: dict, found) -> dict[str, float]:
    """For each parameter that was found and is known: how many of its standard deviations it is off the truth."""
    result = {}
    for name, value in truth["parameters"].items():
        if name in found.parameters and isinstance(value, (int, float)):
            estimate, std = found.parameters[name]
            if np.isfinite(std) and std > 0 and not name.startswith("guideway_waviness.phase"):
                result[name] = (estimate - value) / std
    return result


def heldout_error(folder: Path, model: Model, noise: dict[str, float]) -> float:
    """RMS error over noise on unseen runs from their exact initial states."""
    campaign = load_campaign(folder)
    problem = Problem(campaign, model, noise)
    rest = np.concatenate(problem.residuals(Structure(model, ()), np.zeros(0), [d.guess for d in problem.runs]))
    rest = rest[np.isfinite(rest)]
    return float(np.sqrt(np.mean(rest**2)))
