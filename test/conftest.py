# SPDX-License-Identifier: Apache-2.0
"""Real nodes in real processes over real DDS: fixtures that start them, listen, and end them. The model and the runs
that several files look at."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import scipy.linalg  # noqa: F401  its BLAS must be there to be limited
from collection_guard import missing
from hypothesis import settings
from rosbags.rosbag2 import Reader
from threadpoolctl import threadpool_limits

from inductrack_ros.core.model import Model
from inductrack_ros.data import Campaign
from inductrack_ros.nodes.domain import claim_domain
from inductrack_ros.nodes.ending import NO_ORPHAN

_domain = claim_domain()  # before any import of rclpy reads the environment; held until the tests end
_logs = tempfile.TemporaryDirectory(prefix="inductrack_ros_log_", ignore_cleanup_errors=True)
os.environ["ROS_LOG_DIR"] = _logs.name
os.environ["PYTHONUNBUFFERED"] = "1"
# As the diagnosis itself does: where another worker has the second core its threads only spin.
threadpool_limits(1, "blas")
# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("busy", deadline=None)  # a machine may be busy with something else
settings.load_profile("busy")
NIGHTLY = settings(max_examples=2500)
settings.register_profile("nightly", NIGHTLY)  # `make fuzz`; test_fuzz.py says how much more that is

#: Where `inductrack`, `sim` and the others are: beside Python (pip), or in the package's own folder (colcon).
_INSTALLED = [Path(p, "lib", "inductrack_ros") for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
BIN = next((folder for folder in (Path(sys.executable).parent, *_INSTALLED) if (folder / "inductrack").exists()), None)
if BIN is None:
    raise pytest.UsageError(
        "inductrack_ros is not installed: `make setup`, or `colcon build` and its setup file, comes first"
    )


def pytest_addoption(parser: pytest.Parser) -> None:
    """``--nightly``: the tests that take minutes too."""
    parser.addoption("--nightly", action="store_true", help="run the tests marked nightly too (`make nightly`)")


@pytest.hookimpl(tryfirst=True)  # before any are deselected
def pytest_collection_modifyitems(session: pytest.Session, items: list[pytest.Item]) -> None:
    """All tests are there; the longest come first, and those that take minutes are run only when asked for."""
    lost = missing(session.config, items)
    if lost and not session.testsfailed:
        raise pytest.UsageError(f"{len(lost)} tests are written but were not collected, {lost[0]} for one")
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    for item in items:
        if item.get_closest_marker("nightly") and not session.config.getoption("--nightly"):
            item.add_marker(pytest.mark.skip(reason="takes minutes: make nightly"))


def pytest_unconfigure() -> None:
    """What ROS 2 logged is not left behind."""
    _logs.cleanup()


ANSWER = 5.0  # s without an answer after which it is asked again whether the way back is open
PATIENCE = 120.0  # s; how long a condition is awaited on a busy machine before a test fails
LEAVE = 10.0  # s that what a test has left running gets to end by itself
LONG = 600.0  # s; the same for the end of long work: a diagnosis, a command that compiles, a cluster


def wait_until(
    condition: Callable[[], object],
    what: str,
    while_waiting: Callable[[], None] | None = None,
    patience: float = PATIENCE,
) -> object:
    """Return the condition's first true value, or fail the test saying what did not happen."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        if while_waiting:
            while_waiting()
        else:
            time.sleep(0.01)
    pytest.fail(f"waited {patience:g} s in vain: {what}")


@contextlib.contextmanager
def bounded(what: str, seconds: float) -> Iterator[None]:
    """Fail the test where the block, which may wait without an end, takes longer; in the main thread."""

    def late(*_: object) -> None:
        pytest.fail(f"waited {seconds:g} s in vain: {what}")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds, 10.0)  # again, for what waits while the first is on its way out
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def counted(heard: list, so: Callable[[object], bool]) -> Callable[[], int]:
    """How many of what a list gains from here on are so. Each is looked at once: a node publishes faster than a list
    that grows can be looked through for each message."""
    looked, found = len(heard), 0

    def count() -> int:
        nonlocal looked, found
        new = heard[looked:]
        looked, found = looked + len(new), found + sum(map(so, new))
        return found

    return count


def newest_in(bag: Path) -> dict[str, int]:
    """The newest header stamp (ns) of each topic in a bag, also while it is recorded."""
    from inductrack_ros.nodes.record import stamp_ns

    with Reader(bag) as reader:
        return {connection.topic: stamp_ns(raw) for connection, _, raw in reader.messages()}


class Process:
    """One node in a process of its own, which ends with who runs the tests. Signals go to it and to all that it
    started, as from a terminal."""

    def __init__(self, what: str, *args: str, folder: Path) -> None:
        number = len(list(folder.glob("*.log")))
        self._log = folder / f"{number:02d}_{Path(what).stem}.log"
        # A node as a user starts it, or a file.
        command = [sys.executable, what] if what.endswith(".py") else [str(BIN / what)]
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                [*NO_ORPHAN.split(), *command, *args],
                stdout=log,
                stderr=subprocess.STDOUT,
                cwd=folder,
                start_new_session=True,
            )

    @property
    def output(self) -> str:
        return self._log.read_text()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def minds_signals(self) -> bool:
        """Whether it has a handler for SIGTERM (Linux tells in /proc)."""
        caught = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{self._process.pid}/status").read_text())
        return bool(int(caught.group(1), 16) >> (signal.SIGTERM - 1) & 1)

    def wait_for(self, text: str) -> None:
        wait_until(lambda: text in self.output or not self.running, f"{text!r} in the output")
        assert text in self.output, self.output

    def send(self, number: signal.Signals) -> None:
        if self.running:
            os.killpg(self.pid, number)

    def wait(self, meanwhile: Callable[[], None] | None = None) -> int:
        """The exit status, once it ends by itself; ``meanwhile`` is called over and over until then."""
        wait_until(lambda: not self.running, f"the end of {self._log.stem}", meanwhile)
        return self._process.wait()

    def stop(self, number: signal.Signals = signal.SIGINT) -> int:
        """End it as a user would; a traceback fails the test."""
        self.send(number)
        status = self.wait()
        assert "Traceback" not in self.output, self.output
        return status

    def kill(self) -> None:
        self.send(signal.SIGKILL)
        self._process.wait()


