# SPDX-License-Identifier: Apache-2.0
"""`inductrack watch`: what is shown is what was published, in a terminal, in a pipe, as a list and as a table."""

from __future__ import annotations

import csv
import os
import pty
import re
import select
import signal
import subprocess

import yaml
from conftest import BIN, PATIENCE, wait_until
from rich.console import Console

from inductrack_ros import cli
from inductrack_ros.nodes.messages import flat, plain
from inductrack_ros.nodes.watch_view import View, line, screen, words_of_list

INDUCTRACK = str(BIN / "inductrack")


def as_text(view: View, width: int = 80) -> str:
    console = Console(width=width, color_system=None, force_terminal=False)
    with console.capture() as got:
        console.print(screen(view))
    return got.get()


def full_view() -> View:
    view = View("/rig", time=12.5, now=100.0)
    view.heard("truth", {"surge": 3.0, "surge_rate": 17.25, "heave": -0.0101, "gap_top": 0.0099})
    view.heard("measured", {"surge": 3.001, "gap_top": 0.01})
    view.wrenches["total"] = (1.0, 2.0, -3.5, 0.25)
    view.wrenches["missing_force"] = (-4.0, 0.1, 0.0, 0.01)
    view.wrenches["missing_force_sigma"] = (0.5, 0.2, 0.0, 0.02)
    view.diagnosed("/rig/sim: simulation", 0, "running", {"fired pulses": "7", "late pulses": "2", "paused": "False"})
    view.diagnosed("/rig/monitor: model", 1, "fails in surge above 20 m/s", {})
    view.diagnosed("/other/sim: simulation", 2, "out of bounds", {"late pulses": "9"})
    view.last_pulse = 12.0, -7000.0
    return view


def test_the_screen_shows_state_forces_pulses_and_the_verdict_in_newtons():
    shown = as_text(full_view())
    assert all(len(row) <= 80 for row in shown.splitlines()) and len(shown.splitlines()) <= 24
    assert re.search(r"Top gap +9\.90 +10\.00 mm", shown) and re.search(r"Surge speed +17\.250 +m/s", shown)
    assert re.search(r"total +1\.00 +2\.00 +-3\.50 +0\.25", shown)
    assert "fired pulses 7, late pulses 2, last: coil 12, -7000 A" in shown
    assert "monitor: fails in surge above 20 m/s" in shown and "out of bounds" not in shown
    assert "missing now: surge −4 ± 0.5 N (8.0 σ), sway 0.1 ± 0.2 N (0.5 σ), roll 0.01 ± 0.02 N·m (0.5 σ)" in " ".join(
        shown.split()
    )


def test_silence_is_said():
    view = full_view()
    assert "nothing new" not in as_text(view) and "silent" not in line(view)
    view.now += 10.0
    assert "nothing new for 10 s" in as_text(view)
    assert "monitor: fails in surge above 20 m/s (silent for 10 s)" in as_text(view)
    words = "nothing new since 12.500 s; monitor: fails in surge above 20 m/s, silent; sim: silent"
    assert line(view) == words
    view.now += 10.0
    assert line(view) == words  # and is printed once
    assert "Start sim" in as_text(View("/rig")) and line(View("/rig")) == "/rig: nothing is heard yet"


def test_messages_become_plain_data():
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from sensor_msgs.msg import Imu

    array = DiagnosticArray(
        status=[DiagnosticStatus(level=DiagnosticStatus.WARN, values=[KeyValue(key="a", value="1")])]
    )
    assert yaml.safe_load(yaml.safe_dump(plain(array)))["status"][0]["level"] == 1
    columns = dict(flat(plain(Imu())))
    assert columns["orientation_covariance[8]"] == 0.0 and "linear_acceleration.x" in columns
    assert words_of_list([]).startswith("no topics")


def test_options_that_do_not_go_together(capsys):
    assert cli.main(["watch", "--list", "pose"]) == 2 and cli.main(["watch", "--csv"]) == 2
    assert capsys.readouterr().err.count("\n") == 2


def test_a_running_simulator_is_seen(ros):
    """In another namespace than the usual one; a monitor judges it; piped there is no escape code."""
    apart = ["--ros-args", "-r", "__ns:=/rig"]
    flies = ["-p", "initial_state:=surge_rate=17.0", "-p", "speed_factor:=0.2"]  # for a minute
    ros.start("sim", *apart, *flies)
    ros.start("monitor", *apart)
    once = ros.start("inductrack", "watch", "twist", "-n", "rig", "--once")
    assert once.wait() == 0
    message, _ = once.output.split("---\n")
    assert yaml.safe_load(message)["header"]["frame_id"] == "track"
    live = ros.start("inductrack", "watch", "--namespace", "rig")
    table = ros.start("inductrack", "watch", "measured/pose", "--csv", "-n", "/rig")
    live.wait_for("missing surge")
    table.wait_for("header.stamp.sec")  # it may say before that nobody publishes yet

    def is_listed() -> bool:  # discovery has no end that one could wait for
        listed = ros.start("inductrack", "watch", "--list")
        assert listed.wait() == 0
        return bool(re.search(r"^/rig/measured/pose +geometry_msgs/msg/PoseStamped +1 +[1-9]", listed.output, re.M))

    wait_until(is_listed, "the list of topics")
    view = ros.start("inductrack", "watch", "--once", "-n", "rig")
    assert view.wait() == 0 and "Surge speed" in view.output and "thrust" in view.output and "sim: " in view.output
    assert live.stop() == 0 and table.stop(signal.SIGTERM) == 0
    assert "\x1b" not in live.output + view.output
    assert re.search(r"surge_rate \d+\.\d{3} m/s; gap_top", live.output)
    rows = list(csv.reader(table.output[table.output.index("header.stamp.sec") :].splitlines()))
    assert rows[0][:3] == ["header.stamp.sec", "header.stamp.nanosec", "header.frame_id"] and len(rows) > 1
    at = rows[0].index("pose.position.x")
    surges = [float(row[at]) for row in rows[1:]]
    assert len(set(surges)) == len(surges)  # it flies; past its track it begins anew


def test_ctrl_c_in_a_terminal_leaves_the_last_view(ros):
    ros.start("sim")
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [INDUCTRACK, "watch"], stdout=slave, stderr=slave, stdin=slave, env={**os.environ, "TERM": "xterm"}
    )
    os.close(slave)
    said = b""

    def ended() -> bool:
        """Read what there is; whether that was the last, which comes as an error of the terminal."""
        nonlocal said
        if not select.select([master], [], [], 0.1)[0]:
            return False
        try:
            chunk = os.read(master, 65536)
        except OSError:
            return True
        said += chunk
        return not chunk

    try:
        assert wait_until(lambda: ended() or b"Surge speed" in said, "the view") and b"Surge speed" in said, said
        process.send_signal(signal.SIGINT)
        wait_until(ended, "the end of the terminal")
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        os.close(master)
    assert b"\x1b[" in said and b"Traceback" not in said and said.rstrip().endswith(b"\x1b[?25h")  # the cursor is back
