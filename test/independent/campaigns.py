# SPDX-License-Identifier: Apache-2.0
"""Draws blind measurement campaigns: a rig with something hidden, runs, sensors, noise, and the truth kept apart.

    python test/independent/campaigns.py --seed 3 --out /tmp/blind

writes /tmp/blind/ (what a diagnosis gets), /tmp/blind.truth.json and /tmp/blind.heldout/ (further runs, exact starts).

Why: the diagnosis must be measured on many campaigns it has never seen, made by a simulator it does not share.
The format is that of the campaign description (campaign.yaml and CSV, SI units). Everything follows from the seed.
"""

import argparse
import json
import math
import sys
from pathlib import Path

import numpy as np
import yaml

# as a script too, the package goes by one name: numba's cache depends on it
sys.path.insert(0, str(Path(__file__).parents[1]))

from independent import clarity, hidden_effects
from independent import simulator as sim

KINDS = ("nothing", "single", "two", "three", "unknown", "sensor")
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


def log_uniform(rng, low, high):
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


# ---- the plan: what is run and what is logged ----------------------------------------------------


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


# ---- what is hidden ------------------------------------------------------------------------------


def draw_effect(rng, name, experiment, jacobians, target, channel=None):
    """An effect of this name whose signal_after_nuisance is about `target`, as far as its limits allow.

    jacobians(past_contact) gives the nuisance's of the effect-free rig; the signal is taken as proportional to the
    strength.
    """
    row = hidden_effects.table_of(name)
    low, high = row["limits"]
    reach = float(np.median([run["start"][4] * run["times"][-1] for run in experiment.runs]))
    sign, shapes = float(rng.choice([-1, 1])), row["shapes"](rng, reach)
    noise = dict(zip(experiment.channels, experiment.noise, strict=True))
    if low == high:
        return hidden_effects.with_size(name, high, sign, shapes)

    size = low if row["power"] > 0 else high  # the weakest
    experiment.past_contact = name == "sliding_friction"
    base = experiment.predict([])
    with_it = experiment.predict([hidden_effects.with_size(name, size, sign, shapes, channel, noise)])
    residual, _, _ = clarity.regress(
        [w - b for w, b in zip(with_it, base, strict=True)], *jacobians(experiment.past_contact)
    )
    experiment.past_contact = False
    strength = target / max(float(np.linalg.norm(residual)), 1e-9)
    size = float(np.clip(size * strength ** (1 / row["power"]), low, high))
    return hidden_effects.with_size(name, float(f"{size:.3g}"), sign, shapes, channel, noise)


def names_to_hide(rng, kind, channels, whole=False):
    """A list of (name, sensor channel) to try; `whole`: the effects of November among them."""
    catalogue = [*hidden_effects.CATALOGUE, *(hidden_effects.PLANT if whole else ())]
    sensors = [*hidden_effects.SENSORS, *(hidden_effects.LATER_SENSORS if whole else ())]

    def some(table, number):
        return [(str(name), None) for name in rng.choice(list(table), number, replace=False)]

    if kind == "nothing":
        return []
    if kind == "sensor":
        name, channel = str(rng.choice(sensors)), str(rng.choice(channels))
        return [(name, None if name == "sensor_misalignment" else channel)]
    if kind == "unknown":
        return some(hidden_effects.OUTSIDE, 1) + (some(catalogue, 1) if rng.random() < 0.4 else [])
    return some(catalogue, {"single": 1, "two": 2, "three": 3}[kind])


def with_past_contact(experiment, hidden):
    experiment.past_contact = any(effect["effect"] == "sliding_friction" for effect in hidden)
    return experiment


def rivals_of(experiment, hidden, index, whole=False):
    """The catalogue's eight best imitations of effect `index` and what each leaves unexplained (in noise)."""
    noise = dict(zip(experiment.channels, experiment.noise, strict=True))
    candidates = hidden_effects.small_catalogue(experiment.channels, noise, whole)
    return dict(list(clarity.imitations(experiment, hidden, index, candidates).items())[:8])


def stays_in_track(runs, eta, gamma, hidden):
    """Whether no run tips the cradle over: past this there is no rig that anybody would measure."""

    def roll(run):
        rigs = clarity.rig_of(eta, gamma, hidden, run.get("conditions"))
        return sim.measure(run["times"], run["start"], run["drive_current"], rigs, ["roll"], [])[0]

    rolls = (roll(run) for run in runs)
    return all(np.abs(roll).max() < MOST_ROLL for roll in rolls)


