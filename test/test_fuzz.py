# SPDX-License-Identifier: Apache-2.0
"""Whatever stands in a file or a message, the answer is a result or one line; never a traceback, a hang, a NaN sent
out.

In the tests some 700 inputs; `make fuzz`, nightly, more than ten thousand.
"""

from __future__ import annotations

import contextlib
import faulthandler
import functools
import gc
import io
import math
import shutil
import string
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from conftest import NIGHTLY
from geometry_msgs.msg import PointStamped, PoseStamped
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from rclpy.parameter import Parameter as RosParameter
from rosbags.rosbag2 import StoragePlugin, Writer
from std_msgs.msg import UInt64MultiArray
from std_srvs.srv import SetBool, Trigger
from test_data_bags import STORE, pose

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.parameters import PARAMETERS
from inductrack_ros.core.state import CHANNELS, COORDINATES, STATES
from inductrack_ros.data import Pulses, load_campaign, read_bag, read_csv, write_bag
from inductrack_ros.data.mcap_salvage import zstd
from inductrack_ros.nodes.sim import SimNode
from inductrack_ros.nodes.simulation import parse_initial_state
from inductrack_ros.nodes.topics import nanoseconds_of, stamp_of
from inductrack_ros.nodes.track_controller import TrackController

LONGEST = 60.0  # s for one input, on a busy machine; then it hangs, and the tests end with a traceback of where


def fuzz(share: int):
    """Settings of a fuzz test: so many inputs in the tests, twenty-five times as many at night."""
    nightly = settings().max_examples == NIGHTLY.max_examples
    return settings(
        max_examples=25 * share if nightly else share,
        deadline=None,
        derandomize=not nightly,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
    )


@contextlib.contextmanager
def no_hang() -> Iterator[None]:
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()


@contextlib.contextmanager
def one_line_or_a_result() -> Iterator[None]:
    with no_hang():
        try:
            yield
        except InputError as error:
            assert str(error) and "\n" not in str(error) and len(str(error)) < 2000


# ---- files ----------------------------------------------------------------------------------------------------------

ANY_TEXT = st.text(st.characters(codec="utf-8"), max_size=60) | st.text("{}[]:,-?&*!|>'\"#%@` \n\tab1.e", max_size=40)
ANY_BYTES = st.binary(max_size=100) | ANY_TEXT.map(str.encode)
WORDS = st.sampled_from(
    [
        *PARAMETERS,
        "dof",
        "drive",
        "effects",
        "effect_files",
        "ros__parameters",
        "/**",
        "/**/sim",
        "sim",
        "track_controller",
        "rate",
        "measured",
        "viscous_drag",
        "sensor_delay:heave",
        "viscous_drag.coefficient",
        "coefficient",
        "",
        ".",
        "..",
        "a.b.c",
        "stand_in_heave.values",
    ]
)
SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.dates()
    | st.binary(max_size=3)
    | WORDS
    | st.text(max_size=5)
)
TREES = st.recursive(
    SCALARS, lambda x: st.lists(x, max_size=3) | st.dictionaries(WORDS | SCALARS, x, max_size=4), max_leaves=12
)


@fuzz(120)
@given(
    content=(st.dictionaries(WORDS, TREES, max_size=4) | TREES).map(
        lambda t: yaml.safe_dump(t, allow_unicode=True).encode()
    )
    | ANY_BYTES
)
@example(b"!!timestamp x")
@example(b"!!int x")
@example(b"!!float x")
@example(b"!!bool x")
@example(b"=")
@example(b"<<: {<<: 1}")
@example(b"? !!set {a}\n: 1")
@example(b"!!omap [1]")
@example(b"mass: 1:20")
@example(b"%YAML 9.9\n---\nmass: 1")
@example(b"--- {mass: 1}\n--- {mass: 1}")
def test_a_model_file(tmp_path, content):
    (tmp_path / "model.yaml").write_bytes(content)
    with one_line_or_a_result():
        assert isinstance(Model.load(tmp_path / "model.yaml"), Model)


