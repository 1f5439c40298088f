# SPDX-License-Identifier: Apache-2.0
"""Where the paper's rig is described."""

from __future__ import annotations

from pathlib import Path

from ..core.errors import InputError

PACKAGE = "inductrack_ros"


def config_file(name: str) -> Path:
    """A file of ``config/``: beside the package in a checkout, under ``share/`` where installed. Raises
    `InputError`."""
    for folder in Path(__file__).resolve().parents:
        for place in (folder / "config" / name, folder / "share" / PACKAGE / "config" / name):
            if place.is_file():
                return place
    raise InputError(f"config/{name} is not installed; give the file with --model")
