# SPDX-License-Identifier: Apache-2.0
"""Bags of which bytes in the middle are others than were written: what is whole is read, and what is not is said."""

import re
import struct
from binascii import crc32

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from test_data_bags import EPOCH, GOOD, STORE, pose

from inductrack_ros.core.errors import InputError
from inductrack_ros.data import mcap_salvage, read_bag

COUNT, STEP = 2000, 2_000_000  # messages, ns between them
PLACES = [struct.pack("<d", 0.01 * i) for i in range(COUNT)]
PACKED = {"": lambda raw: raw, "zstd": mcap_salvage.zstd.compress, "lz4": mcap_salvage.lz4.frame.compress}


def recorded(folder, plugin):
    """A bag whose messages are logged as they are stamped, and its file."""
    rng = np.random.default_rng(3)
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection(GOOD, "geometry_msgs/msg/PoseStamped", typestore=STORE)
        for i in range(COUNT):
            kind, message = pose(EPOCH + i * STEP, (0.01 * i, 0.01 + 1e-4 * rng.normal(), -0.005, 0.002))
            writer.write(connection, EPOCH + i * STEP, STORE.serialize_cdr(message, kind))
    return next(p for p in folder.iterdir() if p.suffix != ".yaml").read_bytes()


def chunked(mcap, compression):
    """The same MCAP in two chunks that are compressed and have check sums, without an index, as a recorder may write
    it."""
    out = bytearray(mcap_salvage.MAGIC)
    for kind, content in mcap_salvage._walk(mcap, 8, len(mcap) - 8, mcap_salvage._LEAST):
        if kind == mcap_salvage._CHUNK:
            records = list(mcap_salvage._walk(content[40:], 0, len(content) - 40, mcap_salvage._INSIDE))
            names = [record for record in records if record[0] != mcap_salvage._MESSAGE]
            for part in (records[: COUNT // 2], names + records[COUNT // 2 :]):
                times = [struct.unpack_from("<Q", c, 6)[0] for k, c in part if k == mcap_salvage._MESSAGE]
                raw = b"".join(struct.pack("<BQ", k, len(c)) + c for k, c in part)
                packed = PACKED[compression](raw)
                head = struct.pack("<QQQII", min(times), max(times), len(raw), crc32(raw), len(compression))
                chunk = head + compression.encode() + struct.pack("<Q", len(packed)) + packed
                out += struct.pack("<BQ", mcap_salvage._CHUNK, len(chunk)) + chunk
        elif kind in (1, 15):
            out += struct.pack("<BQ", kind, len(content)) + content
    return bytes(out + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + mcap_salvage.MAGIC)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    plain = recorded(folder / "mcap", StoragePlugin.MCAP)
    written = {"plain.mcap": plain, "rows.db3": recorded(folder / "rows", StoragePlugin.SQLITE3)}
    return written | {f"{c or 'chunks'}.mcap": chunked(plain, c) for c in PACKED}


@pytest.fixture(scope="module")
def everything(files, tmp_path_factory):
    """Samples by their stamp."""
    file = tmp_path_factory.mktemp("everything") / "plain.mcap"
    file.write_bytes(files["plain.mcap"])
    run = read_bag(file)
    assert len(run.times) == COUNT and run.notes == ()
    return dict(samples(run))


def samples(run):
    """(stamp, values) of each sample."""
    return list(zip(run.stamps.tolist(), run.values.tolist(), strict=True))


def spoiled(data, at, size, how):
    bad = bytes(size) if how == "zeroed" else bytes(255 - byte for byte in data[at : at + size])
    return data[:at] + bad + data[at + size :]


@pytest.mark.parametrize("name", ["plain.mcap", "chunks.mcap", "zstd.mcap", "lz4.mcap", "rows.db3"])
def test_what_is_whole_needs_no_word(files, everything, tmp_path, name):
    (tmp_path / name).write_bytes(files[name])
    run = read_bag(tmp_path / name)
    assert dict(samples(run)) == everything and run.notes == ()


@pytest.mark.parametrize("how", ["zeroed", "flipped"])
@pytest.mark.parametrize("name", ["plain.mcap", "chunks.mcap", "rows.db3"])
def test_messages_around_damage_are_read(files, everything, tmp_path, name, how):
    """Six pages in the middle: lost are the messages in them and one or two beside."""
    data, size = files[name], 6 * 4096
    (tmp_path / name).write_bytes(spoiled(data, 12 * 4096, size, how))
    run = read_bag(tmp_path / name)
    assert all(everything[stamp] == values for stamp, values in samples(run))
    lost = COUNT - len(run.times)
    record = (data.index(PLACES[901]) - data.index(PLACES[401])) / 500
    if name.endswith("mcap"):
        assert size / record - 3 < lost < size / record + 3
    else:  # a row is lost with its whole page, and some pages are an index's
        assert 0 < lost < (size + 2 * 4096) / record
    (note,) = [n for n in run.notes if "damaged from" in n]
    mends = f"`mcap recover {name}`" if name.endswith("mcap") else f"`sqlite3 {name} .recover`"
    assert f"messages are whole and read; {mends} mends the file" in note
    (ends,) = re.findall(r"from ([\d.]+) to ([\d.]+) s", note)
    after, before = map(float, ends)
    known = run.times[run.times < after + 0.5 * (before - after)].max()
    assert after == pytest.approx(known, abs=2e-3) and before - after == pytest.approx(
        STEP * (lost + 1) / 1e9, abs=3e-3
    )


@pytest.mark.parametrize("name", ["zstd.mcap", "lz4.mcap"])
def test_a_compressed_chunk_is_read_up_to_the_damage_and_the_next_one_whole(files, everything, tmp_path, name):
    data = files[name]
    at = len(data) // 2 - 6000  # in the first of two chunks
    (tmp_path / name).write_bytes(spoiled(data, at, 500, "flipped"))
    run = read_bag(tmp_path / name)
    assert all(everything[stamp] == values for stamp, values in samples(run))
    assert COUNT // 2 - 5 < len(run.times) < COUNT and run.times[-1] + run.stamps[0] / 1e9 == pytest.approx(
        max(everything) / 1e9
    )
    assert "is damaged" in run.notes[0] and f"`mcap recover {name}` mends the file" in run.notes[0]


def test_one_byte_of_a_chunk_with_a_check_sum(files, everything, tmp_path):
    """Nothing is missing; which message it is in is not known."""
    data = files["chunks.mcap"]
    at = data.index(PLACES[700])
    (tmp_path / "chunks.mcap").write_bytes(spoiled(data, at, 1, "flipped"))
    run = read_bag(tmp_path / "chunks.mcap")
    assert run.notes == (
        "chunks.mcap is damaged, and messages from 0 to 1.994 s may be changed, for a check sum does not fit: 2000"
        " messages are whole and read; `mcap recover chunks.mcap` mends the file",
    )
    assert sum(everything[s] != v for s, v in samples(run)) == 1


def test_one_stamp_of_a_damaged_bag_is_none_of_its_clock(files, tmp_path):
    data = files["chunks.mcap"]
    stamp = (EPOCH + 700 * STEP) // 10**9
    at = data.rindex(struct.pack("<I", stamp), 0, data.index(PLACES[700]))
    (tmp_path / "chunks.mcap").write_bytes(spoiled(data, at, 3, "flipped"))
    run = read_bag(tmp_path / "chunks.mcap")
    assert len(run.times) == COUNT - 1
    assert run.notes[1] == f"1 of {COUNT} messages on {GOOD} are damaged and left out"


def test_a_damaged_summary_loses_nothing(files, everything, tmp_path):
    data = files["plain.mcap"]
    (tmp_path / "plain.mcap").write_bytes(spoiled(data, len(data) - 200, 120, "zeroed"))
    run = read_bag(tmp_path / "plain.mcap")
    assert dict(samples(run)) == everything
    assert "is damaged: 2000 " in run.notes[0] or "damaged from" in run.notes[0]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["plain.mcap", "chunks.mcap", "zstd.mcap", "lz4.mcap", "rows.db3"])
def test_damage_anywhere_is_read_around_or_refused_in_one_line(files, everything, tmp_path, name, seed):
    """Where a page or more is damaged no message is read that was not written."""
    rng = np.random.default_rng([seed, len(name)])
    data = files[name]
    size = int(rng.integers(4096, 20_000))
    at = int(rng.integers(0, len(data) - size))
    (tmp_path / name).write_bytes(spoiled(data, at, size, ["zeroed", "flipped"][seed % 2]))
    try:
        run = read_bag(tmp_path / name)
    except InputError as error:
        assert "\n" not in str(error) and name in str(error)
    else:
        odd = sum(everything.get(s) != v for s, v in samples(run))
        assert odd == 0 and (len(run.times) == COUNT or run.notes)
