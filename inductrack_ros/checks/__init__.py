# SPDX-License-Identifier: Apache-2.0
"""The look at the data before any fit: what in a log cannot be so, what is set aside, what may mislead."""

from .finding import CALLED, IMPOSSIBLE, NOTE, SET_ASIDE, SEVERITIES, WARNING, Finding, impossible
from .look import admit, look, set_aside

__all__ = [
    "CALLED",
    "IMPOSSIBLE",
    "NOTE",
    "SET_ASIDE",
    "SEVERITIES",
    "WARNING",
    "Finding",
    "admit",
    "impossible",
    "look",
    "set_aside",
]
