# SPDX-License-Identifier: Apache-2.0
"""What a node says about itself on /diagnostics, once a second."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

PERIOD = 1.0  # s


class Diagnostics:
    """Publishes counters; the level is WARN while one that is a fault has grown since the last time."""

    def __init__(self, node: Node, name: str, hardware: str = "simulator") -> None:
        self._node = node
        self._name, self._hardware = name, hardware
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._last: dict[str, int] = {}

    def publish(
        self, faults: Mapping[str, int], facts: Mapping[str, object], verdict: tuple[bool, str] = (True, "")
    ) -> None:
        """`faults` are counts since the start that should stay 0; `facts` are anything else worth knowing; `verdict`
        is whether all is well otherwise, and the words that say so.
        """
        grown = [name for name, count in faults.items() if count > self._last.get(name, 0)]
        self._last = dict(faults)
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if verdict[0] and not grown else DiagnosticStatus.WARN,
            name=f"{self._node.get_fully_qualified_name()}: {self._name}",
            message=", ".join(filter(None, [verdict[1], *grown])) or "running",
            hardware_id=self._hardware,
            values=[KeyValue(key=k, value=str(v)) for k, v in {**faults, **facts}.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def strangers(node: Node, pulses: bool) -> dict[str, str]:
    """Which nodes a simulator finds too many or too few, in short and in a sentence that says what to do."""
    found = {}
    if node.count_publishers("pose") > 1:
        found["another simulator"] = (
            "another node publishes pose in this namespace: two simulators on one domain? (One that was killed counts"
            " for 20 s.) Give one of them its own ROS_DOMAIN_ID, or a namespace with --ros-args -r __ns:=/other"
        )
    if pulses:
        controllers = node.count_publishers("drive_pulses")
        if controllers == 0:
            found["no controller"] = "nobody publishes drive_pulses: no thrust until a controller starts"
        if controllers > 1:
            found["another controller"] = (
                f"{controllers} nodes publish drive_pulses (one that was killed counts for 20 s); end all but one"
            )
    return found
