# SPDX-License-Identifier: Apache-2.0
"""Idea: the peers of the blind benchmark are given a fair chance: each finds a clear drag, and the benchmark's judge
counts it."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import peers
from blind.judge import judge
from independent import campaigns

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign

#: A campaign of short runs, of which so many are enough.
SEED, RUNS = 379, 2


@pytest.fixture(scope="module")
def dragged(tmp_path_factory):
    """A campaign whose only secret is a clear drag, and its truth."""
    folder = tmp_path_factory.mktemp("peers") / "drag"
    truth = campaigns.write_campaign(folder, SEED, design="coasting", names=[("aerodynamic_drag", None)], faint=800.0)
    campaign = load_campaign(folder)
    return replace(campaign, runs=campaign.runs[:RUNS]), truth


@pytest.mark.parametrize("name", peers.PEERS)
def test_finds_a_clear_drag(dragged, name):
    if name == "pysindy_weak":
        pytest.importorskip("pysindy")
    campaign, truth = dragged
    found = peers.ask(name, campaign, Model.default())
    assert judge(truth, found) == {"right": True, "missed": [], "extra": [], "verdict": "missing_effect"}, found
