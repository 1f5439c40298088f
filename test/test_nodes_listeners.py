# SPDX-License-Identifier: Apache-2.0
"""A run begins once all who listen are connected: what a simulator publishes earlier is lost to them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import MarkerArray

from inductrack_ros.nodes import listeners
from inductrack_ros.nodes.listeners import LOOK, SETTLED, SLOW, Listeners

KINDS = {"pose": PoseStamped, "measured/pose": PoseStamped, "forces": MarkerArray, "/tf_like": TwistStamped}
DEPTH = 10


class Rig:
    """A node with publishers, another that listens, and a clock that stands until it is moved."""

    def __init__(self, context, monkeypatch) -> None:
        self.now = 100.0
        monkeypatch.setattr(listeners, "time", SimpleNamespace(monotonic=lambda: self.now))
        self._context, self._nodes = context, []
        self._node = node = self.listener("sim")
        self._publishers = {name: node.create_publisher(kind, name, DEPTH) for name, kind in KINDS.items()}
        self.waited_for = Listeners(node, list(self._publishers.values()), self._publishers["pose"])

    def listener(self, name: str):
        self._nodes.append(rclpy.create_node(name, namespace="rig", context=self._context))
        return self._nodes[-1]

    def listens(self, ros, node, topic: str) -> None:
        """Subscribe, and wait until the publisher is connected and the graph tells the node's name."""
        before = self._publishers[topic].get_subscription_count()
        node.create_subscription(KINDS[topic], topic, print, DEPTH)
        ros.wait(lambda: self._publishers[topic].get_subscription_count() > before, f"a listener of {topic}")
        ros.wait(lambda: node.get_name() in self._names(topic), f"{node.get_name()} in the graph")

    def known(self, topic: str) -> int:
        return self._node.count_subscribers(topic)

    def close(self) -> None:
        for node in self._nodes:
            node.destroy_node()

    def _names(self, topic: str) -> set[str]:
        return {end.node_name for end in self._node.get_subscriptions_info_by_topic(topic)}

    def after(self, seconds: float) -> bool:
        """Whether all hear after so long without a change."""
        self.now += LOOK
        self.waited_for.all_hear()  # takes notice of what has changed
        self.now += seconds
        return self.waited_for.all_hear()


@pytest.fixture
def rig(ros, monkeypatch):
    made = Rig(ros.node.context, monkeypatch)
    yield made
    made.close()


def test_nobody_is_waited_for_in_vain(rig):
    assert not rig.after(2 * SLOW)


def test_a_listener_of_the_pose_is_enough(rig, ros):
    rig.listens(ros, rig.listener("controller"), "pose")
    assert not rig.after(0.5 * SETTLED)
    assert rig.after(0.6 * SETTLED)


def test_a_recorder_is_waited_for_until_it_hears_every_topic(rig, ros):
    """One that finds a topic seconds after the pose would miss the first seconds of it."""
    recorder = rig.listener("rosbag2_recorder")
    rig.listens(ros, recorder, "pose")
    assert not rig.after(0.9 * SLOW)
    rig.listens(ros, recorder, "measured/pose")
    assert not rig.after(0.5 * SETTLED)
    assert rig.after(0.6 * SETTLED)  # whoever takes no markers and no transforms is a recorder all the same


def test_a_recorder_of_a_few_topics_does_not_hold_time_for_ever(rig, ros):
    rig.listens(ros, rig.listener("record"), "pose")
    assert rig.after(1.1 * SLOW)


def test_without_a_leading_topic_those_of_any_are_waited_for(rig, ros):
    """As `play` waits: who is connected to one topic and known to listen to another is connected there first."""
    rig.waited_for = Listeners(rig._node, list(rig._publishers.values()))
    assert not rig.after(2 * SETTLED)
    monitor = rig.listener("monitor")
    rig.listens(ros, monitor, "/tf_like")
    assert rig.after(1.1 * SETTLED)
    qos = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # known, and not connected
    monitor.create_subscription(PoseStamped, "pose", print, qos)
    ros.wait(lambda: rig.known("pose") == 1, "the monitor in the graph")
    assert not rig.after(1.1 * SETTLED)


def test_another_recorder_does_not_stand_for_the_first(rig, ros):
    first, second = rig.listener("record"), rig.listener("record_too")
    for topic in ("pose", "measured/pose"):
        rig.listens(ros, first, topic)
    rig.listens(ros, second, "pose")
    assert not rig.after(2 * SETTLED)


def test_a_listener_that_no_publisher_suits_does_not_hold_time_for_ever(rig, ros):
    """It asks for what was published before it came, which nobody offers: DDS never connects it."""
    rig.listens(ros, rig.listener("controller"), "pose")
    qos = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    rig.listener("viewer").create_subscription(PoseStamped, "pose", print, qos)
    ros.wait(lambda: rig.known("pose") == 2, "the viewer in the graph")
    assert not rig.after(0.9 * SLOW)
    assert rig.after(0.2 * SLOW)
