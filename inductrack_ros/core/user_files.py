# SPDX-License-Identifier: Apache-2.0
"""Python files that a user wrote and named: of effects and of channels. They are code, and they are run."""

from __future__ import annotations

import hashlib
import inspect
import os
import sys
import types
from collections.abc import Mapping
from pathlib import Path

from .errors import InputError
from .paths import missing

_shipped: dict[str, bytes] = {}


def use_shipped(files: Mapping[str, bytes]) -> None:
    """From now on take these for the contents of users' files: a machine that works for another need not have them."""
    _shipped.update(files)


def run_file(given: str | Path, kind: str = "effect") -> types.ModuleType:
    """The module a user's file makes, its text in ``content``; one for each text, so that an edited file is a new
    module. ``kind`` is the decorator that its functions bear, and what messages call it."""
    try:
        path = Path(os.path.realpath(os.path.expanduser(given)))
        content = _shipped[str(given)] if str(given) in _shipped else path.read_bytes()
    except (OSError, ValueError) as error:
        problem = missing(os.path.expanduser(given)) or f"cannot be read: {getattr(error, 'strerror', None) or error}"
        raise InputError(
            f"{kind} file {given}: {problem}; give the path of a Python file with @{kind} functions"
        ) from error
    name = f"inductrack_user_{kind}s_{path.stem}_{hashlib.sha256(bytes(path) + content).hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    module = sys.modules[name] = types.ModuleType(name)
    module.__file__ = str(path)
    vars(module)["content"] = content
    try:
        exec(compile(content, str(path), "exec"), vars(module))  # not an import: that could be from a stale .pyc
    except (Exception, SystemExit) as error:  # whatever the user's code raises is the user's to read
        del sys.modules[name]
        own_lines = [f.lineno for f in inspect.trace() if f.filename == str(path)]
        line = getattr(error, "lineno", None) or (own_lines[-1] if own_lines else None)
        place = f", line {line}" if line else ""
        reason = str(getattr(error, "msg", None) or error).partition("\n")[0]
        origin = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        raise InputError(f"{kind} file {given}{place}: {origin}{reason}") from error
    return module