def draw_hidden(rng, kind, experiment, faint, clear, names=None, whole=False):
    """Effects that all show: (hidden, their signals). Redraws what the campaign cannot show."""
    cache = {}

    def jacobians(past_contact):
        if past_contact not in cache:
            experiment.past_contact = past_contact
            cache[past_contact] = experiment.nuisance([])
        return cache[past_contact]

    best, best_score = ([], []), -1.0
    for _ in range(1 if names else 20):
        wanted = names or names_to_hide(rng, kind, experiment.channels, whole)
        if not wanted:
            return [], []
        hidden = [
            draw_effect(rng, name, experiment, jacobians, log_uniform(rng, faint, clear), channel)
            for name, channel in wanted
        ]
        found = clarity.signals(with_past_contact(experiment, hidden), hidden)
        score = min(one.get("signal_after_others", one["signal_after_nuisance"]) for one in found)
        if kind == "unknown":  # a strange effect that one of the catalogue imitates is no question
            found[0]["imitations"] = rivals_of(experiment, hidden, 0, whole)
            score = min([score, *found[0]["imitations"].values()])
        if not names and not stays_in_track(experiment.runs, experiment.eta, experiment.gamma, hidden):
            continue
        if score > best_score:
            best, best_score = (hidden, found), score
        if score > 0.7 * faint:
            break
    return best


# ---- files ---------------------------------------------------------------------------------------


def with_temperatures(seed, runs):
    """The runs on warm and cold days (their own seed: whatever else is drawn stays what it was)."""
    rng = np.random.default_rng([seed, 20])
    days = [{name: float(f"{rng.uniform(5, 60):.3g}") for name in hidden_effects.CONDITIONS} for _ in runs]
    return [{**run, "conditions": day} for run, day in zip(runs, days, strict=True)]


def noisy_csv(rng, run, plan, truth, faults):
    rigs = clarity.rig_of(*truth, run.get("conditions"))
    values, contact = sim.measure(run["times"], run["start"], run["drive_current"], rigs, plan["channels"], faults)
    values = values + rng.standard_normal(values.shape) * [plan["noise"][name] for name in plan["channels"]]
    empty = rng.random(values.shape) < plan["empty_cells"]
    lines = [",".join(["time", *plan["channels"]])]
    for t, row, blank in zip(run["times"], values, empty, strict=True):
        lines.append(
            ",".join([f"{t:.8g}", *("" if b else f"{value:.8g}" for value, b in zip(row, blank, strict=True))])
        )
    return "\n".join(lines) + "\n", contact


def folder_contents(rng, name, prefix, runs, plan, truth, faults, exact):
    """File name -> text; `exact` writes each run's true start into campaign.yaml. Also the times of first contact."""
    given = {"all": plan["channels"], "none": [], "some": plan["channels"][:2]}[plan["noise_given"]]
    config = {"name": name, "runs": []}
    if given:
        config["noise_std"] = {channel: plan["noise"][channel] for channel in given}
    contents, contacts = {}, []
    for i, run in enumerate(runs):
        file = f"{prefix}_{i:02d}.csv"
        contents[file], contact = noisy_csv(rng, run, plan, truth, faults)
        contacts.append(None if contact == math.inf else round(contact, 4))
        row = {"file": file, "drive_current": run["drive_current"]}
        if "conditions" in run:
            row["conditions"] = run["conditions"]
        if exact:
            row["initial_state"] = dict(zip(sim.STATE_CHANNELS, map(float, run["start"]), strict=True))
        config["runs"].append(row)
    contents["campaign.yaml"] = yaml.safe_dump(config, sort_keys=False)
    return contents, contacts


def diagnosis_name(effect):
    return f"{effect['effect']}:{effect['channel']}" if effect.get("channel") else effect["effect"]


