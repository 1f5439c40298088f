# SPDX-License-Identifier: Apache-2.0
"""Whether a shell or a batch system leaves a process what it begins with: address space, and threads."""

from __future__ import annotations

import os
import resource

from .errors import InputError

#: MB of address space with which every command begins and compiles. With less OpenBLAS waits for ever while it is
#: loaded, and LLVM aborts; neither raises anything. No such number would be needed if they did.
NEEDED = 1024
#: What numba reads while it is loaded, and stumbles over.
THREADS = "NUMBA_NUM_THREADS"
_LIMITS = ((resource.RLIMIT_AS, "-v"), (resource.RLIMIT_DATA, "-d"))


def room_to_begin() -> None:
    """Raise `InputError` where a limit of the process leaves less address space than the libraries need, or the
    environment asks for threads that cannot be."""
    if (asked := os.environ.get(THREADS)) and not (asked.strip().isdecimal() and int(asked)):
        raise InputError(f"{THREADS}={asked}: is no number of threads; unset it, or give a whole number above 0")
    for limit, option in _LIMITS:
        allowed, _ = resource.getrlimit(limit)
        if allowed != resource.RLIM_INFINITY and allowed < NEEDED * 2**20:
            raise InputError(
                f"this shell allows {allowed / 2**20:.0f} MB of memory (`ulimit {option}`), and numpy and the compiler"
                f" need {NEEDED} MB to begin; raise it: `ulimit {option} unlimited`"
            )


def too_little(error: MemoryError) -> str:
    """What is said where memory ran out on the way."""
    what = " ".join(str(error).split())
    return f"out of memory{f' ({what})' if what else ''}; give it more, or fewer and shorter runs at a time"
