# SPDX-License-Identifier: Apache-2.0
"""One campaign: drawn, diagnosed and judged, by the peers too where that is asked for."""

from __future__ import annotations

import os
import tempfile
import time
import traceback
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import peers
from independent import campaigns

from inductrack_ros.core.model import Model
from inductrack_ros.data import Campaign, load_campaign
from inductrack_ros.diagnosis.diagnose import diagnose

from . import law_peers, loop
from .judge import heldout_error, judge, judge_findings, off
from .judge_law import NOTHING, hidden_law, judge_law, law_line
from .last_bits import agrees

#: All that can be drawn.
KINDS = (*campaigns.KINDS, *campaigns.BESIDES, *campaigns.DIRTY, *loop.KINDS)


@dataclass(frozen=True)
class Asked:
    """What is drawn and what is done with it.

    ``whole``: the effects of November 2026 among those hidden; ``dirts``: kinds of dirt, drawn unless given; ``twin``:
    a dirty campaign without its dirt; ``faint``: the least signal over noise aimed at; ``peers``, ``perturb``: ask the
    peers (of laws where a law is hidden), ask again with other last bits; ``budget``: s for a diagnosis."""

    kind: str | None = None
    whole: bool = False
    dirts: tuple[str, ...] = ()
    twin: bool = False
    faint: float = 15.0
    peers: bool = False
    perturb: bool = False
    budget: float = np.inf


def draw(folder: Path, seed: int, asked: Asked) -> dict:
    """Write a campaign and its unseen runs; its truth."""
    if asked.kind in loop.KINDS:
        return loop.write_campaign(folder, seed, asked.kind, asked.faint)
    choices = {"kind": asked.kind, "whole": asked.whole, "dirts": list(asked.dirts) or None, "twin": asked.twin}
    return campaigns.write_campaign(folder, seed, faint=asked.faint, **choices)


def run(seed: int, kind: str | None = None, **more) -> dict:
    """One campaign, drawn, diagnosed and judged; ``more`` as `Asked` has it."""
    return answer(seed, Asked(kind, **more))


def answer(seed: int, asked: Asked) -> dict:
    """The row of one campaign: what was hidden, what was found, whether that is right, and at what cost."""
    with tempfile.TemporaryDirectory() as parent:
        folder = Path(parent) / "blind"
        truth = draw(folder, seed, asked)
        campaign = load_campaign(folder)
        row = _of_truth(seed, truth, campaign)
        if asked.peers and hidden_law(truth):
            law_peers.check()
        elif asked.peers:
            row["peers"] = ask_peers(campaign, truth)
        if hidden_law(truth):  # a diagnosis that crashes has found nothing
            row["law"] = judge_law(truth, NOTHING, Path(f"{folder}.heldout"), np.nan)
        model = Model.load(campaign.model) if campaign.model else Model.default()
        began, used = time.perf_counter(), time.process_time()
        try:
            with law_peers.overheard() as heard:
                found = diagnose(campaign, model, budget=asked.budget)
        except Exception as error:  # a crash is a wrong answer with a reason, not the end of the benchmark
            row |= {"verdict": f"{type(error).__name__}: {error} ({_where(error)})", "right": False}
            return row | {"seconds": time.perf_counter() - began, "cpu": time.process_time() - used}
        row |= {"seconds": time.perf_counter() - began, "cpu": time.process_time() - used}
        row |= judge(truth, found) | _of_answer(truth, found)
        row["error"] = heldout_error(Path(f"{folder}.heldout"), found.model, truth["plan"]["noise"])
        if hidden_law(truth):
            row["law"] = judge_law(truth, found, Path(f"{folder}.heldout"), row["error"])
            if asked.peers:
                row["law_peers"] = law_peers.ask_law_peers(heard, found, truth, Path(f"{folder}.heldout"))
        if asked.perturb:
            row["same"] = agrees(campaign, model, found, seed)
        return row


