# SPDX-License-Identifier: Apache-2.0
"""The launch file: what it starts, by its plan; where `launch` is there, the real thing with real nodes."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_packages_with_prefixes
from conftest import BIN, newest_in, wait_until

from inductrack_ros.core.errors import InputError
from inductrack_ros.data.bags import read_bag
from inductrack_ros.nodes.launching import ARGUMENTS, Started, failed, misspelt, plan, rviz_configuration

ROOT = Path(__file__).parents[1]
PULSES = {"/**/sim": {"drive": "pulses", "initial_state": "surge_rate=20.0", "track_frame": "rail"}}


def planned(namespace: str = "/inductrack", **given: str) -> dict[str, Started]:
    default = {name: one.default for name, one in ARGUMENTS.items()} | {
        "params_file": str(ROOT / "config/default.yaml")
    }
    return {one.executable: one for one in plan(default | given, namespace)}


@pytest.fixture
def pulses_file(tmp_path) -> str:
    path = tmp_path / "pulses.yaml"
    path.write_text(yaml.safe_dump({name: {"ros__parameters": values} for name, values in PULSES.items()}))
    return str(path)


# ---- what is decided ------------------------------------------------------------------------------------------------


def test_alone_the_simulator_starts_as_its_file_says():
    assert planned() == {"sim": Started("sim")}


def test_an_argument_left_empty_leaves_the_matter_to_the_file(pulses_file):
    """A default of the launch file once overrode the file: a model with pulses ran averaged."""
    found = planned(params_file=pulses_file)
    assert found["sim"].parameters == {"listeners": 1} and "track_controller" in found
    assert planned(params_file=pulses_file, drive="averaged").keys() == {"sim"}
    assert "track_controller" not in planned(params_file=pulses_file, controller="false")
    assert planned(params_file=pulses_file, monitor="true")["monitor"].parameters == {"drive": "pulses"}


def test_time_begins_once_the_recorder_listens(tmp_path):
    assert planned(bag="run")["sim"].parameters["listeners"] == 1
    with_controller = planned(bag="run", drive="pulses")
    assert with_controller["sim"].parameters["listeners"] == 2
    assert with_controller["record"].arguments == ("--output=run",)
    path = tmp_path / "three.yaml"
    path.write_text("listeners: 3")
    assert "listeners" not in planned(bag="run", params_file=str(path))["sim"].parameters  # as the file says


def test_both_ends_of_lockstep_are_told(tmp_path):
    path = tmp_path / "lockstep.yaml"
    path.write_text("/**/sim: {ros__parameters: {lockstep: true, drive: pulses}}")
    assert planned(params_file=str(path))["track_controller"].parameters == {"lockstep": True}
    found = planned(drive="pulses", lockstep="true")["sim"].parameters
    assert found == {"drive": "pulses", "lockstep": True, "listeners": 1}


def test_who_asks_for_simulated_time_gets_a_clock():
    found = planned(use_sim_time="true", drive="pulses")
    assert (
        found["sim"].parameters["publish_clock"] is True
        and found["track_controller"].parameters["use_sim_time"] is True
    )
    assert planned(use_sim_time="true", publish_clock="false")["sim"].parameters["publish_clock"] is False


def test_what_the_rig_needs_ends_the_launch_when_it_ends():
    found = planned(drive="pulses", bag="run", monitor="true")
    assert {name for name, one in found.items() if one.needed} == {"sim", "track_controller", "record"}


def test_an_initial_state_that_cannot_be_read_is_refused():
    """A recorder once began before the simulator refused it."""
    with pytest.raises(InputError, match="initial_state: 'surge_rate' is not NAME=NUMBER"):
        planned(initial_state="surge_rate", bag="run")


def test_a_file_that_cannot_be_read_is_refused():
    with pytest.raises(InputError, match="none.yaml: no such file"):
        planned(params_file="none.yaml")


def test_a_lost_status_is_no_failure_where_all_are_told_to_end():
    assert failed(1, ending=True) and failed(-9, ending=True) and failed(255, ending=False)
    assert not (failed(0, ending=False) or failed(255, ending=True))


def test_a_misspelt_argument_is_named():
    """`ros2 launch` passes over it without a word."""
    assert misspelt(["drve", "bag", "monitr", "my_own", "ros_namespace"]) == [
        "no argument 'drve'; did you mean 'drive'?",
        "no argument 'monitr'; did you mean 'monitor'?",
    ]


def test_rviz_shows_the_topics_and_frames_of_its_rig(pulses_file):
    text = (ROOT / "rviz/forces.rviz").read_text()
    made = rviz_configuration(text, "/rig", {"params_file": pulses_file, "frame_prefix": "rig/"})
    manager = yaml.safe_load(made)["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "rig/rail"
    assert manager["Views"]["Current"]["Target Frame"] == "rig/cradle"
    assert {d["Topic"]["Value"].rpartition("rig/")[0] for d in manager["Displays"]} == {"/"}


def test_no_text_of_a_user_is_evaluated():
    assert "PythonExpression" not in (ROOT / "launch/inductrack.launch.py").read_text()


# ---- the real launch ------------------------------------------------------------------------------------------------

LAUNCHER = """
import sys
from launch import LaunchService
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import AnyLaunchDescriptionSource

