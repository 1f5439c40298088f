# SPDX-License-Identifier: Apache-2.0
"""Whether an answer hangs on the last bits of the data: asked again with each reading changed by 1e-12 of
itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inductrack_ros.core.model import Model
from inductrack_ros.data import Campaign
from inductrack_ros.diagnosis.diagnose import diagnose
from inductrack_ros.diagnosis.result import Diagnosis

#: By how much of itself each reading is changed (standard deviation).
CHANGE = 1e-12
#: Part of its standard deviation by which a parameter may move.
MOST = 0.1


def changed(campaign: Campaign, seed: int) -> Campaign:
    """The same campaign with other last bits, each reading by itself."""
    rng = np.random.default_rng([seed, 12])
    runs = [replace(r, values=r.values * (1 + CHANGE * rng.standard_normal(r.values.shape))) for r in campaign.runs]
    return replace(campaign, runs=tuple(runs))


def agrees(campaign: Campaign, model: Model, found: Diagnosis, seed: int) -> str:
    """Empty where the answer to data with other last bits is the same, else what differs."""
    return differs(found, diagnose(changed(campaign, seed), model))


def differs(one: Diagnosis, other: Diagnosis) -> str:
    """What differs between two answers; empty where the verdict is the same and every parameter within `MOST`."""
    if (one.verdict, set(one.effects)) != (other.verdict, set(other.effects)):
        return f"{one.verdict} {list(one.effects)} or {other.verdict} {list(other.effects)}"
    moved = {
        n: abs(v - other.parameters[n][0]) / s
        for n, (v, s) in one.parameters.items()
        if n in other.parameters and s > 0
    }
    worst = max(moved, key=moved.get, default=None)
    return f"{worst} moves by {moved[worst]:.2g} of its deviation" if worst and moved[worst] > MOST else ""
