# SPDX-License-Identifier: Apache-2.0
"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError


@contextlib.contextmanager
def output_folder(given: str | Path, apart_from: Path | None = None) -> Iterator[Path]:
    """A new folder to write into, whose files stand in ``given`` once all are written and not before.

    Results are not mixed into the folder ``apart_from``, the campaign's own. Raises `InputError` where ``given`` cannot
    be written, before any work is done.
    """
    if not str(given):
        raise InputError("--output: is empty; give a folder")
    target = Path(given)
    if apart_from is not None and target.resolve() == apart_from.resolve():
        raise InputError(f"--output {given}: that is the campaign's own folder; choose another")
    if os.path.lexists(target) and not target.is_dir():
        raise InputError(f"--output {given}: is a file; give a folder")
    made: list[Path] = [p for p in target.absolute().parents if not p.exists()]
    temporary: Path | None = None
    try:
        try:
            target.absolute().parent.mkdir(parents=True, exist_ok=True)
            if target.is_dir() and not os.access(target, os.W_OK):
                raise PermissionError(13, "Permission denied")
            temporary = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.absolute().parent))
        except OSError as error:
            raise InputError(f"--output {given}: cannot be written: {error.strerror}") from None
        try:
            yield temporary
            target.mkdir(exist_ok=True)
            for file in sorted(temporary.iterdir()):
                file.replace(target / file.name)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
                raise
            raise InputError(f"--output {given}: cannot be written: {error.strerror}; nothing was kept") from None
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        if not target.exists():
            for folder in made:  # those that this call made, deepest first, while they are empty
                with contextlib.suppress(OSError):
                    folder.rmdir()
