# SPDX-License-Identifier: Apache-2.0
"""What is whole in an MCAP file whose end is missing (https://mcap.dev/spec): a recorder that was killed, a full disk.

Such a file has no index, so its records are read one after the other up to the first that is cut, also within the last
chunk. So is a whole file that other programs wrote into as well, which `rosbags` does not open."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # comes with rosbags, as lz4 does

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 3, 4, 5, 6
_LONGEST = 1 << 31  # a record that says that it is longer than this is damaged


@dataclass(frozen=True)
class Channel:
    """Topic of a channel, its message type (with the encoding of its messages, where that is not ROS 2's), and what its
    publisher offered (YAML, may be empty)."""

    topic: str
    msgtype: str
    offered_qos: str


def salvage(file: Path) -> Iterator[tuple[Channel, int, bytes]]:
    """Channel, log time (ns) and bytes of each whole message, in the order of the file."""
    types: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    for kind, content in _records(file):
        try:
            if kind == _SCHEMA:
                types[_u16(content, 0)] = _text(content, 2)[0]
            elif kind == _CHANNEL:
                topic, at = _text(content, 4)
                encoding, at = _text(content, at)
                msgtype = types.get(_u16(content, 2), "") + ("" if encoding == "cdr" else f" ({encoding})")
                channels[_u16(content, 0)] = Channel(topic, msgtype, _offered(content[at:]))
            elif kind == _MESSAGE:
                channel = channels.get(_u16(content, 0))
                if channel is not None:
                    yield channel, struct.unpack_from("<Q", content, 6)[0], content[22:]
        except (struct.error, UnicodeDecodeError):  # damaged, not only cut: nothing behind it can be trusted
            return


def _records(file: Path) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each whole record, those inside chunks in place of the chunk."""
    with file.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            return
        while len(head := stream.read(9)) == 9:
            kind, length = struct.unpack("<BQ", head)
            if length > _LONGEST:
                return
            content = stream.read(length)
            if kind == _CHUNK:
                yield from _inside(content)
            elif len(content) == length:
                yield kind, content


def _inside(chunk: bytes) -> Iterator[tuple[int, bytes]]:
    """The whole records of a chunk, of which the end may be missing."""
    try:
        compression, at = _text(chunk, 28)
        packed = chunk[at + 8 :]
        if compression == "zstd":
            data = zstd.ZstdDecompressor().decompress(packed)
        elif compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed)
        else:
            data = packed if not compression else b""
    except (struct.error, UnicodeDecodeError, zstd.ZstdError, RuntimeError, EOFError):
        return
    at = 0
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        at += 9 + length
        if at > len(data):
            return
        yield kind, data[at - length : at]


def _offered(metadata: bytes) -> str:
    """`offered_qos_profiles` out of a channel's metadata, a map of strings behind its length."""
    at = 4
    while at < len(metadata):
        key, at = _text(metadata, at)
        value, at = _text(metadata, at)
        if key == "offered_qos_profiles":
            return value
    return ""


def _u16(data: bytes, at: int) -> int:
    return struct.unpack_from("<H", data, at)[0]


def _text(data: bytes, at: int) -> tuple[str, int]:
    """A string behind its length, and where the next field begins."""
    end = at + 4 + struct.unpack_from("<I", data, at)[0]
    if end > len(data):
        raise struct.error("a string beyond the end")
    return data[at + 4 : end].decode(), end
