# SPDX-License-Identifier: Apache-2.0
"""What ``inductrack watch`` runs: a node that looks at the others, lists topics or prints one of them."""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import islice

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseStamped, TwistStamped, WrenchStamped
from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rich.console import Console
from rich.live import Live
from sensor_msgs.msg import Range

from .. import frames
from ..core.errors import InputError
from ..core.state import COORDINATES, FURTHER_SENSORS, GAPS, INSTRUMENTS, RATES
from .messages import flat, message_class, plain, waiting
from .runtime import every, run
from .topics import message_type, nanoseconds_of, read_fields
from .watch_view import View, line, screen, words_of_list

LOOK = 0.1  # s between looks at what came
LINE = 1.0  # s between lines where the output is no terminal
SETTLED = 1.5  # s without a new topic after which the list is complete
LONGEST = 6.0  # s without a new topic that the list, or one view, waits at most
SILENT = 2.0  # s after which it is said that nothing comes
QUEUE = 2000  # messages of one topic between two looks
#: The nodes' own log has no place on the screen.
_QUIET = ["watch", "--ros-args", "--log-level", "error", "--disable-rosout-logs"]


class Polled(CallbackGroup):
    """Subscriptions that no executor wakes up for: their messages are taken when there is time to show them."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class Watcher(Node):
    """Takes what lies in its subscriptions' queues at every look."""

    def __init__(self, namespace: str) -> None:
        super().__init__("watch", namespace=namespace, start_parameter_services=False)
        self.finished = False
        self._polled = Polled()
        self._taken: list[tuple[Subscription, Callable[[object], None]]] = []
        self._since = time.monotonic()
        self._known: list[str] = []

    @property
    def waited(self) -> float:
        """Seconds since the start, or since the newest topic appeared."""
        return time.monotonic() - self._since

    def find(self) -> dict[str, list[str]]:
        """All topics, with their types; a new one starts the waiting anew."""
        topics = dict(self.get_topic_names_and_types())
        if sorted(topics) != self._known:
            self._known, self._since = sorted(topics), time.monotonic()
        return topics

    def take(self, kind: type, topic: str, into: Callable[[object], None], qos: QoSProfile) -> None:
        """Hand every message of a topic to ``into``."""
        self._taken.append((self.create_subscription(kind, topic, into, qos, callback_group=self._polled), into))

    def take_all(self) -> None:
        """Hand out what came since the last time."""
        for subscription, into in self._taken:
            for message, _ in islice(waiting(subscription), subscription.qos_profile.depth):
                into(message)

    def offered(self) -> dict[str, list[str]]:
        """Topics that somebody publishes, with their types."""
        return {t: types for t, types in self.find().items() if self.count_publishers(t)}


class Lister(Watcher):
    """All topics, once no more appear."""

    def __init__(self, namespace: str) -> None:
        super().__init__(namespace)
        every(self, LOOK, self._look)

    def _look(self) -> None:
        topics = self.find()
        alone = len(self.get_node_names()) < 2
        if self.waited < (LONGEST if alone else SETTLED):
            return
        rows = [(t, ", ".join(topics[t]), self.count_publishers(t), self.count_subscribers(t)) for t in self._known]
        print(words_of_list([r for r in rows if r[2] or r[3]]))
        self.finished = True


class Echo(Watcher):
    """Prints one topic as YAML or as a table."""

    def __init__(self, topic: str, namespace: str, once: bool, table: bool) -> None:
        super().__init__(namespace)
        self._topic = topic if topic.startswith("/") else f"/{namespace}/{topic}"
        self._once, self._table = once, table
        self._columns: list[str] | None = None
        self._writer = csv.writer(sys.stdout, lineterminator="\n")
        self._told = False
        every(self, LOOK, self._look)

    def _look(self) -> None:
        if not self._taken:
            self._subscribe()
        self.take_all()
        sys.stdout.flush()
        if self._columns is None and not self._told and self.waited > SILENT:
            self._told = True
            what = "nobody publishes it" if not self._taken else "it is silent"
            print(f"{self._topic}: {what} so far; waiting (inductrack watch --list shows all topics)", file=sys.stderr)

    def _subscribe(self) -> None:
        types = self.offered().get(self._topic)
        if not types:
            return
        try:
            kind = message_class(types[0])
        except (ImportError, AttributeError, ValueError):
            raise InputError(f"{self._topic}: its type {types[0]} is not installed") from None
        ends = [info.qos_profile for info in self.get_publishers_info_by_topic(self._topic)]
        qos = QoSProfile(depth=QUEUE)
        if any(e.reliability == ReliabilityPolicy.BEST_EFFORT for e in ends):
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if all(e.durability == DurabilityPolicy.TRANSIENT_LOCAL for e in ends):
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        self.take(kind, self._topic, self._print, qos)

    def _print(self, message: object) -> None:
        if self.finished:
            return
        data = plain(message)
        if self._table:
            self._print_row(dict(flat(data)))
        else:
            print(yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=1000) + "---")
            self._columns = []
        self.finished = self._once

    def _print_row(self, row: dict[str, object]) -> None:
        if self._columns is None:
            self._columns = list(row)
            self._writer.writerow(self._columns)
        if list(row) != self._columns:
            raise InputError(f"{self._topic}: its messages differ in length, so they make no table; leave out --csv")
        self._writer.writerow(row.values())


