# SPDX-License-Identifier: Apache-2.0
"""The effects of November against a second simulator that shares no line with the package: whole runs, and what sensors
read of them."""

import numpy as np
import pytest
from independent import simulator as sim

from inductrack_ros.core.model import Model
from inductrack_ros.core.sensors import Sensors

TIMES = np.arange(301) / 500
START = [0.0, 1e-3, -0.0045, 2e-3, 22.0, 0.0, 0.0, 0.0]
LOW = [0.0, 1e-3, -0.0085, 2e-3, 9.0, 0.0, -0.02, 0.0]
#: Effect, its parameters, conditions, start; the current is 4000 A.
PLANT = {
    "flexible_mode": ({"frequency": 22.0, "damping_ratio": 0.04, "mass_ratio": 0.4}, {}, START),
    "dead_coils": ({"place": 4.0, "fraction": 0.3}, {}, START),
    "joint_step": ({"height": 4e-4, "place": 4.0}, {}, START),
    "auxiliary_wheels": ({"height": 4e-3, "stiffness": 3e4, "damping": 200.0, "rolling_resistance": 0.03}, {}, LOW),
    "bungee_launcher": ({"stiffness": 30.0, "stroke": 5.0}, {}, START),
    "track_temperature": ({"coefficient": 4e-3}, {"track_temperature": 45.0}, START),
    "magnet_temperature": ({"coefficient": -1.1e-3}, {"magnet_temperature": 60.0}, START),
}
SENSORS = {
    "sensor_lag:heave": {"time_constant": 0.01},
    "sensor_drift:heave": {"rate": 1e-3},
    "sensor_clock:heave": {"rate": -0.02},
    "sensor_saturation:heave": {"limit": 0.0044},
    "sensor_misalignment": {"angle": 0.05},
}


@pytest.mark.parametrize("name", PLANT)
def test_a_run_with_a_plant_effect(name):
    parameters, conditions, start = PLANT[name]
    run = Model.create(effects={name: parameters}, conditions=conditions).simulate(TIMES, start, 4000.0)
    fields = {f"{name}__{p}": v for p, v in parameters.items()} | {
        c.replace("temperature", "celsius"): v for c, v in conditions.items()
    }
    names = [*sim.STATE_CHANNELS, *sim.GAP_CHANNELS, *sim.ACCELERATION_CHANNELS]
    theirs, contact = sim.measure(TIMES, start, 4000.0, sim.rig(**fields), names, far_step=2e-5)
    plain, _ = sim.measure(TIMES, start, 4000.0, sim.rig(), names)
    assert np.isinf(contact)
    assert np.abs(theirs - plain)[:, :4].max() > 1e-5  # it does something
    ours = np.stack([run[n] for n in names], axis=1)
    # What begins or ends within a step costs a micrometre of travel.
    surge = 3e-6 if name in ("bungee_launcher", "dead_coils") else 5e-7
    off = np.abs(ours - theirs) / [surge, *[5e-7] * 3, *[1e-5] * 4, *[5e-7] * 3, *[3e-3] * 3]
    assert off.max() < 1, names[int(off.max(axis=0).argmax())]


@pytest.mark.parametrize("name", SENSORS)
def test_what_a_sensor_reads(name):
    base, _, channel = name.partition(":")
    channel = channel or "heave"
    run = Model.default().simulate(TIMES, START, 4000.0)
    sensors = Sensors.of(Model.create(effects={name: SENSORS[name]}))
    used = np.arange(0, 280, 7)
    grid = np.linspace(0.0, 0.6, 3001)
    fine = Model.default().simulate(grid, START, 4000.0)
    ours = sensors.read(channel, TIMES[used], grid, fine.outputs[None])[0]
    fault = {"effect": base, "channel": channel, **SENSORS[name]}
    theirs = sim.measure(TIMES[used], START, 4000.0, sim.rig(), [channel], [fault])[0][:, 0]
    assert np.abs(theirs - run[channel][used]).max() > 1e-5
    assert np.abs(ours - theirs).max() < 1e-7
