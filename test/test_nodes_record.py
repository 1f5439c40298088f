# SPDX-License-Identifier: Apache-2.0
"""`record`: nothing lost, and a bag that can be read however the recorder ends."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.state import STATES
from inductrack_ros.data import read_bag, write_bag
from inductrack_ros.nodes.bag import SegmentedBag

TYPES = get_typestore(Stores.ROS2_JAZZY)
POSE = "geometry_msgs/msg/PoseStamped"

#: Publishes numbered poses on N topics at 1 kHz until it is told the count or ended; says the last number it sent. Its
#: queues are as long as those of `sim`: a busy machine may leave the recorder out for seconds.
SOURCE = """
import sys, time, rclpy
from geometry_msgs.msg import PoseStamped
topics, count = int(sys.argv[1]), int(sys.argv[2])
rclpy.init()
node = rclpy.create_node("source", namespace="inductrack")
publishers = [node.create_publisher(PoseStamped, f"topic{i}", 10000) for i in range(topics)]
while not all(p.get_subscription_count() for p in publishers):
    time.sleep(0.01)
message, begin = PoseStamped(), time.perf_counter()
message.pose.orientation.w = 1.0
for number in range(count):
    message.header.stamp.sec, message.header.stamp.nanosec = 1 + number // 1000, number % 1000 * 1_000_000
    message.pose.position.x = float(number)
    for publisher in publishers:
        publisher.publish(message)
    if number % 50 == 0:
        print(number, flush=True)
    wait = begin + (number + 1) / 1000 - time.perf_counter()
    if wait > 0:
        time.sleep(wait)
print("all sent", flush=True)
while rclpy.ok():  # a writer that ends takes what is on its way with it
    time.sleep(0.1)
"""


def numbers_in(bag: Path) -> dict[str, list[int]]:
    """The number of every message, per topic, by a reader of others."""
    found: dict[str, list[int]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append(int(message.pose.position.x))
    return found


def kept(bag: Path) -> int:
    """How many numbers can be read of each topic."""
    return min(map(len, numbers_in(bag).values()), default=0) if list(bag.glob("*.mcap")) else 0


def source(ros, topics: int, count: int):
    script = ros.folder / "source.py"
    script.write_text(SOURCE)
    return ros.start(str(script), str(topics), str(count))


def test_eight_topics_at_a_kilohertz_lose_nothing(ros, tmp_path):
    bag = tmp_path / "bag"
    recorder = ros.start("record", "-o", str(bag))
    sender = source(ros, 8, 3000)
    sender.wait_for("all sent")
    metadata = bag / "metadata.yaml"
    ros.wait(lambda: "  message_count: 24000" in metadata.read_text(), "the last message in the bag")
    assert recorder.stop() == 0 and "24000 messages on 8 topics" in recorder.output
    assert [p.name for p in bag.glob("*.mcap")] == ["bag.mcap"]
    recorded = numbers_in(bag)
    assert len(recorded) == 8 and all(numbers == list(range(3000)) for numbers in recorded.values())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_bag_is_complete_after_ctrl_c_and_sigterm(ros, tmp_path, number):
    bag = tmp_path / "bag"
    recorder = ros.start("record", "-o", str(bag), "--stamp", "header")
    sender = source(ros, 1, 100000)
    sender.wait_for("\n500\n")
    ros.wait(lambda: list(bag.glob("*.mcap")), "something in the bag")
    assert recorder.stop(number) == 0
    numbers = numbers_in(bag)["/inductrack/topic0"]
    assert numbers == list(range(len(numbers))) and f"{len(numbers)} messages on 1 topics" in recorder.output
    run = read_bag(bag, {"pose": "/inductrack/topic0"})  # what `inductrack compare` reads
    assert len(run.times) == len(numbers) and run.times[-1] == pytest.approx((len(numbers) - 1) / 1000)


@pytest.mark.parametrize("moment", [200, 650, 1150, 1600])
def test_kill_9_costs_at_most_the_last_second(ros, tmp_path, figure, moment):
    bag = tmp_path / "bag"
    recorder = ros.start("record", "-o", str(bag))
    sender = source(ros, 2, 100000)

    def sent() -> int:
        return int(sender.output.split()[-1])

    def keeps_pace() -> bool:
        """Nothing more is sent from here on where it does: else the recorder may fall behind before it is killed."""
        sender.send(signal.SIGSTOP)
        if sent() - kept(bag) < 700:
            return True
        sender.send(signal.SIGCONT)
        return False

    sender.wait_for(f"\n{moment}\n")
    ros.wait(keeps_pace, "the recorder to keep pace, which a busy machine may not let it")
    until = sent() + 50
    recorder.kill()
    recorded = numbers_in(bag)
    for numbers in recorded.values():
        assert numbers == list(range(len(numbers)))
        figure("lost by a recorder that was killed", f"at most {until - len(numbers)} ms")
        assert until - len(numbers) <= 1000
    assert recorded or until <= 1000
    assert len(unnamed(bag)) <= 1  # it was killed between the writing of a file and that of its name


KILLED = """
import os, signal, sys
from inductrack_ros.nodes import bag, record, start

