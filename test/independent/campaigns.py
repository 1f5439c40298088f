# SPDX-License-Identifier: Apache-2.0
"""Draws blind measurement campaigns: a rig with something hidden, runs, sensors, noise, and the truth kept apart.

    python test/independent/campaigns.py --seed 3 --out /tmp/blind
    python test/independent/campaigns.py --seed 31001 --kind dirty --out /tmp/blind        # --twin: the same, clean

writes /tmp/blind/ (what a diagnosis gets), /tmp/blind.truth.json and /tmp/blind.heldout/ (further runs, exact starts).

Why: the diagnosis must be measured on many campaigns it has never seen, made by a simulator it does not share.
The format is that of the campaign description (campaign.yaml and CSV, SI units). Everything follows from the seed.
A dirty campaign is one as a rig logs it (`dirt`); its truth says what a diagnosis should find besides the physics.
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

from independent import clarity, dirt, hidden_effects, laws, whitened
from independent import simulator as sim
from independent.hiding import draw_hidden, rivals_of, stays_in_track, with_past_contact
from independent.plans import DESIGNS, draw_plan, draw_runs

KINDS = ("nothing", "single", "two", "three", "unknown", "sensor")
#: What a dirty campaign hides (a complete one: nothing), and how often.
DIRTY = {"dirty": {"nothing": 0.15, "single": 0.5, "two": 0.1, "unknown": 0.1, "sensor": 0.15},
         "dirty_complete": {"nothing": 1.0}, "dirty_law": {"law": 1.0}}  # fmt: skip
#: Kinds that are not drawn unless they are asked for: an unknown force by a law that is drawn (`laws`).
BESIDES = ("law",)
#: The part of each design among clean and among dirty campaigns, as in DESIGNS.
WEIGHTS, DIRTY_WEIGHTS = [0.5, 0.12, 0.1, 0.1, 0.08, 0.1], [0.6, 0.1, 0.05, 0.08, 0.09, 0.08]
#: A dirty campaign's runs and their length (s) at the most, and those of one that hides a law: a diagnosis of it is
#: quick enough for many. A dirty one's rate (Hz) at the least.
SHORT_RUNS, SHORT_LENGTH, DIRTY_RATE = 6, 1.2, 200.0


# ---- files ---------------------------------------------------------------------------------------


def with_temperatures(seed, runs):
    """The runs on warm and cold days (their own seed: whatever else is drawn stays what it was)."""
    rng = np.random.default_rng([seed, 20])
    days = [{name: float(f"{rng.uniform(5, 60):.3g}") for name in hidden_effects.CONDITIONS} for _ in runs]
    return [{**run, "conditions": day} for run, day in zip(runs, days, strict=True)]


def readings(run, plan, truth, faults, times=None):
    """What noiseless sensors read of a run as it was really flown (n, c), and the time of first contact."""
    rigs = clarity.rig_of(*truth, run.get("conditions"))
    for name, factor in run.get("factors", {}).items():
        rigs[name] *= factor
    steps = {"kicks": run["kicks"]} if "kicks" in run else {}
    times, current = run["times"] if times is None else times, run.get("current", run["drive_current"])
    return sim.measure(times, run["start"], current, rigs, plan["channels"], faults, **steps)


def csv_text(times, values, channels):
    """A run's file; NaN is an empty cell."""
    lines = [",".join(["time", *channels])]
    for t, row in zip(times, values, strict=True):
        lines.append(",".join([f"{t:.8g}", *("" if math.isnan(value) else f"{value:.8g}" for value in row)]))
    return "\n".join(lines) + "\n"


def noisy_csv(rng, run, plan, truth, faults):
    values, contact = readings(run, plan, truth, faults)
    values = values + rng.standard_normal(values.shape) * [plan["noise"][name] for name in plan["channels"]]
    values[rng.random(values.shape) < plan["empty_cells"]] = math.nan
    return csv_text(run["times"], values, plan["channels"]), contact


def dirty_csvs(rng, runs, plan, truth, faults, dirts):
    """The files of dirty runs, and their first contacts; the end of a saturated range is set in `dirts`."""
    flown = dirt.on_runs(rng, runs, dirts)
    true = [readings(run, plan, truth, faults, dirt.moments(rng, run["times"], dirts)) for run in flown]
    dirt.set_limits(dirts, [values for values, _ in true], plan)
    texts = []
    for k, (run, (values, _)) in enumerate(zip(flown, true, strict=True)):
        logged = dirt.on_readings(rng, run["times"], values, plan, dirts, k)
        logged[rng.random(logged.shape) < plan["empty_cells"]] = math.nan
        texts.append(csv_text(run["times"], logged, plan["channels"]))
    return list(zip(texts, [contact for _, contact in true], strict=True))


