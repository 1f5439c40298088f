# SPDX-License-Identifier: Apache-2.0
"""What a user can get wrong, said in one line: what, where, and what to do about it."""

from __future__ import annotations

import difflib
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