@pytest.fixture(scope="module")
def rig(tmp_path_factory) -> Path:
    """A folder with a CSV, a bag with pulses and a model to name in a campaign."""
    folder = tmp_path_factory.mktemp("rig")
    (folder / "run.csv").write_text("time,surge,heave\n0,0,-0.005\n0.1,1.5,-0.004\n")
    (folder / "model.yaml").write_text("eta: 0.7\n")
    pulses = Pulses(np.zeros(1), np.array([3]), np.array([7e3]))
    with Writer(folder / "old", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        messages = [pose(i * 2_000_000 + 1) for i in range(20)]
        connection = writer.add_connection("/inductrack/pose", messages[0][0], typestore=STORE)
        for i, (kind, message) in enumerate(messages):
            writer.write(connection, i, STORE.serialize_cdr(message, kind))
    shutil.move(folder / "old" / "old.db3", folder / "old.db3")
    write_bag(folder / "bag", np.arange(50) / 500, dict.fromkeys(STATES, np.zeros(50)), pulses=pulses)
    return folder


RUN_ENTRIES = st.fixed_dictionaries(
    {"file": st.sampled_from(["run.csv", "bag", "model.yaml", ".", "..", "/dev/zero", "none", "a\0b"]) | SCALARS},
    optional={
        "drive_current": SCALARS,
        "initial_state": st.dictionaries(st.sampled_from(STATES) | SCALARS, SCALARS, max_size=2),
        "conditions": st.dictionaries(WORDS | SCALARS, SCALARS, max_size=2) | SCALARS,
    },
)
CAMPAIGNS = st.fixed_dictionaries(
    {"runs": st.lists(RUN_ENTRIES, max_size=3) | SCALARS},
    optional={
        "name": SCALARS,
        "model": st.sampled_from(["model.yaml", "bag", "/dev/zero"]) | SCALARS,
        "free": st.lists(WORDS | SCALARS, max_size=2) | SCALARS,
        "dof": st.integers(0, 5) | st.lists(st.sampled_from(COORDINATES) | SCALARS, max_size=3) | SCALARS,
        "inputs": (
            st.dictionaries(
                WORDS,
                st.sampled_from(["heave", "/inductrack/pose:pose.position.x", ":", "/:a.b"]) | SCALARS,
                max_size=2,
            )
            | SCALARS
        ),
        "noise_std": st.dictionaries(st.sampled_from(CHANNELS), SCALARS, max_size=2) | SCALARS,
        "topics": st.dictionaries(st.sampled_from(["pose", "twist", "pulses"]), SCALARS, max_size=2) | SCALARS,
    },
).map(lambda tree: yaml.safe_dump(tree, allow_unicode=True).encode())
ALMOST_YAML = (
    st.lists(
        st.sampled_from(
            [
                "name",
                "runs",
                "file",
                "run.csv",
                "heave",
                ":",
                ": ",
                "- ",
                "\n",
                "\n  ",
                "{",
                "}",
                "[",
                "]",
                ", ",
                "&a ",
                "*a",
                "<<",
                "!!",
                "?",
                "|",
                "0",
                "1.5",
                "\t",
                "%",
            ]
        ),
        max_size=30,
    )
    .map("".join)
    .map(str.encode)
)


@fuzz(120)
@given(
    content=CAMPAIGNS
    | ALMOST_YAML
    | ALMOST_YAML.map(lambda t: b"runs: [{file: run.csv, drive_current: 0}]\n" + t)
    | ANY_BYTES
)
def test_a_campaign(rig, content):
    (rig / "campaign.yaml").write_bytes(content)
    with one_line_or_a_result():
        campaign = load_campaign(rig)
        assert campaign.runs and isinstance(campaign.load_model(), Model)


CELLS = st.sampled_from(
    ["0", "1", "2.5", "-3e-3", "", "nan", "inf", "x", '"', " ", "1e999", "1_0", "٣", "\0", "\t", ";"]
)
ROWS = st.lists(st.lists(CELLS, max_size=4).map(",".join), max_size=6)
HEADERS = st.lists(st.sampled_from(["time", "heave", "surge", "heve", ""]), max_size=4).map(",".join)
TABLES = st.builds(lambda head, body, end: end.join([head, *body]).encode(), HEADERS, ROWS, st.sampled_from("\n\r\v"))


NAMES = [
    "time",
    "Time (ms)",
    "t [us]",
    "time_ns",
    "timestamp",
    "heave",
    "heave [mm]",
    "roll/deg",
    "surge_rate (km/h)",
    "surge",
    "heve",
    "temperature",
    "heave [parsec]",
    "",
    "#time",
    "sep=;",
]
DIALECT_CELLS = CELLS | st.sampled_from(
    [
        "1,5",
        "-0,004",
        "1.5e-3",
        "1700000000000000000",
        "-9999",
        "2026-01-01T10:00:00.5Z",
        "2026-13-45",
        "12:30:01",
        "99:99",
        "01.02.2026 10:00",
        "NaT",
        "°",
        "mm",
        "[s]",
        "=1/0",
        "TRUE",
        "0x1F",
        "1e400",
        "-",
        "#N/A",
    ]
)
ENCODINGS = st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp1252", "shift-jis"])


@st.composite
def dialects(draw) -> bytes:
    """A table as a logger may write it: mostly a good one, with a few cells, rows and lines that are odd."""
    separator = draw(st.sampled_from([",", ";", "\t", "|", " ", ", "]))
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    header = draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=5))
    step = draw(st.sampled_from([0.004, 1e-3, 4.0, 4e6, 0.0, -1.0, 1e300]))
    rows = [[repr(i * step)] + [repr(0.1 * i)] * (len(header) - 1) for i in range(draw(st.integers(0, 30)))]
    for _ in range(draw(st.integers(0, 3))):
        if rows:
            row = draw(st.sampled_from(rows))
            row[draw(st.integers(0, len(row) - 1))] = draw(DIALECT_CELLS)
    lines = [separator.join(header), *map(separator.join, rows)]
    for _ in range(draw(st.integers(0, 3))):
        lines.insert(
            draw(st.integers(0, len(lines))),
            draw(
                st.sampled_from(["# note", "% x", "sep=;", "", separator, "s;m;m", "[ms],[mm]", '"', "end", "Logger 3"])
            ),
        )
    text = end.join(lines) + draw(st.sampled_from(["", end, separator]))
    if draw(st.booleans()):
        text = text.replace(".", ",")
    return text.encode(draw(ENCODINGS), errors="replace")[: draw(st.sampled_from([None, None, -1, -7]))]


