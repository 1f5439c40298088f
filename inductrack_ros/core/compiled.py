# SPDX-License-Identifier: Apache-2.0
"""Effects as machine code, kept on disk: what `kernel` and `sensor_kernel` have in common.

Each of these two writes the text of a Python module that calls the effects' functions. This file loads the module,
compiles its functions, and keeps the result under a hash of all its sources, so a changed effect makes a new module.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import platform
import re
import shutil
import sys
import time
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.errors import NumbaError

from . import effects as effects_package
from .cache import cache_folder
from .channels import Channel
from .effects import Effect
from .errors import InputError
from .output_folder import write_whole

#: Compiled modules unused for so long are thrown away when a new one is compiled.
KEPT_DAYS = 90
_MODULE = "inductrack_kernel.py"

_modules: dict[str, types.ModuleType] = {}


def load(
    text: str,
    items: Sequence[Effect],
    warm_up: Callable[[types.ModuleType], None],
    flags: Sequence[str] = (),
    announce: Callable[[str], None] | None = None,
    channels: Mapping[str, Channel] = types.MappingProxyType({}),
    inlined: bool = False,
) -> types.ModuleType:
    """The module of ``text``, in which item i's compiled functions stand by `function_name`, and those of ``channels``
    by `channel_function`; one for each text and functions.

    ``warm_up`` calls what is to be compiled now; ``flags`` are arguments that are true or false; ``announce`` is told
    where compiling will take its time. Effects that are ``inlined`` are compiled into what calls them. Raises
    `InputError` for an effect or a channel that numba cannot compile.
    """
    key = _key(text, items, channels)
    if key in _modules:
        return _modules[key]
    folder = cache_folder() / key
    _write(text, folder)
    module = _fill(f"inductrack_kernel_{key}", folder / _MODULE, items, channels, inlined)
    kept = any(folder.glob("__pycache__/*.nbc"))
    if not kept:
        _check_each(module, items, channels, flags)
        if announce:
            announce("compiling the model, once for this set of effects: 15 s to a minute …")
    try:
        warm_up(module)
    except NumbaError as error:
        names = ", ".join([*(e.name for e in items), *channels])
        raise InputError(f"the effects and channels {names} do not compile together: {_reason(error)}") from error
    except Exception as error:
        if not kept:
            shutil.rmtree(folder, ignore_errors=True)  # what was kept of it is not whole
            if isinstance(error, OSError):
                raise _not_kept(folder.parent, error) from None
            raise
        shutil.rmtree(folder, ignore_errors=True)  # what was kept is damaged
        return load(text, items, warm_up, flags, announce, channels, inlined)
    _modules[key] = module
    return module


def _key(text: str, items: Sequence[Effect], channels: Mapping[str, Channel]) -> str:
    """The hash of all that the machine code depends on."""
    ingredients = [text, numba.__version__, np.__version__, sys.version, platform.processor(), platform.machine()]
    ingredients += [fingerprint(part.function, set()) for e in items for part in e.parts]
    ingredients += [fingerprint(c.function, set()) for c in channels.values() if c.function]
    return hashlib.sha256("\n".join(ingredients).encode()).hexdigest()[:20]


def _write(text: str, folder: Path) -> None:
    """The module's text in its folder, unless it is there. Raises `InputError` where there is no room."""
    path = folder / _MODULE
    fresh = not path.exists()
    with contextlib.suppress(OSError):
        os.utime(folder)  # what is used is kept; not the file: older numba takes another age for another text
    if not fresh:
        return
    try:
        folder.mkdir(exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise _not_kept(folder.parent, error) from None
    prune(folder.parent)


def _fill(
    name: str, path: Path, items: Sequence[Effect], channels: Mapping[str, Channel], inlined: bool
) -> types.ModuleType:
    """The module in ``path``, with the functions of effects and channels under the names that it calls."""
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec and spec.loader  # a path that ends in .py has both
    module = importlib.util.module_from_spec(spec)
    done: dict[int, Callable] = {}
    for i, item in enumerate(items):
        for number, part in enumerate(item.parts):
            setattr(module, function_name(i, number), _jit(part.function, name, done, inlined))
    for channel, item in channels.items():
        if item.function:
            setattr(module, channel_function(channel), _jit(item.function, name, done))
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _check_each(
    module: types.ModuleType, items: Sequence[Effect], channels: Mapping[str, Channel], flags: Sequence[str]
) -> None:
    """Compile a user's functions one by one, so that an error names the function. Raises `InputError`."""
    for i, item in enumerate(items):
        for number in range(len(item.parts)) if not _is_ours(item) else ():
            _check_alone(item, number, getattr(module, function_name(i, number)), flags)
    for channel, item in channels.items():
        signature = tuple(numba.boolean if a in flags else numba.float64 for a in item.arguments)
        _check_function(item.place, getattr(module, channel_function(channel)), signature, ["what is read"])


def _not_kept(folder: Path, error: OSError) -> InputError:
    """No room for compiled code, in words."""
    return InputError(
        f"{folder}: compiled code cannot be kept there: {error.strerror}; make room, or set INDUCTRACK_CACHE to another"
        " folder"
    )


def _plain(value: Any) -> Any:
    """The Python function behind an effect or a jitted function; anything else as it is."""
    value = value.function if isinstance(value, Effect) else value
    return getattr(value, "py_func", value)


def _jit(function: Callable, home: str, done: dict[int, Callable], inlined: bool = False) -> Callable:
    """``function`` for numba, together with the plain Python functions it calls.

    What comes back belongs to the module named ``home``: compiled code is loaded by its module's name, and that of a
    user's file differs where the effect does not (another folder, another remark).
    """
    if id(function) in done:
        return done[id(function)]
    options = {"nopython": True, "nogil": True, "error_model": "numpy"} | getattr(function, "targetoptions", {})
    options |= {"forceinline": True} if inlined else {}
    plain = _plain(function)
    names = plain.__globals__ | {"__name__": home}
    cells = [types.CellType(c.cell_contents) for c in plain.__closure__ or ()]
    copy = types.FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, tuple(cells))
    done[id(function)] = compiled = numba.jit(**options)(copy)

    def helper(value: Any) -> Any:
        return _jit(value, home, done, inlined) if isinstance(_plain(value), types.FunctionType) else value

    for name in _names_in(plain.__code__) & set(names):
        names[name] = helper(names[name])
    for cell in cells:
        cell.cell_contents = helper(cell.cell_contents)
    return compiled


