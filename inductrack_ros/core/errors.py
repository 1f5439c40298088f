# SPDX-License-Identifier: Apache-2.0
"""What a user is told beside results: errors in one line (what, where, what to do about it), and warnings."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterable


class InputError(Exception):
    """Wrong input from a user. The command line prints the message and exits with status 2."""

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(str(message).splitlines()))  # one line, whatever names and values are quoted in it


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean 'x'?"`` for the nearest known name, or a list of all when none is near."""
    known = list(known)
    near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.5)
    if near:
        return f"; did you mean '{near[0]}'?"
    return f"; known: {', '.join(known)}" if known else ""


def one_line(error: Exception) -> str:
    """What a library's exception says, in one line that is not too long."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def announce(message: str) -> None:
    """Say to the user, on standard error, what is no error: a warning, or that something takes its time."""
    print(message, file=sys.stderr, flush=True)
