# SPDX-License-Identifier: Apache-2.0
"""Whether a proposed law is the one that a campaign hides: coordinate, variables, form, parameters, and its error on
unseen runs beside that of the table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.factor import Factor
from inductrack_ros.diagnosis.laws.code import Written
from inductrack_ros.diagnosis.laws.forms import FORMS, Form, Range
from inductrack_ros.diagnosis.laws.structure import laid

from .judge import heldout_error

#: A diagnosis that found nothing at all, for one that crashed.
NOTHING = SimpleNamespace(unknown=None, laws=None)
#: Half of a 95 % interval, in standard deviations.
INTERVAL = 1.96


def judge_law(truth: dict, found, heldout: Path, error_with_table: float) -> dict:
    """What became of the law that is hidden; ``heldout`` are the unseen runs.

    ``variables``: coordinate and all variables right; ``proposed``: names of the laws; ``in_set``: the true one is
    among them; ``false``: laws are proposed and it is not; ``off``: how many standard deviations each of its
    parameters is off; ``errors`` on unseen runs over noise, with the table and with the first law."""
    hidden = hidden_law(truth)
    said = found.unknown
    proposed = () if found.laws is None else found.laws.proposed
    names = law_names(hidden)
    mine = next((law for law in proposed if law.name in names), None)
    errors = None
    if proposed:
        errors = [error_with_table, heldout_error(heldout, as_table(found), truth["plan"]["noise"])]
    return {
        "sort": hidden["law"]["sort"],
        "name": names[0],
        "coordinate": said is not None and said.channel == hidden["channel"],
        "variables": said is not None
        and said.channel == hidden["channel"]
        and set(said.depends_on) == set(hidden["depends_on"]),
        "proposed": [law.name for law in proposed],
        "in_set": mine is not None,
        "false": bool(proposed) and mine is None,
        "off": _off(mine, hidden["law"]["parameters"]) if mine is not None and mine.name == names[0] else {},
        "errors": errors,
    }


def hidden_law(truth: dict) -> dict | None:
    """The unknown force of a truth that follows a drawn law; None where there is none."""
    return next((u for u in truth.get("unknown", []) if "law" in u), None)


def law_names(hidden: dict) -> list[str]:
    """What the package would call the effect of a hidden law; a product in proportion to both may be told the other way
    round."""
    law, (variable, *others) = hidden["law"], hidden["depends_on"]
    if not others:
        return [f"proposed_{law['form']}_{hidden['channel']}_on_{variable}"]
    other, power = others[0], law["power"]
    names = [f"{law['form']}_{hidden['channel']}_on_{variable}_times_{other}{'_squared' if power == 2 else ''}"]
    if law["form"] == "linear":
        turned = {1: "linear", 2: "quadratic"}[int(power)]
        names.append(f"{turned}_{hidden['channel']}_on_{other}_times_{variable}")
    return [f"proposed_{n}" for n in names]


def as_table(found) -> Model:
    """The model with the first law in the table's place."""
    name = next(n for n in found.model.effects if n.startswith("stand_in"))
    law, about = found.laws.proposed[0], found.model.effects[name]
    model = found.laws.model
    without = replace(
        model, effects={n: v for n, v in model.effects.items() if n != law.name}, effect_files=found.model.effect_files
    )
    return with_force(without, name, about, *first_law(found))


def first_law(found) -> tuple[Form, dict[str, float]]:
    """The form of the first law and its parameters."""
    law, name = found.laws.proposed[0], next(n for n in found.model.effects if n.startswith("stand_in"))
    form = next(f for f in FORMS if law.name.startswith(f"proposed_{f.name}_{name.removeprefix('stand_in_')}_on_"))
    return form, {p: v for p, (v, _, _) in law.parameters.items()}


def with_force(model: Model, name: str, about: Mapping, form: Form, values: Mapping[str, float]) -> Model:
    """The model with a form in the place of a stand-in of this name, whose table was ``about``, as a table so fine that
    it is the form: nothing is compiled.

    It goes on for half the range beyond the data; there a table of the diagnosis is constant."""
    low, length = about["start"], about["step"] * (about["knots"] - 1)
    covered = Range(low - 0.5 * length, low + 1.5 * length)
    written = Written(form, "", "", values, covered, factor=Factor.of(about))
    return replace(model, effects={**model.effects, name: dict(about) | laid(written)})


def _off(law, parameters: dict[str, float]) -> dict[str, float]:
    """Deviations of a law's parameters from the truth over their standard deviations."""
    found = {}
    for name, true in parameters.items():
        value, std, _ = law.parameters[name]
        off = value - true
        if name == "phase":
            off = (off + math.pi) % (2 * math.pi) - math.pi
        found[name] = off / std if std > 0 else math.inf
    return found


def law_line(law: dict) -> str:
    """What became of a law, for the line of its campaign."""
    outcome = "in the set" if law["in_set"] else "FALSE LAW" if law["false"] else "none proposed"
    errors = "" if law["errors"] is None else f", unseen {law['errors'][1]:.3g} for {law['errors'][0]:.3g}"
    far = [f"{n} {z:+.1f}" for n, z in law["off"].items() if abs(z) > INTERVAL]
    where = "" if law["variables"] else ", other variables"
    names = ", ".join(n.removeprefix("proposed_") for n in law["proposed"])
    return f"{law['sort']} {law['name'].removeprefix('proposed_')}: {outcome}{where} ({names}){errors}{far or ''}"
