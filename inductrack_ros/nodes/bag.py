# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 folder that can be read at every moment of its recording, even after ``kill -9``.

An MCAP file is readable only once its footer is written. So messages are held for up to a second and then written as
one complete file more, after which ``metadata.yaml``, which names the files, is replaced in one step. At the end the
files of a bag that is not too long are joined into one.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from ..core.errors import InputError

VERSION = 9  # of the metadata: Jazzy's
JOINED = 300_000  # messages up to which a bag's files are joined at the end, which takes a second for each 100,000

_METADATA = """\
rosbag2_bagfile_information:
  version: {version}
  storage_identifier: mcap
  duration:
    nanoseconds: {duration}
  starting_time:
    nanoseconds_since_epoch: {start}
  message_count: {count}
  topics_with_message_count:{topics}
  compression_format: ""
  compression_mode: ""
  relative_file_paths:{paths}
  files:{files}
  custom_data: ~
  ros_distro: rosbags
"""

_TOPIC = """
    - topic_metadata:
        name: {name}
        type: {type}
        serialization_format: cdr
        offered_qos_profiles:
          - {{history: unknown, depth: 0, reliability: {reliability}, durability: {durability}, \
deadline: {{sec: 9223372036, nsec: 854775807}}, lifespan: {{sec: 9223372036, nsec: 854775807}}, \
liveliness: automatic, liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}, \
avoid_ros_namespace_conventions: false}}
        type_description_hash: {hash}
      message_count: {count}"""

_FILE = """
    - path: {path}
      starting_time:
        nanoseconds_since_epoch: {start}
      duration:
        nanoseconds: {duration}
      message_count: {count}"""


@dataclass
class _Topic:
    type: str
    definition: str
    hash: str
    qos: Qos
    count: int = 0
    pending: list[tuple[int, bytes]] = field(default_factory=list)


class SegmentedBag:
    """Writes serialized messages; `flush` makes everything so far safe. Never overwrites an existing bag."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise InputError(f"{self.path} exists already; give another --output or move it away")
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._topics: dict[str, _Topic] = {}
        self._files: list[tuple[str, int, int, int]] = []  # name, first and last time, messages
        try:
            self.path.mkdir(parents=True)
            self._write_metadata()
        except OSError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror}; give another --output") from None

    @property
    def message_count(self) -> int:
        return sum(t.count for t in self._topics.values())

    def add_topic(
        self, name: str, type_name: str, reliable: bool = True, latched: bool = False, stamped: bool = False
    ) -> None:
        """Prepare for a topic.

        Raises `InputError` for a message type whose definition is not known or which, where it must be `stamped`,
        does not begin with a time, its own or its header's.
        """
        if type_name not in self._types.fielddefs:
            raise InputError(f"the definition of {type_name} is not known")
        first_field = self._types.fielddefs[type_name][1][0][1]
        if stamped and first_field[1] not in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time"):
            raise InputError(f"{type_name} has no header stamp; use --stamp receive")
        definition, _ = self._types.generate_msgdef(type_name, ros_version=2)
        forever = QosTime(9223372036, 854775807)
        qos = Qos(
            QosHistory.UNKNOWN, 0,
            QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
            QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            forever, forever, QosLiveliness.AUTOMATIC, forever, False,
        )  # fmt: skip
        self._topics[name] = _Topic(type_name, definition, self._types.hash_rihs01(type_name), qos)

    def write(self, topic: str, time_ns: int, data: bytes) -> None:
        """Hold one serialized message until the next `flush`."""
        self._topics[topic].pending.append((time_ns, data))

    def flush(self) -> None:
        """Write what is held as one more complete file, then name it in the metadata."""
        waiting = {name: topic for name, topic in self._topics.items() if topic.pending}
        if not waiting:
            return
        name = f"{self.path.name}_{len(self._files)}.mcap"
        times = [time_ns for topic in waiting.values() for time_ns, _ in topic.pending]
        self._write_file(name, ((topic, *one) for topic in waiting for one in self._topics[topic].pending))
        self._files.append((name, min(times), max(times), len(times)))
        for topic in waiting.values():
            topic.count += len(topic.pending)
            topic.pending.clear()
        self._write_metadata()

    def close(self) -> None:
        """Flush, and join the files of a bag of up to `JOINED` messages. Raises `OSError`; what was flushed stays."""
        self.flush()
        if len(self._files) < 2 or self.message_count > JOINED:
            return
        with Reader(self.path) as reader:
            self._write_file(f"{self.path.name}.mcap", ((c.topic, t, data) for c, t, data in reader.messages()))
        parts = self._files
        first, last = min(start for _, start, _, _ in parts), max(end for _, _, end, _ in parts)
        self._files = [(f"{self.path.name}.mcap", first, last, self.message_count)]
        self._write_metadata()
        for name, *_ in parts:
            (self.path / name).unlink()

    def _write_file(self, name: str, messages: Iterable[tuple[str, int, bytes]]) -> None:
        """One complete MCAP file, which appears whole."""
        aside = self.path / ".part"
        connections = {}
        try:
            with Writer(aside, version=VERSION, storage_plugin=StoragePlugin.MCAP) as writer:
                for topic, time_ns, data in messages:
                    if topic not in connections:
                        t = self._topics[topic]
                        connections[topic] = writer.add_connection(
                            topic, t.type, msgdef=t.definition, rihs01=t.hash, offered_qos_profiles=[t.qos]
                        )
                    writer.write(connections[topic], time_ns, data)
            (aside / ".part.mcap").rename(self.path / name)
        finally:
            shutil.rmtree(aside, ignore_errors=True)

    def _write_metadata(self) -> None:
        start = min((first for _, first, _, _ in self._files), default=0)
        end = max((last for _, _, last, _ in self._files), default=0)
        topics = "".join(
            _TOPIC.format(
                name=name, type=t.type, hash=t.hash, count=t.count,
                reliability=t.qos.reliability.name.lower(), durability=t.qos.durability.name.lower(),
            )
            for name, t in self._topics.items()
        )  # fmt: skip
        files = "".join(
            _FILE.format(path=name, start=first, duration=last - first, count=count)
            for name, first, last, count in self._files
        )
        text = _METADATA.format(
            version=VERSION,
            duration=end - start,
            start=start,
            count=self.message_count,
            paths="".join(f"\n    - {n}" for n, *_ in self._files) or " []",
            topics=topics or " []",
            files=files or " []",
        )
        new = self.path / "metadata.yaml.new"
        try:
            new.write_text(text, encoding="utf8")
            new.replace(self.path / "metadata.yaml")
        finally:
            new.unlink(missing_ok=True)
