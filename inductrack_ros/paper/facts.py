# SPDX-License-Identifier: Apache-2.0
"""What the paper prints, read from `facts.yaml`; see there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import resources
from typing import Any

import yaml

AGREES, CLOSE, DISAGREES = "agrees", "close", "disagrees"


@dataclass(frozen=True)
class Claim:
    """One number or statement of the paper, where it stands, and why the model differs where it does.

    ``value`` is None for a statement without a number; ``holds_if`` then says what of the model's number makes it true.
    ``kind`` of a disagreement: ``typo``, ``contradiction`` (inside the paper) or ``assumption`` (of ours).
    """

    id: str
    name: str
    place: str
    says: str
    value: float | None
    unit: str
    within: float = 0.0
    near: float = 0.0
    holds_if: str = ""
    kind: str = ""
    why: str = ""

    def verdict(self, found: float) -> str:
        """``agrees``, ``close`` or ``disagrees``."""
        if self.value is None:
            word, _, limit = self.holds_if.partition(" ")
            holds = {"positive": found > 0, "negative": found < 0, "below": found < float(limit or math.nan)}[word]
            return AGREES if holds else DISAGREES
        off = abs(found - self.value)
        return AGREES if off <= self.within else CLOSE if off <= self.near else DISAGREES


@dataclass(frozen=True)
class Facts:
    """The paper's claims by id, and its tables as lists of mappings."""

    claims: dict[str, Claim]
    table_1: list[dict[str, Any]]
    elsewhere: list[dict[str, Any]]
    assumed: list[dict[str, Any]]
    table_2: list[dict[str, Any]]
    title: str
    authors: str
    doi: str

    @property
    def before(self) -> dict[str, float]:
        """η and γ before identification."""
        return {row["parameter"]: row["before"] for row in self.table_2}

    @property
    def after(self) -> dict[str, float]:
        """η and γ after identification."""
        return {row["parameter"]: row["after"] for row in self.table_2}


def load_facts() -> Facts:
    """Read the table that ships with the package."""
    raw = yaml.safe_load(resources.files(__package__).joinpath("facts.yaml").read_text(encoding="utf-8"))
    claims = [Claim(**row) for row in raw.pop("claims")]
    return Facts({c.id: c for c in claims}, **raw)
