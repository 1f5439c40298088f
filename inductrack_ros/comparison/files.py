# SPDX-License-Identifier: Apache-2.0
"""The results of `compare` as files: ``comparison.json`` and predictions.

``comparison.json``::

    {"campaign": "rig-2026-10",
     "model": {"effects": ["aerodynamic_drag"], "parameters": {"eta": 0.7295, …},
               "uncertain": ["eta", …]},    // parameters whose covariance the bands below take
     "findings": [{"kind": "outliers", "channel": "sway", "count": 31, …}],      // as in check.json
     "notes": ["run_00: …"],      // what was converted or left out while reading
     "noise_std": {"heave": {"value": 3e-05, "given": true}, …},
     "error_over_noise": 41.2,       // RMS of (measured − predicted) / noise over all samples; 1 is a perfect model
     "channels": {"heave": 12.0, …},           // the same per channel
     "runs": [{"name": "run_00", "file": "run_00.csv", "drive_current": 7000.0, "duration": 1.5, "samples": 751,
               "error_over_noise": 50.1, "channels": {"heave": 13.1, …},
               "rmse": {"heave": 3.9e-4, …},                     // in the channel's unit
               "holds_for": 0.31,   // s until the error (RMS over 20 samples) exceeds 3 noises; null: it never does
               "initial_state": {"surge": 0.0, …}, "estimated": ["surge_rate", …],
               "band": {"heave": 2.1e-5, …},     // largest standard deviation of the prediction, in the channel's unit
               "beyond_band": {"heave": 1.1, …},      // error over noise and band together; both are {} without bands
               "predicted": "run_00.predicted.csv"}, …],
     "stretches": [{"by": "speed", "unit": "m/s", "low": 15.0, "high": 20.0, "samples": 3000,
                    "error_over_noise": 60.2, "channels": {"heave": 14.0, …},
                    "restarted": 1.4,     // when every 0.2 s starts afresh: what goes wrong here, not before
                    "restarted_channels": {"heave": 1.6, …}}, …],
     "outstanding": {"regions": [{"by": "gap", "low": 0.006, "high": null}, …],     // that the runs cannot tell apart
                     "inside": 3.1, "outside": 1.0, "channel": "heave"}}            // null: nothing stands out

``by`` is ``speed`` (m/s), ``gap`` (top gap, m), ``place`` (surge, m) or ``contact`` (low 1: an array touches; low 0:
none), taken from the measurements where they show it. A number that is not finite is null.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..core.plain_json import file_text, plain
from ..data import write_prediction
from .result import Comparison, RunComparison


def write_results(result: Comparison, folder: Path) -> None:
    """Write ``comparison.json`` and each run's ``<run>.predicted.csv``."""
    (folder / "comparison.json").write_text(file_text(to_json(result)), encoding="utf-8")
    for r in result.runs:
        write_prediction(folder, r.run, r.predicted)


def _largest_bands(result: Comparison, r: RunComparison) -> dict[str, float]:
    """The largest standard deviation of each channel's prediction, SI."""
    if r.band is None:
        return {}
    return {c: float(np.nanmax(r.band[:, i])) * result.noise[c] for i, c in enumerate(r.run.channels)}


def to_json(result: Comparison) -> dict[str, Any]:
    """The contents of ``comparison.json`` (see the module's docstring)."""
    return plain(
        {
            "campaign": result.campaign.name,
            "model": {
                "effects": list(result.model.effects),
                "parameters": {k: v for k, v in result.model.to_mapping().items() if isinstance(v, (int, float))},
                "uncertain": list(result.known),
            },
            "findings": [f.to_json() for f in result.findings],
            "notes": list(result.campaign.notes),
            "noise_std": {c: {"value": s, "given": c in result.noise_given} for c, s in result.noise.items()},
            "error_over_noise": result.error,
            "channels": result.errors,
            "runs": [
                {
                    "name": r.run.name,
                    "file": r.run.file.name,
                    "drive_current": r.run.drive_current,
                    "duration": r.run.duration,
                    "samples": len(r.run.times),
                    "error_over_noise": r.error,
                    "channels": r.errors,
                    "rmse": r.rmse,
                    "holds_for": r.holds_for,
                    "initial_state": dict(r.initial_state),
                    "estimated": list(r.estimated),
                    "band": _largest_bands(result, r),
                    "beyond_band": r.beyond_band,
                    "predicted": f"{r.run.name}.predicted.csv",
                }
                for r in result.runs
            ],
            "stretches": [
                {
                    "by": s.by,
                    "unit": s.unit,
                    "low": s.low,
                    "high": s.high,
                    "samples": s.samples,
                    "error_over_noise": s.error,
                    "channels": dict(s.errors),
                    "restarted": s.restarted,
                    "restarted_channels": dict(s.restarted_errors),
                }
                for s in result.stretches
            ],
            "outstanding": None if result.outstanding is None else asdict(result.outstanding),
        }
    )
