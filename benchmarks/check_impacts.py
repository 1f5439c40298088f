# SPDX-License-Identifier: Apache-2.0
"""How often the look at the data takes an impact for a fault: campaigns of the package's own model that hit the track
in every way.

    python benchmarks/check_impacts.py --campaigns 300

Speeds, currents, drops, releases, sampling (0.5 to 20 ms), channels and rounding are drawn. Printed is how many
campaigns are refused or have samples set aside although nothing is wrong, and how many of the bad cells that are
planted, one into each campaign, are found: large ones, which no contact explains, and small ones (60 times the noise),
which beside the track it may. docs/check.md quotes it."""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from inductrack_ros.checks import IMPOSSIBLE, SET_ASIDE, look
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import CHANNELS
from inductrack_ros.data import Campaign, Run

POSE = ("surge", "sway", "heave", "roll")
IMU = ("surge_acceleration", "sway_acceleration", "heave_acceleration")
CHOICES = (
    tuple(CHANNELS),
    POSE,
    (*POSE, *IMU),
    tuple(CHANNELS[:8]),
    ("surge", "gap_top", "gap_right", "gap_left"),
    ("surge", "heave"),
)
STEPS = (5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
NOISE = {
    "surge": 5e-4,
    "sway": 3e-5,
    "heave": 3e-5,
    "roll": 1e-4,
    "surge_rate": 0.01,
    "sway_rate": 3e-3,
    "heave_rate": 3e-3,
    "roll_rate": 0.01,
}
NOISE |= dict.fromkeys(("gap_top", "gap_right", "gap_left"), 3e-5) | dict.fromkeys(IMU, 0.05)
#: What no contact does from one sample to the next.
LARGE = {
    c: 8e3 if c in IMU else 200.0 if c == "roll_rate" else 20.0 if c.endswith("_rate") else 0.5 if c == "roll" else 0.05
    for c in CHANNELS
} | {"surge": 1.0, "surge_rate": 50.0}


def drawn(rng: np.random.Generator, model: Model) -> Campaign:
    """One campaign."""
    channels, step, seconds = CHOICES[rng.integers(len(CHOICES))], float(rng.choice(STEPS)), rng.uniform(0.4, 2.0)
    times = np.arange(round(seconds / step) + 1) * step
    runs = []
    for k in range(rng.integers(1, 7)):
        start = {"surge_rate": rng.uniform(8, 30)}
        if rng.random() < 0.7:
            start |= {"sway": rng.uniform(-8e-3, 8e-3), "roll": rng.uniform(-0.04, 0.04)}
        if rng.random() < 0.4:
            start |= {"heave": rng.uniform(-8e-3, 4e-3)}
        if rng.random() < 0.3:
            start |= {
                "sway_rate": rng.uniform(-0.6, 0.6),
                "heave_rate": rng.uniform(-0.8, 0.8),
                "roll_rate": rng.uniform(-3, 3),
            }
        current = float(rng.choice([0.0, 3000.0, 7000.0]))
        flight = model.simulate(times, model.initial_state(**start), current, further=True)
        values = np.column_stack([flight[c] + NOISE[c] * rng.standard_normal(len(times)) for c in channels])
        runs.append(Run(f"run_{k}", Path(f"run_{k}.csv"), channels, times, values, times, current))
    if rng.random() < 0.2:
        coarse = np.isin(channels, POSE[1:])
        runs = [replace(run, values=np.where(coarse, np.round(run.values, 4), run.values)) for run in runs]
    return Campaign("rig", Path("rig"), tuple(runs), {c: NOISE[c] for c in channels})


def planted(campaign: Campaign, run: int, row: int, channel: str, size: float) -> Campaign:
    """The campaign with one cell off."""
    values = campaign.runs[run].values.copy()
    values[row, campaign.runs[run].channels.index(channel)] += size
    return replace(
        campaign, runs=tuple(replace(r, values=values) if i == run else r for i, r in enumerate(campaign.runs))
    )


def main() -> None:
    """Draw, look, plant, look, count."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--campaigns", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, model, wrong, found, slow = np.random.default_rng(given.seed), Model.default(), Counter(), Counter(), Counter()
    for number in range(given.campaigns):
        campaign = drawn(rng, model)
        for severity, finding in {f.severity: f for f in look(campaign, model)}.items():
            wrong[severity] += 1
            if severity in (IMPOSSIBLE, SET_ASIDE):
                print(f"campaign {number}: {finding.said}")
        run = int(rng.integers(len(campaign.runs)))
        times = campaign.runs[run].times
        row = int(rng.integers(7, len(times) - 7))
        channel = str(rng.choice([c for c in campaign.channels if c != "surge_acceleration"]))
        kind = "at 20 ms" if times[1] > 0.015 else "to 10 ms"
        slow[kind] += 1
        for name, size in (("large", LARGE[channel]), ("small", 60 * NOISE[channel])):
            findings = look(planted(campaign, run, row, channel, size), model)
            found[name, kind] += any(
                f.severity == SET_ASIDE and f.channel == channel and row in f.samples.get(f"run_{run}", ())
                for f in findings
            )
    print(f"{given.campaigns} campaigns: {wrong[IMPOSSIBLE]} refused, {wrong[SET_ASIDE]} with samples set aside")
    for (name, kind), count in sorted(found.items()):
        print(f"{name} bad cells, sampled {kind}: found {count} of {slow[kind]}")


if __name__ == "__main__":
    main()
