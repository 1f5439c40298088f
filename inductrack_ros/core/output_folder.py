# SPDX-License-Identifier: Apache-2.0
"""Results that appear whole or not at all: a folder of them, a single file."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from .errors import InputError
from .paths import missing


@contextlib.contextmanager
def output_folder(given: str | Path, apart_from: Path | None = None) -> Iterator[Path]:
    """A new folder to write into, whose files stand in ``given`` once all are written and not before.

    Results are not mixed into the folder ``apart_from``, the campaign's own. Raises `InputError` where ``given`` cannot
    be written, before any work is done.
    """
    target = Path(given)
    if apart_from is not None and os.path.realpath(target) == os.path.realpath(apart_from):
        raise InputError(f"--output {given}: that is the campaign's own folder; choose another")
    check_place(given)
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
            with _under_the_name_given(temporary, str(given)):
                yield temporary
            target.mkdir(exist_ok=True)
            files = sorted(temporary.iterdir())
            for place in (target / file.name for file in files):
                if place.is_dir() and not place.is_symlink():
                    raise InputError(
                        f"--output {given}: {place} is a folder, and a file of the results has that name; move it away,"
                        " or choose another name; nothing was kept"
                    )
            for file in files:
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


def check_place(given: str | Path) -> None:
    """Raise `InputError` where no folder can be at ``given``: a file or a link is in its place, or on the way."""
    if not str(given):
        raise InputError("--output: is empty; give a folder")
    if str(given) == "-":
        raise InputError("--output -: results are files, not a stream; give a folder")
    for part in (*reversed(Path(given).parents), Path(given)):
        if part.is_dir() or not os.path.lexists(part):
            continue
        what, remedy = missing(part), "delete the link, or choose another name"
        place = "" if part == Path(given) else f"{part} "
        raise InputError(f"--output {given}: {place}{what or 'is a file'}; {remedy if what else 'give a folder'}")


@contextlib.contextmanager
def _under_the_name_given(folder: Path, given: str) -> Iterator[None]:
    """Let messages about the hidden ``folder`` speak of the one that the user gave."""
    try:
        yield
    except InputError as error:
        raise InputError(str(error).replace(str(folder), given)) from None


def write_whole(file: str | Path, text: str) -> None:
    """Write a text so that no half-written file is ever seen under its name, also where two write it at once.

    An older file is replaced. Raises OSError where it cannot be written.
    """
    aside = Path(file).with_name(f".{secrets.token_hex(8)}.partial")
    try:
        aside.write_text(text, encoding="utf-8")
        os.replace(aside, file)
    finally:
        aside.unlink(missing_ok=True)
