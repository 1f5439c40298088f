# SPDX-License-Identifier: Apache-2.0
"""``inductrack watch``: its options, and what is started for them. ROS is imported when the command runs."""

from __future__ import annotations

import argparse

from ..core.errors import InputError
from .middleware import check_middleware

EPILOG = """examples:
  inductrack watch                                  state, gaps, forces, pulses and the monitor's verdict, live
  inductrack watch --list                           all topics
  inductrack watch measured/pose --once             one message
  inductrack watch twist --csv > twist.csv          a table, until Ctrl-C

A TOPIC without a leading / is one of the namespace. Where the output is no terminal, the live view is one line a second."""  # noqa: E501


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "topic", metavar="TOPIC", nargs="?", help="print this topic's messages (default: the live view)"
    )
    parser.add_argument("-n", "--namespace", default="inductrack", help="namespace of the nodes (default: inductrack)")
    parser.add_argument("--list", action="store_true", help="list all topics, with their types and who is on them")
    parser.add_argument("--once", action="store_true", help="end after one message, or one view of the whole")
    parser.add_argument("--csv", action="store_true", help="print TOPIC as a table with a header")
    parser.epilog = EPILOG


def run(arguments: argparse.Namespace) -> None:
    """Watch until Ctrl-C. Raises `InputError` for options that do not go together, or where ROS is missing."""
    if arguments.list and (arguments.topic or arguments.once or arguments.csv):
        raise InputError("--list stands alone")
    if arguments.csv and not arguments.topic:
        raise InputError("--csv needs a TOPIC; inductrack watch --list shows what there is")
    check_middleware()
    try:
        from .watch import watch
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] == __package__.partition(".")[0]:
            raise
        raise InputError(
            f"watch needs ROS 2, and {error.name} is missing; source a distribution, or pip install"
            " 'inductrack_ros[ros]'"
        ) from None
    watch(arguments.topic, arguments.namespace.strip("/"), arguments.list, arguments.once, arguments.csv)
