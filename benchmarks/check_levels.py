"""How often the look at the data is wrong: clean campaigns of the independent simulator, as they are and spoiled in one way each.

    python benchmarks/check_levels.py --campaigns 60

For each campaign that has surge, sway, heave and roll, every spoiling is tried; printed is how many clean campaigns got each kind of finding,
how far from the model's motion the worst channel of each is, and of each spoiling how many campaigns it was refused in, and for the right reason.
docs/check.md quotes it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))

from independent.campaigns import write_campaign  # noqa: E402

from inductrack_ros.checks import impossible, look  # noqa: E402
from inductrack_ros.checks.balance import Reading, misfits, windows_of  # noqa: E402
from inductrack_ros.checks.noise_found import channels_of  # noqa: E402
from inductrack_ros.core.model import Model  # noqa: E402
from inductrack_ros.data import Campaign, Run, load_campaign  # noqa: E402

#: What is multiplied by what, and the kind and the channels that are right to name.
SPOILINGS = {
    "surge in mm": ("surge", 1e3), "sway in mm": ("sway", 1e3), "heave in mm": ("heave", 1e3), "roll in degrees": ("roll", 180 / np.pi),
    "sway flipped": ("sway", -1.0), "heave flipped": ("heave", -1.0), "roll flipped": ("roll", -1.0), "surge flipped": ("surge", -1.0),
    "time in ms": ("time", 1e3), "current in kA": ("current", 1e-3),
}  # fmt: skip


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


def right(name: str, what: str, found) -> bool:
    """Whether one of the findings says what was spoiled."""
    if what == "time":
        return any(f.kind == "time_unit" for f in found)
    if what == "current":
        return any(f.channel == "drive_current" for f in found)
    twins = {"sway", "roll"} if name.endswith("flipped") and what in ("sway", "roll") else {what}
    named = {f.channel for f in found} | {f.size.get("of") for f in found} | {c for f in found for c in f.size.get("candidates", ())}
    return bool(twins & named)


def main() -> None:
    """Draw, spoil, look, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=7000)
    given = parser.parse_args()
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
                if what in ("time", "current") and (what == "time" or any(r.drive_current for r in campaign.runs)) or what in campaign.channels:
                    found = impossible(look(spoiled(campaign, what, factor), model))
                    tried[name] += 1
                    refused[name] += bool(found)
                    named[name] += right(name, what, found)
    print(f"clean campaigns: {clean.pop('campaigns')}")
    for (severity, kind), count in sorted(clean.items()):
        print(f"  {severity} {kind}: in {count}")
    print(f"worst channel off the model's motion: median {np.median(worst):.2f}, largest {max(worst):.2f}")
    for name in SPOILINGS:
        print(f"{name}: refused {refused[name]} of {tried[name]}, rightly named {named[name]}")


if __name__ == "__main__":
    main()
