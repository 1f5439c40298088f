"""Where the paper's rig is described, and how results are written."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from ..core.errors import InputError

PACKAGE = "inductrack_ros"


def config_file(name: str) -> Path:
    """A file of ``config/``: beside the package in a checkout, under ``share/`` where installed. Raises `InputError`."""
    for folder in Path(__file__).resolve().parents:
        for place in (folder / "config" / name, folder / "share" / PACKAGE / "config" / name):
            if place.is_file():
                return place
    raise InputError(f"config/{name} is not installed; give the file with --model")


def write_files(folder: str | Path, files: Mapping[str, str]) -> None:
    """Write each text into ``folder``, made if need be; a file appears whole or not at all. Raises `InputError`."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            aside = folder / f".{name}.{os.getpid()}"
            try:
                aside.write_text(content, encoding="utf-8")
                aside.replace(folder / name)
            finally:
                aside.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"--output {folder}: cannot be written: {error.strerror}") from None
