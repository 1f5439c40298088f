# SPDX-License-Identifier: Apache-2.0
"""What a campaign hides: effects drawn so large that the campaign can show them."""

import numpy as np

from independent import clarity, hidden_effects, laws
from independent import simulator as sim
from independent.hidden_effects import log_uniform
from independent.plans import MOST_ROLL


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


def names_to_hide(rng, kind, channels, whole=False, without=()):
    """A list of (name, sensor channel) to try; `whole`: the effects of November among them; `without` these."""
    catalogue = [*hidden_effects.CATALOGUE, *(hidden_effects.PLANT if whole else ())]
    catalogue = [name for name in catalogue if name not in without]
    sensors = [*hidden_effects.SENSORS, *(hidden_effects.LATER_SENSORS if whole else ())]

    def some(table, number):
        return [(str(name), None) for name in rng.choice(list(table), number, replace=False)]

    if kind == "nothing":
        return []
    if kind == "sensor":
        name, channel = str(rng.choice(sensors)), str(rng.choice(channels))
        return [(name, None if name == "sensor_misalignment" else channel)]
    if kind == "law":
        return [(laws.names(rng), None)]
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
        wanted = names or names_to_hide(rng, kind, experiment.channels, whole, experiment.cannot_judge)
        if not wanted:
            return [], []
        hidden = [
            draw_effect(rng, name, experiment, jacobians, log_uniform(rng, faint, clear), channel)
            for name, channel in wanted
        ]
        found = clarity.signals(with_past_contact(experiment, hidden), hidden)
        score = min(one.get("signal_after_others", one["signal_after_nuisance"]) for one in found)
        if kind in ("unknown", "law"):  # a strange effect that one of the catalogue imitates is no question
            found[0]["imitations"] = rivals_of(experiment, hidden, 0, whole)
            score = min([score, *found[0]["imitations"].values()])
        if not names and not stays_in_track(experiment.runs, experiment.eta, experiment.gamma, hidden):
            continue
        if score > best_score:
            best, best_score = (hidden, found), score
        if score > 0.7 * faint:
            break
    return best
