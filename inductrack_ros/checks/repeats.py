# SPDX-License-Identifier: Apache-2.0
"""Blocks of samples that a logger wrote twice under new stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..data import Campaign, Run
from .finding import SET_ASIDE, Finding, as_samples, place

#: Samples in a row that repeat earlier ones, in all their channels, before it is called a block.
BLOCK = 8
#: Odd numbers that make one number of a sample's channels; two samples with the same one are the same.
_ODD = (np.arange(1, 65, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)) | np.uint64(1)


def repeats(campaign: Campaign) -> list[Finding]:
    """A finding where samples of some run stand there again; the later ones are no measurements."""
    rows = {run.name: _repeated(run) for run in campaign.runs}
    again = as_samples({name: found[0] for name, found in rows.items()})
    if not again:
        return []
    run = next(r for r in campaign.runs if r.name in again)
    numbers, lag = rows[run.name]
    count = sum(map(len, again.values()))
    text = (
        f"{count} samples from {place(run, int(numbers[0]))} on repeat those {lag} samples before them, digit for"
        " digit: a block was written twice"
    )
    return [Finding("repeated", SET_ASIDE, text, "", samples=again, size={"count": count, "lag": lag})]


def _repeated(run: Run) -> tuple[NDArray[np.intp], int]:
    """Samples that repeat earlier ones as a block, and how far before those are."""
    nothing = np.empty(0, np.intp), 0
    if len(run.times) < 2 * BLOCK or len(run.channels) < 2:
        return nothing
    key = np.zeros(len(run.times), np.uint64)
    for k in range(len(run.channels)):
        bits = np.ascontiguousarray(run.values[:, k]).view(np.uint64)
        key += (bits ^ (bits >> np.uint64(29))) * _ODD[k]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    lags = np.zeros(len(key), np.intp)
    lags[order[same + 1]] = order[same + 1] - order[same]
    lags[np.isnan(run.values).all(axis=1)] = 0
    starts = np.flatnonzero(np.concatenate([[True], np.diff(lags) != 0]))
    lengths = np.diff(np.append(starts, len(lags)))
    blocks = (lags[starts] >= BLOCK) & (lengths >= BLOCK) & (lengths <= lags[starts])  # what is longer is periodic
    if not blocks.any():
        return nothing
    numbers = np.concatenate([np.arange(s, s + n) for s, n in zip(starts[blocks], lengths[blocks], strict=True)])
    return numbers, int(lags[numbers[0]])
