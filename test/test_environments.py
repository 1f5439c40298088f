# SPDX-License-Identifier: Apache-2.0
"""Machines that are not as one's own: no home that can be written, no user, a package that cannot be written, any
terminal."""

from __future__ import annotations

import errno
import io
import os
import shutil
import socket
import sqlite3
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from conftest import LONG
from rclpy import get_rmw_implementation_identifier
from test_compare import make_campaign
from test_data_bags import GOOD, poses
from test_data_odd_bags import raw, sqlite_bag

import inductrack_ros
from inductrack_ros import cli
from inductrack_ros.core import compiled
from inductrack_ros.core.cache import cache_folder
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.output_folder import write_whole
from inductrack_ros.core.paths import missing
from inductrack_ros.data import bag_files, read_bag, sqlite_files
from inductrack_ros.nodes import domain as domains
from inductrack_ros.nodes.middleware import check_middleware

AS_NOBODY = """
import pwd, runpy
def unknown(uid): raise KeyError(uid)
pwd.getpwuid = unknown
runpy.run_module('inductrack_ros.cli', run_name='__main__')
"""


@pytest.mark.parametrize("home", ["/proc/none", None])
def test_a_user_without_home_and_a_package_that_cannot_be_written(tmp_path, home):
    """numba can keep nothing beside a package where a file stands in place of its folders."""
    package = tmp_path / "site" / "inductrack_ros"
    shutil.copytree(Path(inductrack_ros.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in [package, *(p for p in package.rglob("*") if p.is_dir())]:
        (folder / "__pycache__").write_text("")
    Model.default().kernel  # noqa: B018 - compiled, so that it can be copied
    shutil.copytree(cache_folder(), tmp_path / "cache", ignore=shutil.ignore_patterns("numba"))
    environment = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(tmp_path / "site"),
        "INDUCTRACK_CACHE": str(tmp_path / "cache"),
    }
    if home:
        environment["HOME"] = home
    done = subprocess.run(
        [sys.executable, "-B", "-c", AS_NOBODY, "simulate", "--duration", "0.2", "--output", "run.csv"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=LONG, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "101 samples" in done.stdout and not done.stderr, done.stderr
    assert (tmp_path / "run.csv").exists()
    estimation = AS_NOBODY.replace("inductrack_ros.cli", "inductrack_ros.estimation.kalman")
    done = subprocess.run(
        [sys.executable, "-B", "-c", estimation],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=LONG, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr


def test_no_home_no_user_no_cache(tmp_path, monkeypatch):
    def nobody():
        raise RuntimeError("Could not determine home directory.")

    for name in ("INDUCTRACK_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", nobody)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert cache_folder().parent == tmp_path


def said_by(arguments, monkeypatch, encoding) -> tuple[int, str]:
    """Exit status and what a terminal of this encoding shows, in this process."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding) for _ in range(2)]
    with monkeypatch.context() as terminal:
        terminal.setattr(sys, "stdout", streams[0])
        terminal.setattr(sys, "stderr", streams[1])
        try:
            status = cli.main(arguments)
        except SystemExit as end:
            status = end.code
        for stream in streams:
            stream.flush()
    return status, b"".join(stream.buffer.getvalue() for stream in streams).decode(encoding)


@pytest.mark.parametrize("encoding", ["latin-1", "ascii", "cp1252", "cp437", "utf-8"])
def test_a_terminal_of_any_encoding(tmp_path, monkeypatch, encoding):
    for command in cli.COMMANDS:
        status, said = said_by([command.name, "-h"], monkeypatch, encoding)
        assert status == 0 and "usage: inductrack" in said
    (tmp_path / "travels.csv").write_text("initial_speed,travel\n10,20\n15,30\n20,40\n")
    arguments = ["fit", str(tmp_path / "travels.csv"), "--free", "eta", "--output", str(tmp_path / "out")]
    status, said = said_by(arguments, monkeypatch, encoding)
    assert status == 0 and ("eta" in said or "η" in said)


def test_a_folder_whose_name_is_no_text(tmp_path, monkeypatch):
    """Bytes of another encoding in a name: Python has them as lone surrogates, which nothing can print."""
    named = tmp_path / os.fsdecode(b"M\xfcller")
    rig = make_campaign(named, Model.default(), duration=0.1)
    status, said = said_by(["compare", str(rig), "--output", str(named / os.fsdecode(b"\xe4"))], monkeypatch, "utf-8")
    assert status == 0 and "predicts" in said and (named / os.fsdecode(b"\xe4") / "report.html").exists()
    status, said = said_by(["compare", str(named / "none"), "--output", "x"], monkeypatch, "latin-1")
    assert status == 2 and "no such folder" in said


# ---------------------------------------------------------------- streams, folders and disks that fail


def test_streams_that_were_closed(tmp_path, monkeypatch):
    """`>&-` leaves Python without the stream."""
    with monkeypatch.context() as closed:
        closed.setattr(sys, "stdout", None)
        closed.setattr(sys, "stderr", None)
        assert cli.main(["simulate", "--duration", "0.01", "--output", str(tmp_path / "run.csv")]) == 0
        assert cli.main(["check", str(tmp_path / "none"), "--output", str(tmp_path / "out")]) == 2
    assert (tmp_path / "run.csv").exists()


def test_a_standard_error_that_cannot_be_written_changes_no_status(tmp_path):
    """`2>/dev/full`."""
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "inductrack_ros.cli", "check", str(tmp_path / "none"), "--output", "out"],
            cwd=tmp_path, stderr=full, stdout=subprocess.PIPE, timeout=LONG, check=False,
        )  # fmt: skip
    assert done.returncode == 2 and not done.stdout


def test_a_current_folder_that_is_gone(tmp_path, monkeypatch, capsys):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert cli.main(["simulate", "--duration", "0.01", "--output", "run.csv"]) == 2
    assert "the current folder is gone; change into one that exists" in capsys.readouterr().err


def test_a_disk_that_is_full_is_named_with_its_folder(tmp_path, monkeypatch, capsys):
    rig = make_campaign(tmp_path / "rig", Model.default(), duration=0.1)

    def full(self, *_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_text", full)
        assert cli.main(["check", str(rig), "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert f"--output {tmp_path / 'out'}: cannot be written: No space left on device; nothing was kept" in said
    assert not (tmp_path / "out").exists()


def test_no_room_for_compiled_code_names_the_folder_and_the_variable(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setenv("INDUCTRACK_CACHE", str(tmp_path))
    monkeypatch.setattr(compiled.os, "replace", full)
    with pytest.raises(InputError, match=f"{tmp_path}: compiled code cannot be kept there: .*set INDUCTRACK_CACHE"):
        compiled.load("VALUE = 1", [], lambda module: None)


def test_an_empty_name_is_no_folder(tmp_path, capsys):
    """`--output $UNSET` is not to write into the current folder."""
    rig = make_campaign(tmp_path / "rig", Model.default(), duration=0.1)
    assert cli.main(["check", str(rig), "--output", ""]) == 2
    assert "--output: is empty; give a folder" in capsys.readouterr().err


def test_one_run_in_place_of_a_campaign_says_what_to_write(tmp_path, capsys):
    rig = make_campaign(tmp_path / "rig", Model.default(), duration=0.1)
    file = next(rig.glob("*.csv"))
    assert cli.main(["check", str(file), "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        f"is one run; write a campaign.yaml beside it, `runs: [{{file: {file.name}, drive_current: 7000.0}}]`" in said
    )


@pytest.mark.parametrize("option", ["-v", "-d"])
@pytest.mark.parametrize("program", ["cli", "nodes.start"])
def test_a_shell_that_allows_too_little_memory_is_told(tmp_path, option, program):
    """With 400 MB of address space a library would wait for ever."""
    words = {"cli": ["check", "rig", "--output", "out"], "nodes.start": ["sim"]}[program]
    limited = f'ulimit {option} 400000 && exec "$@"'
    done = subprocess.run(
        ["bash", "-c", limited, "bash", sys.executable, "-m", f"inductrack_ros.{program}", *words],
        cwd=tmp_path, capture_output=True, text=True, timeout=LONG, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1 and "391 MB" in done.stderr and f"ulimit {option} unlimited" in done.stderr


def test_memory_that_runs_out_on_the_way_is_one_line(tmp_path, monkeypatch, capsys):
    def reads_too_much(folder):
        raise MemoryError("Unable to allocate 8.00 TiB for an array")

    monkeypatch.setattr("inductrack_ros.data.load_campaign", reads_too_much)
    assert cli.main(["check", str(tmp_path), "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("inductrack check: out of memory (Unable to allocate 8.00 TiB") and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


# ---------------------------------------------------------------- links, and folders that may not be entered


@pytest.fixture
def odd(tmp_path, monkeypatch):
    """A folder with links into nowhere and round in a circle, a file, and a good campaign."""
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    Path("dangling").symlink_to("nowhere")
    Path("file").write_text("")
    make_campaign(tmp_path / "rig", Model.default(), duration=0.1)
    return tmp_path


LOOP, NOWHERE = "is a link that leads back to itself", "is a link to nowhere, which is not there"
PLACES = {
    "loop": LOOP,
    "loop/x": f"loop {LOOP}",
    "dangling": NOWHERE,
    "dangling/x": f"dangling {NOWHERE}",
    "file": "is a file; give a folder",
    "file/x/y": "file is a file; give a folder",
    "-": "results are files, not a stream",
}


@pytest.mark.parametrize("place", PLACES)
def test_results_where_no_folder_can_be(odd, capsys, place):
    before = sorted(odd.rglob("*"))
    for words in (["compare", "rig"], ["check", "rig"], ["fit", "rig"], ["add", "track_slope", "rig"]):
        assert cli.main([*words, "--output", place]) == 2
        said = capsys.readouterr().err
        assert f"--output {place}: {PLACES[place]}" in said and said.count("\n") == 1
    assert sorted(odd.rglob("*")) == before


def test_a_run_where_no_file_can_be(odd, capsys):
    for place, says in (("dangling/x.csv", NOWHERE), ("loop/x.csv", LOOP), ("file/bag", "is a file"), ("-", "stream")):
        assert cli.main(["simulate", "--duration", "0.01", "--output", place]) == 2
        said = capsys.readouterr().err
        assert says in said and said.count("\n") == 1
    assert not Path("-").exists()


def test_inputs_that_are_links_into_nowhere(odd, capsys):
    """A campaign, its campaign.yaml, a run, a model, a file of effects."""
    for link, says in (("loop", LOOP), ("dangling", NOWHERE)):
        for words in ([link], ["rig", "--model", link], ["rig", "--effects", link]):
            assert cli.main(["compare", *words, "--output", "out"]) == 2
            assert f"{link}: {says}" in capsys.readouterr().err
    run = next(odd.glob("rig/*.csv"))
    run.unlink()
    run.symlink_to("/nfs/gone.csv")
    assert cli.main(["compare", "rig", "--output", "out"]) == 2
    assert f"{run.name}: is a link to /nfs/gone.csv, which is not there" in capsys.readouterr().err
    Path("rig/campaign.yaml").unlink()
    Path("rig/campaign.yaml").symlink_to("campaign.yaml")
    assert cli.main(["compare", "rig", "--output", "out"]) == 2
    assert f"campaign.yaml: {LOOP}" in capsys.readouterr().err


def test_a_folder_that_may_not_be_entered():
    """A folder outside of pytest's own, which other users may not enter either."""
    with tempfile.TemporaryDirectory() as name:
        inside = Path(name, "closed", "run.csv")
        inside.parent.mkdir()
        inside.write_text("")
        Path(name).chmod(0o755)
        inside.parent.chmod(0)
        root = os.geteuid() == 0
        try:
            os.seteuid(12345) if root else None
            said = missing(inside)
        finally:
            os.seteuid(0) if root else None
            inside.parent.chmod(0o700)
        assert said.startswith(f"cannot be read: this user may not enter the folder {inside.parent}")
        assert missing(inside) == "" and missing(Path(name, "none")) == "no such file"


def test_one_file_written_by_two_at_once_is_whole(tmp_path):
    """Each writes beside the file under a name of its own."""
    texts = [c * 100_000 for c in "abcd"]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda text: [write_whole(tmp_path / "model.yaml", text) for _ in range(20)], texts))
    assert (tmp_path / "model.yaml").read_text() in texts and len(list(tmp_path.iterdir())) == 1


# ---------------------------------------------------------------- the middleware


@pytest.mark.parametrize("domain", ["233", "-1", "abc", "1.5", "99999999999999999999"])
def test_a_domain_that_there_is_not(monkeypatch, domain):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    with pytest.raises(InputError, match=rf"ROS_DOMAIN_ID={domain}: .* from 0 to 232.* 0 to 101 and 215 to 232"):
        check_middleware()


@pytest.mark.parametrize("domain", ["", "0", "232", "0x10", " 7"])
def test_a_domain_that_there_is(monkeypatch, domain):
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    check_middleware()


def test_a_domain_in_which_somebody_speaks_is_not_claimed(monkeypatch, tmp_path):
    """A node that was started by hand, or left over, once published into the tests."""
    monkeypatch.setattr(domains.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(domains, "FIRST", 220)
    for name in ("ROS_DOMAIN_ID", domains.RANGE):
        monkeypatch.setenv(name, "")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        monkeypatch.setattr(domains, "LAST", 221)
        node.bind(("", domains.PORT + domains.PER_DOMAIN * 220 + 14))  # the third of its domain
        with domains.claim_domain():
            assert os.environ["ROS_DOMAIN_ID"] == "221"
            with pytest.raises(RuntimeError, match="all ROS domains from 220 to 221 are in use"):
                domains.claim_domain()
    with domains.claim_domain():
        assert os.environ["ROS_DOMAIN_ID"] == "220"


@pytest.mark.parametrize("command", [["nodes.start", "sim"], ["cli", "watch"]])
def test_a_middleware_that_is_not_installed(command):
    done = subprocess.run(
        [sys.executable, "-m", f"inductrack_ros.{command[0]}", command[1]],
        env=os.environ | {"RMW_IMPLEMENTATION": "rmw_of_nobody_cpp"},
        capture_output=True, text=True, timeout=LONG, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "RMW_IMPLEMENTATION=rmw_of_nobody_cpp: is not installed here; unset RMW_IMPLEMENTATION" in done.stderr


def test_a_middleware_that_is_installed(monkeypatch):
    monkeypatch.setenv("RMW_IMPLEMENTATION", get_rmw_implementation_identifier())
    check_middleware()


# ---------------------------------------------------------------- disks that are full, and threads


def no_room(*_, **__):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_copy_that_has_no_room_names_the_variable(tmp_path, monkeypatch):
    """Of a compressed file, and of a database with what its journal holds."""
    bag = sqlite_bag(tmp_path / "run", {GOOD: raw(poses(40))}, wal_from=15)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for module, name in ((sqlite_files.shutil, "copyfile"), (bag_files.tempfile, "TemporaryDirectory")):
        with monkeypatch.context() as disk:
            disk.setattr(module, name, no_room)
            with pytest.raises(InputError, match=f"cannot be written into {tmp_path}: .*; set TMPDIR to a folder"):
                read_bag(bag)
    with monkeypatch.context() as disk:
        disk.setattr(sqlite_files.sqlite3, "connect", lambda *_: Full())
        with pytest.raises(InputError, match="set TMPDIR to a folder with room"):
            read_bag(bag)
    assert len(read_bag(bag).times) == 40


class Full:
    """A database on a disk that is full."""

    def execute(self, *_):
        raise sqlite3.OperationalError("database or disk is full")

    def close(self) -> None: ...


def test_a_campaign_that_has_no_room_names_the_folder_given(tmp_path, monkeypatch, capsys):
    """Not the hidden one in which it is written first."""
    with monkeypatch.context() as disk:
        disk.setattr(os, "replace", no_room)
        words = ["simulate", "--duration", "0.02", "--run", "surge_rate=16", "--output", str(tmp_path / "camp")]
        assert cli.main(words) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path / 'camp' / 'run_00.csv'}: cannot be written: No space left on device" in said
    assert not list(tmp_path.iterdir())


def test_a_standard_output_that_cannot_be_written_is_named(tmp_path):
    """`>/dev/full`."""
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "inductrack_ros.cli", "simulate", "--duration", "0.01", "--output", "run.csv"],
            cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=LONG, check=False,
        )  # fmt: skip
    assert done.returncode == 2 and done.stderr == "inductrack simulate: standard output: No space left on device\n"


@pytest.mark.parametrize("program", ["cli", "nodes.start"])
@pytest.mark.parametrize("threads", ["abc", "0", "-2", "1.5"])
def test_threads_that_cannot_be(tmp_path, program, threads):
    words = {"cli": ["simulate", "--output", "run.csv"], "nodes.start": ["sim"]}[program]
    done = subprocess.run(
        [sys.executable, "-m", f"inductrack_ros.{program}", *words], env=os.environ | {"NUMBA_NUM_THREADS": threads},
        cwd=tmp_path, capture_output=True, text=True, timeout=LONG, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert f"NUMBA_NUM_THREADS={threads}: is no number of threads; unset it" in done.stderr


def test_a_folder_in_the_place_of_a_result_keeps_what_was_there(odd, capsys):
    """Of several files none is replaced where one cannot be."""
    taken = Path("out", "report.html")
    taken.mkdir(parents=True)
    Path("out", "check.json").write_text("before")
    assert cli.main(["check", "rig", "--output", "out"]) == 2
    said = capsys.readouterr().err
    assert f"--output out: {taken} is a folder" in said and said.count("\n") == 1 and "nothing was kept" in said
    assert Path("out", "check.json").read_text() == "before" and sorted(
        p.name for p in odd.iterdir() if "out" in p.name
    ) == ["out"]
