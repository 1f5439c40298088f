# SPDX-License-Identifier: Apache-2.0
"""The catalogue of effects as a table, from their declarations: ``python -m inductrack_ros.core.effects_table``."""

from __future__ import annotations

from collections.abc import Iterable

from .effects import Effect, catalogue
from .parameters import Parameter

HEAD = "| name | what it does | acts on | parameters |\n|---|---|---|---|"


def _parameter(name: str, declared: Parameter) -> str:
    unit = f" {declared.unit}" if declared.unit else ""
    size = f", up to {declared.count}" if declared.count > 1 else ""
    low, high = (f"{bound:g}".replace("inf", "∞") for bound in (declared.low, declared.high))
    default = f"{declared.default:g}".replace("inf", "∞")
    meaning = declared.meaning.replace("|", r"\|")
    return f"`{name}`{size}: {meaning}; {low} … {high}{unit}, default {default}"


def _acts_on(item: Effect) -> str:
    found = [
        (action, targets)
        for part in item.parts
        for action, targets in (("adds to", part.adds), ("changes", part.changes))
        if targets
    ]
    return "; ".join(f"{action} {', '.join(f'`{t}`' for t in targets)}" for action, targets in found)


def rows(effects: Iterable[Effect]) -> list[str]:
    """One Markdown row for each effect."""
    table = []
    for item in effects:
        name = f"{item.name}:CHANNEL" if item.of_channel else item.name
        acts_on = _acts_on(item) + (f" ({item.only} drive only)" if item.only else "")
        own = "<br>".join(_parameter(n, p) for n, p in item.parameters.items()) or "none"
        table.append(f"| `{name}` | {item.summary.replace('|', chr(92) + '|')} | {acts_on} | {own} |")
    return table


def text() -> str:
    """The table of what a diagnosis chooses from: the cradle's effects, then the sensors'."""
    effects = sorted((e for e in catalogue().values() if e.screened), key=lambda e: e.of_sensor)
    return "\n".join([HEAD, *rows(effects)])


if __name__ == "__main__":
    print(text())
