# SPDX-License-Identifier: Apache-2.0
"""Whether a proposed law is the one that a campaign hides: coordinate, variables, form, parameters, and its error on
unseen runs beside that of the table."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.laws.result import MODEL_FILE

from .judge import heldout_error

#: Half of a 95 % interval, in standard deviations.
INTERVAL = 1.96


def judge_law(truth: dict, found, heldout: Path, error_with_table: float) -> dict:
    """What became of the law that is hidden; ``heldout`` are the unseen runs.

    ``variables``: coordinate and all variables right; ``proposed``: names of the laws; ``in_set``: the true one is
    among them; ``false``: laws are proposed and it is not; ``off``: how many standard deviations each of its
    parameters is off; ``errors`` on unseen runs over noise, with the table and with the first law."""
    hidden = next(u for u in truth["unknown"] if "law" in u)
    said = found.unknown
    proposed = () if found.laws is None else found.laws.proposed
    name = law_name(hidden)
    mine = next((law for law in proposed if law.name == name), None)
    errors = None
    if proposed:
        with tempfile.TemporaryDirectory() as folder:
            found.laws.write(Path(folder), "")
            model = Model.load(Path(folder) / MODEL_FILE)
            errors = [error_with_table, heldout_error(heldout, model, truth["plan"]["noise"])]
    return {
        "sort": hidden["law"]["sort"],
        "name": name,
        "coordinate": said is not None and said.channel == hidden["channel"],
        "variables": said is not None
        and said.channel == hidden["channel"]
        and set(said.depends_on) == set(hidden["depends_on"]),
        "proposed": [law.name for law in proposed],
        "in_set": mine is not None,
        "false": bool(proposed) and mine is None,
        "off": _off(mine, hidden["law"]["parameters"]) if mine is not None else {},
        "errors": errors,
    }


def law_name(hidden: dict) -> str:
    """What the package would call the effect of a hidden law."""
    law, (variable, *others) = hidden["law"], hidden["depends_on"]
    powers = {1.0: "", 2.0: "_squared"}
    times = f"_times_{others[0]}{powers[law['power']]}" if others else ""
    return f"proposed_{law['form']}_{hidden['channel']}_on_{variable}{times}"


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
