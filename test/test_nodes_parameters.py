# SPDX-License-Identifier: Apache-2.0
"""Parameter files and overrides: what a node takes, what it passes over and says, what it refuses; commands do the
same."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter as RosParameter
from test_fuzz import TREES, WORDS, fuzz

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.parameter_files import Block
from inductrack_ros.nodes import runtime
from inductrack_ros.nodes.monitor import MonitorNode
from inductrack_ros.nodes.sim import SimNode
from inductrack_ros.nodes.track_controller import TrackController

NODES = {"sim": SimNode, "monitor": MonitorNode, "track_controller": TrackController}


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture):
    """Start a node in this process with a parameter file's text and further words; its status, parameters and what it
    said."""
    monkeypatch.setattr(runtime.STOP, "listen", lambda: None)
    monkeypatch.chdir(tmp_path)

    def begin(name: str, text: str = "", *words: str) -> tuple[int, dict[str, object], str]:
        found: dict[str, object] = {}

        class Once(NODES[name]):
            def __init__(self, overrides) -> None:
                super().__init__(overrides)
                self.finished = True

            def close(self) -> None:
                getattr(self, "at_the_end", lambda: None)()
                found.update({n: p.value for n, p in self.get_parameters_by_prefix("").items()})

        Path("given.yaml").write_text(text)
        files = ["--params-file", "given.yaml"] if text else []
        status = runtime.run(Once, [name, "--ros-args", *files, *words])
        return status, found, capfd.readouterr().err

    return begin


EMPTY = {
    "sim": ("/**:\n  ros__parameters: {effects: [], eta: 0.75}\n", "effects", [""]),
    "monitor": ("/inductrack/monitor:\n  ros__parameters: {effect_files: [], effects: []}\n", "effect_files", [""]),
    "track_controller": (
        "/inductrack/track_controller:\n  ros__parameters:\n    detectors: {failed: []}\n",
        "detectors.failed",
        [-1],
    ),
}


@pytest.mark.parametrize("node", EMPTY)
def test_an_empty_list_is_none(start, node):
    text, name, value = EMPTY[node]
    status, found, _ = start(node, text)
    assert (status, list(found[name])) == (0, value)
    assert start(node, "", "-p", f"{name}:=[]")[0] == 0


#: A file, the η that sim takes from it, and what it says. `inductrack simulate` takes the same, or says the same and
#: refuses.
FILES = {
    "for it": ("/inductrack/sim: {ros__parameters: {eta: 0.75}}", 0.75, ""),
    "nested": ("inductrack: {sim: {ros__parameters: {eta: 0.75}}}", 0.75, ""),
    "by wildcards": ("/*/sim: {ros__parameters: {eta: 0.75}}", 0.75, ""),
    "plain": ("eta: 0.75", 0.75, ""),
    "whole and real numbers": ("{eta: 0.75, effects: [stand_in_heave], stand_in_heave.values: [0, 0.5]}", 0.75, ""),
    "general before special": ("/**:\n  ros__parameters: {mass: 9.0}\n  sim: {ros__parameters: {eta: 0.75}}", 0.75, ""),
    "special before general": ("/**:\n  sim: {ros__parameters: {eta: 0.75}}\n  ros__parameters: {mass: 9.0}", 0.75, ""),
    "coordinates by name": ("{eta: 0.75, dof: [sway, heave]}", 0.75, ""),
    "one effect": ("{eta: 0.75, effects: aerodynamic_drag}", 0.75, ""),
    "an effect that is off": (
        "{eta: 0.75, aerodynamic_drag.drag_area: 0.1}",
        0.75,
        "not used, effects: does not list their effect: aerodynamic_drag.drag_area",
    ),
    "later counts": ("/**: {ros__parameters: {eta: 0.5}}\n/inductrack/sim: {ros__parameters: {eta: 0.75}}", 0.75, ""),
    "the special one comes first": (
        "/inductrack/sim: {ros__parameters: {eta: 0.5, mass: 9.0}}\n/**: {ros__parameters: {eta: 0.75, mass: 9.0}}",
        0.75,
        "eta: 0.75 of /** counts, not 0.5 of /inductrack/sim above it; put the general block first",
    ),
    "no namespace": (
        "sim: {ros__parameters: {eta: 0.75}}",
        0.7295,
        "nothing in it is for /inductrack/sim; its blocks are for /sim; name",
    ),
    "another namespace": ("/rig1/sim: {ros__parameters: {eta: 0.75}}", 0.7295, "its blocks are for /rig1/sim"),
    "another node": (
        "/inductrack/simulator: {ros__parameters: {eta: 0.75}}",
        0.7295,
        "its blocks are for /inductrack/simulator",
    ),
    "a part elsewhere": (
        "/**: {ros__parameters: {mass: 9.0}}\n/rig1/sim: {ros__parameters: {eta: 0.75}}",
        0.7295,
        "not all in it is for /inductrack/sim; its blocks are for /rig1/sim",
    ),
    "for all nodes": (
        "/**: {ros__parameters: {eta: 0.75, mode: speed, detectors: {failed: [3]}, my_own: 1}}",
        0.75,
        "my_own",
    ),
}


@pytest.mark.parametrize("case", FILES)
def test_a_file_gives_node_and_command_the_same(start, capfd, tmp_path, case):
    text, eta, says = FILES[case]
    status, found, said = start("sim", text)
    assert status == 0 and found["eta"] == eta and says in said
    assert ("[WARN]" in said or "warning" in said) == bool(says)
    code = cli.main(["simulate", "--model", "given.yaml", "--duration", "0.01", "--output", str(tmp_path / "run.csv")])
    assert says in capfd.readouterr().err
    if code == 0:
        assert Model.load("given.yaml").parameters["eta"] == eta
    else:
        assert code == 2 and eta == 0.7295


REFUSED = {
    "unknown, for it": (
        "/inductrack/sim: {ros__parameters: {etta: 0.75}}",
        "unknown parameter 'etta'; did you mean 'eta'?",
    ),
    "unknown, plain": ("etta: 0.75", "unknown parameter 'etta'; did you mean 'eta'?"),
    "no value": ("{eta: }", "given.yaml: eta has no value; give it one, or leave the name out"),
    "a tilde": ("{eta: ~}", "given.yaml: eta has no value; give it one, or leave the name out"),
    "a list without value": ("{effects: }", "given.yaml: effects has no value"),
    "a start as names": (
        "{initial_state: {surge_rate: 16.1, sway: 0.002}}",
        "initial_state has no names below it; write initial_state: 'surge_rate=16.1,sway=0.002'",
    ),
    "names below a switch": ("/**: {ros__parameters: {lockstep: {on: true}}}", "lockstep has no names below it"),
    "a switch in quotes": ("{lockstep: 'true'}", "lockstep = 'true' must be true or false, without quotes"),
    "a switch as a number": ("{publish_clock: 1}", "publish_clock = 1 must be true or false"),
    "a rate that is none": ("{rate: 1e9}", "rate = 1e+09 is out of range"),
    "a seed that is no whole number": ("{seed: 1.5}", "seed = 1.5 must be a whole number"),
    "lists in lists": ("{eta: [[1], [2]]}", "must be of one kind"),
    "a huge number": ("{eta: 100000000000000000000}", "more than 64 bits"),
    "an empty name": ('/inductrack/sim: {ros__parameters: {"": 1}}', "error: "),
    "a word misspelt": ("/**:\n  ros_parameters: {eta: 0.75}", "no ros__parameters below '/**'"),
    "beside the block": ("eta: 0.8\n/**: {ros__parameters: {eta: 0.75}}", "'eta' stands outside of ros__parameters"),
    "not indented": ("/**:\n  ros__parameters:\n  eta: 0.75", "'eta' stands outside of ros__parameters; indent it"),
    "half a wildcard": ("/induct*/sim: {ros__parameters: {eta: 0.75}}", "'/induct*/sim' is no node's name"),
    "a blank in a name": ("'/a b/sim': {ros__parameters: {eta: 0.75}}", "'a b' must be of letters, digits and _"),
    "with dots and nested": ("{conditions.a: 1.0, conditions: {a: 2.0}}", "'conditions.a' is given twice"),
    "nothing": ("# to be filled in\n", "given.yaml: empty; expected parameter names with values"),
    "no file of ROS": ("- 1\n- 2\n", "expected parameter names with values, got list"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_refused_is_said_in_one_line(start, case):
    text, says = REFUSED[case]
    status, _, said = start("sim", text)
    lines = [line for line in said.splitlines() if line.startswith("error: ")]
    assert status == 2 and len(lines) == 1 and says in lines[0]
    with pytest.raises(InputError):
        Model.load("given.yaml")


@pytest.mark.parametrize("node", ["monitor", "track_controller"])
def test_what_is_for_all_nodes_may_hold_what_one_does_not_have(start, node):
    status, found, said = start(node, "/**: {ros__parameters: {wavelength: 0.11, my_own: {deep: 1}, mine: 2}}")
    assert status == 0 and found["wavelength"] == 0.11 and "mine" in said and "[WARN]" in said or "warning" in said
    assert start(node, "", "-p", "mine:=2")[0] == 2  # given to this node


OVERRIDES = """/inductrack/sim:
  ros__parameters:
    qos_overrides:
      /inductrack/pose: {publisher: {reliability: best_effort, depth: 7}}
      /inductrack/drive_pulses: {subscription: {depth: 9}}
