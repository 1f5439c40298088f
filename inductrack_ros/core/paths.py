# SPDX-License-Identifier: Apache-2.0
"""Why nothing is found under a name that a user gave."""

from __future__ import annotations

import errno
import os
from pathlib import Path

NOT_THERE = "no such file"


def missing(path: str | Path) -> str:
    """What is wrong with a path under which nothing can be reached, in words that follow it and a colon; empty where
    something is there.

    The first part of the path that fails is the cause: a link into nowhere, a file in place of a folder, a folder that
    may not be entered.
    """
    path = Path(path)
    for part in (*reversed(path.parents), path):
        try:
            os.stat(part)
        except ValueError:
            return "cannot be read: no name of a file holds NUL"
        except OSError as error:
            return _why(path, part, error)
    return ""


def _why(path: Path, part: Path, error: OSError) -> str:
    """What is wrong with a part of a path, of which all before it is there."""
    which = "" if part == path else f"{NOT_THERE}: {part} "
    if error.errno == errno.ELOOP:
        return f"{which}is a link that leads back to itself"
    if error.errno == errno.ENOENT and part.is_symlink():
        return f"{which}is a link to {os.readlink(part)}, which is not there"
    if error.errno == errno.ENOENT:
        return NOT_THERE if part == path else f"{NOT_THERE}: there is no folder {part}"
    if error.errno == errno.ENOTDIR:
        return f"{NOT_THERE}: {part.parent} is a file, not a folder"
    if error.errno == errno.EACCES:
        return f"cannot be read: this user may not enter the folder {part.parent}; chmod u+x it, or ask its owner"
    if error.errno == errno.ENAMETOOLONG:
        return f"{NOT_THERE}: the name is too long"
    return f"cannot be read: {error.strerror}"
