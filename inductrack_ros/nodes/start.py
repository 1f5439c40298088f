"""Entry points of the nodes: signals are minded before the slow imports, so that an early Ctrl-C is quiet too."""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module


class Stop:
    """What SIGINT and SIGTERM do: end at once while a node starts, ask it to stop once it runs.

    Later ones change nothing: a launched node gets Ctrl-C twice.
    """

    def __init__(self) -> None:
        self.running = False
        self.asked = False

    def listen(self) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, *_: object) -> None:
        if not self.running:
            os._exit(0)  # nothing is open yet; an exception would have to find its way out of imports and compilers
        self.asked = True


STOP = Stop()


def _run(module: str) -> int:
    STOP.listen()
    node = import_module(f".{module}", __package__)
    if {"-h", "--help"} & set(sys.argv[1:]) and not hasattr(node, "parse"):  # others have options of their own, and help for them
        print(f"{node.__doc__}\n\nParameters: ros2 param describe, or README.md; set them with --ros-args -p NAME:=VALUE or --params-file FILE.")
        return 0
    return node.main(sys.argv)


def sim() -> int:
    """`sim`."""
    return _run("sim")


def track_controller() -> int:
    """`track_controller`."""
    return _run("track_controller")


def record() -> int:
    """`record`."""
    return _run("record")


def monitor() -> int:
    """`monitor`."""
    return _run("monitor")


def play() -> int:
    """`play`."""
    return _run("play")
