# SPDX-License-Identifier: Apache-2.0
"""The second simulator against trajectories neither it nor the package made, and against numbers of the paper's
model.
"""

from pathlib import Path

import numpy as np
import pytest

from independent import simulator as sim

GOLDEN = Path(__file__).parents[1] / "data" / "golden"
# file -> drive current (A), rig changes; the start is the file's first row
CASES = {
    "launch_15p5": (7000.0, {}),
    "sway_4mm": (7000.0, {}),
    "coast_30_roll": (0.0, {}),
    "coil_current_dynamics_22": (4200.0, {"coil_current_dynamics__on": 1.0}),
}
LENGTHS = ("surge", "sway", "heave", "roll")


def golden_error(name, **steps):
    """Largest difference (m, rad) over the four coordinates before and after first contact."""
    data = np.genfromtxt(GOLDEN / f"{name}.csv", delimiter=",", names=True)
    drive_current, changes = CASES[name]
    start = [data[channel][0] for channel in sim.STATE_CHANNELS]
    states, contact = sim.simulate(data["time"], start, drive_current, sim.rig(**changes), **steps)
    error = np.max([np.abs(states[:, i] - data[channel]) for i, channel in enumerate(LENGTHS)], axis=0)
    before = data["time"] < contact
    return error[before].max(), error[~before].max() if not before.all() else 0.0, contact


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("far_step", [1e-5, 1e-4])
def test_golden(name, far_step):
    before, after, _ = golden_error(name, far_step=far_step)
    assert before < 1e-6
    assert after < 1e-5


def test_published_numbers():
    """Equilibrium gaps of model.md and the touchdown at 1.19 s."""
    published = sim.rig()
    for speed, gap_mm in ((15.5, 4.36748), (20.0, 5.26583), (40.0, 6.35356)):
        assert 1e3 * (sim.equilibrium_heave(speed, published) + 0.010) == pytest.approx(gap_mm, abs=1e-5)
    assert golden_error("launch_15p5")[2] == pytest.approx(1.1897, abs=2e-4)


def test_waviness_is_a_change_of_track_height():
    """A wave far longer than the run is a raised track: the same gaps, the same motion."""
    times = np.linspace(0, 0.5, 51)
    start = np.array([0, 0.001, -0.004, 0.002, 25.0, 0, 0, 0])
    flat, _ = sim.simulate(times, start, 0.0, sim.rig())
    raised = sim.rig(
        guideway_waviness__amplitude=1e-3, guideway_waviness__wavelength=1e7, guideway_waviness__phase=np.pi / 2
    )
    start[2] += 1e-3
    high, _ = sim.simulate(times, start, 0.0, raised)
    high[:, 2] -= 1e-3
    assert np.abs(high - flat).max() < 1e-9


def test_delayed_sensor_shows_the_past():
    times = np.linspace(0, 0.5, 251)
    start = [0, 0.001, -0.004, 0.002, 25.0, 0, 0, 0]
    fault = {"effect": "sensor_delay", "channel": "surge", "delay": 0.004}
    late, _ = sim.measure(times, start, 3500.0, sim.rig(), ["surge"], [fault])
    true, _ = sim.measure(times, start, 3500.0, sim.rig(), ["surge"])
    assert np.abs(late[2:] - true[:-2]).max() < 1e-9
    assert late[0, 0] == pytest.approx(-0.1, abs=1e-3)


@pytest.mark.parametrize("field", [name for name in sim.FIELDS if "__" in name])
def test_every_effect_moves_the_cradle(field):
    """No field is a dead letter: switching it on changes the motion."""
    # what a field needs beside itself to show
    company = {
        "guideway_waviness__wavelength": {"guideway_waviness__amplitude": 1e-4},
        "guideway_waviness__phase": {"guideway_waviness__amplitude": 1e-4},
        "heave_shake__frequency": {"heave_shake__force": 1.0},
        "thrust_ripple__wavelength": {"thrust_ripple__relative_amplitude": 0.1},
        "lift_above_speed__threshold": {"lift_above_speed__slope": 1.0},
        "drag_from_time__start": {"drag_from_time__force": 5.0},
        "heave_cubic_spring__centre": {"heave_cubic_spring__stiffness": 1e7},
        "flexible_mode__damping_ratio": {"flexible_mode__frequency": 20.0},
        "flexible_mode__mass_ratio": {"flexible_mode__frequency": 20.0},
        "dead_coils__fraction": {"dead_coils__place": 3.0},
        "dead_coils__place": {"dead_coils__fraction": 0.3},
        "joint_step__height": {"joint_step__place": 3.0},
        "joint_step__place": {"joint_step__height": 1e-4},
        "auxiliary_wheels__stiffness": {"auxiliary_wheels__height": 6e-3},
        "auxiliary_wheels__damping": {"auxiliary_wheels__height": 6e-3, "auxiliary_wheels__stiffness": 1e3},
        "auxiliary_wheels__height": {"auxiliary_wheels__stiffness": 1e3},
        "auxiliary_wheels__rolling_resistance": {"auxiliary_wheels__height": 6e-3, "auxiliary_wheels__stiffness": 1e3},
        "bungee_launcher__stroke": {"bungee_launcher__stiffness": 1.0},
        "track_temperature__coefficient": {"track_celsius": 40.0},
        "magnet_temperature__coefficient": {"magnet_celsius": 40.0},
    }
    for kind in ("heave", "sway", "surge", "roll"):
        strength = f"{kind}_patch__{'moment' if kind == 'roll' else 'force'}"
        for shape in ("place", "width"):
            company[f"{kind}_patch__{shape}"] = {strength: 1.0}
    amounts = {
        "skin_effect__corner_frequency": 2000.0,
        "drive_back_emf__cutoff_speed": 200.0,
        "firing_delay__delay": 1e-4,
        "heave_cubic_spring__stiffness": 1e7,
        "sway_cubic_spring__stiffness": 1e7,
        "roll_from_sway_cubed__coefficient": 1e6,
        "heave_from_sway_squared__coefficient": 1e5,
        "guideway_waviness__wavelength": 2.0,
        "drag_from_time__start": 0.2,
        "flexible_mode__frequency": 30.0,
        "dead_coils__place": 3.0,
        "joint_step__place": 3.0,
        "auxiliary_wheels__stiffness": 1e3,
        "auxiliary_wheels__height": 6e-3,
        "auxiliary_wheels__damping": 100.0,
    }
    law = {"size": 1.0, "coordinate": 2, "form": 5, "variable": 4, "a": 17.0, "b": 2.0, "second": 4, "scale": 20.0}
    law = {f"law__{name}": value for name, value in {**law, "power": 1}.items()}  # a step at 17 m/s, times the speed
    company |= {name: {n: v for n, v in law.items() if n != name} for name in law}
    amounts |= law
    times = np.linspace(0, 0.6, 61)
    start = [0, 0.002, -0.0045, 0.002, 18.0, 0, 0, 0]
    drive_current = 0.0 if field.startswith("sliding") else 5000.0  # coasting touches down within the run
    others = company.get(field, {})
    amount = amounts.get(field, sim.FIELDS[field] + 0.01)
    without, _ = sim.simulate(times, start, drive_current, sim.rig(**others))
    with_it, _ = sim.simulate(times, start, drive_current, sim.rig(**{**others, field: amount}))
    assert np.abs(with_it - without)[:, :4].max() > 1e-8
