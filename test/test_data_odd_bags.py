# SPDX-License-Identifier: Apache-2.0
"""Bags as recorders, crashes and converters leave them: read, with a word about what is not as it should be."""

import bz2
import contextlib
import gzip
import lzma
import re
import shutil
import sqlite3
import struct
import zipfile

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from test_data_bags import EPOCH, GOOD, NAN, POSE, RANGE, STORE, gap, imu, make, pose, poses, record, twist

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.state import COORDINATES
from inductrack_ros.data import read_bag, read_csv
from inductrack_ros.data.mcap_salvage import zstd

#: What Foxy and Humble write of one publisher.
QOS = """- history: 3
  depth: 0
  reliability: 1
  durability: 2
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""
HUMBLE = get_typestore(Stores.ROS2_HUMBLE)


def sqlite_bag(folder, topics, wal_from=None):
    """The database of Foxy and Humble: no message definitions. Messages from ``wal_from`` on stay in the -wal of a
    writer that was killed."""
    folder.mkdir()
    file = folder / "run_0.db3"
    database = sqlite3.connect(file, isolation_level=None)
    if wal_from is not None:
        database.execute("PRAGMA journal_mode=WAL")
        database.execute("PRAGMA wal_autocheckpoint=0")
    database.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT,"
        " offered_qos_profiles TEXT)"
    )
    database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    for number, (topic, messages) in enumerate(topics.items(), 1):
        database.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '')", (number, topic, messages[0][0]))
        for i, (_, raw) in enumerate(messages):
            if i == wal_from:
                database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            database.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", (number, EPOCH + i, raw)
            )
    if wal_from is not None:  # as kill -9 leaves it
        for suffix in ("", "-wal"):
            shutil.copy(f"{file}{suffix}", f"{file}{suffix}.kept")
        database.close()
        for suffix in ("", "-wal"):
            shutil.move(f"{file}{suffix}.kept", f"{file}{suffix}")
    database.close()
    return folder


def raw(messages):
    return [(kind, bytes(STORE.serialize_cdr(message, kind))) for kind, message in messages]


def humble_gap(stamp, value):
    head = make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9)), "track")
    message = HUMBLE.types[RANGE](head, 1, 0.0, 0.0, 0.0, value)
    return RANGE, bytes(HUMBLE.serialize_cdr(message, RANGE))


# ---------------------------------------------------------------- files


def test_a_database_of_an_older_distribution(tmp_path):
    """Its Range is one number shorter than Jazzy's."""
    gaps = [humble_gap(EPOCH + i * 2_000_000, 0.005) for i in range(3)]
    run = read_bag(sqlite_bag(tmp_path / "run", {GOOD: raw(poses()), "/inductrack/gap_top": gaps}))
    assert run.channels == (*COORDINATES, "gap_top") and run["gap_top"] == pytest.approx(3 * [0.005])
    assert run.notes == ()


@pytest.mark.parametrize("name", ["run #3", "50%20V", "what?"])
@pytest.mark.parametrize("plugin", StoragePlugin)
def test_a_folder_may_have_any_name(tmp_path, name, plugin):
    bag = record(tmp_path / "bag", {GOOD: poses()}, plugin)
    assert len(read_bag(bag.rename(tmp_path / name)).times) == 3


def test_rows_that_a_killed_recorder_left_beside_the_database(tmp_path):
    folder = sqlite_bag(tmp_path / "run", {GOOD: raw(poses(40))}, wal_from=15)
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    run = read_bag(folder)
    assert len(run.times) == 40
    assert run.notes == ("run_0.db3-wal is read too: the recorder ended before it was taken into run_0.db3",)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_rows_that_cannot_be_taken_from_beside_the_database_are_missed(tmp_path):
    folder = sqlite_bag(tmp_path / "run", {GOOD: raw(poses(40))}, wal_from=15)
    wal = folder / "run_0.db3-wal"
    whole = wal.read_bytes()
    wal.write_bytes(whole[:-500])
    run = read_bag(folder)
    assert 15 < len(run.times) < 40 and "pages, which are read: messages may be missing" in run.notes[0]
    wal.write_bytes(b"no journal" * 100)
    run = read_bag(folder)
    assert len(run.times) == 15
    assert run.notes == ("run_0.db3-wal is damaged and not read: messages may be missing",)
    wal.unlink()
    assert read_bag(folder).notes == ()
    (folder / "run_0.db3-journal").write_bytes(bytes(512))  # done with, as journal_mode PERSIST leaves it
    assert read_bag(folder).notes == ()