"""


def test_quality_of_service_is_as_asked(start, monkeypatch):
    ends: dict[str, tuple[str, int]] = {}

    def look(node) -> None:
        for end in (*node.publishers, *node.subscriptions):
            ends[end.topic_name.removeprefix("/inductrack/")] = (
                end.qos_profile.reliability.name.lower(),
                end.qos_profile.depth,
            )

    monkeypatch.setattr(SimNode, "at_the_end", look, raising=False)
    assert start("sim", OVERRIDES)[0] == 0
    assert (
        ends["pose"] == ("best_effort", 7)
        and ends["drive_pulses"] == ("reliable", 9)
        and ends["twist"] == ("reliable", 10000)
    )
    assert Model.load("given.yaml") == Model.default()  # nothing in it is the model's
    for asked, pose, measured in (
        ("sensor_data", "reliable", "best_effort"),
        ("best_effort", "best_effort", "best_effort"),
    ):
        assert start("sim", "", "-p", f"reliability:={asked}", "-p", "publish_clock:=true")[0] == 0
        assert (ends["pose"][0], ends["measured/imu"][0], ends["/clock"][0]) == (pose, measured, "reliable")


@pytest.mark.parametrize(
    "node, text, says",
    [
        (
            "sim",
            "{lockstep: true, reliability: best_effort}",
            "sim: reliability = 'best_effort': in lockstep time waits for an answer",
        ),
        (
            "sim",
            "/**:\n  ros__parameters:\n    lockstep: true\n" + OVERRIDES,
            "qos_overrides of pose: in lockstep time waits",
        ),
        (
            "track_controller",
            "{lockstep: true, qos_overrides./inductrack/pose.subscription.reliability: best_effort}",
            "qos_overrides of pose: in lockstep",
        ),
        (
            "sim",
            "{qos_overrides./inductrack/pose.publisher.reliability: perhaps}",
            "qos_overrides of pose: Unexpected QoS override",
        ),
        ("sim", "{qos_overrides./inductrack/pose.publisher.depth: many}", "qos_overrides of pose: "),
    ],
)
def test_quality_of_service_that_cannot_be_is_refused(start, node, text, says):
    status, _, said = start(node, text)
    assert status == 2 and "error: " in said and says in said and "Traceback" not in said


@pytest.mark.parametrize("name", ["sim", "monitor", "track_controller"])
def test_what_another_callback_refuses_takes_no_effect(start, monkeypatch, name):
    """A value counts once all of a node's callbacks have accepted it."""
    seen: list = []

    def refuse(node) -> None:
        def others(changed):
            return SetParametersResult(successful=seen[-1], reason="not now")

        node.add_on_set_parameters_callback(others)  # asked before ours: the newest is the first
        node._on_set_parameters_callbacks.reverse()  # and after ours
        in_force = {
            "sim": lambda: node.model,
            "monitor": lambda: node.monitor.model,
            "track_controller": lambda: node._hold.speed,
        }[name]
        parameter = "target_speed" if name == "track_controller" else "mass"
        for accept in (False, True):
            seen.append(accept)
            before = in_force()
            assert node.set_parameters([RosParameter(parameter, value=9.0)])[0].successful is accept
            assert (in_force() != before) is accept
        seen.append("done")

    monkeypatch.setattr(NODES[name], "at_the_end", refuse, raising=False)
    assert start(name)[0] == 0 and seen[-1] == "done"