file, *rigs = sys.argv[1:]
service = LaunchService()
for rig in rigs or [""]:
    arguments = [tuple(word.split(":=")) for word in rig.split()]
    included = IncludeLaunchDescription(AnyLaunchDescriptionSource(file), launch_arguments=arguments)
    service.include_launch_description(GroupAction([included]))
sys.exit(service.run())
"""


@pytest.fixture
def launched(ros, monkeypatch):
    """Starts the file once for each rig, whose arguments stand in one text; the package is found as after colcon."""
    if importlib.util.find_spec("launch_ros") is None:
        pytest.skip("launch_ros comes with a ROS 2 distribution and not as a wheel")
    prefix = ros.folder / "prefix"
    share = prefix / "share" / "inductrack_ros"
    for folder in ("share/ament_index/resource_index/packages", "share/inductrack_ros", "lib"):
        (prefix / folder).mkdir(parents=True)
    (prefix / "share/ament_index/resource_index/packages/inductrack_ros").touch()
    for name in ("config", "rviz", "launch"):
        (share / name).symlink_to(ROOT / name)
    (prefix / "lib/inductrack_ros").symlink_to(BIN)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}{os.pathsep}{os.environ.get('AMENT_PREFIX_PATH', '')}")
    script = ros.folder / "launcher.py"
    launches = []

    def begin(*rigs: str, first: str = ""):
        script.write_text(first + LAUNCHER)
        launches.append(ros.start(str(script), str(share / "launch/inductrack.launch.py"), *rigs))
        return launches[-1]

    yield begin
    for launch in launches:
        launch.stop()  # and with it all that it started


def processes(launch) -> dict[str, int]:
    """Process ids of what was started."""
    return {
        name: int(pid) for name, pid in re.findall(r"\[(\w+)-\d+\]: process started with pid \[(\d+)\]", launch.output)
    }


def clean(launch) -> int:
    """How many processes have ended clean, as far as launch knows: see `failed`."""
    return launch.output.count("process has finished cleanly") + launch.output.count("will report returncode 255")


def gone(pids) -> bool:
    return not any(Path("/proc", str(pid)).exists() for pid in pids)


def test_a_bag_holds_the_run_from_its_first_message(ros, launched, pulses_file):
    launch = launched(f"params_file:={pulses_file} namespace:=/rig bag:=run lockstep:=true")
    folder = ros.folder / "run"
    ros.wait(lambda: list(folder.glob("*.mcap")) and "/rig/fired_pulses" in newest_in(folder), "a pulse in the bag")
    assert processes(launch).keys() == {"track_controller", "record", "sim"}
    assert launch.stop() == 0 and gone(processes(launch).values())
    assert clean(launch) == 3, launch.output
    run = read_bag(folder, {"pose": "/rig/pose", "twist": "/rig/twist", "pulses": "/rig/fired_pulses"})
    first = dict(zip(run.channels, run.values[0], strict=True))
    assert first["surge"] == 0.0 and first["surge_rate"] == 20.0


@pytest.mark.parametrize(
    "arguments, said",
    [
        ("monitor:=yes", 'Argument "monitor" provided value "yes" is not valid'),
        ("namespace:=it's", "namespace:=it's: Invalid namespace"),
        ("bag:=run initial_state:=fast", "initial_state: 'fast' is not NAME=NUMBER"),
        ("params_file:=none.yaml", "none.yaml: no such file"),
        ("rviz:=true", "rviz2 is not installed"),
    ],
)
def test_what_is_wrong_is_said_before_anything_starts(launched, arguments, said):
    """The simulator once stayed behind as an orphan."""
    if arguments.startswith("rviz") and "rviz2" in get_packages_with_prefixes():
        pytest.skip("rviz2 is installed")
    launch = launched(arguments)
    assert launch.wait() == 1
    assert said in launch.output and not processes(launch)


def test_a_node_that_refuses_its_parameters_fails_the_launch(launched):
    """A script that starts the launch looks at its status. It was 0."""
    launch = launched("drive:=pulses initial_state:=surge_rat=17")
    assert launch.wait() == 1 and gone(processes(launch).values())
    assert "did you mean 'surge_rate'" in launch.output and "sim was required and has ended" in launch.output


@pytest.mark.parametrize("dies", ["sim", "record"])
def test_a_rig_without_one_of_its_parts_ends(ros, launched, dies):
    launch = launched("drive:=pulses bag:=run")
    launch.wait_for("recording into")
    wait_until(lambda: len(processes(launch)) == 3, "three processes")
    os.kill(processes(launch)[dies], signal.SIGKILL)
    assert launch.wait() == 1
    assert gone(processes(launch).values()) and "was required" in launch.output


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_launch_that_is_killed_leaves_nobody_behind(ros, launched, number):
    """`ros2 launch` ends at once on SIGTERM, as a container sends it, and leaves to their fate what it started."""
    launch = launched("bag:=run monitor:=true")
    ros.wait(lambda: list((ros.folder / "run").glob("*.mcap")), "something in the bag")
    os.kill(launch.pid, number)
    launch.wait()
    wait_until(lambda: gone(processes(launch).values()), "the end of what was started")
    assert read_bag(ros.folder / "run", {"pose": "/inductrack/pose"}).times.size


#: Stands in for RViz, of which the launch file needs no more than the name of its package.
RVIZ = """#!/bin/sh
echo "started as rviz2 $*" >&2
trap "exit 0" INT
sleep 600 & wait
"""


def test_rviz_gets_the_topics_and_frames_of_its_rig_and_may_be_closed(ros, launched):
    prefix = ros.folder / "prefix"
    (prefix / "share/ament_index/resource_index/packages/rviz2").touch()
    program = prefix / "lib" / "rviz2" / "rviz2"
    program.parent.mkdir()
    program.write_text(RVIZ)
    program.chmod(0o755)

    launch = launched("rviz:=true namespace:=/rig frame_prefix:=rig/ use_sim_time:=true")
    launch.wait_for("started as rviz2")
    (config,) = re.findall(r"started as rviz2 -d (\S+) ", launch.output)
    assert "/rig/scene" in Path(config).read_text() and '"rig/cradle"' in Path(config).read_text()
    assert "__ns:=/rig" in launch.output and "--params-file" in launch.output  # that of use_sim_time
    launch.wait_for("500 Hz")
    os.kill(processes(launch)["rviz2"], signal.SIGINT)
    launch.wait_for("[rviz2-2]: process has finished cleanly")
    assert not gone([processes(launch)["sim"]]) and launch.stop() == 0


def test_ctrl_c_reaches_a_node_twice_and_it_ends_clean(launched):
    """A terminal tells the nodes, and launch tells them again, while their interpreters exit."""
    launch = launched("drive:=pulses monitor:=true")
    wait_until(lambda: len(processes(launch)) == 3, "three processes")
    said = ("firing for", "windows of", "500 Hz")
    wait_until(lambda: all(words in launch.output for words in said), "three nodes that run")
    for pid in processes(launch).values():
        os.kill(pid, signal.SIGINT)
    assert launch.stop() == 0
    assert clean(launch) == 3, launch.output


#: What a node's end at the wrong moment does to launch, always: somebody else has taken its status.
LOSING = """
import os

