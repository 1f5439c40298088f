# SPDX-License-Identifier: Apache-2.0
"""Nodes end within seconds of a signal, with the status they earned, whatever the middleware and whoever sends signals
do."""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import BIN, PATIENCE, wait_until
from rosbags.rosbag2 import Reader

from inductrack_ros.nodes.ending import HELD_BACK, NO_ORPHAN

#: A node whose middleware hangs for ever where it is told to, inside C and with the interpreter's lock held or not.
HANGS = """
import ctypes, sys
from rclpy.node import Node
from rclpy.executors import SingleThreadedExecutor
from inductrack_ros.nodes import ending, start

where, lock, name = sys.argv[1:4]
libc = ctypes.PyDLL(None) if lock == "held" else ctypes.CDLL(None)
def hang(*_):
    while True:
        libc.pause()
if where == "destroy":
    Node.destroy_node = hang
else:
    ending.PATIENCE = 1.0
    spin = SingleThreadedExecutor.spin_once
    def once(self, timeout_sec):
        spin(self, timeout_sec)
        print("hangs", flush=True)
        libc.sigfillset(mask := (ctypes.c_byte * 128)())  # no signal ends this pause
        libc.ppoll(None, 0, None, mask)
    SingleThreadedExecutor.spin_once = once
sys.argv = [name, *sys.argv[4:]]
print("what it printed last", end="")
getattr(start, name)()
"""


@pytest.fixture
def hanging(ros):
    def begin(where: str, lock: str, name: str, *options: str):
        script = ros.folder / "hangs.py"
        script.write_text(HANGS)
        return ros.start(str(script), where, lock, name, *options)

    return begin


@pytest.mark.parametrize("node, lock", [("track_controller", "held"), ("sim", "free")])
def test_a_middleware_that_does_not_let_go_is_left_behind(hanging, node, lock):
    process = hanging("destroy", lock, node)
    process.wait_for("[INFO]")
    process.send(signal.SIGINT)
    assert process.wait() == 0
    assert "what it printed last" in process.output and "Traceback" not in process.output


def count_in(bag: Path) -> int:
    """Messages that a reader finds, also while it is recorded."""
    with Reader(bag) as reader:
        return reader.message_count


def test_a_bag_is_complete_before_the_middleware_is_asked_to_let_go(ros, hanging):
    recorder = hanging("destroy", "held", "record", "-o", "bag")
    sim = ros.start("sim", "--ros-args", "-p", "listeners:=1")
    folder = ros.folder / "bag"
    ros.wait(lambda: (folder / "metadata.yaml").exists() and count_in(folder) > 100, "something in the bag")
    recorder.send(signal.SIGTERM)
    assert recorder.wait() == 0
    assert f"{count_in(folder)} messages on" in recorder.output
    assert sim.stop() == 0


SIGNALLED = """
import os, signal, sys
from inductrack_ros.nodes import record, start

made = record.Recorder.__init__
def init(self, options):
    made(self, options)
    os.kill(os.getpid(), signal.SIGINT)
record.Recorder.__init__ = init
sys.argv = ["record", "-o", "bag"]
start.record()
"""


def test_a_bag_is_closed_when_the_signal_comes_before_the_first_message(ros):
    """Between the recorder's first line and its loop, which a busy machine makes long."""
    script = ros.folder / "signalled.py"
    script.write_text(SIGNALLED)
    recorder = ros.start(str(script))
    assert recorder.wait() == 0 and "0 messages on 0 topics" in recorder.output, recorder.output
    assert count_in(ros.folder / "bag") == 0


def test_a_middleware_that_does_not_answer_is_left_behind_too(hanging):
    process = hanging("spin", "free", "track_controller")
    process.wait_for("hangs")
    process.send(signal.SIGINT)
    assert process.wait() == 1 and "has not answered" in process.output


def holds_back(pid: int, number: signal.Signals) -> bool:
    """Whether the process has the signal blocked (Linux tells in /proc)."""
    blocked = re.search(r"SigBlk:\s*(\w+)", Path(f"/proc/{pid}/status").read_text())
    return bool(int(blocked.group(1), 16) >> (number - 1) & 1)


#: What Python runs while it starts: here it stands until somebody opens the gate, a pipe.
GATE = "open({!r}).read()"


@pytest.mark.parametrize("node", ["sim", "record", "monitor"])
def test_ctrl_c_while_python_itself_starts_is_held_back(tmp_path, monkeypatch, node):
    """What the launch file puts before a node: else the interpreter dies of it, with a traceback or with −2."""
    gate = tmp_path / "gate"
    os.mkfifo(gate)
    (tmp_path / "sitecustomize.py").write_text(GATE.format(str(gate)))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    process = subprocess.Popen(
        [*HELD_BACK.split(), BIN / node], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    wait_until(lambda: holds_back(process.pid, signal.SIGINT), "a signal that is held back")
    process.send_signal(signal.SIGINT)
    wait_until(lambda: opened(gate), "a start that gets to the gate")
    said, _ = process.communicate(timeout=PATIENCE)
    assert (process.returncode, said) == (0, "")


def opened(gate: Path) -> bool:
    """Open the gate for who stands there, if somebody does."""
    try:
        os.close(os.open(gate, os.O_WRONLY | os.O_NONBLOCK))
    except OSError as error:
        assert error.errno == errno.ENXIO, error  # nobody reads
        return False
    return True


STARTER = (
    "import subprocess, sys; started = subprocess.Popen(sys.argv[1:]); print(started.pid, flush=True); started.wait()"
)


def is_python(process: Path) -> bool:
    """Whether setpriv has done its work and given its place to the node. While it does, the command line is empty."""
    return b"python" in (process / "cmdline").read_bytes().split(b"\0")[0]


def test_a_node_ends_with_the_process_that_started_it(tmp_path):
    """A launch or a script that is killed has no time to end what it started, which once went on for hours."""
    with (tmp_path / "log").open("w") as log:
        starter = subprocess.Popen(
            [sys.executable, "-c", STARTER, *NO_ORPHAN.split(), BIN / "sim"], stdout=subprocess.PIPE, stderr=log
        )
    node = Path("/proc", starter.stdout.readline().decode().strip())
    wait_until(lambda: is_python(node), "a node in the place of setpriv")
    starter.kill()
    starter.wait()
    starter.stdout.close()  # not read to its end: the node has it too
    wait_until(lambda: not node.exists() or ") Z " in (node / "stat").read_text(), "the end of the node")


@pytest.mark.parametrize("node", ["sim", "track_controller"])
def test_signals_without_end_change_nothing(ros, node):
    """Also those that come while the interpreter exits, which once killed one node in eight with −2."""
    process = ros.start(node)
    process.wait_for("[INFO]")
    assert process.wait(lambda: process.send(signal.SIGINT)) == 0 and "Traceback" not in process.output
