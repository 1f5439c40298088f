# SPDX-License-Identifier: Apache-2.0
"""Who hears whom: nodes stay on their machine unless asked, tests and the demo in a ROS domain of their own as well."""

from __future__ import annotations

import fcntl
import os
import socket
import tempfile
from pathlib import Path
from typing import IO

FIRST, LAST = 40, 99  # clear of 0, which everybody uses, and of ports that Linux hands out by itself

#: DDS gives participant n of a domain the port PORT + PER_DOMAIN × domain + 10 + 2 n; ROS 2 looks for so many of them.
PORT, PER_DOMAIN, PARTICIPANTS = 7400, 250, 32

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
#: Any of these says how far discovery is to reach; then nothing is changed.
ASKED = (
    RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT",
    "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI",
    "ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE",
)  # fmt: skip


def stay_local() -> None:
    """Keep discovery on this machine unless the environment says how far it is to reach."""
    if not any(os.environ.get(name) for name in ASKED):
        os.environ[RANGE] = "LOCALHOST"


def reach() -> str:
    """How far discovery reaches, for the log."""
    if os.environ.get(RANGE) == "LOCALHOST":
        return f"ROS stays on this machine; for other machines start it with {RANGE}=SUBNET"
    return "ROS discovery follows the environment: " + ", ".join(
        f"{n}={os.environ[n]}" for n in ASKED if n in os.environ
    )


def claim_domain() -> IO[str]:
    """Set ROS_DOMAIN_ID to one that no other process has claimed and nobody speaks in; it is held until the returned
    file is closed."""
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
        if _somebody_speaks(number):
            lock.close()
            continue
        os.environ["ROS_DOMAIN_ID"] = str(number)
        os.environ[RANGE] = "LOCALHOST"
        return lock
    raise RuntimeError(f"all ROS domains from {FIRST} to {LAST} are in use on this machine")


def _somebody_speaks(domain: int) -> bool:
    """Whether a node is there that claimed nothing: started by hand, or left over."""
    for number in range(PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", PORT + PER_DOMAIN * domain + 10 + 2 * number))
            except OSError:
                return True
    return False
