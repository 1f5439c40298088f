# SPDX-License-Identifier: Apache-2.0
"""Messages that tools of ROS can use: ranges with limits, covariances of known noise, frames of the sensors."""

from __future__ import annotations

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, Range

from inductrack_ros.core.model import Model
from inductrack_ros.core.options import SIM
from inductrack_ros.core.rig import SENSORS, Sample, declared, noise
from inductrack_ros.core.state import GAPS, OUTPUTS
from inductrack_ros.nodes.topics import SimulatorTopics, channels, stamp_of
from inductrack_ros.nodes.transforms import cradle_transform, gap_transforms

STAMP = stamp_of(1_500_000_000)
MODEL = Model.default()
NOISE = noise({name: one.default for name, one in declared().items()})
PREFIX = "rig1/"


@pytest.fixture
def topics(ros):
    options = {name: one.default for name, one in SIM.items()} | {"frame_prefix": PREFIX}
    return SimulatorTopics(ros.node, [], options)


def measured(topics, ros, sensor: str, kind: type, roll: float = 0.0):
    """The message that a sensor's sample becomes, over DDS."""
    heard = ros.listen(kind, f"/measured/{sensor}")
    sample = Sample(sensor, 1.5, dict.fromkeys(SENSORS[sensor], 0.006), roll)

    def again():
        topics.measured(STAMP, sample, MODEL.parameters, NOISE)
        return heard

    return ros.wait(again, f"a message of {sensor}")[0]


def test_a_gap_is_a_range_with_limits(topics, ros):
    """Equal limits would declare a sensor that only tells near from far."""
    message = measured(topics, ros, "gap_top", Range)
    assert message.min_range < 0.0 < message.range < message.max_range and message.field_of_view > 0.0
    assert message.header.frame_id == "rig1/gap_top"
    if hasattr(message, "variance"):
        assert message.variance == pytest.approx(NOISE["gap_top"] ** 2, rel=1e-6)


def test_an_imu_tells_its_noise_and_what_it_does_not_measure(topics, ros):
    message = measured(topics, ros, "imu", Imu, roll=0.3)
    covariance = np.reshape(message.linear_acceleration_covariance, (3, 3))
    sigma = [NOISE[channel] for channel in SENSORS["imu"]]
    assert np.linalg.eigvalsh(covariance) == pytest.approx(np.sort(np.square(sigma)))  # turned, not stretched
    assert message.orientation_covariance[0] == message.angular_velocity_covariance[0] == -1.0
    assert message.header.frame_id == "rig1/cradle"


def test_the_true_odometry_is_known_to_be_exact(topics, ros):
    heard = ros.listen(Odometry, "/odometry")
    x = MODEL.initial_state(surge_rate=20.0)
    quantities = MODEL.quantities(x)
    truth = channels(x, quantities)

    def again():
        topics.details(STAMP, x, truth, MODEL.wrenches(x, 0.0), MODEL.parameters)
        return heard

    message = ros.wait(again, "the odometry")[0]
    for covariance in (message.pose.covariance, message.twist.covariance):
        assert 0.0 < np.diag(np.reshape(covariance, (6, 6))).max() < 1e-9  # 0 would mean that it is not known
    assert (message.header.frame_id, message.child_frame_id) == ("rig1/track", "rig1/cradle")
    assert set(OUTPUTS) == set(truth)


def test_frames_of_the_gap_sensors():
    """Each sits on its array and looks along x: down at the top, towards the legs of the track at the sides."""
    found = {t.child_frame_id: t for t in gap_transforms(STAMP, "rig1/cradle", PREFIX, MODEL.parameters)}
    assert set(found) == {PREFIX + gap for gap in GAPS}
    looks = {}
    for name, one in found.items():
        assert one.header.frame_id == "rig1/cradle"
        turned = one.transform.rotation
        looks[name.removeprefix(PREFIX)] = Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).apply([1, 0, 0])
    assert found["rig1/gap_top"].transform.translation.z == MODEL.parameters["magnet_top_height"]
    right, left = (found[f"rig1/gap_{side}"].transform.translation.y for side in ("right", "left"))
    assert right == -left == -MODEL.parameters["magnet_side_offset"]
    # A gap closes where its array moves along the sensor's look: the model says how it opens with sway and heave.
    x = MODEL.initial_state(surge_rate=20.0)
    for gap, look in looks.items():
        for axis in (1, 2):
            moved = x.copy()
            moved[axis] += 1e-4
            opens = (MODEL.quantities(moved)[gap] - MODEL.quantities(x)[gap]) / 1e-4
            assert look[axis] == pytest.approx(-opens, abs=1e-6)


def test_the_cradle_stands_in_the_track():
    one = cradle_transform(STAMP, "track", "cradle", np.array([3.0, 0.001, -0.004, 0.0]))
    to = one.transform.translation
    assert (one.header.frame_id, one.child_frame_id) == ("track", "cradle")
    assert (to.x, to.y, to.z) == pytest.approx((3.0, 0.001, -0.004))


def test_transforms_are_reliable_and_prefixed_whatever_the_rest_is(ros):
    """A listener of tf2 asks for a reliable /tf, and for a /tf_static that waits for who comes late."""
    kind = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs comes with a ROS 2 distribution").TFMessage
    options = {name: one.default for name, one in SIM.items()} | {"frame_prefix": PREFIX, "reliability": "best_effort"}
    topics = SimulatorTopics(ros.node, [], options)
    topics.places(STAMP, MODEL.parameters)
    heard: dict[str, list] = {"/tf": [], "/tf_static": []}
    for topic, durability in (("/tf", DurabilityPolicy.VOLATILE), ("/tf_static", DurabilityPolicy.TRANSIENT_LOCAL)):
        asked = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=durability)
        ros.node.create_subscription(kind, topic, heard[topic].append, asked)
    x = MODEL.initial_state(surge_rate=20.0)

    def again():
        topics.details(STAMP, x, channels(x, MODEL.quantities(x)), MODEL.wrenches(x, 0.0), MODEL.parameters)
        return all(heard.values())

    ros.wait(again, "both kinds of transforms")
    (cradle,) = heard["/tf"][0].transforms
    assert (cradle.header.frame_id, cradle.child_frame_id) == ("rig1/track", "rig1/cradle")
    assert {t.child_frame_id for t in heard["/tf_static"][0].transforms} == {PREFIX + gap for gap in GAPS}
