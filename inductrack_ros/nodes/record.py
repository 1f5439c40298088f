# SPDX-License-Identifier: Apache-2.0
"""`record`: what `ros2 bag record` does, for machines without a ROS 2 distribution."""

from __future__ import annotations

import argparse
import sys
import time
from datetime import datetime
from functools import partial
from itertools import chain, count, islice
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.utilities import remove_ros_args

from ..core.errors import InputError
from .bag import SegmentedBag
from .domain import reach
from .ending import STOP
from .messages import message_class, waiting
from .runtime import NAMESPACE, every, run

QUEUE_DEPTH = 20000  # messages a topic may bring while one second is being written
FLUSH_PERIOD = 0.5  # s; what `kill -9` can cost, with the second of grace the promise gives
TIME_PERIOD = 0.02  # s between looks at the time, where a duration is asked for
SENT_AGAIN = 4.0  # s without a message after which none is on its way; Fast DDS repeats lost ones every 3 s
SILENT = 1.0  # s; the same where the topics that are waited for have brought nothing at all
LOOK_PERIOD = 0.2  # s between looks for new topics
NOT_WANTED = ("lockstep/", "forces", "scene")  # unless asked for: bookkeeping, and what is there once more as markers


class Recorder(Node):
    """Subscribes without deserializing and hands the bytes to a `SegmentedBag`."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__("record", namespace=options.namespace)
        self._options = options
        STOP.running = True  # a signal from here on must not end the process before the bag is closed
        self._bag = SegmentedBag(options.output)
        self._skipped: set[str] = set()
        self._begun: float | None = None  # s, monotonic
        self._first: dict[str, int] = {}  # header stamp (ns) from which each topic's time counts
        self._passed: dict[str, float] = {}  # ns of its time that each topic has reached
        self._last = float("inf") if options.duration is None else options.duration * 1e9  # ns since the first message
        self._kept_at = 0.0  # s, monotonic; when the last message was kept
        self._subscriptions_by_topic: dict[str, Subscription] = {}
        self.finished, self.exit_status = False, 0
        self._look_for_topics()
        every(self, LOOK_PERIOD, self._look_for_topics)
        every(self, FLUSH_PERIOD, self._flush)
        if options.duration is not None:
            every(self, TIME_PERIOD, self._look_at_time)
        self.get_logger().info(f"recording into {options.output}; Ctrl-C ends it")

    def _wanted(self, topic: str) -> bool:
        if self._options.all:
            return True
        if self._options.topics:
            return topic in self._options.topics
        name = topic.removeprefix(f"{self.get_namespace().rstrip('/')}/")
        return topic == "/clock" or (name != topic and not name.startswith(NOT_WANTED))

    def _look_for_topics(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            if topic in self._subscriptions_by_topic or topic in self._skipped or not self._wanted(topic):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if not offers:
                continue  # only subscribers so far
            try:
                self._subscribe(topic, types[0], offers)
            except (InputError, ImportError, AttributeError, ValueError) as error:
                self._skipped.add(topic)
                self.get_logger().warning(f"{topic} is not recorded: {error}")

    def _subscribe(self, topic: str, type_name: str, offers: list) -> None:
        reliable = all(o.qos_profile.reliability == ReliabilityPolicy.RELIABLE for o in offers)
        latched = all(o.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers)
        self._bag.add_topic(topic, type_name, reliable, latched, stamped=self._options.stamp == "header")
        qos = QoSProfile(
            depth=QUEUE_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        self._subscriptions_by_topic[topic] = self.create_subscription(
            message_class(type_name), topic, partial(self._take, topic), qos, raw=True
        )

    def _take(self, topic: str, data: bytes, info: dict[str, int]) -> None:
        self._keep(topic, data, info)
        self._take_waiting(topic)

    def _take_waiting(self, topic: str) -> None:
        """Keep what lies in the topic's queue now."""
        for data, info in islice(waiting(self._subscriptions_by_topic[topic]), QUEUE_DEPTH):
            self._keep(topic, data, info)

    def _keep(self, topic: str, data: bytes, info: dict[str, int]) -> None:
        """Hold a message for the bag, unless it came after the end that was asked for. On a busy machine it may have
        come long before it is kept."""
        received = info["received_timestamp"] or time.time_ns()  # 0: this middleware does not say
        waited = max(0, time.time_ns() - received) / 1e9
        came = time.monotonic() - waited  # a clock that is set must not end the recording
        self._begun = came if self._begun is None else min(self._begun, came)
        if self._options.stamp == "header":
            at = stamp_ns(data)
            passed = at - self._begin_of(topic, at)
            self._passed[topic] = max(self._passed.get(topic, 0), passed)
        else:
            at, passed = received, (came - self._begun) * 1e9
        if passed <= self._last:
            self._bag.write(topic, at, data)
            self._kept_at = time.monotonic()

    def _begin_of(self, topic: str, stamp: int) -> int:
        """The stamp (ns) from which a topic's time counts: the first of all that are on its clock."""
        if topic not in self._first:
            same_clock = [first for first in self._first.values() if 0 <= stamp - first <= self._last]
            self._first[topic] = min(same_clock, default=stamp)
        return self._first[topic]

    def _flush(self) -> None:
        try:
            self._bag.flush()
        except OSError as error:  # the disk is full, the folder gone; what was flushed before can be read
            self._fail(f"cannot be written: {error.strerror}; recording ends, what is in it can be read")
            self.finished = True

    def _look_at_time(self) -> None:
        if self._begun is None:
            return
        if self._options.stamp == "header":
            self.finished |= self._all_have_come()
        else:
            self.finished |= (time.monotonic() - self._begun) * 1e9 >= self._last

    def _all_have_come(self) -> bool:
        """Whether every topic has reached the end, or one has and the others are silent. On a busy machine one topic
        comes long after another, and pulses come only while somebody drives."""
        behind = {t for t in self._subscriptions_by_topic if self._passed.get(t, -1) < self._last}
        if not behind or len(behind) == len(self._subscriptions_by_topic):
            return not behind
        for topic in self._subscriptions_by_topic:
            self._take_waiting(topic)
        patience = SENT_AGAIN if behind & self._passed.keys() else SILENT
        return time.monotonic() - self._kept_at > patience

    def close(self) -> None:
        if not self.exit_status:
            for topic in self._subscriptions_by_topic:
                self._take_waiting(topic)
            try:
                self._bag.close()
            except OSError as error:
                self._fail(f"not all was written: {error.strerror}; what is in it can be read")
        count, topics = self._bag.message_count, len(self._subscriptions_by_topic)
        self.get_logger().info(f"{count} messages on {topics} topics in {self._bag.path}")
        if not count:
            self.get_logger().warning(f"nothing was heard: does anybody publish? {reach()}")

    def _fail(self, words: str) -> None:
        self.exit_status = 1
        self.get_logger().error(f"{self._bag.path}: {words}")


