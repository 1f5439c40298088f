# SPDX-License-Identifier: Apache-2.0
"""`make demo`: a run over real DDS, recorded; then comparison and diagnosis of the sample campaign."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from .core.errors import InputError
from .data.bags import read_bag
from .nodes.domain import claim_domain
from .nodes.ending import NO_ORPHAN

SAMPLE = Path(__file__).resolve().parent.parent / "examples" / "sample_campaign"
SECONDS = 6.0
LOCKSTEP = ("-p", "lockstep:=true")  # the same on a busy machine, where real time would be missed
PATIENCE = 600.0  # s; the first start compiles the model, which takes minutes where others use the machine
LEAVE = 30.0  # s after Ctrl-C; a node needs less than 15, whatever the middleware does


def main() -> int:
    report = Path("report", "demo")
    shutil.rmtree(report, ignore_errors=True)  # of an earlier demo
    report.mkdir(parents=True)
    try:
        print(f"1. ROS 2: sim, track_controller and record, three processes in lockstep, {SECONDS:g} s", flush=True)
        print(f"   {record(report / 'run')}\n{report / 'run' / 'bag'}")
        print("2. Where the paper's model fails to predict the sample campaign", flush=True)
        inductrack("compare", SAMPLE, "--output", report / "compare")
        print("3. Which effects are missing", flush=True)
        inductrack("diagnose", SAMPLE, "--output", report / "diagnose")
    except (subprocess.CalledProcessError, TimeoutError, InputError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def record(folder: Path) -> str:
    """Record a run of simulator and controller; says in a line what it shows."""
    folder.mkdir()
    with claim_domain(), (folder / "nodes.log").open("w", encoding="utf-8") as log:
        nodes = [
            node("record", log, "--output", folder / "bag", "--duration", SECONDS, "--stamp", "header"),
            node("track_controller", log, "--ros-args", "-p", "mode:=speed", *LOCKSTEP),
            node(
                "sim",
                log,
                "--ros-args",
                "-p",
                "drive:=pulses",
                "-p",
                "initial_state:=surge_rate=15.0",
                "-p",
                "listeners:=2",
                *LOCKSTEP,
            ),
        ]
        try:
            recorded(*nodes, log=folder / "nodes.log")
        finally:
            end(nodes)
    truth = {"pose": "/inductrack/pose", "twist": "/inductrack/twist"}
    run = read_bag(folder / "bag", {**truth, **dict.fromkeys(("imu", "gap_top", "gap_right", "gap_left"))})
    speed = run.values[:, run.channels.index("surge_rate")]
    speed = speed[(run.times > 0.5 * run.times[-1]) & np.isfinite(speed)]
    fired = len(run.pulses.times) if run.pulses else 0
    return (
        f"{run.times[-1]:.1f} simulated seconds, {fired} drive pulses fired; "
        f"the unstable 15 m/s held at {speed.mean():.2f} ± {speed.std():.2f} m/s"
    )


def recorded(recorder: subprocess.Popen, *others: subprocess.Popen, log: Path) -> None:
    """Wait for the end of the recording. Raises `InputError` where a node fails, `TimeoutError` after `PATIENCE`."""
    until = time.monotonic() + PATIENCE
    while (status := recorder.poll()) is None:
        if any(process.poll() is not None for process in others):
            raise InputError(f"a node ended before the recording; see {log}")
        if time.monotonic() > until:
            raise TimeoutError(f"the recording has not ended in {PATIENCE:g} s; see {log}")
        time.sleep(0.05)
    if status:
        raise InputError(f"the recording failed with status {status}; see {log}")


def end(processes: list[subprocess.Popen]) -> None:
    """Ctrl-C for each; what does not end by itself is killed, for the bag is complete once the recorder has ended."""
    for process in processes:
        process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(LEAVE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def node(name: str, log: object, *options: object) -> subprocess.Popen:
    command = [*NO_ORPHAN.split(), sys.executable, "-m", "inductrack_ros.nodes.start", name, *map(str, options)]
    return subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | {"PYTHONUNBUFFERED": "1"})


def inductrack(*words: object) -> None:
    """Run the command line as a user would."""
    command = [sys.executable, "-m", "inductrack_ros.cli", *map(str, words)]
    print("   inductrack " + " ".join(map(str, words)), flush=True)
    subprocess.run(command, check=True)


if __name__ == "__main__":
    sys.exit(main())
