# SPDX-License-Identifier: Apache-2.0
"""What is whole in an MCAP file (https://mcap.dev/spec) whose end is missing, of a recorder that was killed or a full
disk, or that is damaged anywhere.

Its records are read one after the other. Behind damage they go on where records follow one another again, also within
a chunk. So is a whole file read that other programs wrote into as well, which `rosbags` does not open."""

from __future__ import annotations

import mmap
import re
import struct
import sys
from binascii import crc32
from collections.abc import Collection, Iterator
from pathlib import Path

import lz4.frame

from .salvage import Channel, Found, Loss

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # comes with rosbags, as lz4 does

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _CHUNK_INDEX, _STATISTICS = 3, 4, 5, 6, 8, 11
#: Bytes that the records of each kind, from 1 on, have at least.
_LEAST = dict(enumerate((8, 20, 14, 16, 22, 40, 6, 64, 36, 48, 46, 8, 20, 17, 4), start=1))
_INSIDE = (_SCHEMA, _CHANNEL, _MESSAGE)
#: In the place of records that are lost, and before those of a chunk whose check sum does not fit.
_LOST, _CHANGED = -1, -2
#: What may be the head of a record; it is one where so many whole records follow one another from there.
_HEAD, _CHAIN = re.compile(rb"(?s)(?=[\x01-\x0f].{4}\0{4})"), 3
_DAMAGE = _LOST, b""
#: Bytes that are unpacked at a time where not all can be, and most that one block of zstd holds (of lz4, as `ros2 bag`
#: has it written, half of that).
_PIECE, _BLOCK = 1024, 1 << 17
_FOOTER = 9 + 20 + len(MAGIC)

_Data = bytes | mmap.mmap
_Record = tuple[int, bytes]


def salvage(file: Path) -> Iterator[Found]:
    """Each whole message and each stretch that is lost, in the order of the file."""
    types: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    last, lost = None, False
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        for kind, content in _summary(data):  # it repeats what the chunks say, of which one may be lost
            if kind in (_SCHEMA, _CHANNEL):
                _learn(kind, content, types, channels)
        for kind, content in _records(data):
            if kind == _CHANGED:
                yield Loss(*struct.unpack_from("<QQ", content), changed=True)
            elif kind in (_SCHEMA, _CHANNEL):
                lost |= not _learn(kind, content, types, channels)
            elif kind == _MESSAGE and len(content) >= 22 and (channel := channels.get(_u16(content, 0))) is not None:
                time = struct.unpack_from("<Q", content, 6)[0]
                if lost:
                    yield Loss(last, time)
                last, lost = time, False
                yield channel, time, content[22:]
            else:
                lost |= kind in (_LOST, _MESSAGE)
    if lost:
        yield Loss(last, None)


def is_whole(file: Path) -> bool:
    """Whether every record follows the one before it, unpacks, and has the check sum that is written."""
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        if data[-len(MAGIC) :] != MAGIC or len(data) < len(MAGIC) + _FOOTER:
            return False
        begin, _, check = struct.unpack_from("<QQI", data, len(data) - _FOOTER + 9)
        if check and crc32(data[begin : len(data) - len(MAGIC) - 4]) != check:
            return False
        indexed = [struct.unpack_from("<QQ", content, 16) for kind, content in _summary(data) if kind == _CHUNK_INDEX]
        heads = ((_CHUNK, length - 9) == _head(data, at) for at, length in indexed)
        records = _walk(data, len(MAGIC), len(data) - len(MAGIC), _LEAST)
        return all(heads) and all(kind != _LOST and (kind != _CHUNK or _is_sound(c)) for kind, c in records)


def promised(file: Path) -> tuple[int, int | None]:
    """How many messages the file's own summary counts, and the log time (ns) of the first; 0 and None where it is
    lost."""
    with file.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        counted = [content for kind, content in _summary(data) if kind == _STATISTICS]
    return (
        (struct.unpack_from("<Q", counted[0])[0], struct.unpack_from("<Q", counted[0], 26)[0]) if counted else (0, None)
    )


