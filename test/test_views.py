# SPDX-License-Identifier: Apache-2.0
"""RViz, PlotJuggler and Foxglove are given topics and fields that exist, of the types they draw."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import MarkerArray

from inductrack_ros.core.model import Model
from inductrack_ros.core.options import SIM
from inductrack_ros.core.state import GAPS
from inductrack_ros.nodes import interface_tables, layouts
from inductrack_ros.nodes.messages import message_class
from inductrack_ros.nodes.scene import OUTWARD, scene
from inductrack_ros.nodes.transforms import cradle_transform, gap_transforms

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def types() -> dict[str, str]:
    """Message type of every topic, as docs/interfaces.md has it; groups (`gap_*`) by their first part."""
    return dict(re.findall(r"^\| `([^`]+)` \| (\w+/\w+) \|", interface_tables.text(), re.MULTILINE))


def type_of(topic: str, types: dict[str, str]) -> str:
    name = topic.removeprefix("/inductrack/")
    group = re.sub(r"^wrench/.*", "wrench/*", re.sub(r"gap_\w+", "gap_*", name))
    assert group in types, topic
    return types[group]


def check_field(kind: str, path: list[str]) -> None:
    """Follow the fields to a number."""
    message = message_class(kind.replace("/", "/msg/"))
    for step in path:
        assert not isinstance(message, str), path
        fields = message.get_fields_and_field_types()
        assert step in fields, (kind, path)
        inner = fields[step]
        message = message_class(inner.replace("/", "/msg/")) if "/" in inner else inner
    assert message in ("double", "float"), (kind, path)


def test_layouts_are_what_the_command_writes(tmp_path):
    layouts.main(str(tmp_path))
    for file in tmp_path.iterdir():
        assert (ROOT / "layouts" / file.name).read_text(encoding="utf-8") == file.read_text(encoding="utf-8"), (
            "out of date: python -m inductrack_ros.nodes.layouts layouts"
        )
    assert {p.name for p in (ROOT / "layouts").iterdir()} == {p.name for p in tmp_path.iterdir()}


def test_plotjuggler_shows_what_exists(types):
    root = ElementTree.parse(ROOT / "layouts" / "plotjuggler.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]  # so version 3 finds them
    assert curves == [f"{curve.get('topic')}/{curve.get('field')}" for curve in root.iter("curve")]  # and so version 4
    assert len(curves) > 20 and root.find("tabbed_widget").get("parent") == "main_window"
    assert root.get("pj4_version") == "4"
    topics = sorted((f"/inductrack/{t}" for tab in layouts.TABS.values() for p in tab.values() for t, _ in p), key=len)
    for curve in curves:
        topic = next(t for t in reversed(topics) if curve.startswith(t + "/"))
        check_field(type_of(topic, types), curve.removeprefix(topic + "/").split("/"))
    for splitter in root.iter("DockSplitter"):
        assert int(splitter.get("count")) == len(splitter) == len(splitter.get("sizes").split(";"))


def test_foxglove_shows_what_exists(types):
    layout = json.loads((ROOT / "layouts" / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    values = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert len(values) > 20
    for value in values:
        topic, *fields = value.split(".")
        check_field(type_of(topic, types), fields)
    for topic in panels["3D!rig"]["topics"]:
        assert type_of(topic, types) == "visualization_msgs/MarkerArray"

    def leaves(node: object) -> list[str]:
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    shown = leaves(layout["layout"])
    shown += [leaf for name in shown for tab in panels[name].get("tabs", []) for leaf in leaves(tab["layout"])]
    assert sorted(shown) == sorted(panels)


def test_rviz_shows_what_exists(types):
    rviz = yaml.safe_load((ROOT / "rviz" / "forces.rviz").read_text(encoding="utf-8"))
    displays = rviz["Visualization Manager"]["Displays"]
    drawn = {"MarkerArray": "MarkerArray", "Odometry": "Odometry", "Pose": "PoseStamped"}
    for display in displays:
        assert type_of(display["Topic"]["Value"], types).endswith("/" + drawn[display["Class"].rpartition("/")[2]])
    assert {d["Topic"]["Value"] for d in displays} >= {"/inductrack/forces", "/inductrack/scene"}


@pytest.mark.parametrize("reliability", SIM["reliability"].choices)
def test_rviz_is_connected_to_all_that_it_shows(ros, reliability):
    """By the types and the quality of service that a running simulator offers. RViz once asked for reliable topics."""
    rviz = yaml.safe_load((ROOT / "rviz" / "forces.rviz").read_text(encoding="utf-8"))
    topics = [display["Topic"] for display in rviz["Visualization Manager"]["Displays"]]
    sim = ros.start("sim", "--ros-args", "-p", f"reliability:={reliability}")
    offered = ros.node.get_publishers_info_by_topic
    ros.wait(lambda: all(offered(topic["Value"]) for topic in topics), "publishers of what RViz shows")
    for topic in topics:
        asked = QoSProfile(
            depth=topic["Depth"],
            reliability=ReliabilityPolicy.get_from_short_key(topic["Reliability Policy"].replace(" ", "_").lower()),
            durability=DurabilityPolicy.get_from_short_key(topic["Durability Policy"].replace(" ", "_").lower()),
        )
        for end in offered(topic["Value"]):
            assert qos_check_compatible(end.qos_profile, asked)[0] != QoSCompatibility.ERROR, topic["Value"]
    assert sim.stop() == 0


def test_the_scene_is_the_rig():
    """Each gap's line is as long as the gap, from the array's centre to the track's surface, whatever the pose."""
    model = Model.default()
    for coordinates in ([0.0, 0.0, 0.0, 0.0], [7.3, 0.002, -0.004, 0.05], [3.0, -0.003, 0.001, -0.04]):
        x = model.initial_state(surge=coordinates[0], sway=coordinates[1], heave=coordinates[2], roll=coordinates[3])
        gaps = [model.quantities(x)[gap] for gap in GAPS]
        markers = {m.ns: m for m in scene(model.parameters, x[:4], gaps, Time(), "track")}
        for face, gap in zip(("top", "right", "left"), gaps, strict=True):
            array, surface = (np.array([p.x, p.y, p.z]) for p in markers[f"gap {face}"].points)
            assert np.linalg.norm(array - surface) == pytest.approx(gap, abs=1e-9)
            track, q = markers[f"track {face}"].pose, markers[f"track {face}"].pose.orientation
            angle = 2 * np.arctan2(q.x, q.w)
            normal = np.array([0.0, -np.sin(angle), np.cos(angle)])
            centre = np.array([track.position.x, track.position.y, track.position.z])
            assert abs((surface - centre) @ normal) == pytest.approx(0.5 * markers[f"track {face}"].scale.z, abs=1e-9)
            assert markers[f"gap {face} (mm)"].text == f"{1e3 * gap:.1f} mm"
            assert markers[f"array {face}"].pose.position.x == pytest.approx(coordinates[0])
            body = markers[f"array {face}"].pose.position
            away = np.array([0.0, body.y - array[1], body.z - array[2]])
            assert np.linalg.norm(away) == pytest.approx(0.5 * markers[f"array {face}"].scale.z, abs=1e-9)
            assert away @ (array - surface) > 0  # the array lies outside the track


