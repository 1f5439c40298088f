# SPDX-License-Identifier: Apache-2.0
"""rosbag2: there and back, what a rig records, and one broken bag per way to break one."""

import os
import resource

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from inductrack_ros import frames
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.state import COORDINATES, GAPS, RATES, STATES
from inductrack_ros.data import Pulses, bag_messages, bags, read_bag, write_bag

STORE = get_typestore(Stores.ROS2_JAZZY)
EPOCH = 1_760_000_000_000_000_000
POSE, TWIST = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TwistStamped"
IMU, RANGE, POINT = "sensor_msgs/msg/Imu", "sensor_msgs/msg/Range", "geometry_msgs/msg/PointStamped"


def make(msgtype, *fields):
    return STORE.types[msgtype](*fields)


def header(stamp):
    return make("std_msgs/msg/Header", make("builtin_interfaces/msg/Time", *divmod(stamp, 10**9)), "track")


def vector(values, kind="Vector3"):
    return make(f"geometry_msgs/msg/{kind}", *map(float, values))


def pose(stamp, coordinates=(0, 0, 0, 0), orientation=None):
    position, quaternion = frames.coordinates_to_pose(coordinates)
    orientation = vector(quaternion if orientation is None else orientation, "Quaternion")
    return POSE, make(POSE, header(stamp), make("geometry_msgs/msg/Pose", vector(position, "Point"), orientation))


def twist(stamp, rates=(0, 0, 0, 0)):
    return TWIST, make(
        TWIST, header(stamp), make("geometry_msgs/msg/Twist", *map(vector, frames.rates_to_twist(rates)))
    )


def imu(stamp, specific_force, covariance=0.0):
    first = np.array([covariance] + 8 * [0.0])
    still, upright = vector([0, 0, 0]), vector([0, 0, 0, 1], "Quaternion")
    return IMU, make(IMU, header(stamp), upright, np.zeros(9), still, np.zeros(9), vector(specific_force), first)


def gap(stamp, value, low=0.0, high=0.0):
    return RANGE, make(RANGE, header(stamp), 1, 0.0, low, high, value, 0.0)


def point(stamp, coil, current):
    return POINT, make(POINT, header(stamp), vector([coil, current, 0], "Point"))


def record(path, topics, plugin=StoragePlugin.MCAP):
    """Record {topic: [(type, message), …]}, each 3 s late: only header stamps tell the time."""
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic, messages in topics.items():
            msgtype = messages if isinstance(messages, str) else messages[0][0]
            connection = writer.add_connection(topic, msgtype, typestore=STORE)
            for i, (kind, message) in enumerate(() if isinstance(messages, str) else messages):
                writer.write(connection, EPOCH + 3 * 10**9 + i, STORE.serialize_cdr(message, kind))
    return path


def poses(n=3, step=2_000_000):
    return [pose(EPOCH + i * step, (0.1 * i, 0.01, -0.005, 0.002)) for i in range(n)]


# ---------------------------------------------------------------- there and back


@pytest.mark.parametrize("start", [0.0, 1.76e9])
def test_what_is_written_is_read(tmp_path, start):
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(1e-4, 1e-2, 50)).round(9)
    columns = {name: rng.normal(0, 0.1, 50) for name in (*STATES, *GAPS)}
    pulses = Pulses(np.array([0.001, 0.004]), np.array([3, 4]), np.array([7000.0, -7000.0]))
    write_bag(tmp_path / "bag", times, columns, start=start, pulses=pulses)
    assert os.listdir(tmp_path) == ["bag"]
    run = read_bag(tmp_path / "bag")
    assert run.name == "bag"
    assert run.channels == (*STATES, *GAPS)
    assert np.allclose(run.times, times - times[0], atol=1e-12)
    for name in STATES:
        assert np.allclose(run[name], columns[name], rtol=0, atol=1e-15)
    for name in GAPS:  # a Range holds single precision
        assert np.allclose(run[name], columns[name], rtol=1e-7)
    assert np.allclose(run.pulses.times, pulses.times - times[0], atol=1e-12)
    assert run.pulses.coils.tolist() == [3, 4]
    assert run.pulses.currents.tolist() == [7000.0, -7000.0]
    assert np.array_equal(read_bag(tmp_path / "bag" / "bag.mcap").values, run.values)