def _names_in(code: types.CodeType) -> set[str]:
    return set(code.co_names).union(*(_names_in(c) for c in code.co_consts if isinstance(c, types.CodeType)))


def fingerprint(function: Callable, seen: set[int]) -> str:
    """What a function does: its code and everything its code refers to, so that an edit anywhere shows."""
    function = _plain(function)
    if id(function) in seen:
        return ""
    seen.add(id(function))
    parts = []

    def code(c: types.CodeType) -> None:
        parts.append(c.co_code.hex())
        for constant in c.co_consts:
            code(constant) if isinstance(constant, types.CodeType) else parts.append(repr(constant))
        parts.append(repr((c.co_names, c.co_varnames, c.co_freevars)))
        modules = [m for n in c.co_names if isinstance(m := function.__globals__.get(n), types.ModuleType)]
        for name in c.co_names:
            describe(name, function.__globals__.get(name))
            for module in modules:  # helper.rate, say; of numpy and math the version counts, see `build`
                describe(f"{module.__name__}.{name}", getattr(module, name, None))

    def describe(name: str, value: Any) -> None:
        if isinstance(value, np.ndarray):
            parts.append(f"{name}={value.dtype}{value.shape}{value.tobytes().hex()}")
        elif isinstance(_plain(value), types.FunctionType):
            parts.append(name + fingerprint(value, seen))
        elif not isinstance(value, types.ModuleType):
            parts.append(f"{name}={value!r}")

    code(function.__code__)
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        describe(name, cell.cell_contents)
    return "|".join(parts)


