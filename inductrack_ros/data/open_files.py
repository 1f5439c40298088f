"""As many open files as a recording has: one a second, all opened by its reader, where a shell often allows 1024."""

from __future__ import annotations

import contextlib
import resource
from pathlib import Path

#: What else a process may have open: libraries, sockets, the files of its threads.
SPARE = 256


def allow_files_of(folder: str | Path) -> None:
    """Raise this process's limit, as far as the system lets it, so that all files in ``folder`` can be open at once."""
    with contextlib.suppress(OSError, ValueError):  # no such folder, or not allowed: the reader will say what is wrong
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        needed = len(list(Path(folder).iterdir())) + SPARE
        if resource.RLIM_INFINITY != soft < needed:
            resource.setrlimit(resource.RLIMIT_NOFILE, (needed if hard == resource.RLIM_INFINITY else min(needed, hard), hard))
