# SPDX-License-Identifier: Apache-2.0
"""The elastic frame: two masses and a spring, written once more with positions of their own.

`flexible_mode` carries how much higher the magnets stand over the body than at rest. Here frame and body are two
bodies: the frame of mass μm feels all forces of the track and its weight, the body of mass (1 − μ)m the spring. Both
must move alike."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from inductrack_ros.core.model import Model, Pulses

M, MU, ZETA, F = 9.3, 0.35, 0.05, 12.0
EFFECT = {"flexible_mode": {"frequency": F, "damping_ratio": ZETA, "mass_ratio": MU}}
TIMES = np.linspace(0.0, 0.6, 121)


def two_bodies(model, start, times, current):
    """Heights of body and frame (n, 2), from the plain model's forces with the frame where the gaps are."""
    omega = 2 * math.pi * F
    reduced = (
        MU * (1 - MU) * M
        # a frame on a body that moves: f is the frequency of μm on a held body, times 1 − μ the spring's force on the
        # body.
    )

    def force(body, frame, body_rate, frame_rate, speed, travel):
        x = [travel, 0, frame, 0, speed, 0, frame_rate, 0]
        return model.wrenches(x, drive_current=current)["total"]

    def slope(t, s):
        travel, speed, body, body_rate, frame, frame_rate = s
        total = force(body, frame, body_rate, frame_rate, speed, travel)
        spring = reduced * (omega**2 * (frame - body) + 2 * ZETA * omega * (frame_rate - body_rate))
        # `total` holds the whole weight; at rest the spring carries the body's, so what is left of it acts on the frame
        return [speed, total[0] / M, body_rate, spring / ((1 - MU) * M), frame_rate, (total[2] - spring) / (MU * M)]

    first = [start[0], start[4], start[2], start[6], start[2], start[6]]
    found = solve_ivp(slope, (times[0], times[-1]), first, t_eval=times, rtol=1e-9, atol=1e-12, max_step=1e-3)
    return found.y


def test_it_is_two_bodies_and_a_spring():
    plain, model = Model.create(dof=2), Model.create(effects=EFFECT, dof=2)
    start = plain.initial_state(surge_rate=20.0, heave=-0.0035)
    run = model.simulate(TIMES, start, 3000.0)
    travel, speed, body, body_rate, frame, _ = two_bodies(plain, start, TIMES, 3000.0)
    assert np.abs(run["heave"] - body).max() < 5e-8
    assert np.abs(run["heave_rate"] - body_rate).max() < 2e-6
    assert np.abs(run["surge"] - travel).max() < 2e-7 and np.abs(run["surge_rate"] - speed).max() < 2e-6
    assert np.abs(run["gap_top"] - 0.01 - frame).max() < 5e-8  # gaps are where the magnets are
    assert np.ptp(run["gap_top"] - run["heave"]) > 1e-4  # and that is not where the body is


def test_formula():
    """ÿ = μ s and p̈ = F/(μm) − s at a state with any p and ṗ."""
    model, plain = Model.create(effects=EFFECT), Model.default()
    x = [1.0, 1e-3, -0.004, 2e-3, 22.0, 0.02, -0.03, 0.1]
    p, rate = 3e-4, -0.02
    omega = 2 * math.pi * F
    s = omega**2 * p + 2 * ZETA * omega * rate
    i, j = (model.kernel.states.index(f"flexible_mode.{n}") for n in ("offset", "offset_rate"))
    full = model.with_effect_states(x)
    full[[i, j]] = p, rate
    total = plain.wrenches([*x[:2], x[2] + p, *x[3:6], x[6] + rate, x[7]])["total"]
    dx = model._evaluate(0.0, full, model.vector, model.switches)[0]
    assert dx[6] == pytest.approx(MU * s, rel=1e-12)
    assert dx[i] == rate
    assert dx[j] == pytest.approx(total[2] / (MU * M) - s, rel=1e-12)
    # The other coordinates as without it.
    assert dx[[4, 5, 7]] * [M, M, 0.091] == pytest.approx(total[[0, 1, 3]], rel=1e-12)


def test_starts_at_rest_and_balance_is_where_it_was():
    model, plain = Model.create(effects=EFFECT), Model.default()
    x = model.initial_state(surge_rate=18.0)
    assert x == pytest.approx(plain.initial_state(surge_rate=18.0), abs=1e-12)
    own = [i for i, name in enumerate(model.kernel.states) if name.startswith("flexible_mode.")]
    assert model.with_effect_states(x)[own].tolist() == [0.0, 0.0]


