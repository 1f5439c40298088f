# SPDX-License-Identifier: Apache-2.0
"""Pulses against the averaged law: formulas, free runs, and where the average fails."""

import numpy as np
import pytest

from inductrack_ros.core.model import Model
from inductrack_ros.paper.drive import closed_formula, drive_test, mean_ratio, run_by_pulses, thrust_in_time


@pytest.fixture(scope="module")
def model():
    return Model.default()


@pytest.mark.parametrize("tau", [300e-6, 600e-6, 1200e-6])
@pytest.mark.parametrize("speed", [5.0, 15.5, 40.0, 80.0])
def test_mean_thrust_by_formula(model, speed, tau):
    of = model.with_changes({"pulse_length": tau})
    assert mean_ratio(of, speed) == pytest.approx(float(closed_formula(of, speed)), abs=1e-3)


@pytest.mark.parametrize("delay", [0.0, 1e-4, 6e-4])
def test_late_firing_turns_the_thrust(model, delay):
    assert mean_ratio(model, 40.0, delay) == pytest.approx(float(closed_formula(model, 40.0, delay)), abs=1e-3)
    assert mean_ratio(model, 40.0, 0.1 / 2 / 40.0) == pytest.approx(-mean_ratio(model, 40.0), rel=1e-3), (
        "half a wave late brakes"
    )


def test_formula_has_no_hole_where_the_pulse_is_half_a_wave(model):
    """ωτ = π: numerator and denominator vanish; the limit is π/4."""
    assert float(closed_formula(model, 0.05 / 600e-6)) == pytest.approx(np.pi / 4, abs=1e-6)


def test_one_pulse_every_half_wave(model):
    """Thrust in time: zero between pulses, all forward, and its mean what mean_ratio says."""
    times, thrust = thrust_in_time(model, 15.5, periods=4.0, points=8001)
    assert thrust.min() > -1e-9
    on = thrust > 1e-6 * thrust.max()
    assert on.mean() == pytest.approx(600e-6 / (0.05 / 15.5), rel=0.01)
    averaged = model.quantities(model.initial_state(surge_rate=15.5))["thrust"]
    assert np.trapezoid(thrust, times) / times[-1] / averaged == pytest.approx(mean_ratio(model, 15.5), rel=1e-3)


def test_free_runs(model):
    """Averaging alone costs under a millimetre in 1 s; leaving the pulse's length out, a quarter of a metre and
    more."""
    test = drive_test(model)
    # cos(x/2)/(1 − (x/π)²) ≈ 1 − x² (1/8 − 1/π²) with x = kvτ
    assert test.good_to == pytest.approx(np.sqrt(0.01 / (1 / 8 - 1 / np.pi**2)) / (20 * np.pi * 600e-6), rel=3e-3)
    for run in test.runs:
        assert run.by_pulses < run.averaged
        assert abs(run.by_pulses - run.corrected) < 1e-3
    at = {r.speed: r for r in test.runs}
    assert at[15.5].averaged - at[15.5].by_pulses == pytest.approx(0.25, abs=0.02)


def test_controller_fires_each_coil_once(model):
    times, states = run_by_pulses(model, 20.0, 0.5)
    assert times[-1] == pytest.approx(0.5)
    assert np.diff(states[:-1, 0]) == pytest.approx(0.05, rel=5e-3), "one row for each coil passed"
