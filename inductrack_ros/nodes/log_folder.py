# SPDX-License-Identifier: Apache-2.0
"""Where ROS 2 writes its logs: it does not start where it cannot write them."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from ..core.cache import cache_folder

LOGS = "ROS_LOG_DIR"


def log_somewhere() -> None:
    """Name another folder for the logs where ROS 2's own cannot be written, as without a home."""
    wanted = _wanted()
    if wanted is None or not _can_be_written(wanted):
        os.environ[LOGS] = str(cache_folder() / "log")


def _wanted() -> Path | None:
    """The folder that ROS 2 would take; None where it finds none."""
    for name, below in ((LOGS, ""), ("ROS_HOME", "log"), ("HOME", ".ros/log")):
        if given := os.environ.get(name):
            return Path(os.path.expanduser(given)) / below  # unchanged where there is no home
    return None


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except (OSError, ValueError):
        return False