written = bag.SegmentedBag._write_metadata
def write(self):
    if len(self._files) == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    written(self)
bag.SegmentedBag._write_metadata = write
sys.argv = ["record", "-o", "bag"]
start.record()
"""


def test_kill_9_between_a_file_and_its_name_leaves_what_was_named(ros):
    script = ros.folder / "killed.py"
    script.write_text(KILLED)
    recorder = ros.start(str(script))
    source(ros, 1, 100000)
    assert recorder.wait() == -signal.SIGKILL
    bag = ros.folder / "bag"
    assert unnamed(bag) == ["bag_1.mcap"]
    numbers = numbers_in(bag)["/inductrack/topic0"]
    assert numbers == list(range(len(numbers))) and numbers


def unnamed(bag: Path) -> list[str]:
    """Files of messages that the metadata does not name."""
    named = (bag / "metadata.yaml").read_text()
    return [p.name for p in bag.iterdir() if p.suffix == ".mcap" and p.name not in named]


def test_an_existing_bag_is_not_overwritten(ros, tmp_path):
    (tmp_path / "bag").mkdir()
    recorder = ros.start("record", "-o", str(tmp_path / "bag"))
    assert recorder.wait() == 2
    assert "exists already; give another --output" in recorder.output and "Traceback" not in recorder.output
    assert not list((tmp_path / "bag").iterdir())


def test_where_nothing_can_be_written_it_says_so(ros, tmp_path):
    (tmp_path / "file").write_text("")
    recorder = ros.start("record", "-o", str(tmp_path / "file" / "bag"))
    assert recorder.wait() == 2 and "cannot be written: Not a directory; give another --output" in recorder.output

    recorder = ros.start("record", "-o", str(tmp_path / "bag"))  # the folder goes while it records
    sender = source(ros, 1, 100000)
    sender.wait_for("\n50\n")
    (tmp_path / "bag").rename(tmp_path / "gone")  # in one step: the recorder may be at it
    (tmp_path / "bag").write_text("")
    assert recorder.wait() == 1 and "recording ends" in recorder.output and "Traceback" not in recorder.output


@pytest.mark.parametrize("stamp", ["receive", "header"])
def test_a_duration_is_kept_to_a_tenth_of_a_second(ros, tmp_path, stamp):
    """It once ended up to half a second late, at the next flush. Half a second of time, by either clock."""
    bag = tmp_path / "bag"
    recorder = ros.start("record", "-o", str(bag), "-d", "0.5", "--stamp", stamp)
    source(ros, 2, 100000)
    assert recorder.wait() == 0
    with Reader(bag) as reader:
        first, span = reader.start_time / 1e9, reader.duration / 1e9
    if stamp == "header":
        assert span == pytest.approx(0.5, abs=0.1)
    else:  # a busy machine may leave source and middleware out for the last tenth
        ended = float(re.search(r"\[(\d+\.\d+)\] \[\S+\]: \d+ messages on", recorder.output)[1])
        assert span < 0.51 and ended - first > 0.49


#: A recorder that gets no turn for two seconds, twice a second.
BUSY = """
import sys, time
from inductrack_ros.nodes import record, start

