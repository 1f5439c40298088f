# SPDX-License-Identifier: Apache-2.0
"""What is in bags, above tables, and around the process may be anything: a result or one line, as in test_fuzz.py.

In the tests 268 inputs; `make fuzz`, nightly, 6,700.
"""

from __future__ import annotations

import gc
import io
import os
import shutil
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import lz4.frame
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin
from test_data_bags import EPOCH, GOOD, POINT, STORE, gap, imu, point, pose, record, twist
from test_data_odd_bags import sqlite_bag
from test_fuzz import fuzz, one_line_or_a_result, resident, sound

from inductrack_ros.core.cache import cache_folder
from inductrack_ros.core.errors import InputError
from inductrack_ros.data import read_bag, read_csv
from inductrack_ros.data.mcap_salvage import zstd
from inductrack_ros.nodes.log_folder import LOGS, log_somewhere
from inductrack_ros.terminal import speak_to_any_terminal

# ---- bags -----------------------------------------------------------------------------------------------------------

NUMBERS = st.sampled_from([0.0, 0.01, -0.005, 1.0, float("nan"), float("inf"), -float("inf"), 1e300, 5e-324])
STAMPS = st.sampled_from([0, 1, EPOCH - 10**9, EPOCH, -(10**9), 2**31 * 10**9 - 1]) | st.integers(0, 40).map(
    lambda i: EPOCH + 2_000_000 * i
)
FOUR = st.tuples(*4 * [NUMBERS])
MESSAGES = {
    "pose": st.builds(pose, STAMPS, FOUR, st.none() | FOUR.map(list)),
    "twist": st.builds(twist, STAMPS, FOUR),
    "imu": st.builds(imu, STAMPS, st.tuples(*3 * [NUMBERS]), NUMBERS),
    "gap_top": st.builds(
        gap, STAMPS, NUMBERS.filter(lambda v: v < 1e38), st.just(0.0), NUMBERS.filter(lambda v: v < 1)
    ),
    "fired_pulses": st.builds(point, STAMPS, NUMBERS, NUMBERS),
}
#: What may stand in a database in place of a message.
BLOBS = st.sampled_from([None, b"", b"\0", b"\0\1\0\0", b"\x28\xb5\x2f\xfd", b'{"x": 1}', bytes(400)])


@st.composite
def topics(draw) -> dict:
    """Topics and their messages: mostly a good run, among it anything."""
    run = [pose(EPOCH + i * 2_000_000, (0.1 * i, 0.01, -0.005, 0.002)) for i in range(draw(st.integers(0, 8)))]
    prefix = draw(st.sampled_from(["/inductrack/", "/inductrack/measured/", "/rig/"]))
    found = {f"{prefix}pose": run + draw(st.lists(MESSAGES["pose"], max_size=3))}
    for key in draw(st.sets(st.sampled_from([*MESSAGES]), max_size=3)):
        kind = draw(st.sampled_from([*MESSAGES])) if draw(st.integers(0, 9)) == 0 else key
        found.setdefault(f"{prefix}{key}", draw(st.lists(MESSAGES[kind], max_size=4)))
    for messages in found.values():
        if draw(st.booleans()):
            draw(st.randoms(use_true_random=False)).shuffle(messages)
    return {name: messages for name, messages in found.items() if messages}


@fuzz(60)
@given(held=topics(), blob=st.none() | st.tuples(BLOBS), wal=st.sampled_from([None, None, 0, 2]))
def test_a_bag_of_any_messages(tmp_path, held, blob, wal):
    """Stamps, values, order, types and bytes of any kind, in a database (also with a journal) and in an MCAP."""
    shutil.rmtree(tmp_path / "run", ignore_errors=True)
    if blob is None and wal is None:
        bag = record(tmp_path / "run", held, StoragePlugin.MCAP)
    else:
        raw = {n: [(kind, bytes(STORE.serialize_cdr(m, kind))) for kind, m in ms] for n, ms in held.items()}
        for messages in raw.values():
            messages += [(messages[0][0], *blob)] if blob else []
        bag = sqlite_bag(tmp_path / "run", raw, wal)
    for asked in ({}, {"pose": "/rig/pose"}):
        with one_line_or_a_result():
            sound(read_bag(bag, asked))


