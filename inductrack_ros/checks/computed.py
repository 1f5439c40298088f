# SPDX-License-Identifier: Apache-2.0
"""Rates and accelerations that were computed from the readings of another channel: differences, smoothed or not.

Such a channel is a sum of its neighbours in the other, each times a number that is the same for all samples. A sensor
of its own has noise that no such sum holds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.state import ACCELERATIONS, COORDINATES, RATES
from ..data import Campaign, Run
from ..data.measurement import Array
from . import levels
from .finding import SET_ASIDE, Finding, as_samples, shared
from .local import spread
from .noise_found import Channel

#: Neighbours on each side that a sum may have, and the samples for each of them that tell.
SIDE, FOR_EACH = 16, 8
#: Samples of a run that are looked at.
MOST = 4_000
#: What no sum holds of a measured channel is its noise, at least 0.8 of what its own neighbours do not tell. Of a
#: computed one it is 0.03 of that, 0.2 where its past was smoothed in; below this part of it a channel is computed.
NOTHING = 0.3


def computed(campaign: Campaign, channels: Mapping[str, Channel]) -> list[Finding]:
    """A finding for each channel that is computed from another in some runs: what counts twice seems surer than it
    is."""
    found: list[Finding] = []
    for coordinate, rate, acceleration in zip(COORDINATES, RATES, ACCELERATIONS, strict=False):
        for channel, sources in ((rate, (coordinate,)), (acceleration, (rate, coordinate))):
            for source in sources:
                runs = [run for run in campaign.runs if _is_computed(run, channel, source, channels)]
                if runs:
                    found.append(_finding(runs, len(campaign.runs), channel, source))
                    break
    return found


def _finding(runs: list[Run], count: int, channel: str, source: str) -> Finding:
    where = "" if len(runs) == count else f" in {shared(r.name for r in runs)}"
    text = (
        f"{channel} is computed from {source}{where}: it is no measurement of its own, and would count {source} twice"
    )
    samples = as_samples({r.name: np.flatnonzero(~np.isnan(r[channel])) for r in runs})
    return Finding("computed", SET_ASIDE, text, "", channel, samples=samples, size={"of": source})


def _is_computed(run: Run, channel: str, source: str, channels: Mapping[str, Channel]) -> bool:
    """Whether a channel of a run is a sum of its neighbours in another, noise and all."""
    if not {channel, source} <= {*run.channels} & channels.keys():
        return False
    about = channels[source]
    if not about.resolved or about.noise <= about.step:  # what is not noise is alike by its physics
        return False
    rows = np.flatnonzero(~np.isnan(run[channel]) & ~np.isnan(run[source]))[:MOST]
    steps = np.diff(run.times[rows])
    side = min(SIDE, (len(rows) // FOR_EACH - 1) // 4)
    if side < 1 or len(rows) < levels.FEW:
        return False
    windows = np.lib.stride_tricks.sliding_window_view
    even = np.abs(steps - np.median(steps)) < levels.JITTER * np.median(steps)
    whole = windows(even, 2 * side).all(axis=1)
    mine, other = (windows(run[c][rows], 2 * side + 1)[whole] for c in (channel, source))
    if len(mine) < FOR_EACH * (2 * side + 1):
        return False
    here, beside = mine[:, side], np.delete(mine - mine[:, :1], side, axis=1)
    own = spread(_left(here - mine[:, 0], beside[:, 1:]))
    return spread(_left(here, np.delete(other - other[:, side : side + 1], side, axis=1))) < NOTHING * own


def _left(values: Array, columns: Array) -> Array:
    """What a sum of columns (m, c), and a constant, leave of values (m,)."""
    basis = np.column_stack([columns, np.ones(len(values))])
    scale = np.abs(basis).max(axis=0)
    basis = basis / np.where(scale > 0.0, scale, 1.0)
    return values - basis @ np.linalg.lstsq(basis, values, rcond=1e-13)[0]
