# SPDX-License-Identifier: Apache-2.0
"""A hum in what a fit leaves: found where it is, by all channels together, and not where there is none."""

from types import SimpleNamespace

import numpy as np
import pytest

from inductrack_ros.diagnosis.humming import humming

CHANNELS, STEP, COUNT, RUNS = ("surge", "heave", "roll"), 5e-3, 240, 4


def left(seed, amplitudes, frequency=16.7, lost=0.0, uneven=0.0):
    """A problem of four runs, and white innovations with a hum of these amplitudes (over the noise) beside them."""
    rng = np.random.default_rng(seed)
    runs, whitened = [], []
    for _ in range(RUNS):
        times = STEP * (np.arange(COUNT) + uneven * rng.uniform(-0.5, 0.5, COUNT))
        times = times[rng.random(COUNT) >= lost]
        channel = np.tile(np.arange(len(CHANNELS)), len(times))
        time = np.repeat(times, len(CHANNELS))
        turn = 2 * np.pi * frequency * time + rng.uniform(0, 2 * np.pi, len(CHANNELS))[channel]
        whitened.append(rng.standard_normal(len(time)) + np.array(amplitudes)[channel] * np.sin(turn))
        runs.append(SimpleNamespace(time=time, channel=channel))
    return SimpleNamespace(runs=runs, channels=CHANNELS), whitened


@pytest.mark.parametrize("of", [{}, {"lost": 0.15}, {"uneven": 0.3}], ids=["even", "lossy", "uneven"])
def test_a_hum_is_found_in_the_channels_that_have_it(of):
    for seed in range(10):
        found = humming(*left(seed, [0.7, 0.0, 0.6], **of))
        assert set(found) == {"surge", "roll"}
        assert 1.0 / found["surge"] == pytest.approx(16.7, abs=0.5 / (COUNT * STEP))


def test_what_is_too_faint_in_one_channel_shows_in_all_together():
    alone = [len(humming(*left(seed, [0.4, 0.0, 0.0]))) for seed in range(40)]
    together = [len(humming(*left(seed, [0.4, 0.4, 0.4]))) > 0 for seed in range(40)]
    assert sum(n > 0 for n in alone) < sum(together)


def test_noise_alone_hardly_ever_hums():
    assert sum(bool(humming(*left(seed, [0.0, 0.0, 0.0]))) for seed in range(400)) < 12


def test_readings_that_do_not_count_say_nothing():
    problem, whitened = left(1, [0.0, 0.0, 0.0])
    spoiled = [np.where(d.time > 0.6, np.nan, w) for d, w in zip(problem.runs, whitened, strict=True)]
    assert humming(problem, spoiled) == {}
    assert humming(problem, [np.full(len(w), np.nan) for w in whitened]) == {}