@fuzz(40)
@given(data=st.data())
def test_the_parts_of_a_bag(tmp_path, data):
    """Some files of a recording, some of them cut, empty, something else or from another bag, with metadata or not."""
    folder = tmp_path / "run"
    for made in (folder, tmp_path / "parts"):
        shutil.rmtree(made, ignore_errors=True)
        made.mkdir()
    names = data.draw(st.lists(st.sampled_from([f"run_{i}.mcap" for i in range(12)]), max_size=4, unique=True))
    for i, name in enumerate(names):
        run = [pose(EPOCH + (10 * i + j) * 2_000_000, (0.1 * (10 * i + j), 0, 0, 0)) for j in range(3)]
        whole = (record(tmp_path / "parts" / str(i), {GOOD: run}) / f"{i}.mcap").read_bytes()
        other = data.draw(st.sampled_from([whole, whole, whole, b"", whole[:300], whole[:-9], b"text", bytes(50)]))
        (folder / name).write_bytes(other)
    if data.draw(st.booleans()):
        named = data.draw(st.lists(st.sampled_from([*names, "run_3.mcap", "other.db3", "a/b.mcap.zstd", "", "../x"])))
        lines = "".join(f"\n    - {name!r}" for name in named) or " []"
        count = data.draw(st.sampled_from([0, 3, 100, -1, "'many'", 1.5]))
        (folder / "metadata.yaml").write_text(
            f"rosbag2_bagfile_information:\n  message_count: {count}\n  relative_file_paths:{lines}\n"
        )
    with one_line_or_a_result():
        sound(read_bag(folder))


@fuzz(20)
@given(
    field=st.text("pointxyz.[]0123456789-_heads ", max_size=20) | st.sampled_from(["point.x", "header.stamp.sec", ""]),
    messages=st.lists(MESSAGES["fired_pulses"], max_size=4),
)
def test_an_input_out_of_a_bag(tmp_path, field, messages):
    shutil.rmtree(tmp_path / "run", ignore_errors=True)
    run = [pose(EPOCH + i * 2_000_000, (0.1 * i, 0, 0, 0)) for i in range(3)]
    bag = record(tmp_path / "run", {GOOD: run, "/bus": messages or POINT})
    with one_line_or_a_result():
        found = read_bag(bag, inputs={"current": f"/bus:{field}"}).inputs["current"]
        assert all(np.isfinite(column).all() for column in found)


#: What the same work differs by from one time to the next (bytes).
SLACK = 8 * 2**20
#: Messages of a bag that is large enough for what it takes to be seen.
MANY = 30_000
#: Numbers that a damaged length may say.
LENGTHS = st.sampled_from([0, 1, 2**15, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1])


@pytest.fixture(scope="module")
def good_bags(tmp_path_factory) -> dict[str, bytes]:
    """Storage files of one run by kind: plain, in chunks that are packed, as a database."""
    folder = tmp_path_factory.mktemp("good")
    run = [pose(EPOCH + i * 2_000_000, (0.03 * i, 0.01, -0.005, 0.002)) for i in range(MANY)]
    made = {
        "mcap": record(folder / "mcap", {GOOD: run}),
        "db3": record(folder / "db3", {GOOD: run}, StoragePlugin.SQLITE3),
    }
    found = {kind: next(bag.glob(f"*.{kind}")).read_bytes() for kind, bag in made.items()}
    return found | {"zstd": chunked(found["mcap"], "zstd"), "lz4": chunked(found["mcap"], "lz4")}


def chunked(whole: bytes, compression: str) -> bytes:
    """The records of an MCAP in packed chunks of 1 MB, without an index, as a recorder that was killed leaves them."""
    pack = {"zstd": zstd.compress, "lz4": lz4.frame.compress}[compression]
    records = [struct.pack("<BQ", kind, len(content)) + content for kind, content in records_of(whole)]
    inner = [r for r in records if r[0] in (3, 4, 5)]
    chunks, size = [], 1 + 2**20 // (len(whole) // len(inner))
    for first in range(0, len(inner), size):
        data = b"".join(inner[first : first + size])
        packed, name = pack(data), compression.encode()
        head = struct.pack("<QQQII", 0, 2**63, len(data), 0, len(name)) + name + struct.pack("<Q", len(packed))
        chunks.append(struct.pack("<BQ", 6, len(head) + len(packed)) + head + packed)
    return whole[:8] + b"".join([r for r in records if r[0] == 1]) + b"".join(chunks)


def records_of(whole: bytes) -> Iterator[tuple[int, bytes]]:
    """Kind and content of the records of an MCAP, those inside chunks that are not packed too."""
    at = 8
    while at + 9 <= len(whole) - 8:
        kind, length = struct.unpack_from("<BQ", whole, at)
        content = whole[at + 9 : at + 9 + length]
        if kind == 6:
            name = struct.unpack_from("<I", content, 28)[0]
            assert name == 0, "packed"
            yield from records_of(bytes(8) + content[40:] + bytes(8))
        else:
            yield kind, content
        at += 9 + length


def memory_of(bag: Path) -> int:
    """What reading a bag takes at its height (bytes)."""
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # forget the height so far
    before = resident("VmRSS")
    with one_line_or_a_result():
        sound(read_bag(bag))
    return resident("VmHWM") - before