def test_the_simulator_publishes_what_viewers_draw(ros):
    drawn = {topic: ros.listen(MarkerArray, f"/inductrack/{topic}") for topic in ("scene", "forces")}
    sim = ros.start("sim")
    ros.wait(lambda: all(drawn.values()), "markers")
    names = {topic: {m.ns for m in heard[-1].markers} for topic, heard in drawn.items()}
    assert {"track top", "array left", "gap right"} < names["scene"] and {"lift", "thrust", "total"} < names["forces"]
    assert sim.stop() == 0


def test_a_gap_sensors_range_ends_on_the_track():
    """From the frames in /tf and /tf_static, a range along the sensor's x comes to lie on the track's face, wherever
    the cradle is."""
    model = Model.default()
    p = model.parameters
    x = model.initial_state(surge_rate=15.0, sway=0.002, heave=-0.003, roll=0.02)
    x[0] = 3.0
    truth = model.quantities(x)

    def placed(message, points: np.ndarray) -> np.ndarray:
        t, q = message.transform.translation, message.transform.rotation
        return Rotation.from_quat([q.x, q.y, q.z, q.w]).apply(points) + [t.x, t.y, t.z]

    cradle = cradle_transform(Time(), "rig1/track", "rig1/cradle", x[:4])
    assert (cradle.header.frame_id, cradle.child_frame_id) == ("rig1/track", "rig1/cradle")
    offset, side = p["magnet_side_offset"], p["magnet_side_height"]
    centres = (0.0, p["magnet_top_height"]), (-offset, side), (offset, side)
    for sensor, gap, centre, outward in zip(
        gap_transforms(Time(), "rig1/cradle", "rig1/", p), GAPS, centres, OUTWARD, strict=True
    ):
        assert (sensor.header.frame_id, sensor.child_frame_id) == ("rig1/cradle", f"rig1/{gap}")
        seen = placed(cradle, placed(sensor, np.array([[truth[gap], 0.0, 0.0], [0.0, 0.0, 0.0]])))
        surface = np.array(centre) - p["nominal_gap"] * np.array(outward)
        # The sensor turns with the roll, the gap is measured across the track: they differ by the cosine.
        assert (seen[0, 1:] - surface) @ outward == pytest.approx(0.0, abs=truth[gap] * (1 - np.cos(0.02)) + 1e-9)
        assert (seen[1, 1:] - surface) @ outward == pytest.approx(truth[gap], abs=1e-6)