def mark(text: str, options: str, *names: str) -> str:
    """``text`` with these of its functions handed to numba."""
    for name in names:
        text = text.replace(f"\ndef {name}(", f"\n@njit(nogil=True, error_model='numpy', {options})\ndef {name}(", 1)
    return text


def prune(folder: Path) -> None:
    """Drop kernels that nobody has loaded for `KEPT_DAYS`."""
    for path in folder.glob(f"*/{_MODULE}"):
        with contextlib.suppress(OSError):  # another process may be at it
            if path.parent.stat().st_mtime < time.time() - KEPT_DAYS * 86400:
                shutil.rmtree(path.parent)


def _is_ours(item: Effect) -> bool:
    return item.function.__module__.startswith(effects_package.__name__)


def place_of(item: Effect) -> str:
    """Who is at fault, at the head of a message: file and line too where the effect is the user's."""
    code = item.function.__code__
    return (
        f"effect '{item.name}'"
        if _is_ours(item)
        else f"{code.co_filename}, line {code.co_firstlineno}: effect '{item.name}'"
    )


def function_name(index: int, number: int) -> str:
    """What function ``number`` of effect ``index`` is called in a module."""
    return f"effect_{index}" if number == 0 else f"effect_{index}_then"


def channel_function(name: str) -> str:
    """What the function of a channel is called in a module."""
    return f"channel_{name}"


def _check_alone(item: Effect, number: int, function: Callable, flags: Sequence[str]) -> None:
    """Compile one function of an effect for numbers and look at what it returns, so that an error names it and comes at
    once."""
    part, last = item.parts[number], number == len(item.parts) - 1
    real, flag = numba.float64, numba.boolean
    own = set(item.parameters) | set(item.states)
    tables = {p for p, d in item.parameters.items() if d.count > 1}
    signature = tuple(
        flag if a in flags and a not in own else real[::1] if a in tables else real for a in part.arguments
    )
    wanted = [*part.targets, *(f"rate of {s}" for s in item.states if last)]
    _check_function(place_of(item), function, signature, wanted)


def _check_function(place: str, function: Any, signature: tuple, wanted: Sequence[str]) -> None:
    """Compile a user's function. Raises `InputError` that names its ``place`` where it does not return what is
    ``wanted``, so many real numbers."""
    try:
        function.compile(signature)
    except Exception as error:  # numba has many; all are about this function's text
        raise InputError(f"{place} cannot be compiled: {_reason(error)}; use numbers, math functions and if") from error
    returned: Any = function.overloads[signature].signature.return_type
    kinds: Any = numba.types  # whose annotations say nothing of what these types hold
    given = list(returned) if isinstance(returned, kinds.BaseTuple) else [returned]
    numbers = (kinds.Float, kinds.Integer, kinds.Boolean)
    if isinstance(returned, kinds.NoneType | kinds.Optional):
        problem = "does not always return a value"
    elif len(given) != len(wanted) or (len(wanted) == 1 and given[0] is not returned):
        problem = f"returns {len(given)} values"
    elif any(not isinstance(g, numbers) for g in given):
        problem = f"returns {returned}, not real numbers"
    else:
        return
    raise InputError(f"{place} {problem}; it must return {len(wanted)}: {', '.join(wanted)}")


def _reason(error: Exception) -> str:
    """The line of a compiler's message that tells a user what to change, with its place."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(error))
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    noise = ("Failed in ", "During:", "File ", "There are ", "- ", "This error")
    told = [line for line in lines if not line.startswith(noise)]
    place = re.search(r'File "[^"]*", line (\d+)', text)
    told = told or lines or [type(error).__name__]
    # What it was called with.
    reason = " ".join(told[:2] if told[0].endswith("signature:") else told[:1]).rstrip(".:")[:200]
    return reason + (f" (line {place[1]})" if place else "")
