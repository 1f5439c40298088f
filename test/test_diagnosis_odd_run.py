# SPDX-License-Identifier: Apache-2.0
"""A run of another rig among the others is named and left out, and what is left is diagnosed."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from test_diagnosis_input import simulated

from inductrack_ros.checks import SET_ASIDE
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import diagnose

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from blind.ask import Asked, draw


def test_a_heavier_cradle_in_one_run_is_left_out():
    rig = Model.default()
    heavier = Model.create({"mass": 1.03 * rig.parameters["mass"]})
    (odd,) = simulated([24.0], model=heavier).runs
    campaign = simulated([18.0, 22.0, 26.0, 30.0, 34.0])
    found = diagnose(replace(campaign, runs=(*campaign.runs, replace(odd, name="odd"))), rig)
    assert found.verdict == "adequate"
    assert [(f.kind, f.run, f.severity) for f in found.findings] == [("bad_run", "odd", SET_ASIDE)]
    assert any("odd does not belong" in line for line in found.log)
    # The rest tells as much as it does alone.
    alone = diagnose(campaign, rig)
    assert found.parameters["eta"] == pytest.approx(alone.parameters["eta"], rel=1e-9)


@pytest.mark.nightly
def test_it_gets_no_force_of_its_own(tmp_path):
    """Runs that touch the track, one with a cradle lighter by 2 %. No other run had its current, so a force by the
    current once explained it."""
    truth = draw(tmp_path / "rig", 35024, Asked("dirty_complete"))
    assert truth["dirt"][0]["name"] == "odd_run" and truth["dirt"][0]["run"] == 0
    found = diagnose(load_campaign(tmp_path / "rig"), Model.default())
    assert found.verdict == "adequate"
    assert [f.run for f in found.findings if f.kind == "bad_run"] == ["run_00"]