def test_the_odometry_moves_in_the_cradles_axes(tmp_path):
    columns = dict.fromkeys(STATES, np.zeros(2)) | {"roll": np.full(2, np.pi / 2), "heave_rate": np.full(2, 0.5)}
    write_bag(tmp_path / "bag", [0.0, 0.1], columns)
    with Reader(tmp_path / "bag") as reader:
        wanted = [c for c in reader.connections if c.topic == "/inductrack/odometry"]
        raw = next(reader.messages(wanted))[2]
    odometry = STORE.deserialize_cdr(raw, "nav_msgs/msg/Odometry")
    assert odometry.header.frame_id == "track"
    assert odometry.child_frame_id == "cradle"
    linear = odometry.twist.twist.linear
    assert (linear.x, linear.y, linear.z) == pytest.approx((0, 0.5, 0))


def test_writing_keeps_what_is_there_and_leaves_nothing_half_done(tmp_path):
    columns = dict.fromkeys(STATES, np.zeros(2))
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="exists already"):
        write_bag(tmp_path / "bag", [0, 1], columns)
    with pytest.raises(InputError, match="no folder"):
        write_bag(tmp_path / "none" / "bag", [0, 1], columns)
    with pytest.raises(InputError, match="missing: roll"):
        write_bag(tmp_path / "new", [0, 1], {k: v for k, v in columns.items() if k != "roll"})
    with pytest.raises(InputError, match="before 0"):
        write_bag(tmp_path / "new", [-1, 1], columns)
    with pytest.raises(ValueError):  # a caller's mistake in the middle of writing
        write_bag(tmp_path / "new", [0, 1, 2], columns)
    assert os.listdir(tmp_path) == ["bag"]


# ---------------------------------------------------------------- what a rig records


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_topics_at_different_rates_share_one_time_axis(tmp_path, plugin):
    ms = 1_000_000
    bag = record(
        tmp_path / "bag",
        {
            "/rig/pose": poses(3),
            "/rig/twist": [twist(EPOCH + 2 * ms, (15, 0.1, 0.2, 0.3)), twist(EPOCH + 3 * ms, (16, 0, 0, 0))],
        },
        plugin,
    )
    run = read_bag(bag, {"pose": "/rig/pose", "twist": "rig/twist"}, "name")
    assert run.name == "name"
    assert run.channels == STATES
    assert run.stamps.tolist() == [EPOCH, EPOCH + 2 * ms, EPOCH + 3 * ms, EPOCH + 4 * ms]
    assert run.times == pytest.approx([0, 0.002, 0.003, 0.004], abs=1e-12)
    assert run.samples("surge")[1].tolist() == pytest.approx([0, 0.1, 0.2])
    assert run.samples("roll")[1].tolist() == pytest.approx(3 * [0.002])
    assert run.samples("surge_rate")[0].tolist() == pytest.approx([0.002, 0.003])
    assert run.values[1, 4:].tolist() == pytest.approx([15, 0.1, 0.2, 0.3])
    assert run.pulses is None


def test_the_specific_force_of_an_imu_becomes_accelerations(tmp_path):
    tilted = [pose(EPOCH + i * 10**6, (0, 0, 0, 0.1 * i)) for i in range(3)]
    force = frames.accelerations_to_specific_force([1.0, 2.0, 3.0], 0.15)
    bag = record(
        tmp_path / "bag",
        {
            "/inductrack/pose": tilted,
            "/inductrack/imu": [imu(EPOCH + 1_500_000, force), imu(EPOCH + 2_000_000, force, -1)],
        },
    )
    run = read_bag(bag)
    names = ("surge_acceleration", "sway_acceleration", "heave_acceleration")
    assert [run.samples(name)[1].tolist() for name in names] == [pytest.approx([a]) for a in (1, 2, 3)]
    weightless = read_bag(bag, gravity=0.0)
    assert weightless.samples("heave_acceleration")[1] == pytest.approx([3 + 9.81])


def test_a_range_that_sees_nothing_is_not_measured(tmp_path):
    values = [0.005, np.inf, -0.00001, 0.03, np.nan]
    readings = [gap(EPOCH + i * 10**6, value, 0.0, 0.02) for i, value in enumerate(values)]
    run = read_bag(record(tmp_path / "bag", {"/inductrack/pose": poses(), "/inductrack/gap_top": readings}))
    times, seen = run.samples("gap_top")
    assert times.tolist() == pytest.approx([0, 0.002])
    assert seen.tolist() == pytest.approx([0.005, -0.00001])


def test_measured_topics_go_before_the_simulators_truth(tmp_path):
    topics = {
        "/inductrack/pose": poses(),
        "/inductrack/twist": [twist(EPOCH)],
        "/inductrack/measured/pose": [pose(EPOCH, (7, 0, 0, 0)), pose(EPOCH + 10**6, (8, 0, 0, 0))],
    }
    run = read_bag(record(tmp_path / "bag", topics))
    assert run.channels == COORDINATES  # a rig that measures no twist is not given the true one
    assert run["surge"].tolist() == [7, 8]
    # Sensors that are switched off have topics without messages.
    run = read_bag(record(tmp_path / "off", topics | {"/inductrack/measured/pose": POSE}))
    assert run.channels == STATES


