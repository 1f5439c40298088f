# SPDX-License-Identifier: Apache-2.0
"""The blind benchmark's own parts: its loop campaigns fly as the nodes do, its judge knows what a finding is about."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from blind import loop
from blind.judge import judge_findings
from blind.last_bits import CHANGE, changed

from inductrack_ros.checks import NOTE, Finding
from inductrack_ros.data import load_campaign


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A loop campaign and its truth."""
    folder = tmp_path_factory.mktemp("loop") / "rig"
    truth = loop.write_campaign(folder, 33003, "loop_complete")
    return load_campaign(folder), truth


def test_loop_campaign_is_flown_by_pulses_and_measured_with_the_noise_that_is_said(flown):
    campaign, truth = flown
    rig = loop.model_of(truth["parameters"]["eta"], truth["parameters"]["gamma"], [])
    for run, told in zip(campaign.runs, truth["runs"], strict=True):
        coils = run["surge"][-1] / (0.5 * rig.parameters["wavelength"])
        assert run.pulses is not None and abs(len(run.pulses.times) - coils) < 6  # every coil but the first few
        start = rig.initial_state(**told["initial"])
        true = rig.simulate(run.times, start, pulses=run.pulses)
        for channel, sigma in truth["plan"]["noise"].items():
            off = (run[channel] - true[channel]) / sigma
            assert abs(np.nanstd(off) - 1) < 5 / np.sqrt(2 * np.isfinite(off).sum()), channel


def test_a_finding_is_known_by_its_kind_and_what_it_is_about():
    truth = {
        "dirt": [{"name": "current_differs"}, {"name": "spikes"}],
        "findings": [
            {"kind": "run_to_run", "parameter": ["gamma", "drive_current"]},
            {"kind": "outliers", "channel": "sway"},
        ],
    }
    said = [
        Finding("run_to_run", NOTE, "", size={"parameter": "gamma", "relative_std": 0.01}),
        Finding("outliers", NOTE, "", channel="heave"),
        Finding("shaken", NOTE, "", size={"coordinate": "sway"}),
    ]
    told = judge_findings(truth, said)
    assert (told["expected"], told["told"], told["not_there"]) == (2, 1, ["shaken"])
    assert [w["channel"] for w in told["lost"]] == ["sway"]


def test_other_last_bits_are_other_and_no_more(flown):
    campaign, _ = flown
    one, other = campaign.runs[0].values, changed(campaign, 1).runs[0].values
    assert 0 < np.nanmax(np.abs(other / one - 1)) < 10 * CHANGE
