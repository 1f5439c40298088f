# SPDX-License-Identifier: Apache-2.0
"""Published numbers: every row of the table the model must reach, and the paper's contradictions where they can be
computed.

Idea: a wrong sign, factor or unit anywhere in the equations moves at least one of these. The expected values come
from the paper or from a simulator that shares no code with this one, never from this package.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from inductrack_ros.core.model import Model, Pulses

HALF_WAVE = 0.05  # m, λ/2: one pulse per half wavelength
TAU = 600e-6


@pytest.fixture(scope="module")
def model():
    return Model.default()


@pytest.fixture(scope="module")
def landing():
    """The 2-DOF landing of Figure 7: 15.5 m/s, averaged thrust at 7000 A, 3 s."""
    model = Model.create(dof=2)
    return model.simulate(np.arange(30001) * 1e-4, model.initial_state(surge_rate=15.5))


def balance(model, speed):
    """Quantities on the equilibrium heave at ``speed``."""
    return model.quantities(model.initial_state(surge_rate=speed))


# -- on the equilibrium heave ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("speed", "gap_mm"), [(15.5, 4.36748), (20.0, 5.26583), (40.0, 6.35356)])
def test_equilibrium_gap(model, speed, gap_mm):
    q = balance(model, speed)
    assert q["gap_top"] * 1e3 == pytest.approx(gap_mm, abs=1e-5)
    assert abs(q["force_heave"]) < 1e-9


def test_drag_and_thrust(model):
    q = balance(model, 15.5)
    assert q["magnetic_drag"] == pytest.approx(278.416, abs=1e-3)
    assert q["thrust"] == pytest.approx(267.050, abs=1e-3)
    lift = 9.3 * 9.81
    assert q["magnetic_drag"] / lift == pytest.approx(3.05, abs=0.01)  # Figure 7c: drag about 3 × lift


def test_critical_speed(model):
    def excess(speed):
        q = balance(model, speed)
        return q["thrust"] - q["magnetic_drag"]

    assert excess(15.5) < 0 < excess(17.0)  # an unstable balance: too slow gets slower
    assert brentq(excess, 15.5, 17.0) == pytest.approx(16.0279, abs=1e-4)


def test_lowest_carrying_speed(model):
    """At zero gap on top, heave −10 mm."""

    def lift(speed):
        return model.quantities([0, 0, -0.01, 0, speed, 0, 0, 0])["force_heave"]

    assert brentq(lift, 5.0, 12.0) == pytest.approx(8.338, abs=1e-3)


def test_drag_peaks_at_half_the_greatest_lift(model):
    """Figure 2: at fixed gap drag is greatest where ωL = R, and is then half the lift of infinite speed."""
    speeds = np.linspace(5.0, 30.0, 2501)
    drag = [model.quantities([0, 0, 0, 0, v, 0, 0, 0])["magnetic_drag"] for v in speeds]
    corner = 1.5e-3 / 1.8e-6 / (2 * np.pi / 0.1)
    assert speeds[np.argmax(drag)] == pytest.approx(corner, abs=0.01)
    greatest = model.quantities([0, 0, 0, 0, 1e9, 0, 0, 0])
    lift = sum(greatest[f"repulsion_{a}"] for a in ("top", "right", "left"))  # drag sums over all three arrays as well
    assert max(drag) / lift == pytest.approx(0.5, abs=1e-6)


# -- in motion ------------------------------------------------------------------------------------------------------


def test_touchdown(landing):
    first = np.argmax(landing["gap_top"] < 0)
    assert landing.times[first] == pytest.approx(1.1897, abs=1e-4)
    assert landing.times[first] == pytest.approx(1.19, abs=0.01)  # the paper's


def test_sink_at_rest(landing):
    assert landing["gap_top"][-1] * 1e3 == pytest.approx(-0.0100, abs=5e-5)


def test_stops_at_three_seconds(landing):
    assert landing["surge_rate"][-1] == pytest.approx(0.0186, abs=1e-4)
    assert landing["surge"][-1] == pytest.approx(18.682, abs=1e-3)


def test_four_degrees_of_freedom_reduce_to_two(landing):
    model = Model.create(dof=4)
    full = model.simulate(landing.times, model.initial_state(surge_rate=15.5))
    assert np.abs(full.states - landing.states).max() < 1e-12
    assert np.abs(full.states[:, [1, 3, 5, 7]]).max() == 0.0


def test_second_array_touches(model):
    times = np.arange(30001) * 1e-4
    run = model.simulate(times, model.initial_state(surge_rate=15.5, sway=0.004, sway_rate=-0.1))
    touched = {a: times[np.argmax(run[a] < 0)] for a in ("gap_top", "gap_right", "gap_left") if (run[a] < 0).any()}
    assert set(touched) == {"gap_top", "gap_right"}
    assert touched["gap_right"] == pytest.approx(2.81, abs=5e-3)
    assert touched["gap_top"] < touched["gap_right"]


def test_one_degree_of_freedom_orbits_for_ever():
    """Figure 4: held at 20 m/s with η = 1, heave from a 10 mm gap is neutral: the orbit closes and does not decay."""
    model = Model.create({"eta": 1.0}, dof=1)
    run = model.simulate(np.arange(40001) * 5e-4, np.array([0, 0, 0, 0, 20.0, 0, 0, 0]))
    gap = run["gap_top"] * 1e3
    assert gap.min() == pytest.approx(3.339, abs=1e-3)
    assert gap.max() == pytest.approx(10.000, abs=1e-3)
    assert run["heave_rate"].max() == pytest.approx(0.1736, abs=1e-4)
    assert run["heave_rate"].min() == pytest.approx(-0.1736, abs=1e-4)
    assert gap[-4000:].max() == pytest.approx(10.0, abs=1e-5)  # after 20 s as in the first second: closed
    assert run["surge_rate"].min() == run["surge_rate"].max() == 20.0


def test_energy_is_conserved_in_the_one_degree_orbit():
    """At held speed lift is a force of position alone: ½mẏ² − ∫F dy stays. The potential is summed here, from (36)."""
    model = Model.create({"eta": 1.0}, dof=1)
    run = model.simulate(np.arange(2001) * 5e-4, np.array([0, 0, 0, 0, 20.0, 0, 0, 0]))
    k, c = 2 * np.pi / 0.1, np.sqrt(0.5)
    heights = np.linspace(-0.0067, 0.0, 4001)
    e1, e2 = 0.12 * np.exp(-k * (0.01 + heights)), 0.08 * np.exp(-k * (0.01 - c * heights))
    rho = 1.5e-3 / (k * 20.0 * 1.8e-6)
    force = (e1 - 2 * c * e2) * (e1 + 2 * e2) * 13 * 0.52 * 0.52 / k / 1.8e-6 / (1 + rho**2) - 9.3 * 9.81
    work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(heights))])
    energy = 0.5 * 9.3 * run["heave_rate"] ** 2 - np.interp(run["heave"], heights, work)
    assert np.ptp(energy) < 1e-5 * (0.5 * 9.3 * run["heave_rate"] ** 2).max()


# -- where the paper contradicts itself -----------------------------------------------------------------------------


def test_side_contact_pushes_down(model):
    """(24) and (27) would let a side contact lift the cradle; (36)–(37) push it down, and towards the other side."""
    state = np.array([0.0, 0.002, 0.0132, 0.0, 10.0, 0, 0, 0])  # to the left and up: the right array closes its gap
    q = model.quantities(state)
    assert q["gap_right"] < 0 < q["gap_left"]
    sway, heave = model.wrenches(state)["contact"][1:3]
    assert heave < 0
    assert sway == pytest.approx(heave)  # along n_2 = (−c, −c)


def test_lift_over_drag_at_forty(model):
    """Not "up to 200 : 1": (8) gives ωL/R = 3.02."""
    q = balance(model, 40.0)
    assert q["current_lift"] / q["current_drag"] == pytest.approx(3.02, abs=5e-3)


def test_heave_is_damped_once_the_speed_is_free(model):
    """Neutral only while the speed is held: linearised at the speed where thrust equals drag, the bounce decays."""
    centre = model.initial_state(surge_rate=16.0279)
    names = ["surge_rate", "heave", "heave_rate"]
    places, sizes = [4, 2, 6], [1e-4, 1e-7, 1e-5]
    matrix = np.zeros((3, 3))
    matrix[1, 2] = 1.0
    for column, (place, size) in enumerate(zip(places, sizes, strict=True)):
        step = np.zeros(len(centre))
        step[place] = size
        ahead, behind = model.quantities(centre + step), model.quantities(centre - step)
        for row in (0, 2):
            key = names[row].replace("rate", "acceleration")
            matrix[row, column] = (ahead[key] - behind[key]) / (2 * size)
    held = np.linalg.eigvals(matrix[1:, 1:])
    free = np.linalg.eigvals(matrix)
    bounce = free[np.argmax(free.imag)]
    assert np.abs(held.real).max() < 1e-6 * np.abs(held.imag).max()
    assert bounce.imag == pytest.approx(np.abs(held.imag).max(), rel=0.05)
    assert bounce.real < -0.05


# -- drive by pulses ------------------------------------------------------------------------------------------------


def fired_at_peaks(speed, seconds, late=0.0):
    """One pulse per half wavelength, its middle ``late`` s behind the field's peak at constant ``speed``; 7000 A,
    alternating."""
    coils = np.arange(-2, int(seconds * speed / HALF_WAVE) + 2)
    return Pulses(coils * HALF_WAVE / speed - TAU / 2 + late, coils, 7000.0 * (-1.0) ** coils)


@pytest.mark.parametrize("late", [0.0, 3e-4])
@pytest.mark.parametrize("speed", [2.0, 15.5, 30.0, 60.0])
def test_mean_of_pulses_is_the_averaged_law(speed, late):
    """Mean thrust over one half wavelength = (39) · cos(ωτ/2)/(1 − (ωτ/π)²) · cos(ωδ), to 1e-8 of it."""
    pulsed = Model.create(drive="pulses")
    pulses = fired_at_peaks(speed, 1.0, late)
    state = pulsed.initial_state(surge_rate=speed)
    begin, end = pulses.times[4], pulses.times[5]
    nodes, weights = np.polynomial.legendre.leggauss(40)
    mean = 0.0
    for a, b in [(begin, min(begin + TAU, end)), (min(begin + TAU, end), end)]:
        for node, weight in zip(nodes, weights, strict=True):
            t = 0.5 * (a + b) + 0.5 * (b - a) * node
            state[0] = speed * t
            mean += 0.5 * (b - a) * weight * pulsed.quantities(state, t, pulses=pulses)["thrust"] / (end - begin)
    averaged = balance(Model.default(), speed)["thrust"]
    omega = 2 * np.pi / 0.1 * speed
    width = np.cos(omega * TAU / 2) / (1 - (omega * TAU / np.pi) ** 2)
    assert mean == pytest.approx(averaged * width * np.cos(omega * late), rel=1e-8, abs=1e-8 * averaged)


def test_pulses_carry_the_cradle_as_the_averaged_law_does():
    """A second at 16 m/s, fired where the averaged model will be: 0.1 mm of 16 m apart, heave within 1 µm."""
    times = np.arange(501) * 2e-3
    smooth = Model.create(effects=["finite_pulse_width"])
    start = smooth.initial_state(surge_rate=16.0)
    expected = smooth.simulate(times, start)
    coils = np.arange(int(expected["surge"][-1] / HALF_WAVE) + 2)
    at_peak = np.interp(coils * HALF_WAVE, expected["surge"], times)
    pulses = Pulses(at_peak - TAU / 2, coils, 7000.0 * (-1.0) ** coils)
    run = Model.create(drive="pulses").simulate(times, start, pulses=pulses)
    assert np.abs(run["surge"] - expected["surge"]).max() < 2e-4
    assert np.abs(run["heave"] - expected["heave"]).max() < 1e-6
    idle = Model.create(drive="pulses").simulate(times, start)
    assert expected["surge"][-1] - idle["surge"][-1] > 1.0  # without pulses there is no thrust


def test_a_pulse_in_the_wrong_direction_brakes():
    pulsed = Model.create(drive="pulses")
    state = pulsed.initial_state(surge_rate=15.0)
    for coil in (0, 1):
        state[0] = coil * HALF_WAVE
        push = {
            i: pulsed.quantities(state, TAU / 2, pulses=Pulses(np.zeros(1), [coil], [i]))["thrust"] for i in (7e3, -7e3)
        }
        assert push[7e3] == -push[-7e3]
        assert push[7e3] * (1 - 2 * coil) > 0  # the current alternates from coil to coil


@pytest.mark.parametrize("step", [1.0, 5e-6])
def test_a_pulse_gives_its_whole_impulse_whatever_the_rows(step):
    """Steps end at a pulse's edges: rows far apart lose nothing of it, against an integral taken here."""
    model = Model.create({"contact_damping": 0.0}, drive="pulses", dof=2)
    start = model.initial_state(surge_rate=1e-3, heave=0.0)
    pulse = Pulses(np.array([0.01234567]), np.array([0]), np.array([7000.0]))
    rows = [0.0, 0.01234567 + TAU + 1e-5]
    with_it = model.simulate(rows, start, pulses=pulse, longest_step=step)
    without = model.simulate(rows, start, longest_step=step)
    k = 2 * np.pi / 0.1
    fall = 0.5 * 9.81 * (0.01234567 + TAU / 2) ** 2  # the magnets hardly carry at 1 mm/s
    overlap = 0.12 * np.exp(-k * (0.01 - fall)) + 0.16 * np.exp(-k * (0.01 + np.sqrt(0.5) * fall))
    impulse = 3.9298 * overlap * 0.52 * 7000.0 * 2 * TAU / np.pi
    gained = with_it["surge_rate"][-1] - without["surge_rate"][-1]
    assert gained * 9.3 == pytest.approx(impulse, rel=5e-3)
