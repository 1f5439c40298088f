# SPDX-License-Identifier: Apache-2.0
"""What a blind campaign may hide: the catalogue of effects.md, sensors' faults, and effects outside the catalogue.

Each entry tells how to draw one. `limits` bound the size (the entry's first parameter, in its unit); signal grows as
size**power near the middle of them; `signed`: either sign may be drawn; `shapes` draws the other parameters.
"""

import numpy as np

from independent import laws


def entry(parameter, low, high, power=1.0, signed=False, shapes=None, along=None):
    """`along`: parameters that are so many times the size."""
    return {
        "along": along or {},
        "parameter": parameter,
        "limits": (low, high),
        "power": power,
        "signed": signed,
        "shapes": shapes or (lambda rng, reach: {}),
    }


def log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


CATALOGUE = {
    "aerodynamic_drag": entry("drag_area", 1e-4, 0.1),
    "skin_friction_drag": entry("wetted_area", 0.05, 20.0),
    "aerodynamic_lift": entry("lift_area", 1e-4, 0.05, signed=True),
    "viscous_drag": entry("coefficient", 0.003, 2.0),
    "sliding_friction": entry("coefficient", 0.01, 0.5),
    "heave_damping": entry("coefficient", 0.05, 40.0),
    "sway_damping": entry("coefficient", 0.05, 40.0),
    "roll_damping": entry("coefficient", 5e-4, 0.4),
    "coil_current_dynamics": entry("on", 1.0, 1.0),
    "skin_effect": entry("corner_frequency", 300.0, 20000.0, power=-2.0),
    "track_resistance": entry("relative_change", 5e-4, 0.25, signed=True),
    "track_inductance": entry("relative_change", 5e-4, 0.25, signed=True),
    "magnet_warming": entry("rate", 1e-5, 0.05),
    "finite_pulse_width": entry("on", 1.0, 1.0),
    "firing_delay": entry("delay", 5e-6, 4e-4, power=2.0),
    "drive_back_emf": entry("cutoff_speed", 60.0, 50000.0, power=-1.0),
    "drive_droop": entry("fraction_per_pulse", 1e-6, 5e-3),
    "track_slope": entry("angle", 5e-5, 0.03, signed=True),
    "guideway_waviness": entry(
        "amplitude",
        1e-6,
        1e-3,
        shapes=lambda rng, reach: {
            "wavelength": log_uniform(rng, 0.5, 4.0),
            "phase": float(rng.uniform(-np.pi, np.pi)),
        },
    ),
    "array_asymmetry": entry("relative_difference", 1e-4, 0.1, signed=True),
    "cg_offset": entry("offset", 1e-6, 5e-3, signed=True),
    "crosswind": entry("force", 5e-3, 8.0, signed=True),
    "beam_attraction": entry("force", 0.05, 50.0),
    "halbach_fifth_harmonic": entry("relative_amplitude", 5e-4, 0.3),
}

# size of sensor_bias (and of sensor_drift, over a second) is in units of the channel's noise; of sensor_scale it is
# scale - 1
SENSORS = {
    "sensor_bias": entry("bias", 0.05, 100.0, signed=True),
    "sensor_scale": entry("scale", 2e-5, 0.1, signed=True),
    "sensor_delay": entry("delay", 2e-5, 0.012),
}


def passed(rng, reach):
    """Somewhere the runs come by."""
    return {"place": float(rng.uniform(0.15, 0.75) * reach)}


