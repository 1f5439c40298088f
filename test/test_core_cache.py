# SPDX-License-Identifier: Apache-2.0
"""Where compiled code is kept: not for ever, and not where somebody else could have put it.

That an edited effect is never served stale is in test_core_user_effects.py.
"""

import os
import time

import pytest

from inductrack_ros.core import cache, compiled, kernel
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model


def test_kernels_nobody_uses_are_dropped(tmp_path):
    for name, age in (("old", compiled.KEPT_DAYS + 1), ("young", compiled.KEPT_DAYS - 1)):
        (tmp_path / name / "__pycache__").mkdir(parents=True)
        (tmp_path / name / "inductrack_kernel.py").write_text("")
        os.utime(tmp_path / name, (then := time.time() - age * 86400, then))
    (tmp_path / "not_ours").mkdir()
    compiled.prune(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["not_ours", "young"]


def test_a_kernel_in_use_is_young_and_its_text_as_old_as_it_was(tmp_path, monkeypatch):
    """numba of Ubuntu 24.04 compiles anew where the file is younger than what it kept: each start took half a
    minute."""
    monkeypatch.setenv("INDUCTRACK_CACHE", str(tmp_path))
    monkeypatch.setattr(kernel, "_warm_up", lambda kernel: None)
    monkeypatch.setattr(compiled, "_modules", {})
    kernel._build([], None)
    (module,) = tmp_path.glob("*/inductrack_kernel.py")
    for path in (module, module.parent):
        os.utime(path, (0, 0))
    compiled._modules.clear()
    kernel._build([], None)
    assert module.parent.stat().st_mtime > time.time() - 3600 and module.stat().st_mtime == 0


def test_whole_numbers_are_not_compiled_for_anew():
    model = Model.default()
    x = model.initial_state(surge_rate=15)
    functions = model.kernel.simulate_batch, model.kernel.evaluate

    def compiled() -> list[int]:
        return [len(function.signatures) for function in functions]

    model.wrenches(model.advance(x, 0.0, 1.0, 7000.0), 2.0, 7000.0)
    before = compiled()  # by whatever ran in this process, too
    x = model.advance(x, 0, 1, 7000, origin=0)
    model.simulate([1, 2], x, 7000, start=1, longest_step=1)
    model.wrenches(x, 2, 7000, origin=0)
    assert compiled() == before


def test_a_temporary_folder_of_somebody_else_is_not_used(tmp_path, monkeypatch):
    """The fallback's name can be guessed, so another user may have made it, with code in it."""
    monkeypatch.delenv("INDUCTRACK_CACHE", raising=False)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))  # no folder can be made there
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    mine = cache.cache_folder()
    assert mine.parent == tmp_path
    assert mine.stat().st_mode & 0o077 == 0
    user = os.getuid()
    mine.rename(tmp_path / f"inductrack_ros-{user + 1}")
    monkeypatch.setattr(os, "getuid", lambda: user + 1)  # now it is another's
    with pytest.raises(InputError, match="no folder to keep compiled code in"):
        cache.cache_folder()
