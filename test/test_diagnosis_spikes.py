# SPDX-License-Identifier: Apache-2.0
"""Bad readings at a run's ends and beside a contact: the model shows those that the look at the data has to keep."""

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis_input import CHANNELS, NOISE, simulated

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.diagnose import base_fit, spikes_and_fit
from inductrack_ros.diagnosis.spikes import outlying

#: Run, channel and row of each bad reading, and by how many times the noise it is off.
PLANTED = ((0, "roll", 1, -45.0), (1, "roll", 98, 30.0), (2, "heave", 60, 25.0), (3, "surge", 99, 40.0))


@pytest.fixture(scope="module")
def touching():
    """Four runs that sink to the track and bounce."""
    return simulated([9.0, 10.0, 12.0, 14.0], seconds=0.5, rate=200.0)


def spoiled(campaign, planted):
    runs = [replace(r, values=r.values.copy()) for r in campaign.runs]
    for run, channel, row, size in planted:
        runs[run].values[row, CHANNELS.index(channel)] += size * NOISE[channel]
    return replace(campaign, runs=tuple(runs))


def test_all_that_were_planted_are_found_and_no_others(touching):
    spikes, (_, base, _) = spikes_and_fit(spoiled(touching, PLANTED), Model.default())
    assert any(t.any() for t in base.touching)
    found = {(f.channel, run, row) for f in spikes for run, rows in f.samples.items() for row in rows}
    assert found == {(channel, f"run_{run}", row) for run, channel, row, _ in PLANTED}


def test_a_clean_campaign_has_none(touching):
    campaign = touching
    problem, base, _ = base_fit(campaign, Model.default())
    assert outlying(problem, base, campaign) == ()


def test_a_model_that_lacks_an_effect_makes_no_spikes():
    """What is off for many readings is no bad reading."""
    rig = Model.create(effects={"joint_step": {"place": 4.0, "height": 1e-3}})
    campaign = simulated([14.0, 18.0, 22.0], seconds=0.5, model=rig)
    problem, base, _ = base_fit(campaign, Model.default())
    assert outlying(problem, base, campaign) == ()
    assert np.max(base.power) > 0.0


def test_noise_larger_than_stated_makes_no_spikes(touching):
    loud = simulated([9.0, 10.0, 12.0, 14.0], seconds=0.5, rate=200.0, scale=3.0)
    problem, base, _ = base_fit(loud, Model.default())
    assert outlying(problem, base, loud) == ()
