"""A ROS domain of one's own, so that tests and the demo neither hear nor disturb another ROS system on the machine."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path
from typing import IO

FIRST, LAST = 40, 99  # clear of 0, which everybody uses, and of ports that Linux hands out by itself


def claim_domain() -> IO[str]:
    """Set ROS_DOMAIN_ID to one that no other process has claimed; it is held until the returned file is closed."""
    for number in range(FIRST, LAST + 1):
        path = Path(tempfile.gettempdir(), f"inductrack_ros_domain_{number}.lock")
        try:
            lock = open(path, "a")
        except OSError:  # another user's
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        os.environ["ROS_DOMAIN_ID"] = str(number)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        return lock
    raise RuntimeError(f"all ROS domains from {FIRST} to {LAST} are in use on this machine")