class Ros:
    """A node of the test's own, and the processes it talks to."""

    def __init__(self, folder: Path) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.folder = folder
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = rclpy.create_node("tester", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._processes: list[Process] = []
        self._subscriptions: list = []
        self._clients: dict = {}  # by service, whose way back is open

    def start(self, what: str, *args: str) -> Process:
        """Run the node of that name, or a Python file."""
        for client in self._clients.values():  # it may be the node of the same name once more
            self.node.destroy_client(client)
        self._clients.clear()
        process = Process(what, *args, folder=self.folder)
        self._processes.append(process)
        return process

    def spin(self, seconds: float = 0.02) -> None:
        self._executor.spin_once(timeout_sec=seconds)

    def wait(self, condition: Callable[[], object], what: str) -> object:
        """Spin until the condition holds."""
        return wait_until(condition, what, self.spin)

    def listen(self, kind: type, topic: str) -> list:
        """A list that grows with what is published from now on."""
        heard: list = []
        self._subscriptions.append(self.node.create_subscription(kind, topic, heard.append, 10000))
        return heard

    def connect(self, *nodes: str) -> None:
        """From here on all is heard that these nodes publish on the topics that are listened to, and they hear all that
        is published here.

        DDS connects the two ends of a topic one after the other. This end tells; what the other end has done an answer
        to a request that was made later shows, as a node learns of our readers and writers in their order.
        """
        self.wait(
            lambda: all(s.get_publisher_count() for s in self._subscriptions), "publishers of all that is listened to"
        )
        for node in nodes:
            self._open(node)

    def publisher(self, kind: type, topic: str):
        """A publisher that somebody listens to already."""
        publisher = self.node.create_publisher(kind, topic, 1000)
        self.wait(publisher.get_subscription_count, f"somebody who listens to {topic}")
        return publisher

    def call(self, kind: type, name: str, **fields: object):
        """The answer of a service, which is asked once.

        Fast DDS drops an answer whose way to the client is not open 0.1 s after the question came ("client will not
        receive response"), and does not tell the client. So the way is opened first.
        """
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self.node.create_client(kind, name)
            self.wait(client.service_is_ready, f"service {name}")
            self._open(name.rpartition("/")[0])
        future = client.call_async(kind.Request(**fields))
        self.wait(future.done, f"an answer of {name}")
        return future.result()

    def step_on(self, simulator: str) -> None:
        """Let a paused simulator run for a few ticks, however busy the machine is: both requests are on their way
        before it looks at the first."""
        from std_srvs.srv import SetBool

        client = self._clients[f"{simulator}/pause"]
        asked = [client.call_async(SetBool.Request(data=paused)) for paused in (False, True)]
        self.wait(lambda: all(future.done() for future in asked), "a pause")

    def _open(self, node: str) -> None:
        """Wait until the node knows all our readers and writers: it answers a client that is younger than they are.

        That may be asked again, for nothing comes of it.
        """
        from rcl_interfaces.srv import GetParameters

        client = self.node.create_client(GetParameters, f"{node}/get_parameters")
        self.wait(client.service_is_ready, f"node {node}")
        asked: list = []
        again = 0.0

        def answered() -> bool:
            nonlocal again
            if time.monotonic() >= again:
                asked.append(client.call_async(GetParameters.Request()))
                again = time.monotonic() + ANSWER
            return any(future.done() for future in asked)

        self.wait(answered, f"an answer of {node}")
        self.node.destroy_client(client)

    def set_parameter(self, node: str, name: str, value: object):
        """Set one parameter of another node; returns the result with `successful` and `reason`."""
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        message = Parameter(name, value=value).to_parameter_msg()
        return self.call(SetParameters, f"{node}/set_parameters", parameters=[message]).results[0]

    def close(self) -> None:
        """End what still runs, as a user would: one that is killed leaves half a megabyte of shared memory behind."""
        running = [process for process in self._processes if process.running]
        for process in running:
            process.send(signal.SIGTERM)
            process.send(signal.SIGCONT)
        end = time.monotonic() + LEAVE
        while any(process.running for process in running) and time.monotonic() < end:
            time.sleep(0.01)
        for process in running:
            process.kill()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Ros]:
    """A fresh node for one test; what the test started is ended with it."""
    world = Ros(tmp_path)
    yield world
    world.close()


@pytest.fixture
def figure() -> Callable[[str, object], None]:
    """Say a measured figure; `make faults` shows them, docs/robustness.md quotes them."""
    return lambda name, value: print(f"\nfigure: {name}: {value}")


@pytest.fixture(scope="session")
def model() -> Model:
    """The package's own model; a file may have another."""
    return Model.default()


@pytest.fixture(scope="session")
def pose() -> Campaign:
    """Three runs of that model with white noise, as the looks at the data take them."""
    from test_checks import measured  # once pytest has rewritten its assertions

    return measured()
