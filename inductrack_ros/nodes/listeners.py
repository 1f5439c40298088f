# SPDX-License-Identifier: Apache-2.0
"""Who listens to a node, and whether all of them are connected: what is published earlier is lost to them."""

from __future__ import annotations

import time

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

LOOK = 0.05  # s between two looks at the graph
SETTLED = 0.5  # s without a new listener after which no other is expected
SLOW = 5.0  # s; the same while a recorder hears some of the topics only, because it may still find the others


def recorders(node: Node, topic: str) -> set[tuple[str, str]]:
    """Namespace and name of each node that records ``topic``: `record` and `ros2 bag record` are known by name."""
    ends = node.get_subscriptions_info_by_topic(topic)
    return {(end.node_namespace, end.node_name) for end in ends if "record" in end.node_name}


class Answerers:
    """Who publishes on ``topic`` in answer to ``question``, a topic too.

    What is put to them is put once, for a second message would make another run of it in a bag. Nothing is lost on the
    way to who is there already and listens reliably, however long the answer takes.
    """

    def __init__(self, node: Node, topic: str, question: str) -> None:
        self._node, self._topic, self._question_topic = node, topic, question
        self._question = -1
        self._seen: set[bytes] = set()  # at the last look
        self._asked: set[bytes] = set()  # who was seen before the present question

    def may_not_have_heard(self, question: int) -> bool:
        """Whether somebody has come since the question of this number was put, or may have lost it; to be called at
        every look."""
        if question != self._question:
            self._question, self._asked = question, self._seen
        ends = self._node.get_publishers_info_by_topic(self._topic)
        self._seen = {bytes(end.endpoint_gid) for end in ends}
        names = {(end.node_namespace, end.node_name) for end in ends}
        lossy = any(
            (end.node_namespace, end.node_name) in names
            for end in self._node.get_subscriptions_info_by_topic(self._question_topic)
            if end.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
        )
        return lossy or not self._seen <= self._asked


class Listeners:
    """The listeners of all publishers of a node. ``leading`` is the publisher whose listeners are waited for; without
    it those of any are."""

    def __init__(self, node: Node, publishers: list[Publisher], leading: Publisher | None = None) -> None:
        self._node, self._publishers, self._leading = node, publishers, leading
        self._heard: list[int] = []  # listeners connected to each publisher
        self._since = self._next_look = 0.0  # s, monotonic: of the last change; of the next look

    def all_hear(self) -> bool:
        """Whether somebody listens, all who listen are connected, and nobody else is expected.

        A recorder subscribes to one topic after the other, and on a busy machine it finds some topics seconds late.
        So a recorder of the leading topic is expected on every topic. Markers and topics outside the namespace are
        no part of that, because not every recorder takes them. After `SLOW` without a change nobody is waited for:
        a recorder may have been asked for a few topics only, and a listener with another quality of service is never
        connected.
        """
        now = time.monotonic()
        if now < self._next_look:
            return False
        self._next_look = now + LOOK
        heard = [publisher.get_subscription_count() for publisher in self._publishers]
        if heard != self._heard:
            self._heard, self._since = heard, now
        calm = now - self._since
        if calm < SETTLED or not (self._leading.get_subscription_count() if self._leading else any(heard)):
            return False
        return calm >= SLOW or (self._all_connected() and self._recorders_hear_all())

    def _all_connected(self) -> bool:
        return all(
            self._node.count_subscribers(publisher.topic_name) <= publisher.get_subscription_count()
            for publisher in self._publishers
        )

    def _recorders_hear_all(self) -> bool:
        if self._leading is None:
            return True
        names = recorders(self._node, self._leading.topic_name)
        namespace = self._node.get_namespace().rstrip("/") + "/"
        return all(
            names <= recorders(self._node, publisher.topic_name)
            for publisher in self._publishers
            if publisher.topic_name.startswith(namespace) and publisher.msg_type is not MarkerArray
        )
