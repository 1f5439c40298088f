"""What a blind campaign may hide: the catalogue of effects.md, sensors' faults, and effects outside the catalogue.

Each entry tells how to draw one. `limits` bound the size (the entry's first parameter, in its unit); signal grows as
size**power near the middle of them; `signed`: either sign may be drawn; `shapes` draws the other parameters.
"""

import numpy as np


def entry(parameter, low, high, power=1.0, signed=False, shapes=None):
    return {
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

# size of sensor_bias is in units of the channel's noise; of sensor_scale it is scale - 1
SENSORS = {
    "sensor_bias": entry("bias", 0.05, 100.0, signed=True),
    "sensor_scale": entry("scale", 2e-5, 0.1, signed=True),
    "sensor_delay": entry("delay", 2e-5, 0.012),
}


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


def table_of(name):
    for table in (CATALOGUE, SENSORS, OUTSIDE):
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

    def scaled(strength):
        return with_size(name, size * strength ** (1 / row["power"]), sign, shapes, channel, noise)

    if name in SENSORS:
        if name == "sensor_bias":
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
    parameters = {row["parameter"]: value, **shapes}
    fields = {f"{name}__{parameter}": amount for parameter, amount in parameters.items()}
    switch = row["parameter"] == "on"
    return {
        "effect": name,
        "fields": fields,
        "parameters": {} if switch else parameters,
        "scaled": None if switch else scaled,
    }


def small_catalogue(channels, noise):
    """Every catalogue effect and sensor fault, so small that the motion answers linearly, for asking which could
    imitate another.
    """
    candidates = {}
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
