# SPDX-License-Identifier: Apache-2.0
"""The package as colcon, pip and ROS tools see it."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml

from inductrack_ros import cli

ROOT = Path(__file__).parent.parent
#: What a build needs; not .venv, not what other builds left.
SOURCES = (
    "setup.py", "setup.cfg", "package.xml", "pyproject.toml", "resource", "config", "launch", "rviz", "layouts",
    "inductrack_ros",
)  # fmt: skip
NODES = ("sim", "track_controller", "record", "monitor", "play", "inductrack")


def run(*command: str, cwd: Path, **environment: str) -> str:
    done = subprocess.run(command, cwd=cwd, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def workspace(tmp_path_factory) -> Path:
    """A colcon workspace in which the package has been built."""
    folder = tmp_path_factory.mktemp("workspace")
    package = folder / "src" / "inductrack_ros"
    package.mkdir(parents=True)
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, package / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, package / name)
    (package / "test").mkdir()
    shutil.copy(ROOT / "test" / "test_frames.py", package / "test")
    run(colcon(), "--log-base", "log", "build", cwd=folder)
    return folder


def colcon() -> str:
    found = shutil.which("colcon", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    assert found, "colcon is missing; `make setup` installs it"
    return found


def test_colcon_build_puts_everything_where_ros_looks(workspace):
    prefix = workspace / "install" / "inductrack_ros"
    assert (prefix / "share/ament_index/resource_index/packages/inductrack_ros").is_file()
    for name in NODES:  # `ros2 run inductrack_ros <name>`
        assert os.access(prefix / "lib/inductrack_ros" / name, os.X_OK), name
    share = prefix / "share/inductrack_ros"
    for name in (
        "package.xml",
        "launch/inductrack.launch.py",
        "config/default.yaml",
        "rviz/forces.rviz",
        "layouts/foxglove.json",
    ):
        assert (share / name).is_file(), name
    command = str(prefix / "lib/inductrack_ros/inductrack")
    assert "usage: inductrack" in run(command, "-h", cwd=workspace, PYTHONPATH=str(site(prefix)))


def site(prefix: Path) -> Path:
    return next(prefix.glob("lib/python3*/site-packages"))


def test_colcon_build_takes_all_files_along(workspace):
    installed = site(workspace / "install" / "inductrack_ros") / "inductrack_ros"
    tracked = run("git", "ls-files", "inductrack_ros", cwd=ROOT).split() if (ROOT / ".git").exists() else []
    missing = [name for name in tracked if (ROOT / name).exists() and not (installed.parent / name).exists()]
    assert not missing


def test_colcon_test_runs_the_tests(workspace):
    run(colcon(), "--log-base", "log", "test", "--event-handlers", "console_direct+", cwd=workspace)
    result = run(colcon(), "test-result", "--all", cwd=workspace)
    assert re.search(r"[1-9]\d* tests, 0 errors, 0 failures", result), result


def without_rosdep_key() -> set[str]:
    """Packages of the distribution that package.xml can name in a comment only."""
    comment = re.search(r"<!-- Without a rosdep key .*? apt install (.*?) -->", (ROOT / "package.xml").read_text())
    return set(comment[1].split())


def test_pages_and_hosted_ci_install_what_has_no_rosdep_key():
    for name in ("docs/installation.md", ".github/workflows/ci.yml"):
        line = re.search(r"apt(?:-get)? install (.*python3-.*)", (ROOT / name).read_text())
        assert without_rosdep_key() <= set(line[1].split()), name


def test_hosted_ci_asks_make_for_what_it_has():
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"].values()
    commands = " ".join(step.get("run", "") for job in jobs for step in job["steps"])
    asked = set(re.findall(r"\bmake (\w+)", commands))
    assert asked and asked <= set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def test_package_xml_agrees_with_setup_py():
    manifest = ElementTree.parse(ROOT / "package.xml").getroot()
    text = (ROOT / "setup.py").read_text()
    arguments = {k.arg: k.value for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Call) for k in n.keywords}
    assert manifest.get("format") == "3" and manifest.find("export/build_type").text == "ament_python"
    assert re.search(
        rf"^{re.escape(manifest.findtext('version'))} \(\d{{4}}-\d\d-\d\d\)\n-+\n",
        (ROOT / "CHANGELOG.rst").read_text(),
        re.MULTILINE,
    )
    keys = {e.text for e in manifest if e.tag.endswith("depend")}
    # Every ROS package that the nodes import is declared, under its own name.
    imported = set()
    for file in (ROOT / "inductrack_ros" / "nodes").glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level == 0:
                imported.add(node.module.partition(".")[0])
            elif isinstance(node, ast.Import):
                imported |= {name.name.partition(".")[0] for name in node.names}
    ros = {name for name in imported if name.endswith(("_msgs", "_srvs", "_interfaces")) or name == "rclpy"}
    assert ros <= keys and {"launch", "launch_ros"} <= keys
    for name in ast.literal_eval(arguments["install_requires"]):
        name = re.split(r"[<>=]", name)[0]
        if name != "setuptools" and f"python3-{name}" not in without_rosdep_key():
            assert {"PyYAML": "python3-yaml", "rosbags": "python3-rosbags-pip"}.get(name, f"python3-{name}") in keys


def test_entry_points_exist():
    ours = {e.name: e for e in entry_points(group="console_scripts") if e.value.startswith("inductrack_ros")}
    assert set(NODES) <= set(ours)
    assert all(callable(ours[name].load()) for name in NODES)


def test_the_version_stands_in_package_xml_alone(capsys):
    with pytest.raises(SystemExit) as left:
        cli.main(["--version"])
    said = ElementTree.parse(ROOT / "package.xml").findtext("version")
    assert left.value.code == 0 and capsys.readouterr().out == f"inductrack {said}\n"


def test_make_uses_a_sourced_distribution_and_brings_ros_otherwise():
    bare = run("make", "-n", "setup", "VENV=none", "AMENT_PREFIX_PATH=", cwd=ROOT)
    sourced = run("make", "-n", "setup", "VENV=none", "AMENT_PREFIX_PATH=/opt/ros/jazzy", "ROS_DISTRO=jazzy", cwd=ROOT)
    assert "'.[test,ros,ament]'" in bare and "--system-site-packages" not in bare
    assert "'.[test]'" in sourced and "--system-site-packages" in sourced


def test_the_parameter_file_names_what_exists():
    from inductrack_ros.core.model import Model
    from inductrack_ros.core.parameter_files import blocks_for, merged
    from inductrack_ros.nodes import monitor, sim, track_controller

    blocks = yaml.safe_load((ROOT / "config/default.yaml").read_text())
    assert set(blocks) == {"/**/sim", "/**/track_controller", "/**/monitor"}
    assert Model.load(ROOT / "config/default.yaml") == Model.default()  # and what is the node's own is passed over
    for node, own in (("sim", sim.OWN), ("track_controller", track_controller.DECLARED), ("monitor", monitor.OWN)):
        given = merged(blocks_for(ROOT / "config/default.yaml", f"/inductrack/{node}"))
        assert given and set(given) <= {*own, *Model.default().parameters}


SKIPS_ITSELF = """
import pytest

pytest.importorskip("no_such_module")

def test_one():
    pass
"""


def test_a_run_from_which_tests_are_missing_fails(tmp_path):
    """Under colcon one file that skips itself ended the collection: one test of 1,400 ran, and passed."""
    skips = tmp_path / "test_skips.py"
    skips.write_text(SKIPS_ITSELF)
    plain = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}  # where colcon says what
    for files, status, said in (
        (["test_frames.py"], 0, "tests collected"),
        (["test_frames.py", str(skips)], 4, "written but were not collected"),
    ):
        command = [sys.executable, "-m", "pytest", "--collect-only", *files]
        done = subprocess.run(command, cwd=ROOT / "test", env=plain, capture_output=True, text=True, check=False)
        assert done.returncode == status and said in done.stdout + done.stderr, done.stdout + done.stderr