# ---------------------------------------------------------------- records


def _records(data: _Data) -> Iterator[_Record]:
    """Kind and content of each whole record of the file, those inside chunks in place of the chunk."""
    if data[: len(MAGIC)] != MAGIC:
        return
    end = len(data) - len(MAGIC) * (data[-len(MAGIC) :] == MAGIC)
    for kind, content in _walk(data, len(MAGIC), end, _LEAST):
        if kind == _CHUNK:
            yield from _inside(content)
        else:
            yield kind, content


def _walk(data: _Data, at: int, end: int, kinds: Collection[int]) -> Iterator[_Record]:
    """Kind and content of each whole record between two bytes, and of a chunk whose end is missing.

    `_LOST` stands in the place of what is damaged. A message right before it is lost too, for the damage may begin
    there."""
    held: _Record | None = None
    while at + 9 <= end:
        kind, length = _head(data, at)
        behind = at + 9 + length
        if not _fits(kind, length, kinds) or behind > end:
            cut_chunk = kind == _CHUNK in kinds and _is_chunk(data, at + 9, length)
            found = None if cut_chunk else _next(data, at + 1, end, kinds)
            if held and (found is None or held[0] != _MESSAGE):
                yield held
            held = None
            yield (_CHUNK, data[at + 9 : end]) if cut_chunk else _DAMAGE
            if found is None:
                return
            at = found
            continue
        if held:
            yield held
        held, at = (kind, data[at + 9 : behind]), behind
    if held:
        yield held
    if at != end:
        yield _DAMAGE


def _head(data: _Data, at: int) -> tuple[int, int]:
    """Kind of a record and the length of its content."""
    return struct.unpack_from("<BQ", data, at) if 0 <= at <= len(data) - 9 else (0, 0)


def _fits(kind: int, length: int, kinds: Collection[int]) -> bool:
    """Whether a record may have this head; kinds from 128 on are other programs' own."""
    return length >= _LEAST.get(kind, 0) if kind in kinds else kind >= 128 and kinds is _LEAST


def _next(data: _Data, at: int, end: int, kinds: Collection[int]) -> int | None:
    """Where records follow one another again; None where they do not."""
    for match in _HEAD.finditer(data, at, end):
        place = match.start()
        for _ in range(_CHAIN):
            kind, length = _head(data, place)
            if kind not in kinds or length < _LEAST[kind] or place + 9 + length > end:
                break
            place += 9 + length
            if place == end:
                return match.start()
        else:
            return match.start()
    return None


def _summary(data: _Data) -> Iterator[_Record]:
    """The records behind the data, as far as they are whole."""
    end = len(data) - _FOOTER
    if end < len(MAGIC) or data[-len(MAGIC) :] != MAGIC or _head(data, end) != (2, 20):
        return
    (begin,) = struct.unpack_from("<Q", data, end + 9)
    if len(MAGIC) <= begin < end:
        yield from _walk(data, begin, end, _LEAST)


# ---------------------------------------------------------------- chunks


def _is_chunk(data: _Data, at: int, length: int) -> bool:
    """Whether the content of a chunk of this length may begin at a byte: what it says of itself agrees."""
    try:
        compression, behind = _text(data, at + 28)
        (packed,) = struct.unpack_from("<Q", data, behind)
    except (struct.error, UnicodeDecodeError):
        return False
    return compression in ("", "lz4", "zstd") and behind + 8 + packed == at + length


