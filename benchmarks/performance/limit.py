# SPDX-License-Identifier: Apache-2.0
"""The limit: limit.c, compiled here by the C compiler that is here."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from inductrack_ros.core import integrator, kernel

SOURCE = Path(__file__).with_name("limit.c")
BUILD = Path(__file__).parents[2] / "build" / "performance"
FAST = ("-march=native", "-ffast-math", "-mprefer-vector-width=512")
LANES = int(re.search(r"#define W (\d+)", SOURCE.read_text())[1])


@cache
def compiler() -> str | None:
    """The C compiler, if there is one."""
    return shutil.which("gcc") or shutil.which("cc")


@cache
def library(*options: str) -> ctypes.CDLL:
    """limit.c compiled with -O3 and ``options``, with the step sizes of the integrator."""
    BUILD.mkdir(parents=True, exist_ok=True)
    sizes = {
        "FREE_STEP": kernel.FREE_STEP,
        "CONTACT_STEP": kernel.CONTACT_STEP,
        "CONTACT_GROWTH": integrator.CONTACT_GROWTH,
        "CONTACT_GROWN": integrator.CONTACT_SHRINK,
        "CONTACT_GROWS": integrator.CONTACT_GROW,
        "FINEST": integrator.FINEST,
    }
    target = BUILD / f"limit{'_'.join(o.strip('-').replace('=', '_') for o in ('', *options))}.so"
    defines = [f"-D{name}={value!r}" for name, value in sizes.items()]
    # Another thread may be making it too, another process loading it.
    with tempfile.TemporaryDirectory(dir=BUILD) as own:
        part = Path(own) / target.name
        subprocess.run(
            [compiler(), "-O3", *options, *defines, "-shared", "-fPIC", "-o", part, SOURCE, "-lmvec", "-lm"], check=True
        )
        part.replace(target)
    return ctypes.CDLL(str(target))


def _at(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


def run(P: np.ndarray, state: np.ndarray, times: np.ndarray) -> np.ndarray:
    """One run (n, 15) of the parameters P (22,) from a state (8,)."""
    x, out = state.copy(), np.empty((times.size, 15))
    library().run(_at(P), _at(x), _at(times), ctypes.c_long(times.size), _at(out))
    return out


def evaluations(P: np.ndarray, state: np.ndarray, times: np.ndarray) -> int:
    """Right-hand sides of one run; ours takes the same steps."""
    counting, x, out = library("-DCOUNT"), state.copy(), np.empty((times.size, 15))
    counter = ctypes.c_long.in_dll(counting, "evaluations")
    counter.value = 0
    counting.run(_at(P), _at(x), _at(times), ctypes.c_long(times.size), _at(out))
    return counter.value


def ensemble(P: np.ndarray, states: np.ndarray, times: np.ndarray, options: tuple[str, ...] = FAST) -> np.ndarray:
    """Runs (jobs, n, 15) of parameters (jobs, 22) and states (jobs, 8), lane by lane; jobs a multiple of `LANES`."""
    P, x, out = np.ascontiguousarray(P), states.copy(), np.empty((len(P), times.size, 15))
    library(*options).ensemble(ctypes.c_long(len(P)), _at(P), _at(x), _at(times), ctypes.c_long(times.size), _at(out))
    return out