@fuzz(8)
@given(data=st.data(), kind=st.sampled_from(["mcap", "db3", "zstd", "lz4"]))
def test_no_bag_takes_more_than_twice_the_memory_of_a_good_one(tmp_path, good_bags, data, kind):
    """Cut, with other bytes, with lengths that say anything, packed again, with metadata that promise anything."""
    whole = good_bags[kind]
    suffix = ".db3" if kind == "db3" else ".mcap"
    bag = tmp_path / "run"
    good = 0
    for _ in range(2):  # the first time imports
        shutil.rmtree(bag, ignore_errors=True)
        bag.mkdir()
        (bag / f"run_0{suffix}").write_bytes(whole)
        good = memory_of(bag)
    content = bytearray(whole)
    near = st.integers(0, 400) | st.integers(-400, -9) | st.integers(0, len(whole) - 9)
    for place in data.draw(st.lists(near, max_size=4)):
        width = data.draw(st.sampled_from([1, 4, 8]))
        number = data.draw(LENGTHS) % 2 ** (8 * width)
        place %= len(content)
        content[place : place + width] = number.to_bytes(width, data.draw(st.sampled_from(["little", "big"])))
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content)))]
    target = bag / f"run_0{suffix}"
    if data.draw(st.integers(0, 3)) == 0:
        target.unlink()
        target, content = bag / f"run_0{suffix}.zstd", bytearray(zstd.compress(bytes(content)))
    target.write_bytes(content)
    if data.draw(st.integers(0, 3)) == 0:
        promised = data.draw(LENGTHS)
        (bag / "metadata.yaml").write_text(
            f"rosbag2_bagfile_information:\n  message_count: {promised}\n  relative_file_paths: [{target.name}]\n"
        )
    assert memory_of(bag) <= 2 * good + SLACK


# ---- tables ---------------------------------------------------------------------------------------------------------

ABOVE = st.sampled_from(
    [
        "Test of surge, heave, time",
        "time,2026-11-29 10:00",
        "Channels;surge;heave",
        "0,1,2",
        "# time,surge",
        "s,m,mm",
        "time [ms],heave [mm]",
        "surge\theave",
        '"time","heave"',
        '"a ""quoted"" cell, and',
        "time",
        "Rate,250",
        ",,,",
        "\u200b",
        "x" * 300,
    ]
)
CELL = st.sampled_from(
    ["+NaN", "-nan(ind)", "NaT", "1.#INF", "29-Nov-2026 10:00:00", "Nov 29", "1'056", "1e5", "", "="]
)


@fuzz(80)
@given(
    above=st.lists(ABOVE, max_size=4),
    below=st.lists(ABOVE, max_size=2),
    cells=st.lists(st.lists(CELL, min_size=1, max_size=3), max_size=3),
    separator=st.sampled_from(",;\t| "),
    quoted=st.booleans(),
)
def test_a_table_with_rows_above_and_below_its_header(tmp_path, above, below, cells, separator, quoted):
    rows = [f"{0.004 * i}{separator}{i}{separator}-0.00{i}" for i in range(5)] + [separator.join(row) for row in cells]
    lines = [*above, separator.join(["time", "surge", "heave"]), *below, *rows]
    text = "".join(f'"{line}"\n' if quoted else f"{line}\n" for line in lines)
    (tmp_path / "run.csv").write_text(text, encoding="utf-8")
    with one_line_or_a_result():
        try:
            sound(read_csv(tmp_path / "run.csv"))
        except InputError as error:
            assert "cannot be read as a table" not in str(error)  # pandas' words say nothing to a user
            raise


# ---- around the process ---------------------------------------------------------------------------------------------

FOLDERS = st.sampled_from(
    ["", "~", "~nobody/x", "/proc/none", "/dev/null", "relative", "a\udcffb", "/" + "x" * 300, "$OK"]
)
VARIABLES = st.sampled_from(["HOME", "XDG_CACHE_HOME", "INDUCTRACK_CACHE", "TMPDIR", LOGS, "ROS_HOME"])


@fuzz(40)
@given(environment=st.dictionaries(VARIABLES, FOLDERS), known=st.booleans())
def test_any_environment_has_a_place_for_cache_and_logs(tmp_path, monkeypatch, environment, known):
    monkeypatch.chdir(tmp_path)
    given = {name: str(tmp_path / "ok") if value == "$OK" else value for name, value in environment.items()}
    unknown = mock.patch("pwd.getpwuid", side_effect=KeyError) if not known else mock.patch("os.getpid", os.getpid)
    with mock.patch.dict(os.environ, given, clear=True), mock.patch.object(tempfile, "tempdir", None), unknown:
        with one_line_or_a_result():
            log_somewhere()
            for folder in [
                cache_folder(),
                *([Path(os.environ[LOGS])] if given.get(LOGS) != os.environ.get(LOGS) else []),
            ]:
                folder.mkdir(parents=True, exist_ok=True)
                (folder / "written").write_text("")


@fuzz(20)
@given(
    encoding=st.sampled_from(["ascii", "latin-1", "utf-8", "utf-16", "cp437", "shift-jis", "koi8-r"]),
    text=st.text(max_size=40),
)
def test_a_terminal_of_any_encoding_shows_any_text(encoding, text):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    with mock.patch.object(sys, "stdout", stream):
        speak_to_any_terminal()
        print(text)
        print("eta ± γ → °, …")
        sys.stdout.flush()
