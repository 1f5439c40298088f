# SPDX-License-Identifier: Apache-2.0
"""What campaign.yaml says of a run against what its samples say: the initial state, and conditions that take a
parameter's place; and its limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.model import Model
from ..core.parameters import PARAMETERS
from ..core.state import RATES, UNITS
from ..data import Campaign, Run
from . import levels
from .balance import stops
from .finding import IMPOSSIBLE, WARNING, Finding, number
from .noise import meant
from .noise_found import Channel
from .room import room_of

#: Conditions in °C that effects of the catalogue ask for.
TEMPERATURES = ("track_temperature", "magnet_temperature")
#: Samples at a run's beginning from which the state there is taken, by a parabola.
FIRST = 9
#: A stated number is off by so many standard deviations of what the samples say: from here on it is said; it is
#: significant itself.
OFF, SURE = 10.0, 30.0


def stated(campaign: Campaign, channels: Mapping[str, Channel], model: Model | None) -> list[Finding]:
    """Findings about every run's initial state and conditions, alike ones of several runs once; and about limits."""
    limits = _limits(campaign, channels, model) if model else []
    found = [f for run in campaign.runs for f in (*_states(run, channels), *(_conditions(run, model) if model else ()))]
    first = {(f.kind, f.severity, f.channel): f for f in reversed(found)}
    return limits + [f for f in found if f is first[f.kind, f.severity, f.channel]]


def _limits(campaign: Campaign, channels: Mapping[str, Channel], model: Model) -> list[Finding]:
    """Limits that hold nothing: far outside of what the track leaves, or wholly apart from what the runs did."""
    findings, rooms = [], room_of(model) if stops(model) else {}
    for state, (low, high) in campaign.limits.ranges.items():
        unit, about = UNITS.get(state, "A"), channels.get(state)
        reach = max(abs(low), abs(high))
        text = f"limits: {state} may go from {number(low)} to {number(high)} {unit}"
        if state in rooms and reach > levels.OUTSIDE * rooms[state]:
            remedy = "is it in degrees or mrad?" if state == "roll" else "is it in mm?"
            text += f", where the track leaves it {number(rooms[state])} {unit}"
        elif about is not None and (high < about.low or low > about.high):
            remedy = "is its unit another?"
            text += f", and the runs went from {number(about.low)} to {number(about.high)} {unit}, outside of it"
        else:
            continue
        remedy = f"limits are in SI units: {remedy} A proposed run keeps to them"
        findings.append(Finding("limits", WARNING, text, remedy, state, size={"least": low, "most": high}))
    return findings


def _states(run: Run, channels: Mapping[str, Channel]) -> list[Finding]:
    findings = []
    for state, value in run.initial_state.items():
        begins = _beginning(run, state, channels)
        if begins is None or abs(value - begins[0]) < OFF * begins[1]:
            continue
        there, deviation = begins
        size = {"stated": value, "measured": there}
        text = (
            f"initial_state of {run.file.name} says {state} {number(value, 4)} {UNITS[state]}, where its samples begin"
            f" at {number(there, 4)} {UNITS[state]}"
        )
        factor = value / there if there else np.inf
        if max(abs(value), abs(there)) > SURE * deviation and not 1 / levels.UNIT < factor < levels.UNIT:
            hint = meant(abs(factor), UNITS[state]) if 0 < abs(factor) < np.inf else ""
            remedy = (
                f"is it in {hint} instead of {UNITS[state]}?"
                if hint
                else "correct it, or leave it out to have it estimated"
            )
            findings.append(Finding("initial_state", IMPOSSIBLE, text, remedy, state, run.name, size=size))
        else:
            findings.append(
                Finding("initial_state", WARNING, text, "leave it out to have it estimated", state, run.name, size=size)
            )
    return findings


def _beginning(run: Run, state: str, channels: Mapping[str, Channel]) -> tuple[float, float] | None:
    """A state at a run's first sample and its standard deviation, from its own channel, of a rate else from its
    coordinate's."""
    of = state if state in run.channels else state.removesuffix("_rate")
    about = channels.get(of)
    if about is None or of not in run.channels:
        return None
    times, values = (y[:FIRST] for y in run.samples(of))
    if len(times) < FIRST or times[0] > 0.0:
        return None
    length = float(times[-1])
    basis = np.vander(times / length, 3, increasing=True)
    inverse = np.linalg.pinv(basis)
    row = inverse[1] / length if of != state and state in RATES else inverse[0]
    left = values - basis @ (inverse @ values)
    noise = max(about.scatter, float(np.sqrt(left @ left / (FIRST - 3))))
    return float(row @ values), float(noise * np.sqrt(row @ row))


def _conditions(run: Run, model: Model) -> list[Finding]:
    findings = []
    for name, value in run.conditions.items():
        if name in TEMPERATURES and value > levels.HOTTEST:
            text = f"conditions of {run.file.name} say {name} {number(value, 4)} °C"
            remedy = f"is it in kelvin? {number(value, 5)} K are {number(value - 273.15, 4)} °C"
            findings.append(Finding("condition", IMPOSSIBLE, text, remedy, name, run.name, size={"stated": value}))
        usual = model.parameters.get(name) if name in PARAMETERS else None
        if usual and value and not 1 / levels.NOISE_IMPOSSIBLE < value / usual < levels.NOISE_IMPOSSIBLE:
            unit = PARAMETERS[name].unit
            text = (
                f"conditions of {run.file.name} say {name} {number(value, 4)} {unit}, {number(value / usual)} times the"
                f" model's {number(usual, 4)} {unit}"
            )
            findings.append(
                Finding(
                    "condition",
                    IMPOSSIBLE,
                    text,
                    "conditions are in SI units; correct it",
                    name,
                    run.name,
                    size={"stated": value, "model": usual},
                )
            )
    return findings
