# SPDX-License-Identifier: Apache-2.0
"""Rounded readings: the trajectory foretells the rounding as far as the noise beside it lets it."""

from dataclasses import replace

import numpy as np
import pytest
from test_diagnosis_input import CHANNELS, NOISE, simulated

from inductrack_ros.checks import admit
from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.background import dithered
from inductrack_ros.diagnosis.diagnose import base_fit, diagnose
from inductrack_ros.estimation.processes import ROUNDED


def rounded(noise, speeds=(9.0, 11.0, 13.0)):
    """Runs that come to rest on the track, read in steps beside which there is so much noise (in steps)."""
    exact = simulated(speeds, seconds=0.5, scale=1.0)
    steps = np.array([NOISE[c] for c in CHANNELS]) / noise
    runs = tuple(replace(r, values=np.round(r.values / steps) * steps) for r in exact.runs)
    return replace(exact, runs=runs)


@pytest.mark.parametrize("noise", [0.15, 0.3])
def test_the_noise_beside_the_rounding_is_found(noise):
    campaign, seen = admit(rounded(noise), Model.default())
    problem, base, _ = base_fit(campaign, Model.default(), seen)
    sizes = {p.on: p.size for p in dithered(problem, base).processes if p.kind == ROUNDED}
    assert sizes and set(sizes) <= set(CHANNELS)
    assert all(0.5 * noise <= size <= 2.0 * noise for size in sizes.values())


def test_a_cradle_at_rest_that_reads_one_value_is_no_saturated_sensor():
    """All readings of the rest have the same rounding error."""
    assert diagnose(rounded(0.15), Model.default()).verdict == "adequate"
