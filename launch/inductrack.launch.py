"""Simulator and, where asked for, track controller, monitor, recorder and RViz.

    ros2 launch inductrack_ros inductrack.launch.py
    ros2 launch inductrack_ros inductrack.launch.py params_file:=model.yaml          # the model of a diagnosis
    ros2 launch inductrack_ros inductrack.launch.py drive:=pulses rviz:=true bag:=run_01
    ros2 launch inductrack_ros inductrack.launch.py --show-args

All nodes live in one namespace and refer to topics by relative names, so that two rigs fit on one domain.
"""

from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

ARGUMENTS = {
    "params_file": (
        PathJoinSubstitution([FindPackageShare("inductrack_ros"), "config", "default.yaml"]),
        "parameter file for all nodes: a model that `inductrack diagnose` wrote, or a copy of config/default.yaml",
    ),
    "namespace": ("inductrack", "namespace of all nodes and topics"),
    "drive": ("averaged", "averaged (no controller needed) or pulses (the track controller fires the coils)"),
    "initial_state": ("surge_rate=15.5", "name=value,…; heave is the equilibrium's unless given"),
    "controller": (PythonExpression(["'", LaunchConfiguration("drive"), "' == 'pulses'"]), "start track_controller"),
    "lockstep": ("false", "simulated time waits for the controller"),
    "monitor": ("false", "start the monitor, which says where the model fails"),
    "rviz": ("false", "start RViz with track, cradle, gaps and force arrows"),
    "bag": ("", "record all topics of the namespace into this rosbag2; empty: do not"),
}


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    common = {"package": "inductrack_ros", "namespace": value["namespace"], "output": "screen"}
    simulator = {"drive": value["drive"], "initial_state": value["initial_state"], "lockstep": value["lockstep"]}
    asked_bag = PythonExpression(["'", value["bag"], "' != ''"])
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=meaning)
                for name, (default, meaning) in ARGUMENTS.items()
            ),
            Node(executable="sim", parameters=[value["params_file"], simulator], **common),
            Node(
                executable="track_controller",
                parameters=[value["params_file"], {"lockstep": value["lockstep"]}],
                condition=IfCondition(value["controller"]),
                **common,
            ),
            Node(
                executable="monitor",
                parameters=[value["params_file"], {"drive": value["drive"]}],
                condition=IfCondition(value["monitor"]),
                **common,
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([FindPackageShare("inductrack_ros"), "rviz", "forces.rviz"])],
                remappings=[
                    (f"/inductrack/{topic}", PythonExpression(["'/", value["namespace"], f"/{topic}'"]))
                    for topic in ("forces", "scene", "odometry", "measured/pose")
                ],
                condition=IfCondition(value["rviz"]),
            ),
            ExecuteProcess(
                cmd=["ros2", "bag", "record", "--regex", ["/", value["namespace"], "/.*"], "-o", value["bag"]],
                condition=IfCondition(asked_bag),
                output="screen",
            ),
        ]
    )