@fuzz(160)
@given(content=st.binary(max_size=200) | TABLES | dialects())
def test_a_csv(tmp_path, content):
    (tmp_path / "run.csv").write_bytes(content)
    with one_line_or_a_result():
        sound(read_csv(tmp_path / "run.csv"))


GOOD_TIMES = np.arange(400) / 250
ALLOCATORS = 64 * 2**20  # bytes by which the same work differs from one time to the next


@fuzz(8)
@given(
    factor=st.sampled_from([1e3, 1e6, 1e9, 1e-3, 1.0]),
    offset=st.sampled_from([0.0, 1.7e9, -1e9, 1e300]),
    odd=st.lists(st.tuples(st.integers(0, 399), st.floats(allow_nan=False)), max_size=2),
    command=st.sampled_from(["check", "compare"]),
)
def test_no_clock_takes_more_than_twice_the_memory_of_a_good_one(tmp_path, factor, offset, odd, command):
    """Units of time, epochs and wild stamps, through the command: a status, one line where it is 2."""
    times = offset + factor * GOOD_TIMES
    for i, stamp in odd:
        times[i] = stamp
    good = _good_memory(command)
    with no_hang():
        status, said, taken = _run_command(command, tmp_path, times)
    assert status == 0 or status == 2 and said.strip() and "Traceback" not in said
    assert taken <= 2 * good + ALLOCATORS


