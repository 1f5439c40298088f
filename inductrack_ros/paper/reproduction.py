# SPDX-License-Identifier: Apache-2.0
"""Everything the page of the paper shows, computed when first asked for, and the answer in one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..core.model import Model
from ..reports.words import listed
from .claims import AGREES, CLOSE, DISAGREES, Claims, Row
from .drive import DriveTest, drive_test
from .facts import Facts
from .identification import (
    CHOICES,
    FLAT_SPEEDS,
    FLAT_STD,
    FREE,
    SEED,
    SPEEDS,
    STD,
    Answer,
    Precision,
    coverage,
    identify,
    precision,
    simulated,
    truth,
)
from .runs import Runs
from .stability import Modes, modes

SPEEDS_SHOWN = (10.0, 15.5, 20.0, 30.0, 40.0)  # m/s, rows of the stability table


@dataclass(frozen=True)
class Reproduction:
    """Everything the page shows, computed when first asked for."""

    model: Model
    facts: Facts

    @cached_property
    def runs(self) -> Runs:
        """The paper's runs."""
        return Runs(self.model, self.facts)

    @cached_property
    def claims(self) -> Claims:
        """The paper's claims and what the model gives."""
        return Claims(self.runs)

    @cached_property
    def modes(self) -> list[Modes]:
        """Small motions over speed."""
        lowest = max(self.runs.lowest_speed + 0.1, 1.0)
        return [modes(self.model, v) for v in np.linspace(lowest, 60.0, 90)]

    @cached_property
    def modes_shown(self) -> list[Modes]:
        """The same at a few speeds."""
        return [modes(self.model, v) for v in SPEEDS_SHOWN]

    @cached_property
    def identified(self) -> Answer:
        """Four distances, fitted by both methods from the paper's starting values."""
        rng = np.random.default_rng(SEED)
        return identify(self.model, simulated(self.model, SPEEDS, STD, rng), [self.facts.before[n] for n in FREE])

    @cached_property
    def flat(self) -> Answer:
        """Four distances that leave the valley flat."""
        rng = np.random.default_rng(SEED)
        return identify(
            self.model, simulated(self.model, FLAT_SPEEDS, FLAT_STD, rng), truth(self.model), nelder_mead=False
        )

    @cached_property
    def speed_error(self) -> float:
        """By how much (m) 0.01 m/s of initial speed moves the distance near the critical speed."""
        return 0.01 * (self.runs.travel(16.6)[0] - self.runs.travel(16.4)[0]) / 0.2

    @cached_property
    def choices(self) -> list[Precision]:
        """What other choices of four initial speeds would tell."""
        return [precision(self.model, speeds) for speeds in CHOICES]

    @cached_property
    def drive(self) -> DriveTest:
        """The drive pulse by pulse, in free runs."""
        return drive_test(self.model)

    @cached_property
    def coverage(self) -> tuple[dict[str, int], np.ndarray]:
        """How often the stated intervals hold the truth, and all answers."""
        return coverage(self.model)


def verdict(rows: Sequence[Row]) -> str:
    """The answer in one sentence."""
    count = {v: sum(r.verdict == v for r in rows) for v in (AGREES, CLOSE, DISAGREES)}
    kinds = [r.claim.kind for r in rows if r.verdict == DISAGREES]
    why = []
    if n := kinds.count("typo"):
        why.append("a typo" if n == 1 else f"{n} typos")
    if n := kinds.count("contradiction"):
        why.append(f"{n} contradictions inside the paper" if n > 1 else "a contradiction inside the paper")
    if n := len(kinds) - kinds.count("typo") - kinds.count("contradiction"):
        why.append(f"{n} for other reasons")
    rest = f"; {count[DISAGREES]} do not: {listed(why)}" if count[DISAGREES] else ""
    return (
        f"Of {len(rows)} numbers and claims the paper prints, its own equations give {count[AGREES]}, and"
        f" {count[CLOSE]} nearly{rest}."
    )


def results(work: Reproduction) -> dict[str, Any]:
    """The claims and the other numbers of the page, for programs."""
    rows = work.claims.rows
    held, answers = work.coverage
    return {
        "verdict": verdict(rows),
        "claims": [
            {
                "id": r.claim.id,
                "place": r.claim.place,
                "says": r.claim.says,
                "paper": r.claim.value,
                "model": r.found,
                "unit": r.claim.unit,
                "verdict": r.verdict,
                "kind": r.claim.kind,
                "why": r.why,
            }
            for r in rows
        ],
        "beyond_the_paper": work.claims.beyond,
        "identification": {
            n: {"value": v, "std": s, "nelder_mead": nm, "interval": [p.low, p.high], "covered": held[n]}
            for n, v, s, nm, p in zip(
                FREE,
                work.identified.fit.values,
                work.identified.fit.std,
                work.identified.fit.nelder_mead,
                work.identified.profiles,
                strict=True,
            )
        },
        "replicates": len(answers),
    }
