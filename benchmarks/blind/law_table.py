# SPDX-License-Identifier: Apache-2.0
"""What became of unknown forces that follow a law, as tables."""

from __future__ import annotations

import numpy as np
from peers.law_versus import MINE
from peers.laws import LAW_PEERS

from .judge_law import INTERVAL

SORTS = {"inside": "of the list", "two": "products of two variables", "outside": "outside the list", None: "all"}
HEAD = ["laws", "number", "verdict unknown", "coordinate and variables", "in the set", "alone", "a false law",
        "none", "parameters in 95 % intervals", "unseen error, law over table: median, at most 1"]  # fmt: skip
#: An error on unseen runs counts as no larger than another within this part.
ALIKE = 1.01


def laws(rows: list[dict], clear: list[dict]) -> list[str]:
    """The lines of a Markdown table, one for each sort of law, of all and of the clear ones; none where there are no
    rows."""
    if not rows:
        return []
    found = [HEAD, ["---"] * len(HEAD)]
    for kind, of_kind in (("", rows), ("clear, ", clear)):
        for sort, title in SORTS.items():
            if mine := [r for r in of_kind if sort is None or r["law"]["sort"] == sort]:
                found.append([kind + title, *_counts(mine)])
    return [f"| {' | '.join(str(x) for x in row)} |" for row in found]


def versus(rows: list[dict]) -> list[str]:
    """The lines of a Markdown table of the table, its first law and the peers' formulas in the same campaigns; none
    where there are no rows."""
    if not rows:
        return []
    head = ["in a table's place", "a formula", "right form", "unseen error over the table's: median", "at most 1",
            "terms, median", "processor time, median (s)", "and of the refit"]  # fmt: skip
    found = [head, ["---"] * len(head)]
    for name in (MINE, *LAW_PEERS.values()):
        told = [(r, a) for r in rows if (a := _answer(r, name))]
        known = [a["right"] for _, a in told if a["right"] is not None]
        asked = [r for r in rows if r["law"]["sort"] != "outside"]
        ratios = [a["error"] / r["error"] for r, a in told]
        middle = {key: [a[key] for _, a in told if a.get(key) is not None] for key in ("terms", "cpu", "refit")}
        found.append([
            name, f"{len(told)} of {len(rows)}", f"{sum(known)} of {len(asked)}" if asked else "",
            f"{np.median(ratios):.2f}" if ratios else "", f"{sum(x <= ALIKE for x in ratios)} of {len(ratios)}",
            *(f"{np.median(x):.{digits}f}" if x else "" for x, digits in zip(middle.values(), (0, 1, 1), strict=True)),
        ])  # fmt: skip
    return [f"| {' | '.join(row)} |" for row in found]


def _answer(row: dict, name: str) -> dict | None:
    """What the package or a peer gave in a campaign, with its error on unseen runs; None where it gave no formula."""
    answer = row["law_peers"].get(name)
    if answer is not None and name == MINE:
        return {**answer, "error": row["law"]["errors"][1]}
    return answer if answer is not None and answer["error"] is not None else None


def _counts(rows: list[dict]) -> list[str]:
    told = [r["law"] for r in rows]
    n = len(rows)

    def of(hits: list[bool]) -> str:
        return f"{sum(hits)} of {len(hits)}"

    known = [law for law in told if law["sort"] != "outside"]
    off = [abs(z) <= INTERVAL for law in told for z in law["off"].values()]
    ratios = [law["errors"][1] / law["errors"][0] for law in told if law["errors"]]
    return [
        str(n),
        of([r["verdict"] == "unknown_effect" for r in rows]),
        of([law["variables"] for law in told]),
        of([law["in_set"] for law in known]) if known else "",
        of([law["in_set"] and len(law["proposed"]) == 1 for law in known]) if known else "",
        of([law["false"] for law in told]),
        of([not law["proposed"] for law in told]),
        of(off) if off else "",
        f"{np.median(ratios):.2f}, {of([r <= ALIKE for r in ratios])}" if ratios else "",
    ]