# those added to the contract in November 2026; drawn only where a campaign asks for the whole catalogue, so that the
# campaigns of earlier seeds stay what they were
PLANT = {
    "flexible_mode": entry(
        "frequency",
        12.0,
        150.0,
        power=-2.0,
        shapes=lambda rng, reach: {
            "damping_ratio": log_uniform(rng, 0.01, 0.1),
            "mass_ratio": float(rng.uniform(0.15, 0.6)),
        },
    ),
    "dead_coils": entry("fraction", 1e-3, 0.8, shapes=passed),
    "joint_step": entry("height", 1e-6, 1e-3, signed=True, shapes=passed),
    "auxiliary_wheels": entry(
        "stiffness",
        30.0,
        3e4,
        along={"damping": 2e-3},
        shapes=lambda rng, reach: {
            "height": float(rng.uniform(4.5e-3, 6.5e-3)),
            "rolling_resistance": float(rng.uniform(0.005, 0.05)),
        },
    ),
    "bungee_launcher": entry(
        "stiffness", 1e-3, 100.0, shapes=lambda rng, reach: {"stroke": float(rng.uniform(0.1, 0.6) * reach)}
    ),
    "track_temperature": entry("coefficient", 2e-5, 0.01, signed=True),
    "magnet_temperature": entry("coefficient", 2e-6, 0.003, signed=True),
}
# not sensor_saturation, which shows to no order where it begins: a test of its own hides it
LATER_SENSORS = {
    "sensor_lag": entry("time_constant", 5e-5, 0.02),
    "sensor_drift": entry("rate", 1e-2, 100.0, signed=True),
    "sensor_clock": entry("rate", 2e-5, 0.02, signed=True),
    "sensor_misalignment": entry("angle", 2e-4, 0.1, signed=True),
}
CONDITIONS = {"track_temperature": "track_celsius", "magnet_temperature": "magnet_celsius"}


def place(rng, reach):
    """A patch somewhere the runs come by; `reach` is the median travel (m)."""
    return {"place": float(rng.uniform(0.2, 0.7) * reach), "width": log_uniform(rng, 0.2, 1.5)}


# channel: the coordinate whose force is wrong; depends_on: on what
OUTSIDE = {
    "heave_patch": {**entry("force", 0.1, 40.0, shapes=place), "channel": "heave", "depends_on": ["surge"]},
    "sway_patch": {**entry("force", 0.05, 15.0, signed=True, shapes=place), "channel": "sway", "depends_on": ["surge"]},
    "surge_patch": {**entry("force", 0.5, 80.0, shapes=place), "channel": "surge", "depends_on": ["surge"]},
    "roll_patch": {
        **entry("moment", 0.005, 1.0, signed=True, shapes=place),
        "channel": "roll",
        "depends_on": ["surge"],
    },
    "heave_cubic_spring": {
        **entry("stiffness", 1e6, 1e10, shapes=lambda rng, reach: {"centre": float(rng.uniform(-0.006, -0.0035))}),
        "channel": "heave",
        "depends_on": ["heave"],
    },
    "sway_cubic_spring": {**entry("stiffness", 1e6, 1e9), "channel": "sway", "depends_on": ["sway"]},
    "lift_above_speed": {
        **entry("slope", 0.02, 8.0, signed=True, shapes=lambda rng, reach: {"threshold": float(rng.uniform(18, 26))}),
        "channel": "heave",
        "depends_on": ["surge_rate"],
    },
    "thrust_ripple": {
        **entry("relative_amplitude", 0.005, 0.5, shapes=lambda rng, reach: {"wavelength": log_uniform(rng, 1.0, 6.0)}),
        "channel": "surge",
        "depends_on": ["surge", "drive"],
    },
    "roll_from_sway_cubed": {**entry("coefficient", 1e5, 2e8, signed=True), "channel": "roll", "depends_on": ["sway"]},
    "heave_from_sway_squared": {
        **entry("coefficient", 1e4, 5e6, signed=True),
        "channel": "heave",
        "depends_on": ["sway"],
    },
    "drag_from_time": {
        **entry("force", 0.1, 40.0, shapes=lambda rng, reach: {"start": float(rng.uniform(0.25, 0.6))}),
        "channel": "surge",
        "depends_on": ["time"],
    },
    "heave_shake": {
        **entry("force", 0.01, 15.0, shapes=lambda rng, reach: {"frequency": log_uniform(rng, 2.0, 12.0)}),
        "channel": "heave",
        "depends_on": ["time"],
    },
    "sway_from_speed": {
        **entry("coefficient", 2e-5, 0.01, signed=True),
        "channel": "sway",
        "depends_on": ["surge_rate"],
    },
}


