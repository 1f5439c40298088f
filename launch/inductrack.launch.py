# SPDX-License-Identifier: Apache-2.0
"""Simulator and, where asked for, track controller, monitor, recorder and RViz.

    ros2 launch inductrack_ros inductrack.launch.py
    ros2 launch inductrack_ros inductrack.launch.py params_file:=model.yaml          # the model of a diagnosis
    ros2 launch inductrack_ros inductrack.launch.py drive:=pulses rviz:=true bag:=run_01
    ros2 launch inductrack_ros inductrack.launch.py --show-args

Everything is decided, and refused where it cannot be, before the first process starts: see
`inductrack_ros.nodes.launching`."""

import signal
import threading
from collections.abc import Callable
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_package_share_directory
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.events.process import ProcessExited, ProcessStarted, SignalProcess
from launch.logging import get_logger, launch_config
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.utilities import make_namespace_absolute, prefix_namespace
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from inductrack_ros.core.errors import InputError
from inductrack_ros.nodes.ending import HELD_BACK, NO_ORPHAN
from inductrack_ros.nodes.launching import ARGUMENTS, Started, failed, misspelt, plan, rviz_configuration
from launch import Action, LaunchContext, LaunchDescription

PACKAGE = "inductrack_ros"
JOINING = "60"  # s that the recorder gets to join the files of its bag before launch ends it


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    declared = (
        DeclareLaunchArgument(
            name, default_value=one.default, description=one.meaning, choices=list(one.choices) or None
        )
        for name, one in ARGUMENTS.items()
    )
    return LaunchDescription([*declared, OpaqueFunction(function=processes)])


def processes(context: LaunchContext) -> list[Action]:
    """One action for each process, and what sees to its end. Raises `InputError` before any has begun."""
    _keep_ctrl_c_out(context)
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    for words in misspelt(context.launch_configurations):
        get_logger("launch.user").warning(words)
    share = Path(get_package_share_directory(PACKAGE))
    given["params_file"] = given["params_file"] or str(share / "config" / "default.yaml")
    namespace = _namespace(given["namespace"], context)
    nodes = [_node(one, namespace, given) for one in plan(given, namespace)]
    rviz = [_rviz(share, namespace, given)] if given["rviz"] == "true" else []
    told = [RegisterEventHandler(OnProcessStart(target_action=n, on_start=_told(n))) for n in [*nodes, *rviz]]
    # After the others: it would be deaf to Ctrl-C, since it does not know that this is held back.
    last = [RegisterEventHandler(OnProcessStart(target_action=nodes[-1], on_start=rviz))] if rviz else []
    return [*told, *last, *nodes]


def _keep_ctrl_c_out(context: LaunchContext) -> None:
    """Ctrl-C comes to launch by its loop, no more as a KeyboardInterrupt wherever launch happens to be.

    After such an exception launch would know nothing of a process that it was starting, and wait for its end for ever.
    The nodes, which the loop starts in its next turn, are born with Ctrl-C held back. `HELD_BACK` alone begins to do so
    after they are born."""

    def hold_back() -> None:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        context.asyncio_loop.call_soon(signal.pthread_sigmask, signal.SIG_SETMASK, before)

    context.asyncio_loop.call_soon(hold_back)
    ours = threading.current_thread() is threading.main_thread()
    if ours and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda *_: None)


def _told(node: Node) -> Callable[[ProcessStarted, LaunchContext], list[EmitEvent]]:
    """What follows the start of a process that the terminal's Ctrl-C came too early for: launch takes it for told."""

    def started(_: ProcessStarted, context: LaunchContext) -> list[EmitEvent]:
        tell = SignalProcess(signal_number=signal.SIGINT, process_matcher=matches_action(node))
        return [EmitEvent(event=tell)] if context.is_shutdown else []

    return started


def _namespace(name: str, context: LaunchContext) -> str:
    """The absolute namespace; below that of a group of actions (PushRosNamespace), unless it begins with a slash."""
    namespace = make_namespace_absolute(
        prefix_namespace(context.launch_configurations.get("ros_namespace"), name.rstrip("/") or "/")
    )
    try:
        validate_namespace(namespace)
    except InvalidNamespaceException as error:
        raise InputError(f"namespace:={name}: {str(error).splitlines()[0].rstrip(':')}") from None
    return namespace


def _node(one: Started, namespace: str, given: dict[str, str]) -> Node:
    parameters = {n: ParameterValue(v, value_type=type(v)) for n, v in one.parameters.items()}
    return Node(
        package=PACKAGE, executable=one.executable, exec_name=one.executable, name=one.executable,
        namespace=namespace, output="screen",
        parameters=[*([given["params_file"]] if one.reads_file else []), *([parameters] if parameters else [])],
        arguments=list(one.arguments), ros_arguments=["--log-level", given["log_level"]],
        prefix=[LaunchConfiguration("launch-prefix", default=""), f" {HELD_BACK} {NO_ORPHAN}"],
        on_exit=_after(one.executable) if one.needed else None,
        **({"sigterm_timeout": JOINING} if one.executable == "record" else {}),
    )  # fmt: skip


def _after(executable: str) -> Callable[[ProcessExited, LaunchContext], list[Shutdown]]:
    """What follows the end of a process that is needed: that of the launch, with status 1 where the process failed."""

    def ended(event: ProcessExited, context: LaunchContext) -> list[Shutdown]:
        if failed(event.returncode, context.is_shutdown):
            raise RuntimeError(f"{executable} was required and has ended with status {event.returncode}")
        return [Shutdown(reason=f"{executable} has ended")]

    return ended


def _rviz(share: Path, namespace: str, given: dict[str, str]) -> Node:
    try:
        get_package_prefix("rviz2")
    except PackageNotFoundError:
        raise InputError("rviz:=true, but rviz2 is not installed: apt install ros-$ROS_DISTRO-rviz2") from None
    config = given["rviz_config"]
    if not config:
        made = Path(launch_config.log_dir, f"{namespace.strip('/').replace('/', '_')}.rviz")
        made.write_text(
            rviz_configuration((share / "rviz" / "forces.rviz").read_text(encoding="utf-8"), namespace, given),
            encoding="utf-8",
        )
        config = str(made)
    time = {"use_sim_time": True} if given["use_sim_time"] == "true" else {}
    return Node(
        package="rviz2", executable="rviz2", exec_name="rviz2", namespace=namespace, arguments=["-d", config],
        prefix=NO_ORPHAN, parameters=[time] if time else [], ros_arguments=["--log-level", given["log_level"]],
    )  # fmt: skip