def test_a_model_of_coordinates_by_name_runs_in_the_monitor_too(start):
    status, found, _ = start("monitor", "{dof: [sway, heave]}")  # rcl's log goes where the process's first node sent it
    assert status == 0 and list(found["dof"]) == ["sway", "heave"]


@pytest.mark.parametrize("node", ["sim", "monitor"])
def test_plant_effects_and_their_conditions_are_parameters(start, node):
    text = """{effects: [track_temperature, flexible_mode, auxiliary_wheels], track_temperature: {coefficient: 0.004},
      flexible_mode: {frequency: 25.0}, auxiliary_wheels: {height: 0.003, stiffness: 1.0e+5}, conditions: {track_temperature: 35.0}}"""  # noqa: E501
    status, found, _ = start(node, text)
    assert status == 0
    assert (
        found["conditions.track_temperature"] == 35.0
        and found["flexible_mode.frequency"] == 25.0
        and found["auxiliary_wheels.damping"] == 0.0
    )
    status, _, said = start(node, "{effects: [track_temperature], conditions: {trck_temperature: 35.0}}")
    assert status == 2 and "did you mean 'track_temperature'" in said


def test_effect_files_are_sought_beside_the_file_that_names_them(start, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "mine.py").write_text(Path(__file__).with_name("own_effects.py").read_text())
    Path("there/model.yaml").write_text("{effect_files: [mine.py], effects: [patch]}")
    status, found, _ = start("sim", "", "--params-file", "there/model.yaml")
    assert status == 0 and list(found["effect_files"]) == [str(tmp_path / "there" / "mine.py")]
    assert list(Model.load("there/model.yaml").effects) == ["patch"]


@pytest.mark.parametrize(
    "pattern, node, taken",
    [
        ("/**", "/a/b/sim", True),
        ("/*", "/a/sim", False),
        ("/*", "/sim", True),
        ("/*/sim", "/a/sim", True),
        ("/*/sim", "/a/b/sim", False),
        ("/**/sim", "/a/b/sim", True),
        ("/**/sim", "/sim", True),
        ("/a/**", "/a/b/sim", True),
        ("/a/**", "/b/sim", False),
        ("/a.sim", "/a/sim", False),
    ],
)
def test_wildcards(pattern, node, taken):
    assert Block(pattern, {}).is_for(node) is taken


@fuzz(60)
@given(
    node=st.sampled_from([*NODES]),
    tree=st.dictionaries(WORDS, TREES, max_size=4) | TREES.map(lambda t: {"/**": {"ros__parameters": t}}),
)
def test_no_parameter_file_ends_in_a_traceback(start, node, tree):
    text = yaml.safe_dump(tree, allow_unicode=True)
    status, _, said = start(node, text)
    assert status in (0, 2) and (status == 0 or "error: " in said)