def test_a_topic_can_be_left_out(tmp_path):
    bag = record(tmp_path / "bag", {"/inductrack/pose": poses(), "/inductrack/twist": [twist(EPOCH)]})
    assert read_bag(bag).channels == COORDINATES + RATES
    assert read_bag(bag, {"twist": None}).channels == COORDINATES
    with pytest.raises(InputError, match="needs its pose"):
        read_bag(bag, {"pose": None})


def test_fired_pulses_go_before_commanded_ones(tmp_path):
    fired, commanded = [point(EPOCH + 10**6, 4, -7000), point(EPOCH, 3, 7000)], [point(EPOCH, 9, 1)]
    topics = {"/inductrack/pose": poses(), "/inductrack/drive_pulses": commanded}
    assert read_bag(record(tmp_path / "commanded", topics)).pulses.coils.tolist() == [9]
    run = read_bag(record(tmp_path / "fired", topics | {"/inductrack/fired_pulses": fired}))
    assert run.pulses.coils.tolist() == [3, 4]
    assert run.pulses.times.tolist() == pytest.approx([0, 0.001])
    # The topic is there but nothing was fired: the averaged drive.
    assert read_bag(record(tmp_path / "none", topics | {"/inductrack/fired_pulses": POINT})).pulses is None


def test_a_simulator_that_stands_still_says_the_same_again(tmp_path):
    first, second, third = poses()
    run = read_bag(record(tmp_path / "bag", {"/inductrack/pose": [first, second, second, second, third]}))
    assert run.times == pytest.approx([0, 0.002, 0.004])


def test_a_folder_left_without_metadata_is_read_if_its_file_is_whole(tmp_path):
    bag = record(tmp_path / "bag", {"/inductrack/pose": poses()})
    (bag / "metadata.yaml").unlink()
    assert len(read_bag(bag).times) == 3


def test_roll_does_not_jump_at_half_a_turn(tmp_path):
    turning = [pose(EPOCH + i * 10**6, (0, 0, 0, roll)) for i, roll in enumerate([3.0, 3.1, 3.2, 3.3])]
    assert read_bag(record(tmp_path / "bag", {"/inductrack/pose": turning}))["roll"] == pytest.approx(
        [3.0, 3.1, 3.2, 3.3]
    )


# ---------------------------------------------------------------- long bags


def spinning(n):
    """Poses that roll through whole turns, each said twice, and an imu and a gap that sometimes see nothing."""
    topics = {"pose": [], "imu": [], "gap_top": []}
    for i in range(n):
        stamp = EPOCH + i * 10**6
        topics["pose"] += 2 * [pose(stamp, (0.1 * i, 0.01 * i, 0, 0.4 * i))]
        topics["imu"].append(imu(stamp + 10**5, (i, 1, 2), -(i % 3 == 0)))
        topics["gap_top"].append(gap(stamp, 0.005 if i % 5 else np.inf))
    return {f"/inductrack/{key}": messages for key, messages in topics.items()}


def test_reading_in_blocks_is_the_same_as_at_once(tmp_path, monkeypatch):
    whole, broken = spinning(20), {GOOD: [*poses(9), pose(EPOCH - 10**9)]}
    bag, broken = record(tmp_path / "bag", whole), record(tmp_path / "broken", broken)
    at_once = read_bag(bag)
    assert at_once["roll"][~np.isnan(at_once["roll"])] == pytest.approx(0.4 * np.arange(20))
    assert np.isnan(at_once["gap_top"]).sum() == 13 + 4  # at the imu's stamps and where it saw nothing
    for size in (1, 2, 7):
        monkeypatch.setattr(bags, "BLOCK", size)
        monkeypatch.setattr(bag_messages, "BLOCK", size)
        run = read_bag(bag)
        assert np.array_equal(run.stamps, at_once.stamps)
        assert np.array_equal(run.values, at_once.values, equal_nan=True)
        with pytest.raises(InputError, match="message 10 is stamped 1.016 s earlier than one before it"):
            read_bag(broken)


