# SPDX-License-Identifier: Apache-2.0
"""What careful users of other tools would do with the same campaign, to measure the diagnosis against.

Each takes a campaign and the model it is held against and returns a `Found`, which the benchmark judges as it judges a
diagnosis. Both are helped by this project's physics, catalogue and reader of campaigns; neither uses its diagnosis.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from threadpoolctl import threadpool_limits

from inductrack_ros.core.model import Model
from inductrack_ros.data.campaign import Campaign


@dataclass(frozen=True)
class Found:
    """A peer's answer. Neither peer can name twins or an unknown."""

    effects: tuple[str, ...]
    indistinguishable: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    unknown: None = None

    @property
    def verdict(self) -> str:
        """Never ``unknown_effect``."""
        return "missing_effect" if self.effects else "adequate"


#: The peers: each a module here with a `diagnose` of its own.
PEERS = ("stepwise_bic", "pysindy_weak")


def ask(name: str, campaign: Campaign, model: Model) -> Found:
    """A peer's answer. Raises `ImportError` where what it builds on is not installed."""
    with threadpool_limits(1, "blas"):  # as the diagnosis itself does
        return importlib.import_module(f"{__name__}.{name}").diagnose(campaign, model)
