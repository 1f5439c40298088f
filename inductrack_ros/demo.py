"""`make demo`: a run over real DDS, recorded and compared with the model; then a diagnosis of the sample campaign."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml

from .nodes.domain import claim_domain

SAMPLE = Path(__file__).resolve().parent.parent / "examples" / "sample_campaign"
SECONDS = 6.0
PATIENCE = 120.0  # s; the first start compiles the model


def main() -> int:
    report = Path("report")
    shutil.rmtree(report / "demo", ignore_errors=True)
    run = report / "demo" / "run"
    run.mkdir(parents=True)
    try:
        print(f"1. sim and track_controller hold 15 m/s over DDS for {SECONDS:g} s, record writes {run}/bag")
        record(run)
        print("2. inductrack compare: the recorded run against the model")
        inductrack("compare", run, "--output", report / "demo" / "compare")
        print("3. inductrack diagnose: a sample campaign, simulated elsewhere with something hidden in it")
        inductrack("diagnose", SAMPLE, "--output", report / "demo" / "diagnose")
    except (subprocess.CalledProcessError, TimeoutError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    for what in ("compare", "diagnose"):
        print(f"Report: {(report / 'demo' / what / 'report.html').resolve()}")
    return 0


def record(folder: Path) -> None:
    """Record a run of simulator and controller, and describe it as a campaign."""
    with claim_domain():
        log = (folder / "nodes.log").open("w")
        nodes = [
            node("record", log, "--output", folder / "bag", "--duration", SECONDS),
            node("track_controller", log, "--ros-args", "-p", "mode:=speed"),
            node("sim", log, "--ros-args", "-p", "drive:=pulses", "-p", "initial_state:=surge_rate=15.0"),
        ]
        try:
            end = time.monotonic() + PATIENCE
            while nodes[0].poll() is None and time.monotonic() < end:
                time.sleep(0.1)
            if nodes[0].returncode != 0:
                raise TimeoutError(f"nothing was recorded; see {folder / 'nodes.log'}")
        finally:
            for process in nodes:
                process.send_signal(signal.SIGINT)
            for process in nodes:
                process.wait(20)
            log.close()
    (folder / "model.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": {"drive": "pulses"}}}))
    campaign = {"name": "demo run", "model": "model.yaml", "runs": [{"file": "bag", "drive_current": 7000.0}]}
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign, sort_keys=False))


def node(name: str, log: object, *options: object) -> subprocess.Popen:
    command = [sys.executable, "-m", f"inductrack_ros.nodes.{name}", *map(str, options)]
    return subprocess.Popen(command, stdout=log, stderr=log, env=os.environ | {"PYTHONUNBUFFERED": "1"})


def inductrack(*words: object) -> None:
    """Run the command line as a user would."""
    command = [sys.executable, "-m", "inductrack_ros.cli", *map(str, words)]
    print("   inductrack " + " ".join(map(str, words)), flush=True)
    subprocess.run(command, check=True)


if __name__ == "__main__":
    sys.exit(main())
