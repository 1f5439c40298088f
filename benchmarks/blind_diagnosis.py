# SPDX-License-Identifier: Apache-2.0
"""Blind benchmark of the diagnosis: campaigns drawn at random and made by a simulator that shares nothing with the
library.

    python benchmarks/blind_diagnosis.py --campaigns 60 --seed 1000 [--kind nothing] [--whole] [--peers] [--output
    build/diagnosis.json]

Prints each campaign as it is done, then the confusion of verdicts, the part that is right, the false-alarm rate, the
coverage of the 95 % intervals, the error on runs never seen from their exact initial states, and the time. With
``--peers`` the same campaigns are put to what users of other tools would do (`peers`), judged alike."""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "test"))

import peers  # noqa: E402
from independent import campaigns  # noqa: E402

from inductrack_ros.core.model import Model  # noqa: E402
from inductrack_ros.data import Campaign, load_campaign  # noqa: E402
from inductrack_ros.diagnosis.diagnose import diagnose  # noqa: E402
from inductrack_ros.estimation.problem import Problem  # noqa: E402
from inductrack_ros.estimation.structure import Structure  # noqa: E402
from inductrack_ros.workers import workers  # noqa: E402

#: Signal over noise, nuisance refitted, above which an effect counts as clear.
CLEAR = 30.0


def judge(truth: dict, found) -> dict:
    """Whether a diagnosis is right: the verdict, every effect (or its named twin), the unknown's coordinate and
    variable."""
    named = {n: {n, *found.indistinguishable.get(n, ())} for n in found.effects}
    wanted = list(truth["effects"])
    missed = [w for w in wanted if not any(w in group for group in named.values())]
    extra = [n for n, group in named.items() if not group & set(wanted)]
    right = found.verdict == truth["verdict"] and not missed and not extra
    where = True
    if truth["verdict"] == "unknown_effect" and found.unknown is not None:
        where = any(
            found.unknown.channel == u["channel"] and set(found.unknown.depends_on) & set(u["depends_on"])
            for u in truth["unknown"]
        )
    return {"right": right and where, "missed": missed, "extra": extra, "verdict": found.verdict}


def off(truth: dict, found) -> dict[str, float]:
    """For each parameter that was found and is known: how many of its standard deviations it is off the truth."""
    result = {}
    for name, value in truth["parameters"].items():
        if name in found.parameters and isinstance(value, (int, float)):
            estimate, std = found.parameters[name]
            if np.isfinite(std) and std > 0 and not name.startswith("guideway_waviness.phase"):
                result[name] = (estimate - value) / std
    return result


def heldout_error(folder: Path, model: Model, noise: dict[str, float]) -> float:
    """RMS error over noise on unseen runs from their exact initial states."""
    campaign = load_campaign(folder)
    problem = Problem(campaign, model, noise)
    rest = np.concatenate(problem.residuals(Structure(model, ()), np.zeros(0), [d.guess for d in problem.runs]))
    rest = rest[np.isfinite(rest)]
    return float(np.sqrt(np.mean(rest**2)))


def ask_peers(campaign: Campaign, truth: dict) -> dict[str, dict]:
    """What each peer finds, judged as the diagnosis is."""
    answers = {}
    for name in peers.PEERS:
        began = time.perf_counter()
        try:
            found = peers.ask(name, campaign, Model.default())
            answer = {**judge(truth, found), "found": list(found.effects)}
        except ImportError as error:
            raise SystemExit(f"--peers: {error}; pip install -e '.[benchmark]'") from error
        except Exception as error:
            answer = {"right": False, "verdict": f"{type(error).__name__}: {error}", "found": []}
        answers[name] = {**answer, "seconds": time.perf_counter() - began}
    return answers


