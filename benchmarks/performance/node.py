# SPDX-License-Identifier: Apache-2.0
"""4. The node: processor share and period jitter at 1 kHz, the fastest speed factor, and the time to the first message.

The limit is an rclpy timer that publishes an empty pose. Listener and nodes share the machine, so jitter is that of all
three; both are heard by the same listener.
"""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from inductrack_ros.nodes.domain import claim_domain
from inductrack_ros.nodes.ending import NO_ORPHAN

RATE = 1000
TOPIC = "/inductrack/pose"
EMPTY = Path(__file__).with_name("empty_node.py")
SIM = Path(sys.executable).with_name("sim")
PATIENCE = 180.0


class Node:
    """A node in a process of its own, heard by ours."""

    def __init__(self, listener, *command: object, **environment: str):
        self.listener = listener
        listener.take(1.0)  # what an earlier node sent
        listener.heard.clear()
        self.began = time.monotonic()
        self.process = subprocess.Popen(
            [*NO_ORPHAN.split(), *map(str, command)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | environment,
        )

    def __enter__(self) -> Node:
        while not self.listener.heard:
            if time.monotonic() - self.began > PATIENCE or self.process.poll() is not None:
                raise TimeoutError(f"{self.process.args} was not heard")
            self.listener.take(0.1)
        self.first = self.listener.heard[0][0] - self.began
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(PATIENCE)

    def processor(self) -> float:
        """Processor time so far (s)."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def watch(self, seconds: float) -> dict[str, float]:
        """What it takes and how even it is, over ``seconds`` of real time after two of settling."""
        self.listener.take(2.0)
        self.listener.heard.clear()
        began, used = time.monotonic(), self.processor()
        self.listener.take(seconds)
        while len(self.listener.heard) < 3 and time.monotonic() - began < PATIENCE:
            self.listener.take(1.0)
        lasted = time.monotonic() - began
        arrived, stamps = np.array(self.listener.heard).T
        gaps = np.diff(arrived)
        return {
            "processor": (self.processor() - used) / lasted,
            "messages_per_second": len(arrived) / lasted,
            "jitter_ms": 1e3 * float(np.percentile(np.abs(gaps - 1 / RATE), 50)),
            "jitter_99_ms": 1e3 * float(np.percentile(np.abs(gaps - 1 / RATE), 99)),
            "simulated_per_second": float(stamps[-1] - stamps[0]) / (arrived[-1] - arrived[0]),
        }


class Listener:
    """Hears poses: when each came and its stamp (s)."""

    def __init__(self, rclpy, node):
        from geometry_msgs.msg import PoseStamped

        self.rclpy, self.node, self.heard = rclpy, node, []
        node.create_subscription(
            PoseStamped,
            TOPIC,
            lambda m: self.heard.append((time.monotonic(), m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec)),
            1000,
        )

    def take(self, seconds: float) -> None:
        """Listen for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.rclpy.spin_once(self.node, timeout_sec=left)


def measure(quick: bool) -> dict | None:
    """Shares, jitter, speed factor and starting times; None without ROS."""
    try:
        import rclpy
    except ImportError:
        return None
    seconds = 3.0 if quick else 8.0
    with claim_domain(), tempfile.TemporaryDirectory() as cold:
        rclpy.init()
        listener = Listener(rclpy, rclpy.create_node("performance"))
        at_rate = ("--ros-args", "-p", f"rate:={RATE}")
        rows, starts = {}, {"cold": [], "warm": [], "empty": []}
        for _ in range(1 if quick else 3):
            with Node(listener, SIM, *at_rate) as node:
                starts["warm"].append(node.first)
                rows.setdefault("sim", []).append(node.watch(seconds))
            with Node(listener, sys.executable, EMPTY) as node:
                starts["empty"].append(node.first)
                rows.setdefault("empty", []).append(node.watch(seconds))
        if not quick:
            with Node(listener, SIM, *at_rate, INDUCTRACK_CACHE=cold) as node:
                starts["cold"].append(node.first)
        with Node(listener, SIM, *at_rate, "-p", "speed_factor:=1000.0") as node:
            fastest = node.watch(seconds)
        listener.node.destroy_node()
        rclpy.shutdown()
    middle = {name: {k: statistics.median(r[k] for r in many) for k in many[0]} for name, many in rows.items()}
    return {
        "rows": middle,
        "fastest": fastest,
        "first_message": {n: statistics.median(t) for n, t in starts.items() if t},
        "ratio": statistics.median(
            b["processor"] / a["processor"] for a, b in zip(rows["sim"], rows["empty"], strict=True)
        ),
    }


def table(found: dict | None) -> list[str]:
    """Markdown."""
    if found is None:
        return ["No ROS here: the node was not measured."]
    lines = [
        "| node at 1 kHz | share of a core | poses heard per second | jitter: median, 99 % (ms) |",
        "|---|---|---|---|",
    ]
    for name, r in found["rows"].items():
        label = "sim, all topics" if name == "sim" else "empty timer and publisher"
        lines.append(
            f"| {label} | {100 * r['processor']:.0f} % | {r['messages_per_second']:.0f} | {r['jitter_ms']:.2f},"
            f" {r['jitter_99_ms']:.2f} |"
        )
    first = ", ".join(f"{n} {t:.1f} s" for n, t in found["first_message"].items())
    lines += [
        "",
        (
            f"Fastest: {found['fastest']['simulated_per_second']:.2f} simulated seconds to a real one at 1 kHz. First"
            f" message after: {first}."
        ),
    ]
    return lines
