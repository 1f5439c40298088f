# SPDX-License-Identifier: Apache-2.0
"""What became of unknown forces that follow a law, as a table."""

from __future__ import annotations

import numpy as np

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
