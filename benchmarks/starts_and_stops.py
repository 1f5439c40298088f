# SPDX-License-Identifier: Apache-2.0
"""Start and stop every node many times under load: how many end clean?

    python benchmarks/starts_and_stops.py [--times 200] [--load 4] [--seed 0]

Each start gets one of SIGINT, SIGTERM, SIGINT twice (as `ros2 launch` sends it) or SIGINT over and over, at a random
moment after its first log line; `--load` processes spin meanwhile. `record` records what a simulator publishes, so its
bag must be whole. Clean is: status 0, no traceback, ended within `LIMIT` seconds in which
it had a processor or slept. Ctrl-C or SIGTERM: what was seen so far is told. Ends with
status 1 where one did not end clean."""

from __future__ import annotations

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from rosbags.rosbag2 import Reader

from inductrack_ros.core.state import STATES
from inductrack_ros.data import write_bag
from inductrack_ros.nodes.domain import claim_domain
from inductrack_ros.nodes.ending import NO_ORPHAN

LIMIT = 20.0  # s from the signal to the end, without those in which others had the processor that it could have used
LONGEST = 20 * LIMIT  # s, whatever the machine does
SIGNALS = {
    "INT": [signal.SIGINT],
    "TERM": [signal.SIGTERM],
    "INT INT": [signal.SIGINT] * 2,
    "INT …": [signal.SIGINT] * 2000,
}
NODES = ("sim", "track_controller", "monitor", "record", "play")
BIN = Path(sys.executable).parent
SPIN = "while True: pass"


def start(log: Path, name: str, *options: object) -> subprocess.Popen:
    with log.open("w") as file:
        return subprocess.Popen([*NO_ORPHAN.split(), BIN / name, *map(str, options)], stdout=file, stderr=file)


def stop(process: subprocess.Popen, signals: list[signal.Signals]) -> int | None:
    """The status; None for a process that had to be killed."""
    for number in signals:
        if process.poll() is not None:
            break
        process.send_signal(number)
        time.sleep(0.001 if len(signals) > 2 else 0.05)
    begin, passed = time.monotonic(), 0.0
    without = kept_waiting(process.pid)
    while (status := process.poll()) is None:
        passed = time.monotonic() - begin
        if passed - (kept_waiting(process.pid) - without) > LIMIT or passed > LONGEST:
            process.kill()
            process.wait()
            return None
        time.sleep(0.01)
    return status


def kept_waiting(pid: int) -> float:
    """Seconds for which a process's first thread, which ends it, could have run and got no processor (Linux tells)."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except (OSError, IndexError):  # another system; or it has just ended
        return 0.0


def once(name: str, options: list, folder: Path, chance: random.Random) -> str:
    """Start the node and stop it; "clean" or what was wrong."""
    log = folder / "log"
    process = start(log, name, *options)
    try:
        while "[INFO]" not in log.read_text():
            if process.poll() is not None:
                return f"ended at its start: {log.read_text().strip()[-200:]}"
            time.sleep(0.01)
        time.sleep(chance.uniform(0.0, 0.5))
        how = chance.choice([*SIGNALS])
        begin = time.monotonic()
        status = stop(process, SIGNALS[how])
    finally:
        process.kill()  # one that has not ended: the script was broken off
    if status != 0 or "Traceback" in log.read_text():
        what = f"killed after {LIMIT:g} s" if status is None else f"status {status}"
        return f"{how}: {what}: {log.read_text().strip()[-200:]}"
    print(f"{name:17s} {how:8s} {time.monotonic() - begin:5.2f} s", end="\r", flush=True)
    return "clean"


def record(folder: Path, chance: random.Random) -> str:
    bag = folder / "bag"
    shutil.rmtree(bag, ignore_errors=True)
    said = once("record", ["-o", bag], folder, chance)
    if said == "clean":
        told = (folder / "log").read_text()
        with Reader(bag) as reader:
            count = reader.message_count
        return "clean" if f" {count} messages on" in told else f"{count} messages in the bag: {told.strip()[-200:]}"
    return said


def attempt(name: str, folder: Path, chance: random.Random) -> str:
    """Start one node and stop it; "clean" or what was wrong."""
    if name == "record":
        return record(folder, chance)
    options = {"sim": ["--ros-args", "-r", "__ns:=/other"], "play": [folder / "played", "--listeners", "99"]}
    return once(name, options.get(name, []), folder, chance)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n\n")[0])
    parser.add_argument("--times", type=int, default=200, help="of each node (default: 200)")
    parser.add_argument("--load", type=int, default=4, help="processes that spin meanwhile (default: 4)")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    chance, folder = random.Random(given.seed), Path(tempfile.mkdtemp(prefix="inductrack_starts_"))
    for number in (signal.SIGINT, signal.SIGTERM):  # in the background a shell has the first ignored
        signal.signal(number, signal.default_int_handler)
    domain = claim_domain()  # held until the end
    spinning = [subprocess.Popen([*NO_ORPHAN.split(), sys.executable, "-c", SPIN]) for _ in range(given.load)]
    beside = start(folder / "beside", "sim", "--ros-args", "-r", "__node:=beside")
    found: dict[str, Counter] = {name: Counter() for name in NODES}
    try:
        write_bag(folder / "played", [0.0, 1.0], {channel: [0.0, 1.0] for channel in STATES})
        for _ in range(given.times):  # one node after the other, so that a run that is broken off tells of all
            for name in NODES:
                found[name][attempt(name, folder, chance)] += 1
    except KeyboardInterrupt:
        print("broken off")
    finally:
        for process in (beside, *spinning):
            process.kill()
        domain.close()
        shutil.rmtree(folder)
    for name, seen in found.items():
        print(f"{name:17s} {seen['clean']} of {seen.total()} clean")
        for wrong, count in seen.items():
            if wrong != "clean":
                print(f"    {count} × {wrong}")
    return int(any(seen["clean"] < given.times for seen in found.values()))


if __name__ == "__main__":
    sys.exit(main())
