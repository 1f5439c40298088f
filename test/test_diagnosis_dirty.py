# SPDX-License-Identifier: Apache-2.0
"""Idea: campaigns of an independent simulator as a rig logs them; the physics is named, and what the log does besides
is a finding.

``data/practice_dirty`` is made by an independent simulator; what is hidden and what the log does is written here.
"""

from pathlib import Path

import pytest

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import diagnose

DIRTY = Path(__file__).parent / "data" / "practice_dirty"
CHANNELS = {"surge", "sway", "heave", "roll"}

#: verdict, effects with the values they were made with, and each kind of finding with what it must be about.
ANSWERS = {
    "d1_spikes": ("adequate", {}, {("outliers", c) for c in CHANNELS}),
    "d2_quantised": ("adequate", {}, {("quantised", c) for c in CHANNELS}),
    "d3_coloured": ("adequate", {}, {("coloured_noise", c) for c in CHANNELS}),
    "d4_shaken_drag": ("missing_effect", {"aerodynamic_drag.drag_area": 0.06}, {("shaken", c) for c in CHANNELS}),
    "d5_jitter": ("adequate", {}, {("time_jitter", None)}),
    "d6_run_to_run": ("adequate", {}, {("run_to_run", "gamma")}),
    "d7_lag": ("missing_effect", {"sensor_lag:sway.time_constant": 0.006}, set()),
    "d8_hum_damping": ("missing_effect", {"heave_damping.coefficient": 14.0}, {("hum", c) for c in CHANNELS}),
}

#: Sizes of findings: kind, its figure, the value it was made with, and how far off it may be.
SIZES = {
    "d3_coloured": ("coloured_noise", "correlation_time", 0.018, 0.35),
    "d5_jitter": ("time_jitter", "std", 3e-4, 0.1),
    "d6_run_to_run": ("run_to_run", "relative_std", 0.006, 0.5),
}
QUICK = ("d1_spikes", "d2_quantised", "d5_jitter")


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.nightly) for n in ANSWERS])
def test_the_physics_is_named_and_the_log_is_told(name):
    verdict, parameters, findings = ANSWERS[name]
    found = diagnose(load_campaign(DIRTY / name), Model.default())
    assert found.verdict == verdict
    assert set(found.effects) == {p.rpartition(".")[0] for p in parameters}
    for parameter, truth in parameters.items():
        value, std = found.parameters[parameter]
        assert abs(value - truth) < 4 * std, parameter
    about = {(f.kind, f.channel or f.size.get("coordinate") or f.size.get("parameter")) for f in found.findings}
    assert findings <= about
    assert all(f.text for f in found.findings)
    if name in SIZES:
        kind, figure, size, off = SIZES[name]
        assert [f.size[figure] for f in found.findings if f.kind == kind] == pytest.approx(
            [size] * len(findings), rel=off
        )
