# SPDX-License-Identifier: Apache-2.0
"""Blind benchmark of the diagnosis: campaigns drawn at random and made by a simulator that shares nothing with the
library.

    python benchmarks/blind_diagnosis.py --campaigns 60 --seed 1000 --output build/diagnosis.json
    python benchmarks/blind_diagnosis.py --kind dirty --seed 31001            # as a rig logs them: spikes, shaking, …
    python benchmarks/blind_diagnosis.py --kind dirty --seed 31001 --twin     # the same campaigns without their dirt
    python benchmarks/blind_diagnosis.py --kind dirty_complete --seed 32001   # nothing is missing: false alarms
    python benchmarks/blind_diagnosis.py --kind dirty --dirt shaken --dirt spikes --campaigns 5
    python benchmarks/blind_diagnosis.py --kind law --seed 41001              # an unknown force by a law that is drawn
    python benchmarks/blind_diagnosis.py --kind law --seed 41001 --peers      # other tools on the same tables
    python benchmarks/blind_diagnosis.py --kind loop --seed 33001             # flown by this package's own controller
    python benchmarks/blind_diagnosis.py --peers | --perturb | --whole   # other tools; other last bits; all effects

Prints each campaign as it is done. Then, for ideal, dirty and loop campaigns: how many are right, false alarms, the
findings told of those expected, the coverage of the 95 % intervals and the processor time; how often each effect was
found beside the power of an ideal test; the confusion of verdicts; the error on runs never seen; of laws, what
docs/laws.md tells. With ``--peers`` the
same campaigns are put to what users of other tools would do (`peers`), judged alike; where a law is
hidden, to what they would make of the table that the diagnosis found (`peers.laws`). With ``--perturb`` each diagnosis
is made again of readings changed by 1e-12 of themselves."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path

from blind import ask, table
from blind.ask import Asked
from independent import dirt

from inductrack_ros.workers import workers


def main() -> None:
    """Draw, diagnose, judge, print."""
    given = arguments()
    asked = Asked(
        given.kind, given.whole, tuple(given.dirt or ()), given.twin, given.faint, given.peers, given.perturb,
        given.budget,
    )  # fmt: skip

    def task(seed: int) -> dict:
        sys.path.insert(0, str(Path(__file__).parent))
        from blind import ask  # by name, for a worker does not have this as its main program

        return ask.answer(seed, asked)

    seeds = range(given.seed, given.seed + given.campaigns)
    with workers(given.scheduler) as hands:
        report(given, hands.stream(task, seeds) if given.scheduler else map(task, seeds))


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1000, help="of the first campaign; the others follow")
    parser.add_argument("--kind", choices=ask.KINDS, help="what is hidden and how it is logged (default: ideal)")
    parser.add_argument("--dirt", action="append", choices=dirt.DIRTS, help="this dirt instead of drawn; repeatable")
    parser.add_argument("--twin", action="store_true", help="dirty campaigns without their dirt")
    parser.add_argument("--faint", type=float, default=15.0, help="the least signal over noise that is aimed at")
    parser.add_argument("--budget", type=float, default=math.inf, metavar="S", help="seconds for each diagnosis")
    parser.add_argument(
        "--whole",
        action="store_true",
        help="the effects of November 2026 are among those hidden, runs on warm and cold days",
    )
    parser.add_argument(
        "--peers",
        action="store_true",
        help="PySINDy's weak form and a stepwise BIC on the same campaigns too; of laws, formulas by other tools",
    )
    parser.add_argument(
        "--perturb", action="store_true", help="each diagnosis again of data changed by 1e-12 of themselves"
    )
    parser.add_argument("--output", type=Path, help="write all results as JSON too")
    parser.add_argument("--lines", type=Path, help="add each campaign's line to this file as it is done")
    parser.add_argument(
        "--scheduler",
        metavar="tcp://…",
        help="a campaign to each worker of this dask scheduler; they need this checkout at this path",
    )
    return parser.parse_args()


def report(given: argparse.Namespace, found: Iterable[dict]) -> None:
    """Print each campaign as it is done, then the summary."""
    rows = []
    for row in found:
        rows.append(row)
        line = ask.line(row)
        print(line, flush=True)
        if given.lines:
            with given.lines.open("a") as file:
                file.write(line + "\n")
        for name, answer in row.get("peers", {}).items():
            print(
                f"     {name}: {'right' if answer['right'] else 'WRONG'} {answer['verdict'][:150]} {answer['found']}"
                f" {answer['cpu']:.0f} s",
                flush=True,
            )
        for name, answer in row.get("law_peers", {}).items():
            right = {True: "right form", False: "OTHER FORM", None: "no form of the list"}[answer["right"]]
            error = f", unseen {answer['error']:.3g}" if answer.get("error") is not None else ""
            print(f"     {name}: {right}{error}; {answer['text'][:250]}", flush=True)
        if given.output:
            given.output.parent.mkdir(parents=True, exist_ok=True)
            given.output.write_text(json.dumps(rows, indent=1, default=str))
    print("\n" + table.summary(rows))


if __name__ == "__main__":
    main()
