# SPDX-License-Identifier: Apache-2.0
"""``make benchmark`` and ``make benchmark-check``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from . import growth, many_runs, node, one_run, refits
from .timing import machine

PARTS = {"run": one_run, "ensemble": many_runs, "refits": refits, "node": node, "growth": growth}
TITLES = {
    "run": "One run",
    "ensemble": "An ensemble",
    "refits": "Fit and diagnosis",
    "node": "The node",
    "growth": "Growth",
}
BASELINE = Path(__file__).with_name("baseline.json")
#: A ratio that falls below this part of the baseline's is a regression.
ALLOWED = 0.75
#: What the check measures, and takes two minutes.
CHECKED = ("run", "ensemble", "refits")


def ratios(found: dict) -> dict[str, float]:
    """How many times faster ours is than each peer, by part and peer."""
    flat = {}
    if "run" in found:
        flat |= {f"run: {n}": r["best"] for n, r in found["run"]["times_ours"].items()}
    for name, part in found.get("ensemble", {}).items():
        flat |= {f"ensemble, {name}: {n}": r["best"] for n, r in part["times_ours"].items()}
    if "refits" in found:
        flat["fit: least_squares"] = found["refits"]["fit"]["ratio"]
        if "diagnosis" in found["refits"]:
            flat["diagnosis: least_squares"] = found["refits"]["diagnosis"]["ratio"]
    if found.get("node"):
        flat["node: empty timer"] = found["node"]["ratio"]
    return flat


def worse(now: dict[str, float], before: dict[str, float]) -> list[str]:
    """What has fallen by more than a quarter."""
    return [
        f"{n}: {now[n]:.3g} times as fast, was {before[n]:.3g}"
        for n in before
        if n in now and now[n] < ALLOWED * before[n]
    ]


def main() -> int:
    """Measure, write, compare."""
    parser = argparse.ArgumentParser(
        prog="performance", description="Ours against its peers, in one run on this machine."
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument(
        "--output", type=Path, default=Path("build/performance.json"), help="JSON; a .md table beside it"
    )
    parser.add_argument("--quick", action="store_true", help="fewer repeats, no diagnosis, no bags")
    parser.add_argument(
        "--check", action="store_true", help="quick, and fail where a ratio is a quarter worse than the baseline's"
    )
    parser.add_argument("--baseline", action="store_true", help="quick, and make this the baseline")
    parser.add_argument("--bag-seconds", type=float, default=480.0, help="length of the longest bag; 3600 for the hour")
    given = parser.parse_args()
    quick = given.quick or given.check or given.baseline
    parts = CHECKED if given.check or given.baseline else given.parts
    found: dict = {"machine": machine()}
    text = ["Measured on " + ", ".join(f"{k} {v}" for k, v in found["machine"].items()) + "."]
    for name in parts:
        print(f"{TITLES[name]} …", file=sys.stderr, flush=True)
        found[name] = growth.measure(quick, given.bag_seconds) if name == "growth" else PARTS[name].measure(quick)
        if name == "growth":
            growth.plot(found[name])
        text += ["", f"### {TITLES[name]}", "", *PARTS[name].table(found[name])]
        given.output.parent.mkdir(parents=True, exist_ok=True)
        given.output.write_text(json.dumps(found, indent=1, default=str))
        given.output.with_suffix(".md").write_text("\n".join(text) + "\n")
    print("\n".join(text))
    if given.baseline:
        BASELINE.write_text(json.dumps({"machine": found["machine"], "ratios": ratios(found)}, indent=1) + "\n")
    if given.check:
        before = json.loads(BASELINE.read_text())
        problems = worse(ratios(found), before["ratios"])
        print(
            "\n"
            + (
                "\n".join(["slower than the baseline:", *problems])
                if problems
                else f"no ratio is a quarter worse than on {before['machine']['processor']}"
            )
        )
        return bool(problems)
    return 0


if __name__ == "__main__":
    sys.exit(main())