record.Recorder._flush = lambda _: time.sleep(2.0)
sys.argv[0] = "record"
start.record()
"""


def test_what_came_in_time_is_kept_with_the_time_it_came(ros, tmp_path):
    """A busy recorder once filed what had waited under the time it took it, and left out what it took too late."""
    bag, busy = tmp_path / "bag", ros.folder / "busy.py"
    busy.write_text(BUSY)
    recorder = ros.start(str(busy), "-o", str(bag), "-d", "1")
    source(ros, 2, 100000)
    assert recorder.wait() == 0
    with Reader(bag) as reader:
        times = [time_ns / 1e9 for _, time_ns, _ in reader.messages()]
    begin = min(times)
    assert max(times) - begin == pytest.approx(1.0, abs=0.1)
    assert all(any(a <= t - begin < a + 0.25 for t in times) for a in (0.0, 0.25, 0.5, 0.75))


#: Like `SOURCE`, but the second topic comes half a second after the first, and the third brings one message only.
LATE = (
    SOURCE.split("while not all")[0]
    + """
while not all(p.get_subscription_count() for p in publishers):
    time.sleep(0.01)
for publisher, count in zip(publishers, (2000, 2000, 1)):
    message = PoseStamped()
    for number in range(count):
        message.header.stamp.sec, message.header.stamp.nanosec = 1 + number // 1000, number % 1000 * 1_000_000
        message.pose.position.x = float(number)
        publisher.publish(message)
    time.sleep(0.5)
while rclpy.ok():
    time.sleep(0.1)
"""
)


#: A recorder that waits for topics which have brought nothing for as long as a busy machine may keep their source.
PATIENT = """
import sys
from inductrack_ros.nodes import record, start

record.SILENT = 60.0
sys.argv[0] = "record"
start.record()
"""


def test_a_duration_is_that_of_every_topic(ros, tmp_path):
    """On a busy machine one topic comes long after another. The recording once ended with the first."""
    bag, script, patient = tmp_path / "bag", ros.folder / "late.py", ros.folder / "patient.py"
    script.write_text(LATE)
    patient.write_text(PATIENT)
    recorder = ros.start(str(patient), "-o", str(bag), "-d", "1", "--stamp", "header")
    ros.start(str(script), "3", "0")
    assert recorder.wait() == 0
    recorded = numbers_in(bag)
    assert [len(recorded[f"/inductrack/topic{i}"]) for i in range(3)] == [1001, 1001, 1]


def test_only_asked_topics_and_a_duration(ros, tmp_path):
    bag = tmp_path / "bag"
    recorder = ros.start("record", "-o", str(bag), "-d", "0.5", "/inductrack/topic1")
    publisher = ros.node.create_publisher(PoseStamped, "/inductrack/topic1", 1000)
    other = ros.node.create_publisher(PoseStamped, "/inductrack/topic0", 1000)
    ros.wait(publisher.get_subscription_count, "the recorder")

    def publish() -> None:
        publisher.publish(PoseStamped())
        other.publish(PoseStamped())
        time.sleep(0.01)

    assert recorder.wait(publish) == 0 and re.search(r"\d+ messages on 1 topics", recorder.output)
    assert list(numbers_in(bag)) == ["/inductrack/topic1"]


def test_a_segmented_bag_reads_like_any_other(tmp_path):
    """The same messages by rosbags' own writer and by the recorder's: same connections, times and bytes."""
    write_bag(
        tmp_path / "plain",
        [0.0, 0.5, 1.0],
        {c: [0.0, 1.0, 2.0] for c in STATES},
        start=5.0,
    )  # fmt: skip
    ours = SegmentedBag(tmp_path / "ours")
    with Reader(tmp_path / "plain") as reader:
        for connection in reader.connections:
            ours.add_topic(connection.topic, connection.msgtype)
        for connection, time_ns, raw in reader.messages():
            ours.write(connection.topic, time_ns, raw)
            ours.flush()
    ours.close()
    both = []
    for name in ("plain", "ours"):
        with Reader(tmp_path / name) as reader:
            messages = sorted((c.topic, time_ns, raw) for c, time_ns, raw in reader.messages())
            both.append((reader.start_time, reader.duration, messages))
    assert both[0] == both[1]
    with pytest.raises(InputError, match="not known"):
        ours.add_topic("/odd", "my_msgs/msg/Odd")


@pytest.mark.skipif(find_spec("ros2bag") is None, reason="`ros2 bag` comes with a ROS 2 distribution")
def test_ros2_bag_reads_it(tmp_path):
    bag = SegmentedBag(tmp_path / "bag")
    bag.add_topic("/inductrack/pose", POSE)
    bag.close()
    subprocess.run(["ros2", "bag", "info", str(tmp_path / "bag")], check=True, stdout=sys.stderr)