METADATA = {
    "no QoS": lambda text: "\n".join(line for line in text.splitlines() if "offered_qos" not in line),
    "no storage": lambda text: text.replace("storage_identifier: mcap", 'storage_identifier: ""'),
    "other storage": lambda text: text.replace("storage_identifier: mcap", "storage_identifier: my_plugin"),
    "future version": lambda text: text.replace("version: 9", "version: 12"),
    "absolute path": lambda text: text.replace("- bag.mcap", "- /home/rig/bag.mcap"),
}


@pytest.mark.parametrize("odd", METADATA)
def test_the_storage_files_tell_what_is_in_them(tmp_path, odd):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    text = (bag / "metadata.yaml").read_text()
    assert METADATA[odd](text) != text
    (bag / "metadata.yaml").write_text(METADATA[odd](text))
    run = read_bag(bag)
    assert len(run.times) == 3 and run.notes == ()


def test_metadata_that_are_none_are_said(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    (bag / "metadata.yaml").write_text("[")
    assert read_bag(bag).notes == ("metadata.yaml cannot be read and is not used",)


def test_files_that_metadata_name_or_do_not(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    shutil.copy(bag / "bag.mcap", bag / "bag_1.mcap")
    assert read_bag(bag).notes == ("bag_1.mcap is left out: metadata.yaml does not name it",)
    (bag / "bag.mcap").unlink()
    metadata = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(metadata.replace("  - bag.mcap\n", "  - bag_0.mcap\n  - bag_1.mcap\n"))
    with pytest.raises(InputError, match="bag_0.mcap is missing, which metadata.yaml names"):
        read_bag(bag)


def test_a_file_that_was_renamed_or_unpacked(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    metadata = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(metadata.replace("- bag.mcap", "- bag.mcap.zstd"))
    assert read_bag(bag).notes == ()
    (bag / "metadata.yaml").write_text(metadata.replace("- bag.mcap", "- old.mcap"))
    run = read_bag(bag)
    assert len(run.times) == 3 and run.notes == ("metadata.yaml is not used: it names old.mcap, which is not there",)


def test_the_parts_of_a_recording_without_metadata(tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    for i in range(3):
        part = [pose(EPOCH + (10 * i + j) * 2_000_000, (0.1 * (10 * i + j), 0, 0, 0)) for j in range(10)]
        shutil.copy(record(tmp_path / f"part{i}", {GOOD: part}) / f"part{i}.mcap", folder / f"run_{i}.mcap")
    whole = read_bag(folder)
    assert len(whole.times) == 30 and whole.notes == ()
    (folder / "run_0.mcap.zstd").write_bytes(zstd.compress((folder / "run_0.mcap").read_bytes()))
    run = read_bag(folder)
    assert np.array_equal(run.values, whole.values)
    assert run.notes == ("run_0.mcap.zstd is left out: it is there unpacked, too",)
    (folder / "run_0.mcap.zstd").unlink()
    (folder / "run_2.mcap").write_bytes(b"")
    run = read_bag(folder)
    assert len(run.times) == 20
    assert run.notes == ("run_2.mcap is empty and left out: the recorder ended before it was written",)
    shutil.copy(folder / "run_0.mcap", folder / "run_2.mcap")
    (folder / "run_1.mcap").unlink()
    assert "files 0 and 2 follow each other: what was recorded between them is missing" in read_bag(folder).notes


@pytest.mark.parametrize("suffix", [".zstd", ".zst"])
def test_compressed_files(tmp_path, suffix):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    packed = tmp_path / "run" / f"bag_0.mcap{suffix}"
    packed.parent.mkdir()
    packed.write_bytes(zstd.compress((bag / "bag.mcap").read_bytes()))
    run = read_bag(packed)
    assert run.name == "bag_0" and len(run.times) == 3
    assert run.notes == (f"{packed.name} is compressed with zstd and read from an unpacked copy",)
    assert len(read_bag(packed.parent).times) == 3
    packed.write_bytes(packed.read_bytes()[:-40])
    with pytest.raises(InputError, match="zstd compression is damaged or cut off.*copy the file again"):
        read_bag(packed)


def test_an_mcap_without_its_end_is_read_as_far_as_it_is_whole(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses(200)})
    whole = (bag / "bag.mcap").read_bytes()
    everything = read_bag(bag)
    (bag / "bag.mcap").write_bytes(whole[: len(whole) // 2])
    run = read_bag(bag)
    n = len(run.times)
    assert 50 < n < 200 and np.array_equal(run.values, everything.values[:n])
    assert run.notes == (
        f"bag.mcap is cut off: {n} of 200 messages are whole and read; `mcap recover bag.mcap` mends the file",
    )


def test_an_mcap_that_other_programs_wrote_into(tmp_path):
    """Its profile or the schemas of some channels are not ROS 2's."""
    bag = record(tmp_path / "bag", {GOOD: poses(), "/other": [gap(EPOCH, 0.005)]})
    whole = (bag / "bag.mcap").read_bytes()
    everything = read_bag(bag)
    for here, there in ((b"\x04\0\0\0ros2", b"\x04\0\0\0rosX"), (b"ros2msg", b"jsonsch")):
        assert here in whole
        (bag / "bag.mcap").write_bytes(whole.replace(here, there))
        run = read_bag(bag)
        assert np.array_equal(run.values, everything.values) and run.notes == everything.notes
    (bag / "bag.mcap").write_bytes(whole.replace(b"ros2msg", b"jsonsch").replace(b"\x03\0\0\0cdr", b"\x03\0\0\0jso"))
    with pytest.raises(InputError, match=r"is geometry_msgs/msg/PoseStamped \(jso\), but pose must be"):
        read_bag(bag)


def test_the_names_of_other_tools(tmp_path):
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    with pytest.raises(InputError, match="a ROS 1 bag; convert it: `rosbags-convert --src .*old.bag --dst .*old`"):
        read_bag(tmp_path / "old.bag")
    with pytest.raises(InputError, match="a ROS 1 bag"):
        read_bag(tmp_path)
    (tmp_path / "metadata.yaml").write_text("{}")
    with pytest.raises(InputError, match="says what is in a bag; name its folder"):
        read_bag(tmp_path / "metadata.yaml")
    (tmp_path / "run.mcap").write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(InputError, match="is no bag but a pointer of Git LFS; fetch the file itself"):
        read_bag(tmp_path / "run.mcap")


def test_no_room_to_unpack(tmp_path, monkeypatch):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    (tmp_path / "run.mcap.zstd").write_bytes(zstd.compress((bag / "bag.mcap").read_bytes()))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfileobj", full)
    with pytest.raises(InputError, match="cannot be unpacked into .*: No space left on device; .*set TMPDIR"):
        read_bag(tmp_path / "run.mcap.zstd")


# ---------------------------------------------------------------- messages


def test_messages_filed_in_another_order(tmp_path):
    messages = poses(6)
    shuffled = [messages[i] for i in (0, 2, 1, 3, 5, 4)]
    run = read_bag(record(tmp_path / "bag", {GOOD: shuffled}))
    assert run["surge"] == pytest.approx(0.1 * np.arange(6))
    assert run.notes == ("2 messages on /inductrack/pose filed out of order sorted by their stamps",)


def test_exact_repeats_are_dropped(tmp_path):
    messages = poses(4)
    run = read_bag(record(tmp_path / "bag", {GOOD: [*messages, messages[1]]}))
    assert len(run.times) == 4 and "1 message on /inductrack/pose that repeats another exactly left out" in run.notes


def test_a_recording_that_was_played_in_a_loop_counts_once(tmp_path):
    """What `ros2 bag play --loop` publishes has the stamps of the first time; the last turn was cut off."""
    whole = poses(400)
    run = read_bag(record(tmp_path / "run", {GOOD: [*whole, *whole, *whole[:37]]}))
    assert len(run.times) == 400
    assert "437 messages on /inductrack/pose that repeat another exactly left out" in run.notes


def test_stamps_before_the_clock_ran(tmp_path):
    run = read_bag(record(tmp_path / "bag", {GOOD: [pose(0), *poses(4)]}))
    assert len(run.times) == 4
    assert run.notes == ("1 message on /inductrack/pose stamped 0 left out: the clock did not run yet",)
    from_zero = [pose(i * 2_000_000, (0.1 * i, 0, 0, 0)) for i in range(3)]  # simulated time begins at 0
    assert len(read_bag(record(tmp_path / "sim", {GOOD: from_zero})).times) == 3


def test_poses_without_numbers_are_not_measured(tmp_path):
    lost = [
        pose(EPOCH + 2_000_000, (NAN, NAN, NAN, NAN)),
        pose(EPOCH + 4_000_000, (0, 0, 0, 0), orientation=[0, 0, 0, 0]),
    ]
    run = read_bag(record(tmp_path / "bag", {GOOD: [pose(EPOCH), *lost, pose(EPOCH + 6_000_000)]}))
    assert run.times == pytest.approx([0, 0.006])
    assert sorted(run.notes) == [
        "1 of 4 messages on /inductrack/pose are NaN or infinite: not measured",
        "1 of 4 poses on /inductrack/pose have an orientation of 0: not measured",
    ]


def test_messages_that_cannot_be_decoded(tmp_path):
    good = raw(poses(5))
    run = read_bag(sqlite_bag(tmp_path / "few", {GOOD: [*good[:2], (POSE, b""), (POSE, None), *good[2:]]}))
    assert len(run.times) == 5 and run.notes[0].startswith("2 of 7 messages on /inductrack/pose are damaged and left")
    with pytest.raises(InputError, match="5 of 6 messages are no geometry_msgs/msg/PoseStamped .*serialized as CDR"):
        read_bag(sqlite_bag(tmp_path / "most", {GOOD: [good[0], *5 * [(POSE, b'{"x": 1}')]]}))


def test_a_type_as_ros_1_spells_it(tmp_path):
    spelled = [("geometry_msgs/PoseStamped", data) for _, data in raw(poses())]
    assert len(read_bag(sqlite_bag(tmp_path / "run", {GOOD: spelled})).times) == 3


def test_what_a_sensor_does_not_see_is_counted(tmp_path):
    seen = [gap(EPOCH + i * 2_000_000, 9.0 if i < 2 else 0.004, 0.0, 0.02) for i in range(5)]
    run = read_bag(record(tmp_path / "bag", {GOOD: poses(5), "/inductrack/gap_top": seen}))
    assert run.notes == (
        "2 of 5 messages on /inductrack/gap_top are NaN, infinite or out of the sensor's range: not measured",
    )


def test_pitch_and_yaw_are_said_not_to_be_used(tmp_path):
    turned = [pose(EPOCH + i * 2_000_000, (0.1 * i, 0, 0, 0), orientation=[0, 0, 0.5**0.5, 0.5**0.5]) for i in range(3)]
    (note,) = read_bag(record(tmp_path / "bag", {GOOD: turned})).notes
    assert note.startswith("pitch and yaw on /inductrack/pose, up to 90°, are not used")
    rolled = [pose(EPOCH + i * 2_000_000, (0, 0, 0, 0.5)) for i in range(3)]
    assert read_bag(record(tmp_path / "rolled", {GOOD: rolled})).notes == ()


def test_a_tracker_of_places_only(tmp_path):
    places = [pose(EPOCH + i * 2_000_000, (0.1 * i, 0, 0, 0), orientation=[0, 0, 0, 0]) for i in range(3)]
    force = [imu(EPOCH + 2_000_000, (0.0, 0.0, 9.81))]
    run = read_bag(record(tmp_path / "bag", {GOOD: places, "/inductrack/imu": force}))
    assert run.channels == ("surge", "sway", "heave")
    assert run.notes == (
        "roll on /inductrack/pose is never measured and left out",
        "/inductrack/imu is left out: without the roll its axes are not known",
    )


# ---------------------------------------------------------------- topics


def test_the_sensors_beside_a_named_pose(tmp_path):
    topics = {
        "/rig1/measured/pose": poses(),
        "/rig1/measured/twist": [twist(EPOCH, (15, 0, 0, 0))],
        "/rig1/measured/gap_top": [gap(EPOCH, 0.005)],
        "/rig1/pose": poses(),
        "/mocap/cart": poses(),
        "/tf_like": [pose(EPOCH)],
    }
    bag = record(tmp_path / "bag", topics)
    run = read_bag(bag, {"pose": "/rig1/measured/pose"})
    assert {"surge_rate", "gap_top"} < set(run.channels)
    assert run.notes == ("topics left out: /mocap/cart, /tf_like; topics: in campaign.yaml says which are read",)
    assert "surge_rate" not in read_bag(bag, {"pose": "/rig1/measured/pose", "twist": None}).channels
    alone = read_bag(bag, {"pose": "/mocap/cart"})
    assert alone.channels == COORDINATES and "/rig1/measured/twist" in alone.notes[0]


def test_whatever_may_say_something_of_the_rig_is_named(tmp_path):
    number = [("std_msgs/msg/Float64", make("std_msgs/msg/Float64", 0.004))]
    clock = [("rosgraph_msgs/msg/Clock", make("rosgraph_msgs/msg/Clock", make("builtin_interfaces/msg/Time", 1, 0)))]
    topics = {"/rig/pose": poses(), "/rig/gap_left": number, "/rig/current": number, "/clock": clock}
    bag = record(tmp_path / "bag", topics)
    (note,) = read_bag(bag, {"pose": "/rig/pose"}).notes
    assert note.startswith("topics left out: /rig/current, /rig/gap_left;")
    with pytest.raises(InputError, match="none is a geometry_msgs/msg/TwistStamped with messages: republish"):
        read_bag(bag, {"pose": "/rig/pose", "twist": "/rig/twist"})
    with pytest.raises(InputError, match="an empty bag, it has no topics"):
        read_bag(record(tmp_path / "empty", {}))


def test_two_publishers_on_a_topic_are_said(tmp_path):
    folder = sqlite_bag(tmp_path / "run", {GOOD: raw(poses())})
    with sqlite3.connect(folder / "run_0.db3") as database:
        database.execute("UPDATE topics SET offered_qos_profiles = ?", (2 * QOS,))
    assert read_bag(folder).notes == ("2 publishers wrote on /inductrack/pose: a run is of one",)


def test_the_only_pose_is_named(tmp_path):
    bag = record(tmp_path / "bag", {"/rig1/measured/pose": poses(), "/rig1/pose": poses()})
    with pytest.raises(InputError, match=r"set topics: \{pose: /rig1/measured/pose\} in campaign.yaml"):
        read_bag(bag)


def test_a_topic_without_messages_is_there(tmp_path):
    bag = record(tmp_path / "bag", {"/inductrack/measured/pose": POSE})
    with pytest.raises(InputError, match=r"/measured/pose: no messages; record it again, or set topics: \{pose: "):
        read_bag(bag)


# ---------------------------------------------------------------- what is no bag, or more than one


def database(file, *tables):
    with contextlib.closing(sqlite3.connect(file)) as opened:
        for table in tables:
            opened.execute(f"CREATE TABLE {table}(id INTEGER)")
        opened.commit()
    return file


@pytest.mark.parametrize("tables", [("bookmarks", "visits"), ("topics",)])
def test_a_database_that_is_no_bag_is_not_called_damaged(tmp_path, tables):
    (tmp_path / "run").mkdir()
    for path in (database(tmp_path / "run" / "x.db3", *tables), tmp_path / "run"):
        held = f"it holds {', '.join(tables)}"
        with pytest.raises(InputError, match=f"is an SQLite database, but no rosbag2: .*{held}") as caught:
            read_bag(path)
        assert "damaged" not in str(caught.value)


def test_a_folder_of_bags_names_them(tmp_path):
    for name in ("one", "two"):
        record(tmp_path / "runs" / name, {GOOD: poses()})
    with pytest.raises(InputError, match="runs: a folder of 2 bags; name one: one, two"):
        read_bag(tmp_path / "runs")


def test_an_mcap_without_its_summary_is_whole(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses(5)})
    (file,) = bag.glob("*.mcap")
    data = file.read_bytes()
    footer = len(data) - 8 - 20 - 9
    (summary,) = struct.unpack("<Q", data[footer + 9 : footer + 17])
    file.write_bytes(data[:summary] + b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0) + data[-8:])
    run = read_bag(bag)
    assert len(run.times) == 5 and run.notes == ()


def test_a_few_orientations_that_are_none_are_not_measured(tmp_path):
    some = [pose(EPOCH + i * 2_000_000, (0.1 * i, 0, -0.005, 0)) for i in range(8)]
    some[5] = pose(EPOCH + 5 * 2_000_000, (0.5, 0, -0.005, 0), [0, 0, 0, 0.3])
    run = read_bag(record(tmp_path / "bag", {GOOD: some}))
    assert run.numbers.tolist() == [1, 2, 3, 4, 5, 7, 8]
    assert run.notes == (
        f"1 of 8 poses on {GOOD} are not measured: message 6 has an orientation of length 0.3, no unit quaternion",
    )


def test_samples_know_their_messages_where_only_the_pose_gives_them(tmp_path):
    late = poses(5)
    late[1], late[2] = late[2], late[1]
    assert read_bag(record(tmp_path / "late", {GOOD: late})).numbers.tolist() == [1, 3, 2, 4, 5]
    beside = {GOOD: poses(5), "/inductrack/twist": [twist(EPOCH + 500)]}
    assert read_bag(record(tmp_path / "beside", beside)).numbers is None


def test_a_damaged_table_of_tables_is_one_line(tmp_path):
    """Whatever byte of the first page is another one."""
    bag = sqlite_bag(tmp_path / "run", {GOOD: raw(poses())})
    (file,) = bag.glob("*.db3")
    whole = file.read_bytes()
    for at in [i for i, byte in enumerate(whole[:4096]) if byte][100::7]:
        file.write_bytes(whole[:at] + b"\x80" + whole[at + 1 :])
        with contextlib.suppress(InputError):
            read_bag(bag)


# ---------------------------------------------------------------- what is in it and not used, and what cannot be so


def test_two_types_under_one_name(tmp_path):
    """Two publishers: only one of them publishes what is asked for, whichever publishes more."""
    other = "geometry_msgs/msg/PoseWithCovarianceStamped"
    blank = [0.0] * 36
    for plugin in StoragePlugin:
        folder = tmp_path / plugin.name
        with Writer(folder, version=9, storage_plugin=plugin) as writer:
            ours, theirs = (writer.add_connection(GOOD, kind, typestore=STORE) for kind in (POSE, other))
            for i, (_, message) in enumerate(poses(5)):
                writer.write(ours, EPOCH + i, STORE.serialize_cdr(message, POSE))
            for i, (_, message) in enumerate(poses(9)):
                with_covariance = make("geometry_msgs/msg/PoseWithCovariance", message.pose, np.array(blank))
                raw_bytes = STORE.serialize_cdr(make(other, message.header, with_covariance), other)
                writer.write(theirs, EPOCH + i, raw_bytes)
        run = read_bag(folder)
        said = (
            f"9 messages on {GOOD} are {other}, not {POSE} as the other 5: left out; give each type a topic of its own"
        )
        assert len(run.times) == 5 and said in run.notes and not any("damaged" in note for note in run.notes)


@pytest.mark.parametrize(
    ("pack", "suffix", "tool"), [(gzip, ".gz", "gunzip"), (bz2, ".bz2", "bunzip2"), (lzma, ".xz", "unxz")]
)
def test_a_storage_file_that_is_packed(tmp_path, pack, suffix, tool):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    packed = bag / f"bag.mcap{suffix}"
    packed.write_bytes(pack.compress((bag / "bag.mcap").read_bytes()))
    assert len(read_bag(bag).times) == 3
    (bag / "bag.mcap").unlink()
    for _ in range(2):  # with metadata and without
        with pytest.raises(InputError, match=rf"bag.mcap\{suffix}: is compressed; unpack it with `{tool}`"):
            read_bag(bag)
        (bag / "metadata.yaml").unlink(missing_ok=True)


@pytest.mark.parametrize(("form", "suffix", "tool"), [
    ("zip", "zip", "unzip"), ("gztar", "tar.gz", "tar xzf"), ("bztar", "tar.bz2", "tar xjf"), ("tar", "tar", "tar xf"),
])  # fmt: skip
def test_a_folder_that_is_packed(tmp_path, form, suffix, tool):
    record(tmp_path / "bag", {GOOD: poses()})
    packed = shutil.make_archive(str(tmp_path / "packed"), form, tmp_path, "bag")
    with pytest.raises(InputError, match=f"a packed folder; unpack it with `{tool} packed.{suffix}`, and name what"):
        read_csv(packed)
    with pytest.raises(InputError, match=f"is no bag but a packed folder; unpack it with `{tool}"):
        read_bag(shutil.copy(packed, tmp_path / "run.mcap"))


def test_a_workbook_is_no_packed_folder(tmp_path):
    with zipfile.ZipFile(tmp_path / "run.csv", "w") as book:
        book.writestr("xl/workbook.xml", "")
    with pytest.raises(InputError, match="is no CSV but a workbook; save the sheet as CSV"):
        read_csv(tmp_path / "run.csv")


def test_text_that_is_named_as_a_bag(tmp_path):
    (tmp_path / "run.mcap").write_text("time,surge\n0,1\n")
    with pytest.raises(InputError, match=r"is no bag but text, whatever its name says; a table is read as run.csv"):
        read_bag(tmp_path / "run.mcap")


def test_damage_is_not_told_in_words_of_python(tmp_path):
    """Bytes changed anywhere: whatever stumbles over them."""
    file = record(tmp_path / "bag", {GOOD: poses(30)}) / "bag.mcap"
    whole = file.read_bytes()
    for at in range(60, len(whole) - 8, 97):
        file.write_bytes(whole[:at] + b"\xff" * 8 + whole[at + 8 :])
        try:
            said = " ".join(read_bag(file).notes)
        except InputError as error:
            said = str(error)
        assert not re.search(r"'int'|NoneType|object|unpack requires|index out of|codec", said), (at, said)


def test_a_bag_within_a_bag_and_metadata_that_are_cut_off(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses()})
    shutil.copytree(bag, bag / "copy")
    assert read_bag(bag).notes == (
        "copy in it holds a bag of its own, which is not used; list it as a run where it is one",
    )
    shutil.rmtree(bag / "copy")
    metadata = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(metadata[: metadata.index("  topics_with_message_count")])
    (note,) = read_bag(bag).notes
    assert note.startswith("metadata.yaml is cut off or not whole, it lacks") and "topics_with_message_count" in note


def test_where_the_clock_did_not_run(tmp_path):
    def notes(name, stamps):
        messages = [pose(stamp, (0.1 * i, 0, 0, 0)) for i, stamp in enumerate(stamps)]
        return read_bag(record(tmp_path / name, {GOOD: messages})).notes

    good = [EPOCH + i * 2_000_000 for i in range(20)]
    left = f"3 messages on {GOOD} stamped 0 left out: the clock did not run"
    assert notes("first", [0] * 3 + good) == (f"{left} yet",)
    assert notes("last", good + [0] * 3) == (f"{left} there (message 21 to message 23)",)
    assert notes("some", [*good[:4], 0, *good[4:9], 0, 0, *good[9:]]) == (
        f"{left} there (message 5 the first, message 12 the last)",
    )
    (said,) = notes("negative", [i * 2_000_000 - 5_000_000_000 for i in range(20)])
    assert said.startswith(f"20 of 20 messages on {GOOD} are stamped before 1970")


def test_stamps_that_many_share(tmp_path):
    for name, stamps, says in (
        ("seconds", [(EPOCH // 10**9 + i // 10) * 10**9 for i in range(40)], "all are whole seconds: .* nanosec"),
        (
            "blocks",
            [EPOCH + i // 8 * 16_000_000 for i in range(40)],
            r"about 8 messages share each stamp \(the stamp of a",
        ),
    ):
        messages = [pose(stamp, (0.1 * i, 0, 0, 0)) for i, stamp in enumerate(stamps)]
        with pytest.raises(InputError, match=says):
            read_bag(record(tmp_path / name, {GOOD: messages}))


def test_a_frame_that_changes_is_said(tmp_path):
    messages = poses(6)
    for _, message in messages[4:]:
        message.header.frame_id = "odom"
    (said,) = read_bag(record(tmp_path / "bag", {GOOD: messages})).notes
    assert said == f"frame_id on {GOOD} changes from 'track' to 'odom' at message 5: one run is of one frame"