def run(seed: int, kind: str | None, with_peers: bool = False, whole: bool = False) -> dict:
    """One campaign, drawn (of the ``whole`` catalogue), diagnosed and judged; ``with_peers`` by the peers too."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "blind"
        truth = campaigns.write_campaign(folder, seed, kind=kind, whole=whole)
        campaign = load_campaign(folder)
        beside = {"peers": ask_peers(campaign, truth)} if with_peers else {}
        began = time.perf_counter()
        try:
            found = diagnose(campaign, Model.default())
        except Exception as error:  # a crash is a wrong answer with a reason, not the end of the benchmark
            return {
                "seed": seed,
                "kind": truth["kind"],
                "right": False,
                "verdict": f"{type(error).__name__}: {error}",
                "seconds": time.perf_counter() - began,
                # Fmt: skip.
                "truth": truth["verdict"],
                "effects": truth["effects"],
                "found": [],
                "off": {},
                "clarity": 0.0,
                "error": None,
                "samples": 0,
                **beside,
            }
        seconds = time.perf_counter() - began
        clarity = [c["signal_after_nuisance"] for c in truth.get("clarity", {}).values()]
        return {
            "seed": seed,
            "kind": truth["kind"],
            **judge(truth, found),
            "truth": truth["verdict"],
            "effects": truth["effects"],
            "unknown": [(u["channel"], u["depends_on"]) for u in truth.get("unknown", [])],
            "found": list(found.effects),
            "twins": {k: list(v) for k, v in found.indistinguishable.items()},
            "found_unknown": None if found.unknown is None else [found.unknown.channel, list(found.unknown.depends_on)],
            "off": off(truth, found),
            "seconds": seconds,
            "clarity": min(clarity, default=0.0),
            "design": truth["plan"]["design"],
            "error": heldout_error(Path(f"{folder}.heldout"), found.model, truth["plan"]["noise"]),
            "samples": int(sum(r.measured.sum() for r in campaign.runs)),
            **beside,
        }


def summary(rows: list[dict]) -> str:
    """The table for the docs."""
    lines = ["| kind | campaigns | right | of the clear ones |", "|---|---|---|---|"]
    for kind in [*campaigns.KINDS, None]:
        mine = [r for r in rows if kind is None or r["kind"] == kind]
        if mine:
            clear = [r for r in mine if r["truth"] == "adequate" or r["clarity"] >= CLEAR]
            lines.append(
                f"| {kind or 'all'} | {len(mine)} | {sum(r['right'] for r in mine)} | {sum(r['right'] for r in clear)}"
                f" of {len(clear)} |"
            )
    confusion = Counter((r["truth"], r["verdict"]) for r in rows)
    lines += ["", "| truth | verdict | campaigns |", "|---|---|---|"]
    lines += [f"| {t} | {v[:60]} | {n} |" for (t, v), n in sorted(confusion.items())]
    nothing = [r for r in rows if r["truth"] == "adequate"]
    hits = [abs(z) <= 1.96 for r in rows if r["right"] for z in r["off"].values()]
    errors = [r["error"] for r in rows if r["right"] and r["truth"] != "unknown_effect" and r["error"] is not None]
    lines += ["", f"false alarms: {sum(r['verdict'] != 'adequate' for r in nothing)} of {len(nothing)} complete models"]
    if hits:
        lines.append(f"95 % intervals that hold the truth: {100 * np.mean(hits):.1f} % of {len(hits)}")
    if errors:
        lines.append(f"error on unseen runs over noise: median {np.median(errors):.3f}, largest {max(errors):.3f}")
    lines.append(
        f"time: median {statistics.median(r['seconds'] for r in rows):.0f} s, longest"
        f" {max(r['seconds'] for r in rows):.0f} s"
    )
    return "\n".join(lines + versus([r for r in rows if "peers" in r]))


def versus(rows: list[dict]) -> list[str]:
    """The diagnosis and its peers in one table: right by kind, false alarms, time."""
    if not rows:
        return []
    methods = {"this package": rows}
    methods |= {
        name: [{"kind": r["kind"], "truth": r["truth"]} | r["peers"][name] for r in rows] for name in rows[0]["peers"]
    }
    lines = ["", f"| | campaigns | {' | '.join(methods)} |", "|---" * (2 + len(methods)) + "|"]

    def count(label: str, counted: Callable[[dict], bool], what: Callable[[dict], bool]) -> None:
        counts = [[what(r) for r in m if counted(r)] for m in methods.values()]
        if counts[0]:
            lines.append(f"| {label} | {len(counts[0])} | {' | '.join(str(sum(c)) for c in counts)} |")

    for kind in [*campaigns.KINDS, None]:
        count(f"right: {kind or 'all'}", lambda r, kind=kind: kind in (None, r["kind"]), lambda r: r["right"])
    count("false alarms", lambda r: r["truth"] == "adequate", lambda r: r["verdict"] != "adequate")
    count(
        "all true effects, with others",
        lambda r: r["truth"] == "missing_effect",
        lambda r: r.get("missed") == [] and r["extra"] != [],
    )
    times = [[r["seconds"] for r in m] for m in methods.values()]
    lines.append(
        f"| time, median / longest (s) | | {' | '.join(f'{statistics.median(s):.0f} / {max(s):.0f}' for s in times)} |"
    )
    return lines


def main() -> None:
    """Draw, diagnose, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1000, help="of the first campaign; the others follow")
    parser.add_argument("--kind", choices=campaigns.KINDS)
    parser.add_argument(
        "--whole",
        action="store_true",
        help="the effects of November 2026 are among those hidden, runs on warm and cold days",
    )
    parser.add_argument(
        "--peers", action="store_true", help="PySINDy's weak form and a stepwise BIC on the same campaigns too"
    )
    parser.add_argument("--output", type=Path, help="write all results as JSON too")
    parser.add_argument(
        "--scheduler",
        metavar="tcp://…",
        help="a campaign to each worker of this dask scheduler; they need this checkout at this path",
    )
    given = parser.parse_args()

    def task(seed: int) -> dict:
        sys.path.insert(0, str(ROOT / "benchmarks"))
        import blind_diagnosis  # by name, for a worker does not have this as its main program

        return blind_diagnosis.run(seed, given.kind, given.peers, given.whole)

    seeds = range(given.seed, given.seed + given.campaigns)
    with workers(given.scheduler) as hands:
        report(given, hands.stream(task, seeds) if given.scheduler else map(task, seeds))


def report(given: argparse.Namespace, found: Iterable[dict]) -> None:
    """Print each campaign as it is done, then the summary."""
    rows = []
    for row in found:
        rows.append(row)
        seed = row["seed"]
        mark = "right" if row["right"] else "WRONG"
        print(
            f"{seed} {mark} {row['kind']}: {row['effects']} {row.get('unknown')} -> {row['verdict'][:150]}"
            f" {row['found']} {row.get('twins')} {row.get('found_unknown')} "
            # Fmt: skip.
            f"clarity {row['clarity']:.0f} error {row['error']} {row['seconds']:.0f} s {row['samples']} samples",
            flush=True,
        )
        for name, answer in row.get("peers", {}).items():
            print(
                f"     {name}: {'right' if answer['right'] else 'WRONG'} {answer['verdict'][:150]} {answer['found']}"
                f" {answer['seconds']:.0f} s",
                flush=True,
            )
        if given.output:
            given.output.parent.mkdir(parents=True, exist_ok=True)
            given.output.write_text(json.dumps(rows, indent=1, default=str))
    print("\n" + summary(rows))


if __name__ == "__main__":
    main()
