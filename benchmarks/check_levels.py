# SPDX-License-Identifier: Apache-2.0
"""How often the look at the data is wrong: clean campaigns of the independent simulator, as they are and spoiled in one
way each.

    python benchmarks/check_levels.py --campaigns 60
    python benchmarks/check_levels.py --campaigns 0 --samples 3600000      # an hour at 1 kHz: time of the look over time of reading

For each campaign that has surge, sway, heave and roll, every spoiling is tried; printed is how many clean campaigns got
each kind of finding, how far from the model's motion the worst channel of each is, and of each spoiling how many
campaigns it was refused in, and for the right reason. docs/check.md quotes it."""  # noqa: E501

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))

from independent.campaigns import write_campaign

from inductrack_ros.checks import impossible, look
from inductrack_ros.checks.balance import misfits
from inductrack_ros.checks.noise_found import channels_of
from inductrack_ros.checks.windows import Reading, windows_of
from inductrack_ros.core.model import Model
from inductrack_ros.data import Campaign, Run, load_campaign, write_csv

#: What is multiplied by what, and the kind and the channels that are right to name.
SPOILINGS = {
    "surge in mm": ("surge", 1e3),
    "sway in mm": ("sway", 1e3),
    "heave in mm": ("heave", 1e3),
    "roll in degrees": ("roll", 180 / np.pi),
    "sway flipped": ("sway", -1.0),
    "heave flipped": ("heave", -1.0),
    "roll flipped": ("roll", -1.0),
    "surge flipped": ("surge", -1.0),
    "time in ms": ("time", 1e3),
    "a clock twice too slow": ("time", 2.0),
    "a clock 2.5 times too fast": ("time", 0.4),
    "current in kA": ("current", 1e-3),
}


def spoiled(campaign: Campaign, what: str, factor: float) -> Campaign:
    """The campaign with one channel, its clock or its drive current multiplied."""

    def one(run: Run) -> Run:
        if what == "time":
            return replace(run, times=factor * run.times, stamps=factor * run.stamps)
        if what == "current":
            return replace(run, drive_current=factor * run.drive_current)
        values = run.values.copy()
        values[:, run.channels.index(what)] *= factor
        return replace(run, values=values)

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


def minus_the_gap(campaign: Campaign) -> Campaign | None:
    """Heave written as the gap above with a minus."""
    gap = Model.default().parameters["nominal_gap"]
    return _heave(campaign, {r.name: (-1.0, -gap) for r in campaign.runs})


