# SPDX-License-Identifier: Apache-2.0
"""Entry points of the nodes: signals are minded before the slow imports, so that an early Ctrl-C is quiet too.

python -m inductrack_ros.nodes.start NAME …                 as the command NAME
"""

from __future__ import annotations

import sys
import traceback
from importlib import import_module

from ..core.errors import InputError
from ..core.memory import room_to_begin, too_little
from ..terminal import speak_to_any_terminal
from .ending import STOP, leave
from .middleware import check_middleware


def _run(module: str) -> None:
    """Run the node of this name; the process ends with its status."""
    STOP.listen()
    speak_to_any_terminal()
    try:
        room_to_begin()
        if not {"-h", "--help"} & set(sys.argv[1:]):
            check_middleware()
        status = _main(module)
    except (InputError, MemoryError) as error:
        said = too_little(error) if isinstance(error, MemoryError) else error
        print(f"error: {said}", file=sys.stderr)
        status = 2
    except SystemExit as error:  # of the options' parser, which has said why
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        status = 1
    leave(status)


def _main(module: str) -> int:
    node = import_module(f".{module}", __package__)
    # Others have options of their own, and help for them.
    if {"-h", "--help"} & set(sys.argv[1:]) and not hasattr(node, "parse"):
        print(
            f"{node.__doc__}\n\nParameters: ros2 param describe, or docs/interfaces.md; set them with --ros-args -p"
            " NAME:=VALUE or --params-file FILE."
        )
        return 0
    return node.main(sys.argv)


def sim() -> None:
    """`sim`."""
    _run("sim")


def track_controller() -> None:
    """`track_controller`."""
    _run("track_controller")


def record() -> None:
    """`record`."""
    _run("record")


def monitor() -> None:
    """`monitor`."""
    _run("monitor")


def play() -> None:
    """`play`."""
    _run("play")


if __name__ == "__main__":
    _run(sys.argv.pop(1))
