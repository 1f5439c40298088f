# SPDX-License-Identifier: Apache-2.0
"""What long work says of itself while somebody watches."""

from __future__ import annotations

import contextlib
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .checks import Finding

#: To the beginning of the line, which is cleared: a line of `progress` may stand there.
_CLEARED = "\r\x1b[2K"


def say_notes(notes: Iterable[str]) -> None:
    """Print what was converted or left out while the data were read, one line each, before any result."""
    for note in notes:
        print(note, file=sys.stderr, flush=True)


def say_findings(findings: Iterable[Finding]) -> None:
    """Print what a look at the data found, one line each, worst first, before any result."""
    for finding in findings:
        print(f"{_CLEARED if sys.stderr.isatty() else ''}{finding.said}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """A function that shows what is being done, and since when, on one line of the terminal, which is gone at the end.

    Where nobody watches (standard error is no terminal) it says nothing.
    """
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    began, width = time.monotonic(), shutil.get_terminal_size().columns - 1

    def tell(words: str) -> None:
        line = f"[{time.monotonic() - began:3.0f} s] {words}"
        print(f"{_CLEARED}{line[:width]}", end="", file=sys.stderr, flush=True)

    try:
        yield tell
    finally:
        print(_CLEARED, end="", file=sys.stderr, flush=True)
