# SPDX-License-Identifier: Apache-2.0
"""How every node of this package is started and stopped."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ..core.errors import InputError
from .domain import reach, stay_local
from .ending import GRACE, STOP, Deadline
from .log_folder import log_somewhere
from .overrides import Overrides, readable

_ROS_ERRORS = (rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError)
NAMESPACE = "inductrack"  # of every node, unless `--ros-args -r __ns:=/other` says otherwise


def every(node: Node, seconds: float, callback: Callable[[], None]) -> None:
    """A timer in real time, also for a node with use_sim_time."""
    node.create_timer(seconds, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def run(make_node: Callable[[Overrides], Node], args: list[str] | None = None) -> int:
    """Spin the node until Ctrl-C, SIGTERM or its attribute ``finished``; close it; return the exit status.

    It is made from what parameter files give, see `overrides`.

    One thread and `spin_once`: in the PyPI wheels the multi-threaded executor starves a 1 kHz timer.
    """
    STOP.listen()
    stay_local()
    node, status = None, 1
    try:
        log_somewhere()
        with readable(sys.argv if args is None else args) as (ros_args, overrides):
            rclpy.init(args=ros_args, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node(overrides)
        for remark in overrides.remarks(node.get_fully_qualified_name()):
            node.get_logger().warning(remark)
        _spin(node)
        status = 0
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        status = 2
    except _ROS_ERRORS as error:
        print(f"error: ROS 2 does not start: {_one_line(error)}", file=sys.stderr)
        status = 2
    finally:
        STOP.left()
        if node is not None:
            getattr(node, "close", lambda: None)()  # first: what is recorded must be safe
            status = status or getattr(node, "exit_status", 0)
        with Deadline(GRACE, status):
            if node is not None:
                node.destroy_node()
            rclpy.try_shutdown()
    return status


def _spin(node: Node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.get_logger().debug(reach())
    STOP.running = True
    try:
        while not STOP.asked and not getattr(node, "finished", False):
            executor.spin_once(timeout_sec=0.1)
    finally:
        executor.remove_node(node)
        executor.shutdown(timeout_sec=0.0)  # else what it holds is destroyed after its context, with a traceback


def _one_line(error: Exception) -> str:
    """What the middleware says, without the places in its own source."""
    return re.sub(r",? at /\S+:\d+", "", " ".join(str(error).split())).removeprefix("failed to initialize rcl: ")
