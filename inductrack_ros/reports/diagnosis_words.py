# SPDX-License-Identifier: Apache-2.0
"""A diagnosis in words: its verdict in one sentence, and the names and sizes of effects and parameters."""

from __future__ import annotations

import math

from ..core.effects import split_name
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import CHANNELS
from ..diagnosis.result import OF_THRUST, Diagnosis, Step, Unknown
from .words import effect_name, listed, number, ratio, sized, title

_FORCE = {
    "surge": "a force along the track",
    "sway": "a lateral force",
    "heave": "a vertical force",
    "roll": "a roll moment",
}
DEPENDS = {
    "surge": ("the place along the track", "place along the track, m"),
    "sway": ("sway", "sway, m"),
    "heave": ("heave (the gap)", "heave, m"),
    "roll": ("roll", "roll, rad"),
    "surge_rate": ("speed", "speed, m/s"),
    "sway_rate": ("the sway rate", "sway rate, m/s"),
    "heave_rate": ("the heave rate", "heave rate, m/s"),
    "roll_rate": ("the roll rate", "roll rate, rad/s"),
    "time": ("time", "time since the run's start, s"),
    "drive": ("the drive current", "drive current, A"),
}


def verdict(result: Diagnosis) -> str:
    """The answer in one sentence."""
    found = [_with_rivals(result, e) for e in result.effects if not is_stand_in(e)]
    if result.unfinished:
        why = "Interrupted" if result.interrupted else "Out of time"
        return f"{why} while searching. Best found until then: {listed(found) or 'nothing yet'}."
    if result.verdict == "adequate":
        return f"Nothing detectable is missing: what the model leaves is the sensors' noise{_besides(result)}."
    if result.verdict == "missing_effect":
        return (
            f"Missing: {listed(found)}. With {'it' if len(found) == 1 else 'them'}, what is left is"
            f" noise{_besides(result)}."
        )
    missing = f"Missing: {listed(found)}. "
    if result.unknown is None:
        return (
            f"{missing if found else ''}Something {'more ' if found else ''}is missing that no known effect explains."
        )
    what, _, on = law(result.unknown)
    depends = listed([DEPENDS[d][0] for d in on])
    force = f"{what}{f' that depends on {depends}' if depends else ''}{_peak(result.unknown)}"
    return (
        f"{missing}Besides, {force}, which no known effect explains." if found else f"No known effect explains {force}."
    ) + _proposed(result)


def _proposed(result: Diagnosis) -> str:
    """What became of the laws that were tried in place of an unknown force, in short."""
    if result.laws is None:
        return ""
    if not result.laws.proposed:
        return f" None of {result.laws.tried} closed forms describes it."
    titles = [law.title for law in result.laws.proposed]
    return (
        f" A law is proposed for it: {titles[0]}."
        if len(titles) == 1
        else f" Laws are proposed for it: {listed(titles, 'or')}."
    )


def _besides(result: Diagnosis) -> str:
    """What an answer leaves besides noise, by its findings."""
    kinds = {f.kind for f in result.findings}
    words = {
        "shaken": "what shakes the cradle",
        "run_to_run": "what differs from run to run",
        "bad_run": "one run that does not belong",
    }
    named = [text for kind, text in words.items() if kind in kinds]
    return f" and {listed(named)}" if named else ""


def addition(result: Diagnosis) -> str:
    """What adding one effect by hand gained, in one sentence."""
    (rival,) = result.rivals
    name = effect_name(rival.name)
    if not rival.chosen:
        return f"Adding {name} gains no more than chance would."
    before, after = (ratio(math.sqrt(s.reduced_chi2)) for s in (result.steps[0], result.steps[-1]))
    left = "more than noise is left" if result.verdict == "unknown_effect" else "what is left is noise"
    if result.steps[-1].reduced_chi2 > result.steps[0].reduced_chi2:
        return (
            f"Adding {name} gains more than chance would from sample to sample, but predicts no better: the error of"
            f" whole runs is {after} times the noise, {before} without; {left}."
        )
    return f"Adding {name} lowers the error from {before} to {after} times the noise; {left}."


def _with_rivals(result: Diagnosis, effect: str) -> str:
    rivals = result.indistinguishable.get(effect, ())
    if len(result.effects) > 1 and rivals:  # brackets, or "a or b and c" would be read in two ways
        return f"{effect_name(effect)} (or {listed([effect_name(r) for r in rivals], 'or')})"
    return listed([effect_name(e) for e in (effect, *rivals)], "or")


def law(unknown: Unknown) -> tuple[str, tuple[float, str], tuple[str, ...]]:
    """An unknown force in words, with the factor and unit it is shown in, and what it depends on besides the thrust it
    may change."""
    if unknown.unit == OF_THRUST:
        return "a change of the thrust", (100.0, "%"), unknown.depends_on[:1]
    return _FORCE[unknown.channel], (1.0, unknown.unit), unknown.depends_on


def _peak(unknown: Unknown) -> str:
    """`` (−12 N at 8 m)``; nothing where the curve is not known."""
    if not finite(unknown.peak):
        return ""
    _, (factor, unit), on = law(unknown)
    return (
        f" ({number(factor * unknown.peak, 2)} {unit} at {number(unknown.place, 2)}"
        f" {DEPENDS[on[0]][1].rpartition(', ')[2]})"
    )


def not_on(result: Diagnosis) -> str:
    rivals = [DEPENDS[r][0] if r in DEPENDS else r for r in result.unknown.rivals]
    return f"Nearly as well the data would fit one that depends on {listed(rivals, 'or')}." if rivals else ""


def most(first: Step, last: Step) -> str:
    """The channel whose error falls most, where the sum over all channels hides it."""
    falls = {c: e / last.errors[c] for c, e in first.errors.items() if last.errors.get(c) and finite(e)}
    if len(falls) < 2:
        return ""
    channel = max(falls, key=lambda c: falls[c])
    return f"; most in {title(channel).lower()}, from {ratio(first.errors[channel])} to {ratio(last.errors[channel])}"


def finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def is_stand_in(effect: str) -> bool:
    return effect.startswith("stand_in")


def full(effect: str, parameter: str) -> str:
    return parameter if "." in parameter else f"{effect}.{parameter}"


def shown_parameters(result: Diagnosis) -> list[str]:
    """Parameters with a meaning of their own: not the entries of a stand-in's table."""
    return [n for n in result.parameters if "[" not in n and not is_stand_in(n)]


def declared(result: Diagnosis, name: str) -> Parameter:
    effect, _, parameter = name.rpartition(".")
    if not effect:
        return PARAMETERS[name]
    item, channel = split_name(effect, result.model.known_effects, CHANNELS)
    return item.parameters[parameter].for_channel(channel) if channel else item.parameters[parameter]


def of_sensor(result: Diagnosis, name: str) -> bool:
    return result.model.known_effects[name.partition(":")[0]].of_sensor


def symbol(name: str) -> str:
    return name.rpartition(".")[2].replace("_", " ")


def full_symbol(name: str) -> str:
    return f"{effect_name(name.rpartition('.')[0])}: {symbol(name)}"


def size(result: Diagnosis, name: str) -> str:
    value, std = result.parameters[name]
    return sized(value, std, declared(result, name).unit)


def summary(result: Diagnosis, name: str) -> str:
    return split_name(name, result.model.known_effects, CHANNELS)[0].summary
