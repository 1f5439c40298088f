# SPDX-License-Identifier: Apache-2.0
"""From rest by the bungee, afloat, driven, and down on the wheels: one run of the simulator, see
docs/launch_from_rest.md.

    ros2 launch inductrack_ros launch_from_rest.launch.py bag:=from_rest

It is `inductrack.launch.py` with `config/launch_from_rest.yaml`, and takes its other arguments.
"""

from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` runs."""
    share = FindPackageShare("inductrack_ros")
    source = PythonLaunchDescriptionSource(PathJoinSubstitution([share, "launch", "inductrack.launch.py"]))
    file = PathJoinSubstitution([share, "config", "launch_from_rest.yaml"])
    return LaunchDescription([IncludeLaunchDescription(source, launch_arguments={"params_file": file}.items())])
