# SPDX-License-Identifier: Apache-2.0
"""Claims as numbers: eigenvalues, stiffness and damping against long simulations and against formulas from the
equations.

Idea: a linearisation is right when the non-linear model, nudged, does what it says; and it is ours when another
    simulator agrees."""

import numpy as np
import pytest
from independent import simulator as other

from inductrack_ros.core.model import Model
from inductrack_ros.paper.stability import corner_speed, modes, sign_change, trim_current

MASS, INERTIA, K = 9.3, 0.091, 20 * np.pi


@pytest.fixture(scope="module")
def model():
    return Model.default()


@pytest.mark.parametrize(("speed", "damping"), [(10.0, 1.33), (20.0, -0.28), (40.0, -0.12)])
def test_unsteady_current_damps_below_the_corner_and_not_above(model, speed, damping):
    assert modes(model, speed).current_damping == pytest.approx(damping, abs=5e-3)


def test_it_changes_sign_at_the_corner_speed(model):
    corner = corner_speed(model)
    assert corner == pytest.approx(1.5e-3 / (K * 1.8e-6), rel=1e-12)
    # exactly R/kL for an infinitely slow swing; a swing of 7 Hz is slow against R/L but not infinitely
    assert sign_change(model, "current_damping", 8.0, 25.0) == pytest.approx(corner, rel=2e-3)


@pytest.mark.parametrize("speed", [10.0, 16.0, 30.0])
def test_heave_stiffness_by_the_other_simulator(model, speed):
    """k = −dF/dy by the other simulator's force."""
    rig = other.rig()
    heave = other.equilibrium_heave(speed, rig)
    h = 1e-6
    slope = -(other.heave_force(heave + h, speed, rig[0]) - other.heave_force(heave - h, speed, rig[0])) / (2 * h)
    found = modes(model, speed)
    assert found.heave_stiffness == pytest.approx(slope, rel=1e-6)
    assert found.heave_frequency == pytest.approx(np.sqrt(slope / MASS) / (2 * np.pi), rel=1e-6)


def test_sway_stiffness_by_formula(model):
    """F_slip = (F_3 − F_2) c with F_i ∝ e_i S: at the centre S does not change, so k = 2 c² k F_side = k F_side."""
    found = modes(model, 20.0)
    side = model.quantities(model.initial_state(surge_rate=20.0))["repulsion_left"]
    assert found.sway_stiffness == pytest.approx(K * side, rel=1e-6)


@pytest.mark.parametrize("speed", [12.0, 16.0, 20.0])
def test_coupling_damping_is_what_a_nudged_cradle_shows(model, speed):
    """Decay of heave over 12 swings with the speed free, by the non-linear model at the trimmed current.

    The balance speed is unstable, so the nudge is along the heave mode: its eigenvector, which leaves the speed's mode
    at rest."""
    found, m = modes(model, speed), model.with_changes(dof=2)
    x = m.initial_state(surge_rate=speed)
    A = _jacobian(m, x, found.drive_current)
    values, vectors = np.linalg.eig(A)
    i = np.argmax(values.imag)
    start, nudge = x.copy(), 1e-6 * (vectors[:, i] / vectors[1, i]).real
    start[[4, 2, 6]] += nudge
    period = 2 * np.pi / values[i].imag
    run = m.simulate(np.array([0.0, 6 * period, 12 * period]), start, found.drive_current)
    heave = run["heave"] - x[2]
    assert heave[0] == pytest.approx(1e-6)
    decay = np.log(heave[0] / heave[1]) / (6 * period)
    assert 2 * MASS * decay == pytest.approx(found.coupling_damping, rel=0.03)


def _jacobian(m, x, current):
    """d(v, y, ẏ)/dt by (v, y, ẏ) from accelerations alone."""
    states, steps = [4, 2, 6], [1e-4, 1e-7, 1e-6]

    def rates(z):
        q = m.quantities(z, drive_current=current)
        return np.array([q["surge_acceleration"], z[6], q["heave_acceleration"]])

    columns = []
    for s, h in zip(states, steps, strict=True):
        up, down = x.copy(), x.copy()
        up[s] += h
        down[s] -= h
        columns.append((rates(up) - rates(down)) / (2 * h))
    return np.column_stack(columns)


def test_speed_error_grows_as_said(model):
    """From 1 mm/s above the balance, the non-linear model's error after 0.5 s."""
    speed = 16.0279
    found = modes(model, speed)
    x = model.initial_state(surge_rate=speed)
    runs = [
        model.simulate(np.array([0.0, 0.6, 1.1]), x + d * np.eye(8, len(x))[4], found.drive_current)
        for d in (1e-4, -1e-4)
    ]
    apart = runs[0]["surge_rate"] - runs[1]["surge_rate"]
    assert np.log(apart[2] / apart[1]) / 0.5 == pytest.approx(found.growth, rel=0.05)


@pytest.mark.parametrize("speed", [9.0, 13.0, 20.0, 40.0])
def test_trimmed_flight_is_steady(model, speed):
    current = trim_current(model, speed)
    q = model.quantities(model.initial_state(surge_rate=speed), drive_current=current)
    assert abs(q["surge_acceleration"]) < 1e-9 and abs(q["heave_acceleration"]) < 1e-9


def test_held_speed_has_no_damping_and_sides_neither_grow_nor_decay(model):
    for speed in (10.0, 20.0, 40.0):
        found = modes(model, speed)
        assert abs(found.held_damping) < 1e-5
        assert abs(found.lateral_growth) < 1e-6
        assert found.growth > 0 and found.coupling_damping > 0


def test_both_together_turn_unstable(model):
    """Just below the speed where both dampings cancel, a swing with lagging current and free speed decays; just above
    it grows."""
    speed = sign_change(model, "both_damping", 14.0, 40.0)
    assert speed == pytest.approx(24.60, abs=0.02)
    assert modes(model, speed - 1).both_damping > 0 > modes(model, speed + 1).both_damping
    assert modes(model, speed).coupling_damping == pytest.approx(-modes(model, speed).current_damping, rel=0.05)


def test_lateral_frequencies_by_simulation(model):
    """A cradle let go 0.1 mm off the centre swings at the two lateral frequencies and no other."""
    found = modes(model, 20.0)
    x = model.initial_state(surge_rate=20.0, sway=1e-4)
    times = np.arange(4000) * 1e-3
    sway = model.with_changes(dof=4).simulate(times[:1000], x, found.drive_current)["sway"]
    w = 2 * np.pi * np.array(found.lateral_frequencies)
    basis = np.column_stack([np.cos(np.outer(times[:1000], w)), np.sin(np.outer(times[:1000], w))])
    left = sway - basis @ np.linalg.lstsq(basis, sway, rcond=None)[0]
    assert np.abs(left).max() < 2e-3 * np.abs(sway).max()