@functools.cache
def _good_run() -> np.ndarray:
    run = Model.default().simulate(GOOD_TIMES, Model.default().initial_state(surge_rate=18.0), 0.0)
    noise = np.random.default_rng(1).normal(0.0, 1e-4, (2, len(GOOD_TIMES)))
    return np.array([run["surge"], run["heave"]]) + noise


def _run_command(command: str, folder: Path, times: np.ndarray) -> tuple[int, str, int]:
    """Exit status, what standard error says, and the memory (bytes) that it took at its height."""
    rig = folder / "rig"
    rig.mkdir(parents=True, exist_ok=True)
    rows = "".join(
        f"{t!r},{surge!r},{heave!r}\n" for t, surge, heave in zip(times.tolist(), *_good_run().tolist(), strict=True)
    )
    (rig / "run.csv").write_text("time,surge,heave\n" + rows)
    (rig / "campaign.yaml").write_text(
        "noise_std: {surge: 1e-4, heave: 1e-4}\nruns: [{file: run.csv, drive_current: 0}]\n"
    )
    gc.collect()
    Path("/proc/self/clear_refs").write_text("5")  # forget the height so far
    before = resident("VmRSS")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as said:
        status = cli.main([command, str(rig), "--output", str(folder / "out")])
    return status, said.getvalue(), resident("VmHWM") - before


def resident(name: str) -> int:
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(name))
    return 1024 * int(line.split()[1])


@functools.cache
def _good_memory(command: str) -> int:
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(2):  # the first time compiles and imports
            status, said, taken = _run_command(command, Path(folder), GOOD_TIMES)
            assert status == 0, said
    return taken


def sound(run) -> None:
    assert run.values.shape == (len(run.times), len(run.channels))
    assert (np.diff(run.times) > 0).all() and not np.isinf(run.values).any()


@fuzz(80)
@given(data=st.data())
def test_a_bag(rig, tmp_path, data):
    """Bytes of any kind; a whole bag that is cut, packed, or has some bytes changed; one whose metadata are
    anything."""
    whole = data.draw(st.sampled_from([rig / "bag" / "bag.mcap", rig / "old.db3"])).read_bytes()
    kind = data.draw(st.sampled_from(["bytes", "changed", "cut", "packed", "beside", "metadata"]))
    target = tmp_path / data.draw(st.sampled_from(["bag", "run #3", "50%20V", "a?b"]))
    shutil.rmtree(target, ignore_errors=True)
    suffix = ".mcap" if whole.startswith(b"\x89MCAP") else ".db3"
    if kind == "bytes":
        suffix, magic = data.draw(st.sampled_from([(".mcap", b"\x89MCAP0\r\n"), (".db3", b"SQLite format 3\0")]))
        target = tmp_path / f"bytes{suffix}"
        target.write_bytes(data.draw(st.sampled_from([b"", magic])) + data.draw(st.binary(max_size=300)))
    elif kind == "changed":
        content = bytearray(whole)
        for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=5)):
            content[place] = data.draw(st.integers(0, 255))
        target = tmp_path / f"changed{suffix}"
        target.write_bytes(content)
    elif kind == "cut":
        target = tmp_path / f"cut{suffix}"
        target.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    elif kind == "packed":
        target.mkdir()
        (target / f"run_0{suffix}.zstd").write_bytes(
            zstd.compress(whole)[: data.draw(st.sampled_from([None, None, -1, -50]))]
        )
    elif kind == "beside":  # what a killed recorder leaves beside its database may be anything
        target.mkdir()
        (target / f"run_0{suffix}").write_bytes(whole)
        journal = data.draw(st.sampled_from(["-wal", "-journal"]))
        (target / f"run_0{suffix}{journal}").write_bytes(data.draw(st.binary(max_size=200)))
    else:
        target.mkdir()
        (target / f"bag{suffix}").write_bytes(whole)
        words = st.text("rosbag2_infmtv: \n-[]{}019", max_size=100).map(str.encode)
        given = (rig / "bag" / "metadata.yaml").read_bytes()
        cut = st.integers(0, len(given)).map(lambda n: given[:n])
        (target / "metadata.yaml").write_bytes(data.draw(st.binary(max_size=100) | words | cut))
    with one_line_or_a_result():
        sound(read_bag(target))