def another_zero(campaign: Campaign) -> Campaign | None:
    """Heave 3 mm too large in the run that starts neither slowest nor fastest."""
    speeds = {r.name: np.diff(r.samples("surge")[1]).mean() / np.diff(r.times).mean() for r in campaign.runs}
    middle = sorted(speeds, key=lambda name: speeds[name])[len(speeds) // 2]
    return _heave(campaign, {middle: (1.0, 3e-3)}) if len(speeds) > 2 else None


def _heave(campaign: Campaign, changes: Mapping[str, tuple[float, float]]) -> Campaign:
    """Heave multiplied and moved in some runs."""

    def one(run: Run) -> Run:
        values, k = run.values.copy(), run.channels.index("heave")
        factor, zero = changes.get(run.name, (1.0, 0.0))
        values[:, k] = factor * values[:, k] + zero
        return replace(run, values=values)

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


def heave_and_roll(campaign: Campaign) -> Campaign | None:
    """Two columns exchanged."""

    def one(run: Run) -> Run:
        order = [{"heave": "roll", "roll": "heave"}.get(c, c) for c in run.channels]
        return replace(run, values=run.values[:, [run.channels.index(c) for c in order]])

    return replace(campaign, runs=tuple(map(one, campaign.runs))) if "roll" in campaign.channels else None


def two_currents(campaign: Campaign) -> Campaign | None:
    """The largest and the smallest drive current exchanged."""
    driven = sorted((r for r in campaign.runs if r.drive_current > 0.0 and not r.pulsed), key=lambda r: r.drive_current)
    if len(driven) < 2 or driven[-1].drive_current < 1.3 * driven[0].drive_current:
        return None
    to = {driven[0].name: driven[-1].drive_current, driven[-1].name: driven[0].drive_current}
    return replace(
        campaign, runs=tuple(replace(r, drive_current=to.get(r.name, r.drive_current)) for r in campaign.runs)
    )


#: Other ways to spoil a campaign that has heave, and the kind and channel that are right to name.
OTHERS: dict[str, tuple[Callable[[Campaign], Campaign | None], set[tuple[str, str]]]] = {
    "minus the gap above for heave": (minus_the_gap, {("zero", "heave"), ("axis_flipped", "heave")}),
    "a zero of heave in one run": (another_zero, {("zero", "heave")}),
    "heave and roll exchanged": (heave_and_roll, {("axis_flipped", "heave")}),
    "two currents exchanged": (two_currents, {("unit", "drive_current"), ("unlike", "drive_current")}),
}


def right(name: str, what: str, found) -> bool:
    """Whether one of the findings says what was spoiled."""
    if what == "time":
        return any(f.kind == "time_unit" for f in found)
    if what == "current":
        return any(f.channel == "drive_current" for f in found)
    twins = {"sway", "roll"} if name.endswith("flipped") and what in ("sway", "roll") else {what}
    named = (
        {f.channel for f in found}
        | {f.size.get("of") for f in found}
        | {c for f in found for c in f.size.get("candidates", ())}
    )
    return bool(twins & named)


def speed(samples: int) -> None:
    """Print the time of the look over that of reading one run of eight channels at 1 kHz, and what it adds to the
    memory of reading."""
    rng, times = np.random.default_rng(0), np.arange(samples) / 1e3
    swing = {"sway": (1e-3, 12.0, 3e-5), "heave": (5e-4, 35.0, 3e-5), "roll": (3e-3, 9.0, 1e-4)}
    columns = {"surge": 17 * times + 5e-4 * rng.standard_normal(samples)}
    columns |= {c: a * np.sin(w * times) + s * rng.standard_normal(samples) for c, (a, w, s) in swing.items()}
    columns["surge_rate"] = 17 + 0.01 * rng.standard_normal(samples)
    columns |= {
        f"{c}_rate": a * w * np.cos(w * times) + 3e-3 * rng.standard_normal(samples) for c, (a, w, _) in swing.items()
    }
    with tempfile.TemporaryDirectory() as folder:
        write_csv(Path(folder, "run.csv"), times, {c: np.round(y, 8) for c, y in columns.items()})
        Path(folder, "campaign.yaml").write_text("runs: [{file: run.csv, drive_current: 7000}]\n")
        del columns
        model = Model.default()
        model.quantities(model.initial_state())  # compiled before the clock runs
        began = time.perf_counter()
        campaign = load_campaign(folder)
        read, memory = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        look(campaign, model)
        looked = time.perf_counter() - read
        more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / memory - 1
    print(
        f"{samples} samples of 8 channels: the look takes {looked / (read - began):.2f} of the time of reading,"
        f" {100 * more:.0f} % more memory"
    )


def main() -> None:
    """Draw, spoil, look, count."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--campaigns", type=int, default=60)
    parser.add_argument("--samples", type=int, default=0)
    parser.add_argument("--first-seed", type=int, default=7000)
    given = parser.parse_args()
    if given.samples:
        speed(given.samples)
    if not given.campaigns:
        return
    model, clean, worst = Model.default(), Counter(), []
    refused, named, tried = Counter(), Counter(), Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(given.first_seed, given.first_seed + given.campaigns):
            place = Path(folder, str(seed))
            write_campaign(place, seed)
            campaign = load_campaign(place)
            findings = look(campaign, model)
            clean.update({(f.severity, f.kind) for f in findings})
            clean["campaigns"] += 1
            channels = channels_of(campaign)
            windows = windows_of(campaign, channels)
            if windows is not None:
                worst.append(max(misfits(windows, model, Reading()).values(), default=0.0))
            for name, (what, factor) in SPOILINGS.items():
                if (
                    what in ("time", "current")
                    and (what == "time" or any(r.drive_current for r in campaign.runs))
                    or what in campaign.channels
                ):
                    found = impossible(look(spoiled(campaign, what, factor), model))
                    tried[name] += 1
                    refused[name] += bool(found)
                    named[name] += right(name, what, found)
            for name, (spoil, rightly) in OTHERS.items():
                wrong = spoil(campaign) if "heave" in campaign.channels and "surge" in campaign.channels else None
                if wrong is not None:
                    found = impossible(look(wrong, model))
                    tried[name] += 1
                    refused[name] += bool(found)
                    named[name] += any((f.kind, f.channel) in rightly for f in found)
    print(f"clean campaigns: {clean.pop('campaigns')}")
    for (severity, kind), count in sorted(clean.items()):
        print(f"  {severity} {kind}: in {count}")
    print(f"worst channel off the model's motion: median {np.median(worst):.2f}, largest {max(worst):.2f}")
    for name in (*SPOILINGS, *OTHERS):
        print(f"{name}: refused {refused[name]} of {tried[name]}, rightly named {named[name]}")


if __name__ == "__main__":
    main()
