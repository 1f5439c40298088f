# SPDX-License-Identifier: Apache-2.0
"""The plan of a campaign: what is run and what is logged, drawn at random."""

import numpy as np

from independent import clarity
from independent import simulator as sim
from independent.hidden_effects import log_uniform

DESIGNS = ("mixed", "coasting", "touchdown", "gaps", "powered", "one_sided")
NOISE = {  # standard deviations at level 1, SI
    "surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4,
    "surge_rate": 0.01, "sway_rate": 0.003, "heave_rate": 0.003, "roll_rate": 0.01,
    "gap_top": 3e-5, "gap_right": 3e-5, "gap_left": 3e-5,
    "surge_acceleration": 0.05, "sway_acceleration": 0.05, "heave_acceleration": 0.05,
}  # fmt: skip
TOP_SPEED = 48.0  # m/s at the end of a run
MOST_ROLL = 0.5  # rad
POSE = ["surge", "sway", "heave", "roll"]
RATES = ["surge_rate", "sway_rate", "heave_rate", "roll_rate"]
GAPS = ["gap_top", "gap_right", "gap_left"]
ACCELERATIONS = ["surge_acceleration", "sway_acceleration", "heave_acceleration"]


def draw_channels(rng, design):
    if design == "gaps":
        return ["surge", *GAPS] + (["roll"] if rng.random() < 0.8 else [])
    kind = rng.choice(
        ["pose", "twist", "imu", "few"], p=[0.1, 0.85, 0.05, 0.0] if design == "coasting" else [0.72, 0.14, 0.07, 0.07]
    )
    return {"pose": POSE, "twist": POSE + RATES, "imu": POSE + ACCELERATIONS, "few": ["surge", "heave"]}[str(kind)]


def draw_speed_and_drive(rng, design, coasting):
    """Speed (m/s) and drive current (A): near the balance of thrust and drag, about 7000 A (16/v)^2, as often above
    as below.
    """
    if design == "touchdown":
        speed = rng.uniform(9.5, 16.5)
        return speed, 0.0 if coasting else float(rng.choice([3500, 4200, 4900, 5600, 6300, 7000]))
    if coasting:
        return rng.uniform(16.5, 38.0), 0.0
    speed = rng.uniform(15.4, 30.0)
    drive_current = 7000 * (16 / speed) ** 2 * rng.uniform(0.7, 1.9)
    return speed, float(np.clip(round(drive_current / 70) * 70, 1400, 7000))


def draw_start(rng, speed, rigs, one_sided):
    """Heave within 1 mm of equilibrium, sway 3 mm, roll 4 mrad, no rates but the travel's; gaps above 0.2 mm."""
    equilibrium = sim.equilibrium_heave(speed, rigs)
    while True:
        heave, sway, roll = rng.uniform(-1e-3, 1e-3), rng.uniform(-3e-3, 3e-3), rng.uniform(-4e-3, 4e-3)
        if one_sided:
            heave, sway, roll = abs(heave), abs(sway), abs(roll)
        start = np.array([0.0, sway, equilibrium + heave, roll, speed, 0.0, 0.0, 0.0])
        state = np.zeros((1, sim.STATES))
        state[0, :8] = start
        if sim.channels_of(np.zeros(1), state, 0.0, rigs, GAPS).min() > 2e-4:
            return start


def tame(start, drive_current, length, rigs):
    """Drive current (A) lowered until the run ends below TOP_SPEED: above its balance speed a powered cradle runs
    away.
    """
    while drive_current > 0:
        states, _ = sim.simulate([length], start, drive_current, rigs, **clarity.STEPS)
        if states[0, 4] < TOP_SPEED:
            break
        drive_current = round(drive_current * 0.9 / 70) * 70.0
    return drive_current


def draw_times(rng, length, plan):
    """Sample times of one run (s): regular, perhaps jittered, some lost, perhaps a hole. The first is always 0."""
    times = np.arange(round(length * plan["rate"]) + 1) / plan["rate"]
    if plan["jitter"]:
        times[1:] += rng.uniform(-0.25, 0.25, len(times) - 1) / plan["rate"]
    keep = rng.random(len(times)) >= plan["lost"]
    if plan["hole"]:
        begin = rng.uniform(0.1, 0.8) * length
        keep &= (times < begin) | (times > begin + plan["hole"])
    keep[0] = True
    return times[keep]


def draw_plan(rng, design):
    level = log_uniform(rng, 1, 5)
    each = rng.random() < 0.3  # a factor of its own for each sensor
    channels = draw_channels(rng, design)
    length = float(rng.uniform(0.6, 2.0) if design != "touchdown" else rng.uniform(1.0, 2.0))
    return {
        "design": design,
        "channels": channels,
        "noise": {name: float(f"{NOISE[name] * (log_uniform(rng, 1, 5) if each else level):.3g}") for name in channels},
        "rate": float(rng.choice([100, 125, 200, 250, 400, 500, 500])),
        "length": round(length, 1),
        "number_of_runs": int(rng.integers(4, 15)),
        "lost": float(rng.uniform(0.02, 0.2)) if rng.random() < 0.3 else 0.0,
        "hole": float(rng.uniform(0.02, 0.1)) if rng.random() < 0.25 else 0.0,
        "jitter": bool(rng.random() < 0.15),
        "empty_cells": float(rng.uniform(0.01, 0.1)) if rng.random() < 0.12 else 0.0,
        "noise_given": str(rng.choice(["all", "none", "some"], p=[0.7, 0.2, 0.1])),
    }


def draw_runs(rng, plan, rigs, number):
    design = plan["design"]
    runs = []
    for i in range(number):
        coasting = {"coasting": True, "powered": False}.get(design, (i % 5) in (1, 3))
        speed, drive_current = draw_speed_and_drive(rng, design, coasting)
        length = (
            plan["length"]
            if rng.random() < 0.7
            else float(np.clip(round(plan["length"] * rng.uniform(0.7, 1.3), 1), 0.6, 2.0))
        )
        start = draw_start(rng, speed, rigs, design == "one_sided")
        drive_current = tame(start, drive_current, length, rigs)
        runs.append({"times": draw_times(rng, length, plan), "start": start, "drive_current": drive_current})
    return runs
