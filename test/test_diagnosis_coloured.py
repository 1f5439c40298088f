# SPDX-License-Identifier: Apache-2.0
"""Noise that remembers: its size and time are found where they lie in a narrow valley, and nothing shakes."""

from dataclasses import replace

import numpy as np
from test_diagnosis_input import CHANNELS, NOISE, simulated

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis import background
from inductrack_ros.diagnosis.diagnose import base_fit

TIME = 0.03


def remembering(rng, times, size):
    """Samples (n,) of an Ornstein-Uhlenbeck process."""
    kept = np.exp(-np.diff(times) / TIME)
    noise = [size * rng.standard_normal()]
    for part in kept:
        noise.append(part * noise[-1] + size * np.sqrt(1 - part**2) * rng.standard_normal())
    return np.array(noise)


def test_size_and_time_of_coloured_noise():
    rng, runs = np.random.default_rng(4), []
    campaign = simulated([18.0, 22.0, 26.0, 30.0], seconds=0.8, scale=1e-3)
    for run in campaign.runs:
        noise = np.column_stack([remembering(rng, run.times, NOISE[c]) for c in CHANNELS])
        runs.append(replace(run, values=run.values + noise))
    problem, base, _ = base_fit(replace(campaign, runs=tuple(runs)), Model.default())
    found = background.improved(problem, base, tuple(NOISE), (), lambda _: None)
    colours = {p.on: p for p in found.processes if p.kind == "coloured_noise"}
    assert set(colours) == set(CHANNELS)
    # Nothing is gained any more, and each is what it was made with: a time is known to a seventh of itself here.
    assert background.timed(problem, found).deviance > found.deviance - 1.0
    assert all(abs(np.log(p.time / TIME)) < 3 / 7 and abs(np.log(p.size)) < 0.3 for p in colours.values())
    assert not found.power.any() or found.power.max() < 1e-4
