# SPDX-License-Identifier: Apache-2.0
"""The look as `inductrack check` gives it: findings, and what each run and channel holds. ``check.json``, written by
`write_check`::

    {"campaign": "rig-2026-10",
     "verdict": "clean" | "usable" | "impossible",     // impossible: the data cannot be meant as they are written
     "findings": [{"kind": "outliers", "channel": "sway", "count": 31, "share": 0.005, "largest": 0.0021,
                   "severity": "set_aside", "text": "…", "remedy": null, "samples": {"run_00": [17, …]}}, …],   // worst first
     "notes": ["run_00: …"],             // what was converted or left out while reading
     "channels": {"heave": {"samples": 3000, "missing": 0, "noise": 3e-05, "noise_std": 3e-05, "step": 0.0, "low": -0.006, "high": -0.003}, …},
     "runs": [{"name": "run_00", "file": "run_00.csv", "drive_current": 7000.0, "samples": 601, "duration": 1.2, "step": 0.002,
               "longest_hole": 0.002}, …]}

``samples`` count from 0 in each run. ``step`` of a channel is what its readings are multiples of, 0 where none shows;
null is not known."""  # noqa: E501

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.model import Model
from ..core.plain_json import file_text
from ..data import Campaign
from .finding import SET_ASIDE, WARNING, Finding, impossible
from .look import look, set_aside
from .noise_found import Channel, channels_of


@dataclass(frozen=True)
class Check:
    """A campaign as it was read, what the look found, and its channels without what was set aside."""

    campaign: Campaign
    findings: tuple[Finding, ...]
    channels: Mapping[str, Channel]

    @property
    def verdict(self) -> str:
        """``clean``, ``usable`` (something is set aside or may mislead) or ``impossible``."""
        if impossible(self.findings):
            return "impossible"
        return "usable" if any(f.severity in (SET_ASIDE, WARNING) for f in self.findings) else "clean"


def check(campaign: Campaign, model: Model) -> Check:
    """Look at a campaign that is to be held against a model."""
    findings = look(campaign, model)
    left = set_aside(campaign, findings)
    with np.errstate(all="ignore"):
        return Check(campaign, findings, channels_of(left if left.runs else campaign))


def write_check(result: Check, folder: Path) -> None:
    """Write ``check.json``."""
    (folder / "check.json").write_text(file_text(to_json(result)), encoding="utf-8")


def to_json(result: Check) -> dict[str, Any]:
    """The contents of ``check.json`` (see the module's docstring)."""
    campaign = result.campaign
    return {
        "campaign": campaign.name,
        "verdict": result.verdict,
        "findings": [f.to_json() for f in result.findings],
        "notes": list(campaign.notes),
        "channels": {c: _channel(campaign, c, about) for c, about in result.channels.items()},
        "runs": [
            {
                "name": run.name,
                "file": run.file.name,
                "drive_current": run.drive_current,
                "samples": len(run.times),
                "duration": run.duration,
                "step": float(np.median(np.diff(run.times))) if len(run.times) > 1 else None,
                "longest_hole": float(np.diff(run.times).max()) if len(run.times) > 1 else None,
            }
            for run in campaign.runs
        ],
    }


def _channel(campaign: Campaign, channel: str, about: Channel) -> dict[str, Any]:
    mine = [run for run in campaign.runs if channel in run.channels]
    return {
        "samples": about.count,
        "missing": sum(len(run.times) for run in mine) - about.count,
        "noise": about.noise,
        "noise_std": campaign.noise_std.get(channel),
        "step": about.step,
        "low": about.low,
        "high": about.high,
    }
