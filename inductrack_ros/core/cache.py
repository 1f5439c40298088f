# SPDX-License-Identifier: Apache-2.0
"""Where compiled code is kept: also for who has no home, no entry in the list of users, or a package that cannot be
written."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from numba.core import config

from .errors import InputError


def cache_folder() -> Path:
    """Where compiled kernels are kept: ``$INDUCTRACK_CACHE``, else the user's cache folder, else a temporary one."""
    temporary = Path(tempfile.gettempdir()) / f"inductrack_ros-{os.getuid()}"
    for folder in (*_of_the_user(), temporary):
        try:
            folder.mkdir(0o700, parents=True, exist_ok=True)
            if folder == temporary and (folder.is_symlink() or folder.stat().st_uid != os.getuid()):
                continue  # anybody may make a folder there, and what is in it would be run
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    raise InputError("no folder to keep compiled code in; set INDUCTRACK_CACHE to one that can be written")


def _of_the_user() -> Iterator[Path]:
    if given := os.environ.get("INDUCTRACK_CACHE"):
        yield Path(given)
    if given := os.environ.get("XDG_CACHE_HOME"):
        yield Path(given) / "inductrack_ros"
    else:
        try:
            yield Path.home() / ".cache" / "inductrack_ros"
        except RuntimeError:  # HOME is not set, and the list of users does not know this one
            return


def compiled_once(function: Callable) -> Callable:
    """``function`` of this package as machine code, kept beside its file, or in `cache_folder` where that cannot be
    written."""
    try:
        return numba.njit(cache=True, nogil=True)(function)
    except RuntimeError:  # numba finds no place of its own
        settings: Any = config  # numba makes its settings at run time
        before = settings.CACHE_DIR
        settings.CACHE_DIR = str(cache_folder() / "numba")
        try:
            return numba.njit(cache=True, nogil=True)(function)
        finally:
            settings.CACHE_DIR = before
