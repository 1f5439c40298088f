# SPDX-License-Identifier: Apache-2.0
"""make soak: half an hour of simulated running as fast as the machine can, recorded; is memory flat, is anything lost?

    python benchmarks/soak.py [--minutes 30] [--lockstep] [--output build/soak.json]

`sim` runs at the highest speed factor and `record` takes every topic, or with --lockstep `track_controller` runs as
well and simulated time waits for it. The bag is then read: every tick of every topic must be in it. Ends with status 1
where a message is missing or memory grew.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader

from inductrack_ros.core.options import SIM
from inductrack_ros.nodes.domain import claim_domain
from inductrack_ros.nodes.ending import NO_ORPHAN
from inductrack_ros.nodes.record import stamp_ns

SAMPLE = 2.0  # s between looks at the memory
ALLOWED = 5.0  # MB that a process may grow after the first quarter: allocators breathe
PERIODIC = {"pose": 500.0, "twist": 500.0, "measured/pose": 500.0, "measured/twist": 500.0, "measured/imu": 100.0,
            "odometry": 50.0, "wrench/total": 50.0}  # fmt: skip


def memory(process: subprocess.Popen) -> float:
    """Resident memory (MB)."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


class Watch:
    """Listens to the simulator's diagnostics: how far simulated time is, and its counters."""

    def __init__(self) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from std_srvs.srv import SetBool

        rclpy.init()
        self._rclpy, self._pause_type = rclpy, SetBool
        self.node = rclpy.create_node("soak")
        self.values: dict[str, str] = {}
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)

    def _take(self, message) -> None:
        for status in message.status:
            if status.name.startswith("/inductrack/sim"):
                self.values = {v.key: v.value for v in status.values}

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._rclpy.spin_once(self.node, timeout_sec=0.1)

    def pause(self, stand: bool) -> None:
        client = self.node.create_client(self._pause_type, "/inductrack/sim/pause")
        client.wait_for_service()
        self._rclpy.spin_until_future_complete(self.node, client.call_async(self._pause_type.Request(data=stand)))

    @property
    def simulated(self) -> float:
        return float(self.values.get("simulated time (s)", 0.0))


def run(minutes: float, lockstep: bool, folder: Path) -> tuple[dict, Path]:
    """Start the nodes, let them run, end them; what was seen, and the bag."""
    bin_folder = Path(sys.executable).parent
    fastest = SIM["speed_factor"].high
    options = [f"speed_factor:={fastest}", "publish_clock:=true", "paused:=true", f"lockstep:={str(lockstep).lower()}"]
    if lockstep:
        options += ["drive:=pulses", "initial_state:='surge_rate=15.0'", "track_length:=100000.0"]
    bag = folder / "bag"
    commands = {
        "sim": ["sim", "--ros-args", *(w for o in options for w in ("-p", o))],
        "record": ["record", "-o", str(bag)],
    }
    if lockstep:
        commands["track_controller"] = ["track_controller", "--ros-args", "-p", "lockstep:=true", "-p", "mode:=speed"]
    with (folder / "log").open("w") as log:
        processes = {
            name: subprocess.Popen([*NO_ORPHAN.split(), bin_folder / words[0], *words[1:]], stdout=log, stderr=log)
            for name, words in commands.items()
        }
        try:
            watch, samples = Watch(), defaultdict(list)
            heard_by = watch.node.count_subscribers
            while not all(heard_by(f"/inductrack/{topic}") for topic in PERIODIC):
                watch.spin(0.1)
            watch.spin(2.0)  # the last of the connections
            watch.pause(False)
            begin = time.monotonic()
            while watch.simulated < 60 * minutes:
                watch.spin(SAMPLE)
                for name, process in processes.items():
                    if process.poll() is not None:
                        raise SystemExit(f"{name} ended with {process.returncode}; see {folder / 'log'}")
                    samples[name].append(memory(process))
            real = time.monotonic() - begin
            watch.pause(True)
            watch.spin(2.0)
        finally:
            for process in processes.values():
                process.send_signal(signal.SIGINT)
            for process in processes.values():
                process.wait(600)
    quarter = {name: len(values) // 4 for name, values in samples.items()}
    return {
        "simulated_s": watch.simulated,
        "real_s": round(real, 1),
        "memory_MB": {
            n: {"after a quarter": round(v[quarter[n]], 1), "most after that": round(max(v[quarter[n] :]), 1)}
            for n, v in samples.items()
        },
        "diagnostics": watch.values,
    }, bag


def missing(bag: Path) -> dict[str, dict[str, int]]:
    """Messages in the bag and messages missing between the first and the last, for each topic that has a period."""
    topics = {f"/inductrack/{name}": rate for name, rate in PERIODIC.items()}
    stamps: dict[str, list[int]] = defaultdict(list)
    with Reader(bag) as reader:
        wanted = [c for c in reader.connections if c.topic in topics]
        for connection, _, raw in reader.messages(wanted):
            stamps[connection.topic].append(stamp_ns(raw))
    found = {}
    for topic, times in stamps.items():
        steps = np.rint(np.diff(np.unique(times)) * topics[topic] / 1e9).astype(int)
        found[topic] = {"recorded": len(times), "missing": int((steps - 1).sum())}
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0, help="simulated minutes (default: 30)")
    parser.add_argument("--lockstep", action="store_true", help="with track_controller, in lockstep")
    parser.add_argument("--output", type=Path, default=Path("build/soak.json"))
    given = parser.parse_args()
    domain = claim_domain()  # held until the end
    folder = Path(tempfile.mkdtemp(prefix="inductrack_soak_"))
    result, bag = run(given.minutes, given.lockstep, folder)
    result["topics"] = missing(bag)
    result["bag_MB"] = round(sum(f.stat().st_size for f in bag.iterdir()) / 1e6)
    shutil.rmtree(folder)
    domain.close()
    given.output.parent.mkdir(parents=True, exist_ok=True)
    given.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=1))
    lost = sum(t["missing"] for t in result["topics"].values()) + len(PERIODIC) - len(result["topics"])
    grown = max(m["most after that"] - m["after a quarter"] for m in result["memory_MB"].values())
    print(f"{lost} messages lost; memory grew by {grown:.1f} MB at most after the first quarter")
    return int(lost > 0 or grown > ALLOWED)


if __name__ == "__main__":
    sys.exit(main())