def unknown(name):
    """Whether an effect is outside the catalogue."""
    return name in OUTSIDE or name in laws.LAWS


def table_of(name):
    for table in (CATALOGUE, SENSORS, OUTSIDE, PLANT, LATER_SENSORS, laws.LAWS):
        if name in table:
            return table[name]
    raise KeyError(f"no such effect: {name}")


def with_size(name, size, sign, shapes, channel=None, noise=None):
    """The effect as the simulator takes it, with its parameters by name in "parameters".

    "scaled"(s) is the same effect with its strength times s, None for one that is only on or off. Strength is what
    the signal is proportional to.
    """
    row = table_of(name)
    value = size * sign if row["signed"] else size
    value = laws.damping(name, value) if name in laws.LAWS else value

    def scaled(strength):
        return with_size(name, size * strength ** (1 / row["power"]), sign, shapes, channel, noise)

    if name in SENSORS or name in LATER_SENSORS:
        if name in ("sensor_bias", "sensor_drift"):
            value *= noise[channel]
        elif name == "sensor_scale":
            value += 1.0
        return {
            "effect": name,
            "channel": channel,
            row["parameter"]: value,
            "parameters": {row["parameter"]: value},
            "scaled": scaled,
        }
    parameters = {row["parameter"]: value, **shapes, **{other: times * value for other, times in row["along"].items()}}
    fields = {f"{row.get('prefix', name)}__{parameter}": amount for parameter, amount in parameters.items()}
    switch = row["parameter"] == "on"
    return {
        "effect": name,
        "fields": fields,
        "parameters": {} if switch else parameters,
        "scaled": None if switch else scaled,
    }


def small_catalogue(channels, noise, whole=False):
    """Every catalogue effect and sensor fault, so small that the motion answers linearly, for asking which could
    imitate another; `whole`: those of November too.
    """
    candidates = _small_plant(channels, noise) if whole else {}
    for name, row in CATALOGUE.items():
        small = row["limits"][0] if row["power"] > 0 else row["limits"][1]
        if name == "guideway_waviness":
            for wave in np.geomspace(0.5, 4.0, 8):
                both = [with_size(name, small, 1, {"wavelength": wave, "phase": phase}) for phase in (0.0, np.pi / 2)]
                candidates[f"{name}@{wave:.2f}m"] = both
        else:
            candidates[name] = [with_size(name, small, 1, {})]
    for name, size in (("sensor_bias", 1.0), ("sensor_scale", 1e-5), ("sensor_delay", 1e-5)):
        for channel in channels:
            candidates[f"{name}:{channel}"] = [with_size(name, size, 1, {}, channel, noise)]
    return candidates


def _small_plant(channels, noise):
    """Those of November, where they have a place at several of them."""
    candidates = {name: [with_size(name, PLANT[name]["limits"][0], 1, {})] for name in CONDITIONS}
    candidates["flexible_mode"] = [with_size("flexible_mode", 150.0, 1, {"damping_ratio": 0.05, "mass_ratio": 0.3})]
    for where in np.arange(0.5, 40.0, 0.5):
        candidates[f"dead_coils@{where:.1f}m"] = [with_size("dead_coils", 1e-3, 1, {"place": where})]
        candidates[f"joint_step@{where:.1f}m"] = [with_size("joint_step", 1e-6, 1, {"place": where})]
    for stroke in (2.0, 5.0, 10.0, 20.0):
        candidates[f"bungee_launcher@{stroke:.0f}m"] = [with_size("bungee_launcher", 1e-3, 1, {"stroke": stroke})]
    for height in (4.5e-3, 5.5e-3, 6.5e-3):
        shapes = {"height": height, "rolling_resistance": 0.02}
        candidates[f"auxiliary_wheels@{1e3 * height:.1f}mm"] = [with_size("auxiliary_wheels", 30.0, 1, shapes)]
    for name, row in LATER_SENSORS.items():
        for channel in channels if name != "sensor_misalignment" else [None]:
            key = f"{name}:{channel}" if channel else name
            candidates[key] = [with_size(name, row["limits"][0], 1, {}, channel, noise)]
    return candidates