def lose(pid, options, waitpid=os.waitpid):
    waitpid(pid, options)
    raise ChildProcessError

os.waitpid = lose
"""


def test_a_status_that_python_loses_does_not_fail_the_launch(launched):
    """Three of a hundred launches that Ctrl-C ended told of a failure that there was not."""
    launch = launched("", first=LOSING)
    launch.wait_for("500 Hz")
    assert launch.stop() == 0
    assert "will report returncode 255" in launch.output


#: Ctrl-C while one process is being started, and before those after it are.
EARLY = """
import asyncio.unix_events as events, os, signal

def start(self, args, *rest, begin=events._UnixSubprocessTransport._start, **options):
    begin(self, args, *rest, **options)
    if any(str(word).endswith("/ONE") for word in args):
        os.killpg(0, signal.SIGINT)

events._UnixSubprocessTransport._start = start
"""


@pytest.mark.parametrize("executable", ["track_controller", "sim"])
def test_ctrl_c_while_processes_are_started_ends_the_launch(launched, executable):
    """`ros2 launch` waited for ever for a process that it had started and did not know."""
    launch = launched("drive:=pulses", first=EARLY.replace("ONE", executable))
    assert launch.wait() == 0
    assert gone(processes(launch).values()) and clean(launch) == 2, launch.output
    assert "failed to terminate" not in launch.output and "Traceback" not in launch.output


def test_two_rigs_in_one_domain_have_their_own_topics_and_frames(ros, launched):
    from geometry_msgs.msg import PoseStamped

    names = ("rig1", "rig2")
    launch = launched(
        *(
            f"namespace:={name} frame_prefix:={name}/ initial_state:=surge_rate={speed}"
            for name, speed in zip(names, (17, 25), strict=True)
        )
    )
    heard = {name: ros.listen(PoseStamped, f"/{name}/pose") for name in names}
    ros.wait(lambda: all(heard.values()), "poses of both rigs")
    assert {name: {m.header.frame_id for m in poses} for name, poses in heard.items()} == {
        n: {f"{n}/track"} for n in names
    }
    assert launch.stop() == 0