@fuzz(40)
@given(
    text=st.text(string.printable, max_size=30)
    | st.dictionaries(st.sampled_from(STATES), st.floats(), max_size=3).map(
        lambda given: ",".join(f"{n}={v}" for n, v in given.items())
    )
)
def test_an_initial_state(text):
    with one_line_or_a_result():
        assert np.isfinite(Model.default().initial_state(**parse_initial_state(text))[:8]).all()


# ---- messages: nodes in this process, whose callbacks get what DDS could bring ---------------------------------------


def finite(message: object) -> bool:
    """Whether every number in a message is one."""
    if isinstance(message, float):
        return math.isfinite(message)
    if hasattr(message, "get_fields_and_field_types"):
        return all(finite(getattr(message, name)) for name in message.get_fields_and_field_types())
    if isinstance(message, (str, bytes, int)):
        return True
    return all(map(finite, message))


@contextlib.contextmanager
def node_of(kind: type) -> Iterator[tuple[object, list]]:
    """A node, and the list of what it publishes, of which every number must be one."""
    node, sent = kind(), []
    for publisher in list(node.publishers):

        def spy(message, topic=publisher.topic_name):
            assert finite(message), (topic, message)
            sent.append(message)

        if publisher.topic_name != "/parameter_events":  # which repeat what was asked, infinity where that is allowed
            publisher.publish = spy
    yield node, sent
    node.destroy_node()


@pytest.fixture(scope="module")
def nodes() -> Iterator[tuple[SimNode, tuple[TrackController, list]]]:
    options = (
        "sim:drive:=pulses", "sim:publish_clock:=true", "sim:details_rate:=500.0", "sim:initial_state:=surge_rate=15.0",
        "sim:effects:=[viscous_drag, skin_effect]", "track_controller:mode:=speed", "track_controller:lockstep:=true",
        "track_controller:detectors.false_rate:=20.0",
    )  # fmt: skip
    rclpy.init(args=["test", "--ros-args", *(w for o in options for w in ("-p", o))])
    with node_of(SimNode) as (sim, _), node_of(TrackController) as controller:
        yield sim, controller
    rclpy.shutdown()


@pytest.fixture(scope="module")
def sim(nodes) -> SimNode:
    return nodes[0]


@pytest.fixture(scope="module")
def controller(nodes) -> tuple[TrackController, list]:
    return nodes[1]


ANY_FLOAT = st.floats() | st.sampled_from([0.0, -1.0, 1e308, -1e308, 5e-324, math.nan, math.inf])
STAMPS = st.builds(lambda s, n: s * 10**9 + n, st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))
PULSES = st.tuples(
    STAMPS | st.integers(-(10**9), 2 * 10**9),
    st.integers(0, 50).map(float) | ANY_FLOAT,
    st.floats(-2e4, 2e4) | ANY_FLOAT,
)
STEPS = st.one_of(
    PULSES,
    st.integers(1, 20),  # ticks
    st.lists(st.integers(0, 2**64 - 1), max_size=3),  # an answer in lockstep
    st.sampled_from(["reset", "pause", "go on", "step"]),
)


