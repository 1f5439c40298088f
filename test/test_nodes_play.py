# SPDX-License-Identifier: Apache-2.0
"""`play`: what it reads, what it publishes, and what it says."""

import pytest
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from sensor_msgs.msg import Range
from test_data_bags import EPOCH, GOOD, POSE, RANGE, STORE, gap, poses
from test_data_odd_bags import humble_gap, raw, sqlite_bag

from inductrack_ros.data.distributions import migration
from inductrack_ros.nodes.qos import profile


def test_play_plays_what_compare_reads(ros, tmp_path):
    folder = sqlite_bag(tmp_path / "run #1", {GOOD: [*raw(poses(20)), (POSE, b"")]}, wal_from=5)
    player = ros.start("play", "--at-once", "-d", "0", str(folder))
    assert player.wait() == 0
    assert "20 messages played; 1 that are damaged were left out" in player.output
    assert "run_0.db3-wal is read too" in player.output


def test_play_brings_messages_of_an_older_distribution_up_to_date(tmp_path):
    """As they are, DDS would hand them to nobody."""
    up_to_date = migration(RANGE)
    _, old = humble_gap(EPOCH, 0.005)
    assert up_to_date(old) != old
    assert STORE.deserialize_cdr(up_to_date(old), RANGE).range == pytest.approx(0.005)
    (_, new), *_ = raw([gap(EPOCH, 0.005)])
    assert up_to_date(new) == new and up_to_date(b"no message") is None
    assert migration(POSE) is None and migration("my_msgs/msg/Thing") is None


def test_play_publishes_as_was_recorded_and_tells_of_a_pause(ros, tmp_path):
    """What was kept for those who come later is kept again."""
    for_ever = QosTime(0, 0)
    qos = Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
        for_ever, for_ever, QosLiveliness.AUTOMATIC, for_ever, False,
    )  # fmt: skip
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kept = writer.add_connection("/kept", RANGE, typestore=STORE, offered_qos_profiles=[qos])
        for late in (0, 3600 * 10**9):
            writer.write(kept, EPOCH + late, STORE.serialize_cdr(gap(EPOCH, 0.005)[1], RANGE))
    player = ros.start("play", "--at-once", "-d", "0", str(tmp_path / "bag"))
    ros.wait(lambda: "nothing was recorded for the next 3600 s" in player.output, "the pause")
    heard = []
    ros.node.create_subscription(Range, "/kept", heard.append, profile(latched=True))
    ros.wait(lambda: heard, "what was kept")
    assert heard[0].range == pytest.approx(0.005)
    assert player.stop() == 0
    assert "1 messages played" in player.output


@pytest.mark.parametrize("home", ["/proc/none", ""])
def test_play_without_a_home(ros, tmp_path, monkeypatch, home):
    """ROS 2 does not start where it cannot write its logs, so they go elsewhere."""
    folder = sqlite_bag(tmp_path / "run", {GOOD: raw(poses(3))})
    monkeypatch.setenv("HOME", home)
    monkeypatch.setenv("INDUCTRACK_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("ROS_LOG_DIR")
    player = ros.start("play", "--at-once", "-d", "0", str(folder))
    assert player.wait() == 0 and "3 messages played" in player.output
    assert list((tmp_path / "cache" / "log").iterdir())
