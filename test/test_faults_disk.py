# SPDX-License-Identifier: Apache-2.0
"""The disk is full, as the kernel's limit on the size of files stands in for: what was there stays whole and
readable."""

from __future__ import annotations

import contextlib
import resource
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import wait_until
from geometry_msgs.msg import PoseStamped
from test_compare import make_campaign
from test_nodes_record import kept, numbers_in

from inductrack_ros import cli
from inductrack_ros.core.model import Model


@contextlib.contextmanager
def no_file_larger_than(size: int) -> Iterator[None]:
    """In this process."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_the_disk_fills_while_it_records(ros, tmp_path, figure):
    bag = tmp_path / "bag"
    recorder = ros.start("record", "-o", str(bag))
    publisher = ros.publisher(PoseStamped, "/inductrack/topic0")
    message, sent = PoseStamped(), 0

    def send() -> None:
        nonlocal sent
        message.pose.position.x = float(sent)
        publisher.publish(message)
        sent += 1
        time.sleep(0.001)

    wait_until(lambda: list(bag.glob("*_1.mcap")) and kept(bag) > 100, "two files in the bag", send)
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (4096, 4096))
    full = time.monotonic()
    before = {p.name: p.read_bytes() for p in bag.glob("*.mcap")}
    assert recorder.wait(send) == 1 and "Traceback" not in recorder.output
    assert "cannot be written: File too large; recording ends, what is in it can be read" in recorder.output
    figure("disk full: the recorder ends, saying so, after", f"{time.monotonic() - full:.1f} s")
    after = content(bag)
    assert after.items() >= before.items()
    assert all(len(after[name]) <= 4096 for name in set(after) - set(before) - {"metadata.yaml"})
    numbers = numbers_in(bag)["/inductrack/topic0"]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) and len(numbers) > 100


def test_the_disk_fills_while_it_writes_results(tmp_path, capsys):
    made, out = make_campaign(tmp_path / "campaign", Model.default(), duration=0.2), tmp_path / "out"
    assert cli.main(["compare", str(made), "--output", str(out)]) == 0
    assert cli.main(["simulate", "--duration", "1", "--output", str(tmp_path / "run.csv")]) == 0
    Model.default().save(tmp_path / "model.yaml")
    before = content(tmp_path)
    for command in (
        ["compare", str(made), "--output", str(out)],
        ["compare", str(made), "--output", str(tmp_path / "new")],
        ["simulate", "--duration", "2", "--output", str(tmp_path / "run.csv")],
        ["simulate", "--duration", "2", "--output", str(tmp_path / "bag")],
    ):
        capsys.readouterr()
        with no_file_larger_than(10_000):
            assert cli.main(command) == 2, command
        said = capsys.readouterr().err
        assert "File too large" in said and len(said.splitlines()) == 1, said
    with no_file_larger_than(100), pytest.raises(OSError):
        Model.create({"eta": 0.7}).save(tmp_path / "model.yaml")
    assert content(tmp_path) == before