def folder_contents(name, prefix, runs, plan, logged, exact):
    """File name -> text of the runs `logged` as (text, first contact); `exact` writes each run's true start into
    campaign.yaml. Also the times of first contact.
    """
    given = {"all": plan["channels"], "none": [], "some": plan["channels"][:2]}[plan["noise_given"]]
    config = {"name": name, "runs": []}
    if given:
        config["noise_std"] = {channel: plan["noise"][channel] for channel in given}
    contents, contacts = {}, []
    for i, (run, (text, contact)) in enumerate(zip(runs, logged, strict=True)):
        file = f"{prefix}_{i:02d}.csv"
        contents[file] = text
        contacts.append(None if contact == math.inf else round(contact, 4))
        row = {"file": file, "drive_current": run["drive_current"]}
        if "conditions" in run:
            row["conditions"] = run["conditions"]
        if exact:
            row["initial_state"] = dict(zip(sim.STATE_CHANNELS, map(float, run["start"]), strict=True))
        config["runs"].append(row)
    contents["campaign.yaml"] = yaml.safe_dump(config, sort_keys=False)
    return contents, contacts


# ---- one campaign --------------------------------------------------------------------------------


def diagnosis_name(effect):
    return f"{effect['effect']}:{effect['channel']}" if effect.get("channel") else effect["effect"]


def draw_dirty(seed, kind, dirts):
    """What a dirty campaign hides, and its generator: its own, so that the clean twin is what it would be anyway."""
    rng = np.random.default_rng([seed, 33])
    if kind in DIRTY:
        share = DIRTY[kind]
        return str(rng.choice(list(share), p=list(share.values()))), rng
    return kind, rng if dirts else None


def draw_campaign(
    seed, kind=None, design=None, names=None, faint=15.0, clear=1500.0, twins=False, whole=False, dirts=None, twin=False
):
    """One blind campaign, all from `seed`.

    kind: one of KINDS (drawn where None), BESIDES or DIRTY; design: one of DESIGNS.
    names: hide exactly these instead, as [(effect, sensor channel or None), ...], whether or not they show.
    faint, clear: bounds of the signal_after_nuisance aimed at (see clarity.py), log-uniform between; in a dirty
    campaign the signal is what the dirt leaves of it (see whitened.py).
    twins: add to the truth what each catalogue effect would leave unexplained of each hidden one ("imitations", a few
    seconds; always there for the effect of kind "unknown").

    whole: the effects of November 2026 are among those drawn, and runs are on warm and cold days.
    dirts: the kinds of dirt (`dirt.DIRTS`), where not drawn; twin: the dirty campaign without its dirt.

    Returns (contents, truth, heldout): contents and heldout map file names to text; heldout's campaign.yaml gives
    exact initial states and its runs are clean.
    """
    rng = np.random.default_rng(seed)
    asked, (kind, dirty_rng) = kind, draw_dirty(seed, kind, dirts)
    kind = kind or ("given" if names else str(rng.choice(KINDS, p=[0.17, 0.33, 0.15, 0.05, 0.18, 0.12])))
    sliding = names and any(name == "sliding_friction" for name, _ in names)
    weights = WEIGHTS if dirty_rng is None else DIRTY_WEIGHTS
    design = design or ("touchdown" if sliding else str(rng.choice(DESIGNS, p=weights)))
    eta, gamma = float(rng.uniform(0.705, 0.755)), float(rng.uniform(3.8, 4.05))
    plain = sim.rig(eta=eta, gamma=gamma)
    plan = draw_plan(rng, design)
    if dirty_rng is not None or kind in BESIDES:
        plan["number_of_runs"] = min(plan["number_of_runs"], SHORT_RUNS)
        plan["length"] = min(plan["length"], SHORT_LENGTH)
    if dirty_rng is not None:
        plan["rate"], plan["noise_given"] = max(plan["rate"], DIRTY_RATE), "all"
    runs = draw_runs(rng, plan, plain, plan["number_of_runs"])
    runs = with_temperatures(seed, runs) if whole else runs
    found = dirt.drawn(dirty_rng, plan, runs, dirts) if dirty_rng is not None else []
    ideal = clarity.Experiment(runs, plan["channels"], plan["noise"], eta, gamma)
    experiment = whitened.Experiment(ideal, found) if found else ideal
    hidden, signals = draw_hidden(rng, kind, experiment, faint, clear, names, whole)

    rig, faults, name = (eta, gamma, hidden), clarity.faults_of(hidden), f"blind_{seed}"
    if found and not twin:
        logged = dirty_csvs(dirty_rng, runs, plan, rig, faults, found)
    else:
        logged = [noisy_csv(rng, run, plan, rig, faults) for run in runs]
    contents, contacts = folder_contents(name, "run", runs, plan, logged, exact=False)
    further = draw_heldout(rng, seed, plan, plain, rig, whole)
    logged = [noisy_csv(rng, run, plan, rig, faults) for run in further]
    heldout, heldout_contacts = folder_contents(name, "heldout", further, plan, logged, exact=True)

    truth = {
        "seed": seed,
        "kind": asked if asked in DIRTY else kind,
        **what_is_hidden(eta, gamma, hidden, [] if twin else found),
        "clarity": {diagnosis_name(e): numbers for e, numbers in zip(hidden, signals, strict=True)},
        "plan": plan,
        "drive_currents": [run["drive_current"] for run in runs],
        "initial_states": [dict(zip(sim.STATE_CHANNELS, map(float, run["start"]), strict=True)) for run in runs],
        "first_contacts": contacts,
        "heldout_first_contacts": heldout_contacts,
    }
    if found:
        for effect, numbers in zip(hidden, clarity.signals(ideal, hidden), strict=True):
            truth["clarity"][diagnosis_name(effect)]["ideal_signal"] = numbers["signal_after_nuisance"]
    if twins:
        with_past_contact(experiment, hidden)
        for index, effect in enumerate(hidden):
            truth["clarity"][diagnosis_name(effect)]["imitations"] = rivals_of(experiment, hidden, index, whole)
    return contents, truth, heldout


