# SPDX-License-Identifier: Apache-2.0
"""Every test that stands in a file which was asked for is collected, or the run fails.

A plugin, or a file that skips itself while it is imported, can end the collection without an error: with the plugins of
launch_testing one such file left a run of one test, which passed.
"""

from __future__ import annotations

import ast
from collections.abc import Collection
from pathlib import Path

import pytest


def missing(config: pytest.Config, items: Collection[pytest.Item]) -> list[str]:
    """``file::test`` of each test function that stands in the files asked for and is not among the items."""
    collected = {(Path(item.path).resolve(), getattr(item, "originalname", item.name)) for item in items}
    return [
        f"{path.name}::{name}"
        for path in _asked_for(config)
        for name in _written(path)
        if (path, name) not in collected
    ]


def _asked_for(config: pytest.Config) -> list[Path]:
    """Files that the command line names whole, by themselves or by their folder."""
    places = [
        Path(config.invocation_params.dir, argument).resolve() for argument in config.args if "::" not in argument
    ]
    files = [f for p in places for f in ([p] if p.is_file() else sorted(p.rglob("test_*.py")))]
    left_out = {Path(config.invocation_params.dir, p).resolve() for p in config.getoption("ignore") or []}
    return [f for f in files if f not in left_out and f.match("test_*.py")]


def _written(path: Path) -> list[str]:
    functions = [n for n in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(n, ast.FunctionDef)]
    return [f.name for f in functions if f.name.startswith("test_")]
