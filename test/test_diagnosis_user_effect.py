# SPDX-License-Identifier: Apache-2.0
"""Idea: the worked example of docs/diagnosis.md. An unknown is found, its effect written in ten lines, and it wins the
ranking."""

from dataclasses import replace
from pathlib import Path

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import diagnose

ROOT = Path(__file__).parents[1]


def test_a_users_effect_takes_part():
    model = Model.create(effect_files=[ROOT / "examples" / "magnetised_patch.py"])
    campaign = load_campaign(ROOT / "test" / "data" / "practice" / "p6_odd")
    found = diagnose(replace(campaign, runs=campaign.runs[:4]), model)  # a third of the runs: a third of the time
    assert found.verdict == "missing_effect"
    assert found.effects == ("magnetised_patch",)
    truth = {"force": 12.0, "place": 8.0, "width": 0.6}
    for name, value in truth.items():
        estimate, std = found.parameters[f"magnetised_patch.{name}"]
        assert abs(estimate - value) < 4 * std, name
