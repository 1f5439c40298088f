# SPDX-License-Identifier: Apache-2.0
"""`play`: what `ros2 bag play` does, for machines without a ROS 2 distribution."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from ..core.errors import InputError
from ..data.bag_files import open_bag
from ..data.distributions import migration
from .listeners import Listeners
from .messages import message_class
from .qos import profile
from .runtime import every, run

LOOK = 1e-3  # s between looks whether a message is due
AT_ONCE = 500  # messages published between looks at Ctrl-C
ENCAPSULATION = 4  # bytes before a message's own
PAUSE = 5.0  # s without a message that are worth a word


class Player(Node):
    """Publishes a bag's bytes as they were recorded, in the rhythm of the recording."""

    def __init__(self, options: argparse.Namespace) -> None:
        super().__init__("play")
        self._options = options
        self.finished = False
        self._open = ExitStack()
        self._damaged = 0
        self._bag = self._open.enter_context(open_bag(Path(options.bag)))
        try:
            self._publishers_by_topic = self._advertise()
            self._messages = self._recorded()
            self._next = next(self._messages, None)
        except InputError:
            self._open.close()
            raise
        for note in self._bag.notes:
            self.get_logger().warning(note)
        if self._next is None:
            asked = " on the topics asked for" if options.topics else ""
            raise InputError(f"{options.bag}: no messages{asked} that can be played")
        self._listeners = Listeners(self, list(self._publishers_by_topic.values()))
        self._zero, self._begin = self._next[0], None
        self._paused = False  # whether the pause before the next message was told
        self.sent = 0
        self._announce = time.monotonic() + 1.0
        every(self, LOOK, self._look)

    def _advertise(self) -> dict[str, object]:
        publishers = {}
        held = sorted(self._bag.topics)
        for topic in self._options.topics or ():
            if topic not in held:
                raise InputError(f"{self._options.bag}: no topic {topic}; it has {', '.join(held) or 'none'}")
        for topic, recorded in self._bag.topics.items():
            if self._options.topics and topic not in self._options.topics:
                continue
            try:
                kind = message_class(recorded.msgtype)
            except (ImportError, AttributeError, ValueError):
                self.get_logger().warning(f"{topic} is not played: {recorded.msgtype} is not installed")
                continue
            publishers[topic] = self.create_publisher(
                kind, topic, profile(not recorded.lossy, latched=recorded.latched)
            )
        return publishers

    def _recorded(self) -> Iterator[tuple[int, str, bytes]]:
        """Log time (ns), topic and bytes of each message, in order, in the form of this distribution."""
        migrations = {topic: migration(self._bag.topics[topic].msgtype) for topic in self._publishers_by_topic}
        for topic, at, data in self._bag.messages(self._publishers_by_topic):
            migrated = migrations[topic](data) if migrations[topic] else bytes(data)
            if migrated and len(migrated) > ENCAPSULATION:
                yield at, topic, migrated
            else:
                self._damaged += 1

    def _look(self) -> None:
        if self._begin is None:
            self._wait_for_a_listener()
            return
        due = self._zero + (time.monotonic() - self._begin) * self._options.rate * 1e9
        for _ in range(AT_ONCE):
            if self._next is None:
                self.finished = all(p.wait_for_all_acked() for p in self._publishers_by_topic.values())
                return
            if self._next[0] > due:
                self._tell_of_a_pause((self._next[0] - due) / self._options.rate / 1e9)
                return
            _, topic, data = self._next
            self._publishers_by_topic[topic].publish(data)
            self._paused = False
            self.sent += 1
            self._next = next(self._messages, None)

    def _tell_of_a_pause(self, seconds: float) -> None:
        if seconds > PAUSE and not self._paused:
            self._paused = True
            self.get_logger().info(f"nothing was recorded for the next {seconds:.0f} s; --rate shortens that")

    def _wait_for_a_listener(self) -> None:
        """Begin once so many listen to one of the topics, and who listens to others is connected there too."""
        most = max(p.get_subscription_count() for p in self._publishers_by_topic.values())
        if self._options.at_once or (most >= self._options.listeners and self._listeners.all_hear()):
            self._begin = time.monotonic() + self._options.delay
            rate = "" if self._options.rate == 1.0 else f" at {self._options.rate:g} times its speed"
            self.get_logger().info(f"playing {self._options.bag}{rate}; Ctrl-C ends it")
        elif time.monotonic() > self._announce:
            self._announce = float("inf")
            self.get_logger().info("too few listen to any of its topics yet; waiting (--at-once does not wait)")

    def close(self) -> None:
        self._open.close()
        damaged = f"; {self._damaged} that are damaged were left out" if self._damaged else ""
        print(f"{self.sent} messages played{damaged}")


def parse(args: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="play", description=__doc__)
    parser.add_argument("bag", help="folder of the bag, or one of its files")
    parser.add_argument("-r", "--rate", type=_positive, default=1.0, help="recorded seconds to a second")
    parser.add_argument(
        "-d",
        "--delay",
        type=float,
        default=0.5,
        help="seconds between the last listener waited for and the first message",
    )
    parser.add_argument("-l", "--listeners", type=int, default=1, help="wait for so many on one of its topics")
    parser.add_argument("-t", "--topics", nargs="+", help="full names of the topics to play; default: all")
    parser.add_argument("--at-once", action="store_true", help="do not wait for somebody who listens")
    return parser.parse_args(args)


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError("must be above 0")
    return value


def main(args: list[str] | None = None) -> int:
    options = parse(remove_ros_args(args if args is not None else sys.argv)[1:])
    return run(lambda _: Player(options), args)


if __name__ == "__main__":
    sys.exit(main())