class Board(Watcher):
    """Collects what the nodes of a namespace publish and shows it."""

    def __init__(self, namespace: str, once: bool) -> None:
        super().__init__(namespace)
        self._view = View(f"/{namespace}")
        self._once = once
        self._console = Console()
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal and not once else None
        self._next_line, self._last_line = 0.0, ""
        self._offered: frozenset[str] = frozenset()
        latest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        for before, which in (("", "truth"), ("measured/", "measured")):
            self.take(PoseStamped, f"{before}pose", partial(self._take_pose, which), latest)
            self.take(TwistStamped, f"{before}twist", partial(self._take_twist, which), latest)
            for gap in GAPS:
                self.take(Range, f"{before}{gap}", partial(self._take_gap, which, gap), latest)
        for sensor in FURTHER_SENSORS:
            self.take(message_type(sensor), f"measured/{sensor}", partial(self._take_further, sensor), latest)
        for name in ("missing_force", "missing_force_sigma"):
            self.take(WrenchStamped, name, partial(self._take_wrench, name), latest)
        self._latest = latest
        self.take(PointStamped, "fired_pulses", self._take_pulse, latest)
        self.take(DiagnosticArray, "/diagnostics", self._take_diagnostics, QoSProfile(depth=100))
        every(self, LOOK, self._look)
        if self._live:
            self._live.start()

    # -- what comes in --------------------------------------------------------------------------------------------

    def _take_pose(self, which: str, message: PoseStamped) -> None:
        p, q = message.pose.position, message.pose.orientation
        values = frames.pose_to_coordinates((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
        self._view.heard(which, dict(zip(COORDINATES, values.tolist(), strict=True)))
        self._view.time = nanoseconds_of(message.header.stamp) / 1e9

    def _take_further(self, sensor: str, message: object) -> None:
        reading = read_fields(message, sensor).tolist()
        self._view.heard("measured", dict(zip(INSTRUMENTS[sensor].channels, reading, strict=True)))

    def _take_twist(self, which: str, message: TwistStamped) -> None:
        linear, angular = message.twist.linear, message.twist.angular
        self._view.heard(which, dict(zip(RATES, (linear.x, linear.y, linear.z, angular.x), strict=True)))

    def _take_gap(self, which: str, gap: str, message: Range) -> None:
        self._view.heard(which, {gap: message.range})

    def _take_wrench(self, name: str, message: WrenchStamped) -> None:
        f, t = message.wrench.force, message.wrench.torque
        values = frames.wrench_to_force((f.x, f.y, f.z), (t.x, t.y, t.z))
        self._view.wrenches[name] = tuple(values.tolist())

    def _take_pulse(self, message: PointStamped) -> None:
        self._view.last_pulse = message.point.x, message.point.y

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            level = int.from_bytes(status.level, "little") if isinstance(status.level, bytes) else status.level
            facts = {v.key: v.value for v in status.values}
            self._view.diagnosed(status.name, level, status.message, facts)

    # -- what goes out --------------------------------------------------------------------------------------------

    def _look(self) -> None:
        self._view.now = now = time.monotonic()
        self._follow_wrenches()
        self.take_all()
        if self._once:
            if self._is_complete() or self.waited > LONGEST:
                self._console.print(screen(self._view))
                self.finished = True
        elif self._live:
            self._live.update(screen(self._view), refresh=True)
        elif now >= self._next_line:
            self._next_line = now + LINE
            if (words := line(self._view)) not in ("", self._last_line):
                print(words, flush=True)
            self._last_line = words

    def _is_complete(self) -> bool:
        """Whether no new topic appears, a state with its rates is there, and every diagnosing node and every wrench of
        the namespace was heard."""
        speakers = {
            info.node_name for info in self.get_publishers_info_by_topic("/diagnostics")
            if info.node_namespace == self._view.namespace
        }  # fmt: skip
        state = {**self._view.measured, **self._view.truth}
        wrenches = {topic.rsplit("/", 1)[-1] for topic in self._offered}
        return (
            self.waited > SETTLED
            and {"surge", "surge_rate"} <= set(state)
            and speakers <= set(self._view.statuses)
            and wrenches <= set(self._view.wrenches)
        )

    def _follow_wrenches(self) -> None:
        """Each effect has a topic of its own, so they are found and not listed."""
        before = f"{self.get_namespace().rstrip('/')}/wrench/"
        offered = frozenset(t for t in self.offered() if t.startswith(before))
        for topic in sorted(offered - self._offered):
            self.take(WrenchStamped, topic, partial(self._take_wrench, topic.removeprefix(before)), self._latest)
        self._offered |= offered

    def close(self) -> None:
        """Leave the last view on the screen."""
        if self._live:
            self._live.stop()


def watch(topic: str | None, namespace: str, listed: bool, once: bool, table: bool) -> None:
    """Run what was asked for, until Ctrl-C. Raises `InputError` where ROS does not start."""
    if listed:
        make = partial(Lister, namespace)
    elif topic:
        make = partial(Echo, topic, namespace, once, table)
    else:
        make = partial(Board, namespace, once)
    if run(lambda *_: make(), _QUIET):
        raise SystemExit(2)
