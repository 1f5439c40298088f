# SPDX-License-Identifier: Apache-2.0
"""Loop campaigns: runs that the package's own simulator and controllers fly in lockstep and record, drawn at random.

What `sim`, `track_controller` (or `examples/my_controller.py`) and `record` do over topics is done here by the same
parts without ROS, tick by tick, and written as bags with the pulses that were fired. Physics is the package's own, so a
complete model is complete to the last bit; what is tested is the loop: held speeds, pulses, recorded sensors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import yaml
from independent import clarity, hidden_effects, hiding

from inductrack_ros.core.model import Model, Pulses, Trajectory
from inductrack_ros.core.rig import Rig
from inductrack_ros.core.state import GAPS, INDEX, INSTRUMENTS, STATES
from inductrack_ros.data import write_bag
from inductrack_ros.nodes.detectors import Photodiodes
from inductrack_ros.nodes.drive import Pulse, PulseQueue
from inductrack_ros.nodes.firing import FiringPlan, Motion, SpeedHold
from inductrack_ros.nodes.simulation import Simulation

KINDS = {"loop": {"nothing": 0.2, "single": 0.6, "two": 0.2}, "loop_complete": {"nothing": 1.0}}
#: What pulses and their speed control can show; drawn among these.
EFFECTS = (
    "aerodynamic_drag", "aerodynamic_lift", "viscous_drag", "heave_damping", "sway_damping", "roll_damping",
    "coil_current_dynamics", "track_resistance", "track_slope", "guideway_waviness", "array_asymmetry", "cg_offset",
    "crosswind", "beam_attraction", "halbach_fifth_harmonic", "magnet_warming",
)  # fmt: skip
RATE, WINDOW = 500.0, 0.3  # Hz, the node's; s
POSE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}  # noise, SI
TWIST = {"surge_rate": 0.01, "sway_rate": 0.003, "heave_rate": 0.003, "roll_rate": 0.01}
REST = {"surge_acceleration": 0.05, "sway_acceleration": 0.05, "heave_acceleration": 0.05} | dict.fromkeys(GAPS, 3e-5)
SENSORS = {"pose": POSE, "pose and twist": POSE | TWIST, "all": POSE | TWIST | REST}
OFF = {"pose": ("twist", "imu", *GAPS), "pose and twist": ("imu", *GAPS), "all": ()}


# ---- flying --------------------------------------------------------------------------------------


def track_controller(model: Model, speed: float):
    """The shipped controller with its default gains: (time, state) -> pulses."""
    spacing, length = 0.5 * model.parameters["wavelength"], model.parameters["pulse_length"]
    diodes, motion = Photodiodes(0.05, 0.02), Motion(0.02, 0.0, tolerance=0.25 * model.parameters["wavelength"])
    plan, hold = FiringPlan(motion, spacing, length, 0.02, 1.0, waits=True), SpeedHold(speed, 7000, 3000, 3000, 14000)

    def fire(now: float, x: np.ndarray) -> list[Pulse]:
        for edge in diodes.see(now, float(x[0])):
            motion.add(edge)
        return plan.pulses(now, hold)

    return fire


def my_controller(model: Model, speed: float):
    """As `examples/my_controller.py`: feed-forward and proportional, from true place and speed."""
    spacing, length, coil = 0.5 * model.parameters["wavelength"], model.parameters["pulse_length"], 0

    def fire(now: float, x: np.ndarray) -> Iterator[Pulse]:
        nonlocal coil
        surge, v = float(x[0]), float(x[4])
        coil = max(coil, int(surge / spacing) + 1)
        while v > 1.0 and (seconds := (coil * spacing - surge) / v - length / 2) <= 0.006:
            current = min(max(7000.0 + 3000.0 * (speed - v), 0.0), 14000.0)
            if seconds > 0.0:
                yield Pulse(now + seconds, coil, current if coil % 2 == 0 else -current)
            coil += 1

    return fire


CONTROLLERS = {"track_controller": track_controller, "my_controller": my_controller}


def fly(model: Model, start: dict[str, float], seconds: float, controller) -> tuple[np.ndarray, Pulses]:
    """Times (n,) s of a run in lockstep and the pulses that were fired, their stamps whole nanoseconds as in a
    message."""
    sim = Simulation(model, start, RATE, PulseQueue(20000, 2e4, model.parameters["pulse_length"]))
    fired: list[Pulse] = []
    ticks = round(seconds * RATE)
    for _ in range(ticks):
        for pulse in controller(sim.time, sim.x):
            sim.queue.offer(sim.time, round(pulse.time * 1e9) / 1e9, pulse.coil, pulse.current)
        fired += sim.tick()
    columns = [np.array([getattr(p, name) for p in fired], float) for name in ("time", "coil", "current")]
    return np.arange(ticks + 1) / RATE, Pulses(*columns)


# ---- drawing -------------------------------------------------------------------------------------


class Experiment(clarity.Experiment):
    """How clearly an effect shows in pulsed runs: the package's model in place of the independent simulator.

    A start's error grows ten-thousandfold in a run that is driven by pulses. So runs are cut into `WINDOW` s, each with
    a start of its own: to first order that is linear, and what shows is never less."""

    def __init__(self, runs, noise, eta, gamma, hidden=()):
        model = model_of(eta, gamma, list(hidden))
        super().__init__([w for run in runs for w in _windows(run, model)], list(noise), noise, eta, gamma)

    def one(self, index, start, eta, gamma, hidden):
        run, model = self.runs[index], model_of(eta, gamma, hidden)
        if len(run["carried"]) and model.carries_states:
            start = np.concatenate([start, run["carried"]])
        flown = model.simulate(run["times"], start, pulses=run["pulses"])
        readings = flown.outputs[:, [INDEX[c] for c in self.channels]] / self.noise
        for k, channel in enumerate(self.channels):
            readings[np.arange(len(readings)) % every(channel) > 0, k] = np.nan
        return readings.ravel()


def every(channel: str) -> int:
    """Of how many ticks a sensor delivers one."""
    return round(RATE / next(i.rate for i in INSTRUMENTS.values() if channel in i.channels))


def _windows(run: dict, model: Model) -> list[dict]:
    """A run in pieces of `WINDOW` s, each from where the model has come; ``carried`` are the states of its effects
    there, which no start of a window sets anew."""
    state, length, found = run["start"], round(WINDOW * RATE), []
    for k in range(0, len(run["times"]) - length, length):
        times = run["times"][k : k + length + 1]
        found.append({**run, "times": times[:-1], "start": state[:8], "carried": state[8:]})
        state = model.simulate(times, state, pulses=run["pulses"]).final
    return found


def model_of(eta: float, gamma: float, hidden: list[dict]) -> Model:
    """The model with what is hidden."""
    effects = {e["effect"]: e["parameters"] for e in hidden}
    return Model.create({"eta": eta, "gamma": gamma}, effects, drive="pulses")


def draw_runs(rng: np.random.Generator, controller: str, plain: Model) -> list[dict]:
    """Starts, lengths and speeds to hold of three to six runs, twelve seconds at the most."""
    number = int(rng.integers(3, 7))
    length, runs = float(rng.uniform(1.5, min(4.0, 12.0 / number))), []
    for _ in range(number):
        speed = float(rng.uniform(15.5, 26.0 if controller == "track_controller" else 20.0))
        level = plain.initial_state(surge_rate=speed)[INDEX["heave"]]
        off = {"sway": 2e-3, "roll": 3e-3, "heave": 1e-3}
        start = {"surge_rate": speed} | {c: float(rng.uniform(-size, size)) for c, size in off.items()}
        start["heave"] += level
        runs.append({"speed": speed, "length": round(length, 1), "initial": start})
    return runs


def flown(runs: list[dict], model: Model, controller: str) -> list[dict]:
    """The runs with their times, starts (8,) and pulses."""
    found = []
    for run in runs:
        times, pulses = fly(model, run["initial"], run["length"], CONTROLLERS[controller](model, run["speed"]))
        start = model.initial_state(**run["initial"])[:8]
        found.append({**run, "times": times, "start": start, "pulses": pulses, "drive_current": 0.0})
    return found


def draw_hidden(rng, kind: str, experiment: Experiment, shown, faint: float, clear: float) -> list[dict]:
    """One or two effects that show by about a drawn signal, sized on the runs of a complete rig. One that has no size
    and hardly shows is replaced by another; ``shown``: how clearly an effect shows in runs flown with it."""
    number = {"nothing": 0, "single": 1, "two": 2}[kind]
    jacobians = experiment.nuisance([]) if number else None
    names, hidden = rng.choice(EFFECTS, number, replace=False).tolist(), []
    while names:
        target = hidden_effects.log_uniform(rng, faint, clear)
        effect = hiding.draw_effect(rng, names.pop(0), experiment, lambda past: jacobians, target)
        if effect["scaled"] or shown(effect) > faint:
            hidden.append(effect)
        else:
            names.append(str(rng.choice([n for n in EFFECTS if n != effect["effect"]])))
    return hidden


# ---- writing -------------------------------------------------------------------------------------


def write_campaign(folder: Path, seed: int, kind: str, faint: float = 15.0, clear: float = 600.0) -> dict:
    """Fly and write one campaign, all from ``seed``, and two further runs with exact starts; returns the truth."""
    rng = np.random.default_rng([seed, 19])
    controller = str(rng.choice(list(CONTROLLERS), p=[0.65, 0.35]))
    sensors = str(rng.choice(list(SENSORS), p=[0.45, 0.2, 0.35]))
    level = hidden_effects.log_uniform(rng, 1, 4)
    noise = {c: float(f"{level * s:.3g}") for c, s in SENSORS[sensors].items()}
    eta, gamma = float(rng.uniform(0.715, 0.745)), float(rng.uniform(3.85, 4.0))
    inside = str(rng.choice(list(KINDS[kind]), p=list(KINDS[kind].values())))
    complete = model_of(eta, gamma, [])
    runs = draw_runs(rng, controller, complete)
    plain = Experiment(flown(runs, complete, controller), noise, eta, gamma)

    def shown(effect: dict) -> float:
        some = flown(runs, model_of(eta, gamma, [effect]), controller)
        signal = clarity.signals(Experiment(some, noise, eta, gamma, [effect]), [effect])[0]
        return signal["signal_after_nuisance"]

    hidden = draw_hidden(rng, inside, plain, shown, faint, clear)
    rig = model_of(eta, gamma, hidden)
    runs = flown(runs, rig, controller)
    further = flown(draw_runs(rng, controller, complete)[:2], rig, controller)
    given = bool(rng.random() < 0.5)
    for where, some, exact in ((folder, runs, False), (Path(f"{folder}.heldout"), further, True)):
        _write(where, some, rig, sensors, noise, given, exact, seed)
    signals = clarity.signals(Experiment(runs, noise, eta, gamma, hidden), hidden) if hidden else []
    names = [e["effect"] for e in hidden]
    truth = {
        "seed": seed, "kind": kind, "verdict": "missing_effect" if hidden else "adequate", "effects": names,
        "parameters": {"eta": eta, "gamma": gamma}
        | {f"{e['effect']}.{k}": v for e in hidden for k, v in e["parameters"].items()},
        "clarity": dict(zip(names, signals, strict=True)),
        "plan": {"design": f"{controller}, {sensors}", "noise": noise},
        "runs": [{k: r[k] for k in ("speed", "length", "initial")} for r in runs],
    }  # fmt: skip
    Path(f"{folder}.truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    return truth


def _write(folder: Path, runs: list[dict], rig: Model, sensors: str, noise: dict, given: bool, exact: bool, seed: int):
    folder.mkdir(parents=True)
    values = {f"measured.{c}.noise": s for c, s in noise.items()} | {f"measured.{s}.rate": 0.0 for s in OFF[sensors]}
    rows = []
    for k, run in enumerate(runs):
        flight: Trajectory = rig.simulate(run["times"], run["start"], pulses=run["pulses"])
        records = Rig(values, rig, 1000 * seed + k + 500 * exact).record(flight.times, flight.outputs, 1 / RATE)
        columns = {name: flight[name] for name in (*STATES, *GAPS)}
        write_bag(folder / f"run_{k:02d}", flight.times, columns, pulses=run["pulses"], measured=records)
        start = {n: float(v) for n, v in zip(STATES, run["start"], strict=True)}
        rows.append({"file": f"run_{k:02d}"} | ({"initial_state": start} if exact else {}))
    (folder / "model.yaml").write_text("/**:\n  ros__parameters:\n    drive: pulses\n")
    about = {"name": folder.name, "model": "model.yaml", "runs": rows}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(about | ({"noise_std": noise} if given else {})))