def draw_campaign(seed, kind=None, design=None, names=None, faint=15.0, clear=1500.0, twins=False, whole=False):
    """One blind campaign, all from `seed`.

    kind: one of KINDS (drawn where None); design: one of DESIGNS.
    names: hide exactly these instead, as [(effect, sensor channel or None), ...], whether or not they show.
    faint, clear: bounds of the signal_after_nuisance aimed at (see clarity.py), log-uniform between.
    twins: add to the truth what each catalogue effect would leave unexplained of each hidden one ("imitations", a few
    seconds; always there for the effect of kind "unknown").

    whole: the effects of November 2026 are among those drawn, and runs are on warm and cold days.

    Returns (contents, truth, heldout): contents and heldout map file names to text; heldout's campaign.yaml gives
    exact initial states.
    """
    rng = np.random.default_rng(seed)
    kind = kind or ("given" if names else str(rng.choice(KINDS, p=[0.17, 0.33, 0.15, 0.05, 0.18, 0.12])))
    weights = [0.5, 0.12, 0.1, 0.1, 0.08, 0.1]
    sliding = names and any(name == "sliding_friction" for name, _ in names)
    design = design or ("touchdown" if sliding else str(rng.choice(DESIGNS, p=weights)))
    eta, gamma = float(rng.uniform(0.705, 0.755)), float(rng.uniform(3.8, 4.05))
    plain = sim.rig(eta=eta, gamma=gamma)
    plan = draw_plan(rng, design)
    runs = draw_runs(rng, plan, plain, plan["number_of_runs"])
    runs = with_temperatures(seed, runs) if whole else runs
    experiment = clarity.Experiment(runs, plan["channels"], plan["noise"], eta, gamma)
    hidden, found = draw_hidden(rng, kind, experiment, faint, clear, names, whole)

    rig, faults = (eta, gamma, hidden), clarity.faults_of(hidden)
    name = f"blind_{seed}"
    contents, contacts = folder_contents(rng, name, "run", runs, plan, rig, faults, exact=False)
    number = int(rng.integers(3, 6))
    for _ in range(20):
        further = draw_runs(rng, plan, plain, number)
        further = with_temperatures(seed + 1, further) if whole else further
        if stays_in_track(further, eta, gamma, hidden):
            break
    heldout, heldout_contacts = folder_contents(rng, name, "heldout", further, plan, rig, faults, exact=True)

    known = [effect for effect in hidden if effect["effect"] not in hidden_effects.OUTSIDE]
    strange = [effect for effect in hidden if effect["effect"] in hidden_effects.OUTSIDE]
    truth = {
        "seed": seed,
        "kind": kind,
        "verdict": "unknown_effect" if strange else "missing_effect" if known else "adequate",
        "effects": [diagnosis_name(effect) for effect in known],
        "parameters": {
            "eta": eta,
            "gamma": gamma,
            **{f"{diagnosis_name(e)}.{key}": value for e in known for key, value in e["parameters"].items()},
        },
        "unknown": [
            {
                "effect": e["effect"],
                "channel": hidden_effects.OUTSIDE[e["effect"]]["channel"],
                "depends_on": hidden_effects.OUTSIDE[e["effect"]]["depends_on"],
                "parameters": e["parameters"],
            }
            for e in strange
        ],
        "clarity": {diagnosis_name(e): numbers for e, numbers in zip(hidden, found, strict=True)},
        "plan": plan,
        "drive_currents": [run["drive_current"] for run in runs],
        "initial_states": [dict(zip(sim.STATE_CHANNELS, map(float, run["start"]), strict=True)) for run in runs],
        "first_contacts": contacts,
        "heldout_first_contacts": heldout_contacts,
    }
    if twins:
        with_past_contact(experiment, hidden)
        for index, effect in enumerate(hidden):
            truth["clarity"][diagnosis_name(effect)]["imitations"] = rivals_of(experiment, hidden, index, whole)
    return contents, truth, heldout


def write_contents(folder, contents):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in contents.items():
        (folder / file).write_text(text)


def write_campaign(folder, seed, **choices):
    """Draw and write FOLDER/, FOLDER.truth.json and FOLDER.heldout/; `choices` as for draw_campaign. Returns the
    truth.
    """
    contents, truth, heldout = draw_campaign(seed, **choices)
    write_contents(folder, contents)
    write_contents(f"{folder}.heldout", heldout)
    Path(f"{folder}.truth.json").write_text(json.dumps(truth, indent=1) + "\n")
    return truth


def main():
    parser = argparse.ArgumentParser(description="Write one blind campaign, its truth and its held-out runs.")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument(
        "--out",
        required=True,
        help="folder of the campaign; the truth goes to OUT.truth.json, further runs to OUT.heldout",
    )
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--design", choices=DESIGNS)
    parser.add_argument(
        "--effect", action="append", help="hide exactly this (repeatable); a sensor fault as sensor_delay:heave"
    )
    parser.add_argument("--faint", type=float, default=15.0)
    parser.add_argument("--clear", type=float, default=1500.0)
    parser.add_argument(
        "--whole", action="store_true", help="the effects of November 2026 too, runs on warm and cold days"
    )
    parser.add_argument("--twins", action="store_true", help="also say which effects could imitate the hidden ones")
    given = parser.parse_args()
    names = [((text + ":").split(":")[0], text.partition(":")[2] or None) for text in given.effect or []] or None
    write_campaign(
        given.out.rstrip("/"),
        given.seed,
        kind=given.kind,
        design=given.design,
        names=names,
        faint=given.faint,
        clear=given.clear,
        twins=given.twins,
        whole=given.whole,
    )


if __name__ == "__main__":
    main()
