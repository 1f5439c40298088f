# SPDX-License-Identifier: Apache-2.0
"""The least a node can do: a timer at 1 kHz and an empty pose."""

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import ExternalShutdownException

rclpy.init()
node = rclpy.create_node("empty")
publisher = node.create_publisher(PoseStamped, "/inductrack/pose", 1000)


def publish() -> None:
    """One message."""
    message = PoseStamped()
    message.header.stamp = node.get_clock().now().to_msg()
    publisher.publish(message)


node.create_timer(0.001, publish)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
