# SPDX-License-Identifier: Apache-2.0
"""Peak memory (MB) of recording a bag of pose and twist at 1 kHz, reading or playing it: bag_memory.py record|read|play
BAG SECONDS."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

RATE = 1000  # Hz


def record(bag: str | Path, seconds: float) -> None:
    """As `record` writes: messages as they come, a file a second, joined where the bag is short."""
    from rosbags.typesys import Stores, get_typestore

    from inductrack_ros.nodes.bag import SegmentedBag

    types, out = get_typestore(Stores.ROS2_JAZZY), SegmentedBag(bag)
    T = types.types
    header = T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](0, 0), "track")
    zero = T["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
    pose = T["geometry_msgs/msg/Pose"](
        T["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    )
    messages = {
        "/inductrack/pose": T["geometry_msgs/msg/PoseStamped"](header, pose),
        "/inductrack/twist": T["geometry_msgs/msg/TwistStamped"](header, T["geometry_msgs/msg/Twist"](zero, zero)),
    }
    data = {}
    for topic, message in messages.items():
        out.add_topic(topic, message.__msgtype__)
        data[topic] = bytes(types.serialize_cdr(message, message.__msgtype__))
    for i in range(int(seconds * RATE)):
        stamp = i * 1_000_000_000 // RATE
        for topic, text in data.items():
            out.write(topic, stamp, text[:4] + struct.pack("<iI", *divmod(stamp, 1_000_000_000)) + text[12:])
        if i % RATE == RATE - 1:
            out.flush()
    out.close()


def read(bag: str | Path, seconds: float) -> None:
    from inductrack_ros.data.bags import read_bag

    assert len(read_bag(bag).times) == int(seconds * RATE)


def play(bag: str | Path, seconds: float) -> None:
    """As `play` does, as fast as it can, to nobody."""
    from inductrack_ros.nodes.domain import claim_domain

    with claim_domain():
        from inductrack_ros.nodes.play import main

        assert main(["play", str(bag), "--at-once", "--rate", "1000"]) == 0


if __name__ == "__main__":
    {"record": record, "read": read, "play": play}[sys.argv[1]](sys.argv[2], float(sys.argv[3]))
    status = Path("/proc/self/status").read_text()  # not getrusage, whose peak is the parent's too
    print(int(status.partition("VmHWM:")[2].split()[0]) / 1024)
