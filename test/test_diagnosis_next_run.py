# SPDX-License-Identifier: Apache-2.0
"""Idea: two effects that the data cannot tell apart; the run that is proposed, made by the independent simulator,
settles it."""

import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parent))

from independent import campaigns, clarity, hidden_effects
from independent import simulator as sim

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import diagnose


@pytest.mark.nightly
def test_the_proposed_run_settles_what_was_open(tmp_path):
    truth = campaigns.write_campaign(
        tmp_path / "rig", 7001, names=[("aerodynamic_drag", None)], design="coasting", faint=15, clear=16
    )
    before = diagnose(load_campaign(tmp_path / "rig"), Model.default())
    assert before.effects == ("aerodynamic_drag",) and before.indistinguishable == {
        "aerodynamic_drag": ("skin_friction_drag",)
    }
    run = before.proposal
    assert run is not None and min(run.sigmas.values()) > 8

    area = truth["parameters"]["aerodynamic_drag.drag_area"]
    hidden = [hidden_effects.with_size("aerodynamic_drag", area, 1.0, {})]
    rigs = clarity.rig_of(truth["parameters"]["eta"], truth["parameters"]["gamma"], hidden)
    heave, sway, roll = run.offsets
    start = np.array([0.0, sway, sim.equilibrium_heave(run.speed, rigs) + heave, roll, run.speed, 0.0, 0.0, 0.0])
    plan = truth["plan"]
    times = np.arange(0.0, run.duration, 1 / plan["rate"])
    made = {"times": times, "start": start, "drive_current": run.current}
    text, _ = campaigns.noisy_csv(
        np.random.default_rng(1), made, plan, (truth["parameters"]["eta"], truth["parameters"]["gamma"], hidden), ()
    )
    (tmp_path / "rig" / "next.csv").write_text(text)
    description = yaml.safe_load((tmp_path / "rig" / "campaign.yaml").read_text())
    description["runs"].append({"file": "next.csv", "drive_current": run.current})
    (tmp_path / "rig" / "campaign.yaml").write_text(yaml.safe_dump(description))

    after = diagnose(load_campaign(tmp_path / "rig"), Model.default())
    assert after.effects == ("aerodynamic_drag",) and after.indistinguishable == {}
    value, deviation = after.parameters["aerodynamic_drag.drag_area"]
    assert value == pytest.approx(area, abs=4 * deviation)
    fall = {r.name: r.chi2_fall for r in after.rivals}
    told = np.sqrt(fall["aerodynamic_drag"] - fall["skin_friction_drag"])
    assert 0.5 < told / run.sigmas["skin_friction_drag"] < 2

    # All that could be is listed, also what promised too little to be refitted.
    screened = {
        n for n, e in Model.default().known_effects.items() if e.screened and not e.of_channel and e.only != "pulses"
    }
    assert screened - set(hidden_effects.CONDITIONS) <= set(fall)  # no run is on a warmer day than another
    assert {r.name for r in after.rivals if r.chosen} == {"aerodynamic_drag"}
    assert all(r.words.startswith("not refitted") and not r.size for r in after.rivals if not r.refitted)