def test_a_bag_of_more_files_than_a_process_may_open(tmp_path):
    bag = record(tmp_path / "bag", {GOOD: poses(1)})
    metadata = (bag / "metadata.yaml").read_text()
    many = "".join(f"  - {i}.mcap\n" for i in range(64))
    for i in range(64):
        os.link(bag / "bag.mcap", bag / f"{i}.mcap")
    (bag / "metadata.yaml").write_text(metadata.replace("  - bag.mcap\n", many))
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 32, hard))
        with pytest.raises(InputError, match="only one sample"):  # the same message in every file
            read_bag(bag)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


# ---------------------------------------------------------------- one broken bag per failure

GOOD = "/inductrack/pose"
NAN = float("nan")
BROKEN = {
    "no pose": (
        {"/rig/pose": poses()},
        r"no topic /inductrack/pose for pose; set topics: \{pose: /rig/pose\}.*/rig/pose \(geometry",
    ),
    "wrong type": ({GOOD: [twist(EPOCH), twist(EPOCH + 1)]}, "is geometry_msgs/msg/TwistStamped, but pose must be"),
    "no messages": ({GOOD: POSE}, "topic /inductrack/pose: no messages"),
    "one message": ({GOOD: poses(1)}, "only one sample"),
    "backwards": (
        {GOOD: [*poses(3), pose(EPOCH - 2 * 10**9)]},
        "message 4 is stamped 2.004 s earlier than one before it; one publisher",
    ),
    "repeated": (
        {GOOD: [pose(EPOCH), pose(EPOCH, (1, 0, 0, 0))]},
        "message 2 repeats the stamp of message 1 with other values",
    ),
    "no stamps": ({GOOD: [pose(0), pose(0)]}, "header stamps are 0"),
    "nan": ({GOOD: [pose(EPOCH + i, (NAN, 0, 0, 0)) for i in range(2)]}, "no measurement"),
    "no unit": ({GOOD: [pose(EPOCH), pose(EPOCH + 1, orientation=[0, 0, 0, 1e300])]}, "no unit quaternion"),
    "two clocks": ({GOOD: poses(), "/inductrack/twist": [twist(10**9)]}, "twist is stamped at other times.*one clock"),
    "nothing in range": ({GOOD: poses(), "/inductrack/gap_left": [gap(EPOCH, np.inf)]}, "gap_left.*no measurement"),
    "no acceleration": ({GOOD: poses(), "/inductrack/imu": [imu(EPOCH, [0, 0, 9.81], -1)]}, "imu.*no measurement"),
    "half a coil": ({GOOD: poses(), "/inductrack/fired_pulses": [point(EPOCH, 0.5, 1)]}, "whole coil index"),
}


@pytest.mark.parametrize(("topics", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_bag_is_one_line_that_names_it(tmp_path, topics, message):
    bag = record(tmp_path / "bag", topics)
    with pytest.raises(InputError, match=message) as caught:
        read_bag(bag)
    assert str(bag) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_bag(tmp_path):
    with pytest.raises(InputError, match="no such bag"):
        read_bag(tmp_path / "none")
    with pytest.raises(InputError, match="neither metadata.yaml nor"):
        read_bag(tmp_path)
    (tmp_path / "run.csv").write_text("time,heave\n")
    with pytest.raises(InputError, match="not a bag"):
        read_bag(tmp_path / "run.csv")
    with pytest.raises(InputError):
        read_bag("a\0b")
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match="several bags; name one"):
        read_bag(tmp_path)
    with pytest.raises(InputError, match="unknown key 'posee'; did you mean 'pose'"):
        read_bag(tmp_path, {"posee": "/x"})


@pytest.fixture(scope="module", params=[StoragePlugin.MCAP, StoragePlugin.SQLITE3], ids=["mcap", "sqlite3"])
def whole(request, tmp_path_factory):
    bag = record(tmp_path_factory.mktemp("bags") / "bag", {GOOD: poses(200)}, request.param)
    return bag, next(p for p in bag.iterdir() if p.suffix != ".yaml")


@pytest.mark.parametrize("part", [0.0, 0.001, 0.3, 0.7, 0.999])
def test_a_bag_that_was_cut_off(whole, tmp_path, part):
    bag, storage = whole
    data = storage.read_bytes()
    cut = tmp_path / "bag"
    cut.mkdir()
    (cut / "metadata.yaml").write_bytes((bag / "metadata.yaml").read_bytes())
    (cut / storage.name).write_bytes(data[: int(part * len(data))])
    if part >= (0.3 if storage.suffix == ".mcap" else 0.7):  # before that there is no page of rows
        assert "cut off" in read_bag(cut).notes[0] and "cut off" in read_bag(cut / storage.name).notes[0]
        return
    for path in (cut, cut / storage.name):
        with pytest.raises(InputError, match="cut off"):
            read_bag(path)
