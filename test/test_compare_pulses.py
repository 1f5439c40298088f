# SPDX-License-Identifier: Apache-2.0
"""Idea: a run driven by pulses, whose errors grow ten-thousandfold in three seconds, compared with the model that made
it."""

from pathlib import Path

import numpy as np

from inductrack_ros.compare import compare
from inductrack_ros.core.model import Model, Pulses
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.data.measurement import Run

NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}


def held_at(speed: float, seconds: float, model: Model) -> tuple[np.ndarray, np.ndarray, Pulses]:
    """Times, states and the pulses of a run that a simple speed controller drives, each pulse commanded 20 ms ahead."""
    tick, spacing = 1e-3, model.parameters["wavelength"] / 2
    x, coil, fired, rows = model.initial_state(surge_rate=speed), 1, [], []
    times = np.arange(0.0, seconds, tick)
    for t in times:
        rows.append(x[:8].copy())
        place, v = x[0], x[4]
        while coil * spacing < place + 0.02 * v:
            current = 7000 * (1 + 2.5 * (speed - v)) * (1 if coil % 2 == 0 else -1)
            fired.append((t + (coil * spacing - place) / v - 3e-4, coil, current))
            coil += 1
        burning = np.array([p for p in fired if t - 1e-3 < p[0] < t + tick]).reshape(-1, 3)
        x = model.advance(x, t, t + tick, pulses=Pulses(*burning.T))
    return times, np.array(rows), Pulses(*np.array(fired).T)


def test_a_pulsed_run_is_predicted_to_its_end():
    model = Model.create(drive="pulses")
    times, states, pulses = held_at(15.0, 3.0, model)
    rng = np.random.default_rng(0)
    measured = states[:, :4] + rng.standard_normal((len(times), 4)) * list(NOISE.values())
    run = Run("pulsed", Path("pulsed"), tuple(NOISE), times, measured, times, pulses=pulses)
    result = compare(Campaign("pulsed", Path("pulsed"), (run,), NOISE), model)
    assert result.error < 1.5