def test_every_other_force_acts_on_the_frame():
    """Also one that another effect adds: only through the spring does it reach the body."""
    model = Model.create(effects={**EFFECT, "aerodynamic_lift": {"lift_area": 0.1}})
    x = model.with_effect_states([0, 0, -0.004, 0, 20.0, 0, 0, 0])
    dx = model._evaluate(0.0, x, model.vector, model.switches)[0]
    lifted = Model.create(effects={"aerodynamic_lift": {"lift_area": 0.1}}).wrenches(x[:8])["total"][2]
    assert dx[6] == 0.0
    assert dx[model.kernel.states.index("flexible_mode.offset_rate")] == pytest.approx(lifted / (MU * M), rel=1e-12)


def test_energy_is_kept_without_damping_and_lost_with_it():
    """In a spring's field (a weak track far below, no travel) body, frame and spring exchange what there is."""

    def energies(ratio):
        effects = {
            "flexible_mode": {"frequency": F, "damping_ratio": ratio, "mass_ratio": MU},
            "auxiliary_wheels": {"height": 0.05, "stiffness": 3e4},
        }
        model = Model.create({"peak_field": 0.0, "contact_stiffness": 0.0}, effects, dof=["heave"])
        i, j = (model.kernel.states.index(f"flexible_mode.{n}") for n in ("offset", "offset_rate"))
        x, found = model.with_effect_states([0, 0, 0.035, 0, 0, 0, 0, 0]), []
        for k in range(400):
            x = model.advance(x, k * 2e-3, (k + 1) * 2e-3)
            body_rate, frame, frame_rate = x[6], x[2] + x[i], x[6] + x[j]
            kinetic = 0.5 * M * ((1 - MU) * body_rate**2 + MU * frame_rate**2)
            held = 0.5 * MU * (1 - MU) * M * (2 * math.pi * F * x[i]) ** 2
            found.append(kinetic + held + M * 9.81 * frame + 0.5 * 3e4 * max(0.04 - frame, 0.0) ** 2)
        return np.array(found)

    kept, lost = energies(0.0), energies(0.05)
    assert np.ptp(kept) < 2e-6 * np.abs(kept).max()
    assert (np.diff(lost) < 1e-7).all() and lost[-1] < lost[0] - 0.01


@pytest.mark.parametrize(
    ("frequency", "closest", "farthest"),
    [(50.0, 1e-6, 1e-3), (500.0, 1e-8, 2e-5), (5000.0, 0.0, 2e-7), (math.inf, 0.0, 0.0)],
)
def test_a_stiff_frame_is_none(frequency, closest, farthest):
    """What it does falls as 1/f², to nothing at an infinite frequency."""
    start = Model.default().initial_state(surge_rate=20.0, sway=1e-3, heave=-0.004)
    model = Model.create(effects={"flexible_mode": {"frequency": frequency, "damping_ratio": 0.1}})
    off = np.abs(model.simulate(TIMES, start)["heave"] - Model.default().simulate(TIMES, start)["heave"]).max()
    assert closest <= off <= farthest


def test_steps_follow_a_fast_frame():
    """200 Hz, hardly damped, through a touch of the track: normal steps of 2 ms would not see it."""
    model = Model.create(effects={"flexible_mode": {"frequency": 200.0, "damping_ratio": 0.005, "mass_ratio": 0.2}})
    start = Model.default().initial_state(surge_rate=9.0, heave_rate=-0.1)
    normal, fine = model.simulate(TIMES, start), model.simulate(TIMES, start, longest_step=2e-6)
    assert normal["gap_top"].min() < 0
    assert np.abs(normal.states[:, :4] - fine.states[:, :4]).max() < 2e-7


def test_it_is_driven_by_pulses_too():
    """A frame shaken by the thrust's own rhythm: normal steps and tiny ones agree, and it moves as by the averaged
    law."""
    pulsed = Model.create(effects=EFFECT, drive="pulses")
    averaged = Model.create(effects={**EFFECT, "finite_pulse_width": {}})
    start = Model.default().initial_state(surge_rate=16.0, heave=-0.004)
    coils = np.arange(1, 40)
    pulses = Pulses(coils * 0.05 / 16.0 - 3e-4, coils, 7000.0 * (1 - 2 * (coils % 2)))
    times = np.linspace(0.0, 0.1, 51)
    normal, fine = (pulsed.simulate(times, start, pulses=pulses, longest_step=h) for h in (1.0, 5e-6))
    assert (
        np.abs(normal.states[:, 1:4] - fine.states[:, 1:4]).max() < 1e-8
        and np.abs(normal["surge"] - fine["surge"]).max() < 1e-6
    )
    # Fired for a speed that is held.
    assert np.abs(normal["gap_top"] - averaged.simulate(times, start, 7000.0)["gap_top"]).max() < 5e-5
