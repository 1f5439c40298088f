# SPDX-License-Identifier: Apache-2.0
"""The tables that the blind benchmark prints."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable

import numpy as np
from independent import campaigns, hidden_effects
from scipy import stats

from inductrack_ros.diagnosis.settings import LEVEL

from . import law_table, loop
from .ask import KINDS

#: Signal over noise, nuisance refitted, above which an effect counts as clear.
CLEAR = 30.0
#: Kinds that have a line of their own; all others are ideal.
APART = (*campaigns.DIRTY, *loop.KINDS)


def summary(rows: list[dict]) -> str:
    """All tables for the docs."""
    blocks = [by_sort(rows), by_kind(rows), by_dirt(rows), confusion(rows), by_effect(rows), whole(rows)]
    of_law = [r for r in rows if "law" in r]
    blocks.append(law_table.laws(of_law, clear_ones(of_law)))
    blocks.append(law_table.versus([r for r in of_law if r.get("law_peers")]))
    blocks.append(versus([r for r in rows if "peers" in r]))
    return "\n\n".join("\n".join(b) for b in blocks if b)


def table(head: list[str], rows: list[list]) -> list[str]:
    """Lines of a Markdown table; none where there are no rows."""
    if not rows:
        return []
    return [f"| {' | '.join(str(x) for x in row)} |" for row in (head, ["---"] * len(head), *rows)]


def by_sort(rows: list[dict]) -> list[str]:
    """Ideal, dirty and loop campaigns side by side."""
    head = ["campaigns", "number", "right", "of the clear ones", "false alarms", "findings told", "told, not there",
            "95 % intervals with the truth", "processor time, median / longest (s)"]  # fmt: skip
    sorts = {"ideal": [r for r in rows if r["kind"] not in APART]}
    sorts |= {kind: [r for r in rows if r["kind"] == kind] for kind in APART}
    return table(head, [[name, *_of_sort(mine)] for name, mine in sorts.items() if mine])


def clear_ones(rows: list[dict]) -> list[dict]:
    """Rows whose truth can be seen: nothing is missing, or what is shows clearly."""
    return [r for r in rows if r["truth"] == "adequate" or r["clarity"] >= CLEAR]


def false_alarms(rows: list[dict]) -> str:
    """How many of the complete models were told to lack something."""
    complete = [r for r in rows if r["truth"] == "adequate"]
    return f"{sum(r['verdict'] != 'adequate' for r in complete)} of {len(complete)}"


def _of_sort(rows: list[dict]) -> list[str]:
    clear = clear_ones(rows)
    told = [r["findings"] for r in rows if r.get("findings")]
    hits = [abs(z) <= 1.96 for r in rows if r["right"] for z in r["off"].values()]
    cpu = [r["cpu"] for r in rows]
    return [
        str(len(rows)),
        str(sum(r["right"] for r in rows)),
        f"{sum(r['right'] for r in clear)} of {len(clear)}",
        false_alarms(rows),
        f"{sum(t['told'] for t in told)} of {sum(t['expected'] for t in told)}",
        f"in {sum(bool(t['not_there']) for t in told)}",
        f"{100 * np.mean(hits):.1f} % of {len(hits)}" if hits else "",
        f"{statistics.median(cpu):.0f} / {max(cpu):.0f}",
    ]


def by_kind(rows: list[dict]) -> list[str]:
    """Right, of all and of the clear ones, by what is drawn."""
    found = []
    for kind in [*KINDS, None]:
        mine = [r for r in rows if kind is None or r["kind"] == kind]
        clear = clear_ones(mine)
        if mine:
            right = f"{sum(r['right'] for r in clear)} of {len(clear)}"
            found.append([kind or "all", len(mine), sum(r["right"] for r in mine), right])
    return table(["kind", "campaigns", "right", "of the clear ones"], found)


def by_dirt(rows: list[dict]) -> list[str]:
    """Right, and findings told, by kind of dirt: alone, and with another beside it."""
    found = []
    for name in sorted({d for r in rows for d in r["dirt"]}):
        mine = [r for r in rows if name in r["dirt"]]
        alone, beside = ([r for r in mine if (len(r["dirt"]) == 1) == only] for only in (True, False))
        told = [r["findings"] for r in alone if r.get("findings")]
        false = sum(r["truth"] == "adequate" != r["verdict"] for r in mine)
        counts = [f"{sum(r['right'] for r in part)} of {len(part)}" for part in (alone, beside)]
        found.append([name, *counts, false, f"{sum(t['told'] for t in told)} of {sum(t['expected'] for t in told)}"])
    return table(["dirt", "right, alone", "right, beside another", "false alarms", "findings told, alone"], found)


def confusion(rows: list[dict]) -> list[str]:
    """How often each verdict was given for each truth."""
    counts = Counter((r["truth"], r["verdict"][:60]) for r in rows)
    return table(["truth", "verdict", "campaigns"], [[t, v, n] for (t, v), n in sorted(counts.items())])


def by_effect(rows: list[dict]) -> list[str]:
    """How often each effect was found, beside the power of a score test at the benchmark's level: with what the dirt
    leaves of the signal, and with the whole of it."""
    counts: dict[str, list[tuple[bool, float, float]]] = {}
    for r in rows:
        said = {n for f in r["found"] for n in (f, *r["twins"].get(f, ()))}
        family = len(hidden_effects.CATALOGUE) + len(hidden_effects.SENSORS) * r["channels"]
        for name, signal in r["signals"].items():
            if name in r["effects"]:
                powers = [power(s, family) for s in (signal, r["ideal"][name])]
                counts.setdefault(name.partition(":")[0], []).append((name in said, *powers))
    lines = [[n, len(c), *(f"{sum(x):.1f}".removesuffix(".0") for x in zip(*c, strict=True))]
             for n, c in sorted(counts.items())]  # fmt: skip
    return table(["effect", "hidden", "found", "expected of the best test", "expected on ideal data"], lines)


def power(signal: float, family: int) -> float:
    """Chance that χ² with one degree of freedom and non-centrality signal² passes the level shared by ``family``
    rivals."""
    return float(stats.ncx2.sf(stats.chi2.isf(LEVEL / family, 1), 1, max(signal, 1e-9) ** 2))


def whole(rows: list[dict]) -> list[str]:
    """What is said of all campaigns in a line each."""
    errors = [r["error"] for r in rows if r["right"] and r["truth"] != "unknown_effect" and r["error"] is not None]
    lines = [f"false alarms: {false_alarms(rows)} complete models"]
    if errors:
        lines.append(f"error on unseen runs over noise: median {np.median(errors):.3f}, largest {max(errors):.3f}")
    if asked := [r["same"] for r in rows if "same" in r]:
        lines.append(f"readings changed by 1e-12 of themselves: the same answer in {asked.count('')} of {len(asked)}")
    if cut := sum(bool(r.get("unfinished")) for r in rows):
        lines.append(f"out of the time allowed: {cut}")
    return lines


def versus(rows: list[dict]) -> list[str]:
    """The diagnosis and its peers in one table: right by kind, false alarms, time."""
    if not rows:
        return []
    methods = {"this package": rows}
    methods |= {
        name: [{"kind": r["kind"], "truth": r["truth"]} | r["peers"][name] for r in rows] for name in rows[0]["peers"]
    }
    lines = []

    def count(label: str, counted: Callable[[dict], bool], what: Callable[[dict], bool]) -> None:
        counts = [[what(r) for r in m if counted(r)] for m in methods.values()]
        if counts[0]:
            lines.append([label, len(counts[0]), *(sum(c) for c in counts)])

    for kind in [*KINDS, None]:
        count(f"right: {kind or 'all'}", lambda r, kind=kind: kind in (None, r["kind"]), lambda r: r["right"])
    count("false alarms", lambda r: r["truth"] == "adequate", lambda r: r["verdict"] != "adequate")
    count(
        "all true effects, with others",
        lambda r: r["truth"] == "missing_effect",
        lambda r: r.get("missed") == [] and r["extra"] != [],
    )
    times = [[r["cpu"] for r in m] for m in methods.values()]
    lines.append(["processor time, median / longest (s)", "",
                  *(f"{statistics.median(s):.0f} / {max(s):.0f}" for s in times)])  # fmt: skip
    return table(["", "campaigns", *methods], lines)
