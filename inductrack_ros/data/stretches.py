# SPDX-License-Identifier: Apache-2.0
"""Stretches of samples of which something holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def stretches(which: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First sample of each stretch of those that are meant (n,), and the one behind its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