def _inside(chunk: bytes) -> Iterator[_Record]:
    """The whole records of a chunk, of which the end may be missing or any part damaged."""
    try:
        size, check = struct.unpack_from("<QI", chunk, 16)
        compression, at = _text(chunk, 28)
        (length,) = struct.unpack_from("<Q", chunk, at)
    except (struct.error, UnicodeDecodeError):
        yield _DAMAGE
        return
    packed = chunk[at + 8 :]
    data, unpacks = _unpacked(packed, compression)
    fits = len(data) == size and bool(check) and crc32(data) == check
    records = list(_walk(data, 0, len(data), _INSIDE) if fits else _of_its_time(data, chunk))
    whole = len(packed) >= length
    if compression and whole and _DAMAGE in (records if unpacks else records[:-1]):
        records = [*_before(records[: records.index(_DAMAGE)]), _DAMAGE]
    if not unpacks or whole and len(data) != size:
        records.append(_DAMAGE)
    if _DAMAGE not in records and len(data) == size and check and not fits:
        yield _CHANGED, chunk[:16]
    yield from records


def _before(records: list[_Record]) -> list[_Record]:
    """The records before those that may have been unpacked together with what follows them, which is damaged: what is
    behind damage hangs on what it changed."""
    size, kept = 0, len(records)
    while kept and size < _BLOCK:
        kept -= 1
        size += 9 + len(records[kept][1])
    return records[:kept]


def _of_its_time(data: bytes, chunk: bytes) -> Iterator[_Record]:
    """The records in a chunk that is damaged or has no check sum; a message is lost whose log time is not among those
    that the chunk says it holds, unless none is."""
    start, end = struct.unpack_from("<QQ", chunk)
    records = list(_walk(data, 0, len(data), _INSIDE))
    within = [kind != _MESSAGE or start <= struct.unpack_from("<Q", content, 6)[0] <= end for kind, content in records]
    told = any(w and kind == _MESSAGE for w, (kind, _) in zip(within, records, strict=True))
    for good, record in zip(within, records, strict=True):
        yield record if good or not told else _DAMAGE


def _is_sound(chunk: bytes) -> bool:
    """Whether a whole chunk holds what its check sum says, or whole records where it has none."""
    try:
        size, check = struct.unpack_from("<QI", chunk, 16)
        compression, at = _text(chunk, 28)
        data, unpacks = _unpacked(chunk[at + 8 :], compression)
    except (struct.error, UnicodeDecodeError):
        return False
    if not unpacks or len(data) != size:
        return False
    return crc32(data) == check if check else all(kind != _LOST for kind, _ in _of_its_time(data, chunk))


def _unpacked(packed: bytes, compression: str) -> tuple[bytes, bool]:
    """What can be unpacked, and whether nothing on the way was damaged."""
    if not compression:
        return packed, True
    make = {"zstd": zstd.ZstdDecompressor, "lz4": lz4.frame.LZ4FrameDecompressor}.get(compression)
    if make is None:
        return b"", False
    for piece in (len(packed), _PIECE):  # of what fails in one go the whole blocks before are had piece by piece
        unpacking, data = make(), []
        try:
            for at in range(0, len(packed), max(piece, 1)):
                if unpacking.eof:
                    break
                data.append(unpacking.decompress(packed[at : at + piece]))
            return b"".join(data), True
        except (zstd.ZstdError, RuntimeError, EOFError):
            pass
    return b"".join(data), False


# ---------------------------------------------------------------- fields


def _learn(kind: int, content: bytes, types: dict[int, str], channels: dict[int, Channel]) -> bool:
    """Take a schema or a channel into what is known, unless it is known already; whether it is whole."""
    try:
        if kind == _SCHEMA:
            types.setdefault(_u16(content, 0), _text(content, 2)[0])
        else:
            topic, at = _text(content, 4)
            encoding, at = _text(content, at)
            msgtype = types.get(_u16(content, 2), "") + ("" if encoding == "cdr" else f" ({encoding})")
            channels.setdefault(_u16(content, 0), Channel(topic, msgtype, _offered(content[at:])))
    except (struct.error, UnicodeDecodeError):
        return False
    return True


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


def _text(data: _Data, at: int) -> tuple[str, int]:
    """A string behind its length, and where the next field begins."""
    end = at + 4 + struct.unpack_from("<I", data, at)[0]
    if end > len(data):
        raise struct.error("a string beyond the end")
    return data[at + 4 : end].decode(), end