@fuzz(60)
@given(steps=st.lists(STEPS, max_size=25))
def test_messages_to_the_simulator(sim, steps):
    sim._reset(Trigger.Request(), Trigger.Response())
    with no_hang():
        for step in steps:
            if isinstance(step, tuple):
                sim._take_pulse(_pulse(*step))
            elif isinstance(step, int):
                for _ in range(step):
                    sim._tick()
            elif isinstance(step, list):
                sim._take_answer(UInt64MultiArray(data=step))
            elif step == "reset":
                sim._reset(Trigger.Request(), Trigger.Response())
            elif step == "step":
                sim._step(Trigger.Request(), Trigger.Response())
            else:
                sim._pause(SetBool.Request(data=step == "pause"), SetBool.Response())
        sim._tick()


def _pulse(stamp: int, coil: float, current: float) -> PointStamped:
    message = PointStamped()
    message.header.stamp = stamp_of(stamp)
    message.point.x, message.point.y = coil, current
    return message


def values_for(sim: SimNode):
    """A parameter of the simulator and something to set it to: in its range, at its ends, or nonsense."""
    numbers = {n: d for n, d in sim._declared.items() if hasattr(d, "unit") and d.count == 1}
    in_range = st.sampled_from(sorted(numbers)).flatmap(
        lambda n: st.tuples(
            st.just(n), st.floats(numbers[n].low, numbers[n].high) | st.sampled_from([numbers[n].low, numbers[n].high])
        )
    )
    nonsense = st.sampled_from([*sorted(sim._declared), "none"]).flatmap(
        lambda n: st.tuples(
            st.just(n),
            ANY_FLOAT
            | st.integers(-(2**63), 2**63 - 1)
            | st.booleans()
            | st.text(max_size=3)
            | st.lists(st.floats(), max_size=2),
        )
    )
    return st.lists(in_range | in_range | nonsense, min_size=1, max_size=6)


@fuzz(60)
@given(data=st.data())
def test_parameters_of_the_simulator_at_run_time(sim, data):
    defaults = [RosParameter(n, value=d.default) for n, d in PARAMETERS.items()]
    defaults += [RosParameter(f"{e}.{p}", value=v) for e, ps in sim.model.effects.items() for p, v in ps.items()]
    with no_hang():
        for name, value in data.draw(values_for(sim)):
            with contextlib.suppress(rclpy.exceptions.ParameterNotDeclaredException):
                result = sim.set_parameters([RosParameter(name, value=value)])[0]
                assert result.successful or result.reason
            for _ in range(3):
                sim._tick()
            sim._wake()
        sim._reset(Trigger.Request(), Trigger.Response())
        sim._tick()
    sim.queue.clear()
    assert sim.set_parameters_atomically(defaults[: len(PARAMETERS)]).successful


MOTIONS = st.tuples(
    st.floats(-600.0, 600.0), st.floats(-1e3, 1e3), st.integers(1, 40), st.sampled_from([1, 2, 20, 900])
)


@fuzz(60)
@given(pieces=st.lists(MOTIONS | st.tuples(STAMPS, ANY_FLOAT), max_size=6))
def test_poses_to_the_controller(controller, pieces):
    """Pieces of motion (speed, acceleration, poses, ms between them) and single poses that are anything."""
    node, sent = controller
    sent.clear()
    stamp, surge = 10**9, 0.0

    def pose() -> None:
        message = PoseStamped()
        message.header.stamp = stamp_of(stamp)
        message.pose.position.x = surge
        node._take_pose(message)

    with no_hang():
        node._begin()
        for piece in pieces:
            if len(piece) == 2:
                stamp, surge = piece
                pose()
                continue
            speed, acceleration, count, period = piece
            for _ in range(count):
                stamp += period * 10**6
                surge += 1e-3 * period * speed
                speed += 1e-3 * period * acceleration
                if stamp >= 2**31 * 10**9 or not math.isfinite(surge):
                    break
                pose()
        node._diagnose()
    for message in sent:
        if isinstance(message, PointStamped):
            assert message.point.x >= 0 and message.point.x == int(message.point.x)
            assert abs(message.point.y) <= node._options["max_current"]
            assert nanoseconds_of(message.header.stamp) >= 0
