# SPDX-License-Identifier: Apache-2.0
"""A force that passes for the noise of a sensor is found beside less of that noise."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.background import quieter, timed
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.forces import promised
from inductrack_ros.diagnosis.moves import State, Task, shaken
from inductrack_ros.diagnosis.strategy import add_unknown
from inductrack_ros.estimation.processes import COLOURED, HUM, Process
from inductrack_ros.estimation.shooting import fit, linearise_all

sys.path.insert(0, str(Path(__file__).parent))
from independent.campaigns import write_campaign


def test_a_ripple_of_the_thrust_that_hum_and_colour_hide_is_found(tmp_path):
    """At nearly one speed a ripple along the track is a hum in time, and a coloured noise takes what is left."""
    truth = write_campaign(tmp_path / "rig", 1, names=[("thrust_ripple", None)], design="one_sided", faint=60, clear=90)
    campaign = load_campaign(tmp_path / "rig")
    problem, base, _ = base_fit(replace(campaign, runs=campaign.runs[:6]), Model.default())
    speed = np.mean([np.ptp(p[:, 0]) / np.ptp(d.grid) for p, d in zip(base.paths, problem.runs, strict=True)])
    period = truth["unknown"][0]["parameters"]["wavelength"] / speed
    noise = Process(HUM, "surge", 1.0, period), Process(COLOURED, "surge", 0.7, 0.0125)
    hidden = timed(problem, fit(problem, base.structure, replace(base.point, processes=(*base.processes, *noise)), 12))
    task, state = Task(problem, given=problem.channels), State(hidden)
    assert hidden.deviance < base.deviance - 20  # noise explains more than a shaken rig does
    assert not shaken(task, state)
    systems = linearise_all(problem, hidden)
    first = promised(task, state, systems, quieter(problem, hidden, task.given, systems))[0]
    assert (first.law.acts_on, first.law.variable) == ("thrust", "surge")
    assert not {HUM, COLOURED} & {p.kind for p in first.beside.fit.processes}
    found = add_unknown(task, state)
    assert found.added == ("stand_in_thrust",)
    assert not {HUM, COLOURED} & {p.kind for p in found.fit.processes}