def draw_heldout(rng, seed, plan, plain, rig, whole):
    """Further runs that stay in the track."""
    number = int(rng.integers(3, 6))
    for _ in range(20):
        further = draw_runs(rng, plan, plain, number)
        further = with_temperatures(seed + 1, further) if whole else further
        if stays_in_track(further, *rig):
            break
    return further


def what_is_hidden(eta, gamma, hidden, dirts):
    """The truth of physics, sensors and log, as a diagnosis should tell it."""
    known = [effect for effect in hidden if not hidden_effects.unknown(effect["effect"])]
    strange = [effect for effect in hidden if hidden_effects.unknown(effect["effect"])]
    sensors = dirt.faults(dirts)
    parameters = {"eta": eta, "gamma": gamma}
    for e in known:
        parameters |= {f"{diagnosis_name(e)}.{key}": value for key, value in e["parameters"].items()}
    for name, values in sensors.items():
        parameters |= {f"{name}.{key}": value for key, value in values.items()}
    effects = [*(diagnosis_name(effect) for effect in known), *sensors]
    return {
        "verdict": "unknown_effect" if strange else "missing_effect" if effects else "adequate",
        "effects": effects,
        "parameters": parameters,
        "unknown": [
            {
                "effect": e["effect"],
                "channel": hidden_effects.table_of(e["effect"])["channel"],
                "depends_on": hidden_effects.table_of(e["effect"])["depends_on"],
                "parameters": e["parameters"],
                **({"law": laws.told(e["effect"], e["parameters"])} if e["effect"] in laws.LAWS else {}),
            }
            for e in strange
        ],
        "dirt": [{k: v for k, v in d.items() if k != "findings"} for d in dirts],
        "findings": [finding for d in dirts for finding in d["findings"]],
    }


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
    parser.add_argument("--kind", choices=[*KINDS, *BESIDES, *DIRTY])
    parser.add_argument("--design", choices=DESIGNS)
    parser.add_argument(
        "--effect", action="append", help="hide exactly this (repeatable); a sensor fault as sensor_delay:heave"
    )
    parser.add_argument("--faint", type=float, default=15.0)
    parser.add_argument("--clear", type=float, default=1500.0)
    parser.add_argument(
        "--whole", action="store_true", help="the effects of November 2026 too, runs on warm and cold days"
    )
    parser.add_argument("--dirt", action="append", choices=dirt.DIRTS, help="this dirt (repeatable)")
    parser.add_argument("--twin", action="store_true", help="the dirty campaign without its dirt")
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
        dirts=given.dirt,
        twin=given.twin,
    )


if __name__ == "__main__":
    main()