def stamp_ns(data: bytes) -> int:
    """Time (ns) at the start of a serialized message whose first field is a Header or a Time."""
    order = "little" if data[1] & 1 else "big"
    return int.from_bytes(data[4:8], order, signed=True) * 10**9 + int.from_bytes(data[8:12], order)


def parse(args: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="record", description=__doc__)
    parser.add_argument("topics", nargs="*", help="full topic names; default: all of the namespace, and /clock")
    parser.add_argument("-a", "--all", action="store_true", help="record every topic there is")
    parser.add_argument(
        "-n",
        "--namespace",
        default=NAMESPACE,
        help=f"of the topics, default: {NAMESPACE}; --ros-args -r __ns:=/NAME says it too",
    )
    parser.add_argument("-o", "--output", help="folder of the bag; default: rosbag2_<date and time>")
    parser.add_argument(
        "-d",
        "--duration",
        type=_duration,
        help="end so many seconds after the first message, of the time that --stamp says",
    )
    parser.add_argument(
        "--stamp", choices=["receive", "header"], default="receive",
        help="time a message is filed under: its arrival, or its own header stamp (stamped topics only), "
        "so that repeated lockstep runs give the same bag",
    )  # fmt: skip
    options = parser.parse_args(args)
    options.namespace = options.namespace.strip("/")
    options.output = options.output or _unused_name()
    return options


def _duration(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError("must be above 0")
    return value


def _unused_name() -> str:
    """A folder named by date and time, numbered where one of this second is there already."""
    name = datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    numbered = (f"{name}_{i}" for i in count(1))
    return next(n for n in chain([name], numbered) if not Path(n).exists())


def main(args: list[str] | None = None) -> int:
    options = parse(remove_ros_args(args if args is not None else sys.argv)[1:])
    return run(lambda _: Recorder(options), args)


if __name__ == "__main__":
    sys.exit(main())
