# SPDX-License-Identifier: Apache-2.0
"""A drive controller of your own, against the topics alone (docs/controllers.md). Run it beside the simulator:

    sim --ros-args -p drive:=pulses -p lockstep:=true        # on a distribution: ros2 run inductrack_ros sim …
    python examples/my_controller.py

It sees every pose, fires each coil as the cradle passes it, and holds 15 m/s by a current in proportion to what is
missing. It uses the true pose and speed; yours would use what it can measure.
"""

import signal

import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import UInt64MultiArray

COIL_SPACING = 0.05  # m, half a wavelength
PULSE_LENGTH = 600e-6  # s
LEAD = 0.006  # s: command a pulse so long before it begins; a message takes about 1 ms
SPEED = 15.0  # m/s

rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # its own raise an exception, at times inside C++
node = rclpy.create_node("my_controller", namespace="inductrack")
drive_pulses = node.create_publisher(PointStamped, "drive_pulses", 1000)
done = node.create_publisher(UInt64MultiArray, "lockstep/done", 1000)
latest_speed = 0.0
next_coil = 0


def take_twist(message):
    global latest_speed
    latest_speed = message.twist.linear.x


def take_pose(message):
    global next_coil
    now = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec  # simulated time, ns: never your own clock
    surge, sent = message.pose.position.x, 0
    next_coil = max(next_coil, int(surge / COIL_SPACING) + 1)
    while latest_speed > 1.0:
        seconds = (next_coil * COIL_SPACING - surge) / latest_speed - PULSE_LENGTH / 2  # centred on the passage
        if seconds > LEAD:
            break
        current = min(max(7000.0 + 3000.0 * (SPEED - latest_speed), 0.0), 14000.0)
        if seconds > 0.0:
            pulse = PointStamped()
            begin = now + round(seconds * 1e9)
            pulse.header.stamp = Time(sec=begin // 10**9, nanosec=begin % 10**9)
            pulse.header.frame_id = "track"
            pulse.point.x = float(next_coil)
            pulse.point.y = current if next_coil % 2 == 0 else -current  # neighbours are wound the other way round
            drive_pulses.publish(pulse)
            sent += 1
        next_coil += 1
    done.publish(UInt64MultiArray(data=[now, sent]))  # only a simulator in lockstep listens


node.create_subscription(TwistStamped, "twist", take_twist, 1000)
node.create_subscription(PoseStamped, "pose", take_pose, 1000)
asked = []  # signals to stop: Ctrl-C, or SIGTERM from a launch
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *which: asked.append(which))
executor = SingleThreadedExecutor()
executor.add_node(node)
while not asked:
    executor.spin_once(timeout_sec=0.1)
rclpy.try_shutdown()
