# SPDX-License-Identifier: Apache-2.0
"""What the environment asks of the middleware, judged before ROS 2 is imported, which would end the process by itself
with a word about its own source."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys

from ..core.errors import InputError

DOMAIN, IMPLEMENTATION = "ROS_DOMAIN_ID", "RMW_IMPLEMENTATION"
#: DDS makes a port out of a domain, 7400 + 250 × domain, and with the next one's offsets that must stay below 65536.
LAST_DOMAIN = 232


def check_middleware() -> None:
    """Raise `InputError` for a domain that DDS has no port for, and for an implementation that cannot be loaded."""
    _check_domain(os.environ.get(DOMAIN, ""), os.environ.get(IMPLEMENTATION, ""))
    if os.environ.get(IMPLEMENTATION) and importlib.util.find_spec("rclpy") is not None:
        _check_implementation(os.environ[IMPLEMENTATION])


def _check_domain(given: str, implementation: str) -> None:
    if not given.strip() or "zenoh" in implementation:  # which has no such ports
        return
    if not re.fullmatch(r"\s*\+?(0[xX][0-9a-fA-F]+|\d+)", given) or _number(given) > LAST_DOMAIN:
        raise InputError(
            f"{DOMAIN}={given}: is no ROS domain; give a whole number from 0 to {LAST_DOMAIN}. Of these, 0 to 101 and"
            f" 215 to {LAST_DOMAIN} are clear of the ports that Linux hands out by itself"
        )


def _number(text: str) -> int:
    """As C reads it: with 0 before it octal, which is smaller than it looks."""
    return int(text, 16) if "x" in text.lower() else int(text)


def _check_implementation(name: str) -> None:
    """Load ROS 2 in a process of its own, which it may end: where libraries lie differs between installations."""
    tried = subprocess.run(
        [sys.executable, "-c", "import rclpy"], stdin=subprocess.DEVNULL, capture_output=True, check=False
    )
    if tried.returncode == 0:
        return
    without = {n: value for n, value in os.environ.items() if n != IMPLEMENTATION}
    again = subprocess.run(
        [sys.executable, "-c", "import rclpy; print(rclpy.get_rmw_implementation_identifier())"],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, env=without,
    )  # fmt: skip
    if again.returncode == 0:  # else it is not this that is wrong, and is said where ROS 2 is imported
        raise InputError(
            f"{IMPLEMENTATION}={name}: is not installed here; unset {IMPLEMENTATION}, for {again.stdout.strip()}, or"
            " install it"
        )