def _where(error: Exception) -> str:
    """The last line of this package that a crash went through."""
    frames = traceback.extract_tb(error.__traceback__)
    mine = [f for f in frames if "/inductrack_ros/" in f.filename] or frames
    return f"{mine[-1].filename.rpartition('/inductrack_ros/')[2]}:{mine[-1].lineno}"


def _of_truth(seed: int, truth: dict, campaign: Campaign) -> dict:
    signals = {n: c["signal_after_nuisance"] for n, c in truth.get("clarity", {}).items()}
    return {
        "seed": seed,
        "kind": truth["kind"],
        "truth": truth["verdict"],
        "effects": truth["effects"],
        "unknown": [(u["channel"], u["depends_on"]) for u in truth.get("unknown", [])],
        "dirt": [d["name"] for d in truth.get("dirt", [])],
        "signals": signals,
        "ideal": {n: c.get("ideal_signal", signals[n]) for n, c in truth.get("clarity", {}).items()},
        "clarity": min([*signals.values(), *_not_imitated(truth)], default=0.0),
        "design": truth["plan"]["design"],
        "samples": int(sum(r.measured.sum() for r in campaign.runs)),
        "channels": len(campaign.channels),
        # of a diagnosis that gives no answer
        "found": [], "twins": {}, "found_unknown": None, "off": {}, "error": None,
    }  # fmt: skip


def _not_imitated(truth: dict) -> list[float]:
    """What the nearest known effect leaves of a law that is hidden."""
    left = [c["imitations"].values() for c in truth.get("clarity", {}).values() if "imitations" in c]
    return [min(x) for x in left if x] if hidden_law(truth) else []


def _of_answer(truth: dict, found) -> dict:
    return {
        "found": list(found.effects),
        "twins": {k: list(v) for k, v in found.indistinguishable.items()},
        "found_unknown": None if found.unknown is None else [found.unknown.channel, list(found.unknown.depends_on)],
        "off": off(truth, found),
        "findings": judge_findings(truth, found.findings),
        "unfinished": found.unfinished,
        "p": found.p_value,
    }


def ask_peers(campaign: Campaign, truth: dict) -> dict[str, dict]:
    """What each peer finds, judged as the diagnosis is."""
    answers = {}
    for name in peers.PEERS:
        began, used = time.perf_counter(), time.process_time()
        try:
            found = peers.ask(name, campaign, Model.default())
            given = {**judge(truth, found), "found": list(found.effects)}
        except ImportError as error:
            raise SystemExit(f"--peers: {error}; pip install -e '.[benchmark]'") from error
        except Exception as error:
            given = {"right": False, "verdict": f"{type(error).__name__}: {error}", "found": []}
        answers[name] = {**given, "seconds": time.perf_counter() - began, "cpu": time.process_time() - used}
    return answers


def line(row: dict) -> str:
    """A row in one line."""
    told = row.get("findings") or {}
    parts = [
        str(row["seed"]),
        "right" if row["right"] else "WRONG",
        row["kind"],
        "+".join(row["dirt"]) or row["design"],
        f"{row['truth']} {row['effects']} {row['unknown'] or ''}".strip(),
        f"-> {row['verdict'][:150]} {row['found']} {row['twins'] or ''} {row['found_unknown'] or ''}".strip(),
        f"findings {told.get('told')} of {told.get('expected')}",
        f"not there {told['not_there']}" if told.get("not_there") else "",
        f"lost {[tuple(w.values())[:2] for w in told['lost']]}" if told.get("lost") else "",
        f"clarity {row['clarity']:.0f}",
        f"error {row['error']:.3g}" if row["error"] is not None else "",
        f"p {row['p']:.2g}" if "p" in row else "",
        law_line(row["law"]) if "law" in row else "",
        f"cpu {row['cpu']:.0f} s",
        f"{row['samples']} samples",
        "out of time" if row.get("unfinished") else "",
        "" if row.get("same") in (None, "") else f"last bits: {row['same']}",
        os.environ.get("OPENBLAS_CORETYPE", ""),
    ]
    return "; ".join(p for p in parts if p)
