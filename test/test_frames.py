# SPDX-License-Identifier: Apache-2.0
"""Paper frame ↔ ROS: proper rotations, right signs, there and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from inductrack_ros import frames

numbers = st.floats(-1e3, 1e3)
triples = arrays(float, (5, 3), elements=numbers)
fours = arrays(float, (5, 4), elements=numbers)
angles = arrays(float, 5, elements=st.floats(-3.1, 3.1))


def test_the_three_paper_axes_are_left_up_forward():
    left, up, forward = np.eye(3)
    assert frames.paper_to_ros(left).tolist() == [0, 1, 0]
    assert frames.paper_to_ros(up).tolist() == [0, 0, 1]
    assert frames.paper_to_ros(forward).tolist() == [1, 0, 0]


def test_the_change_of_frame_is_a_proper_rotation():
    matrix = frames.paper_to_ros(np.eye(3)).T
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    assert np.array_equal(matrix @ matrix.T, np.eye(3))


@settings(deadline=None)
@given(triples)
def test_vectors_come_back(vectors):
    assert np.array_equal(frames.ros_to_paper(frames.paper_to_ros(vectors)), vectors)


@settings(deadline=None)
@given(angles)
def test_roll_comes_back_from_a_unit_quaternion(roll):
    quaternion = frames.roll_to_quaternion(roll)
    assert np.allclose(np.linalg.norm(quaternion, axis=-1), 1.0)
    assert np.allclose(frames.quaternion_to_roll(quaternion), roll, atol=1e-12)


def test_positive_roll_lifts_the_left_side_into_the_top():
    # About ROS x (forward) the left axis y turns towards up, z: the right-hand rule.
    x, y, z, w = frames.roll_to_quaternion(np.pi / 2)
    assert (x, y, z, w) == pytest.approx((np.sqrt(0.5), 0, 0, np.sqrt(0.5)))
    assert frames.specific_force_to_accelerations([0, 1, 0], np.pi / 2, gravity=0.0) == pytest.approx([0, 0, 1])


def test_the_length_and_sign_of_a_quaternion_do_not_matter():
    quaternion = frames.roll_to_quaternion(0.3)
    assert frames.quaternion_to_roll(7.0 * quaternion) == pytest.approx(0.3)
    assert frames.quaternion_to_roll(-quaternion) == pytest.approx(0.3)


def test_roll_is_the_roll_of_roll_pitch_yaw():
    roll, pitch, yaw = 0.2, -0.1, 0.4
    c, s = np.cos(np.array([roll, pitch, yaw]) / 2), np.sin(np.array([roll, pitch, yaw]) / 2)
    quaternion = [
        s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
        c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
        c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
    ]
    assert frames.quaternion_to_roll(quaternion) == pytest.approx(roll)


def test_a_zero_quaternion_has_no_roll():
    assert np.isnan(frames.quaternion_to_roll([0, 0, 0, 0]))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("roll", [np.inf, -np.inf, np.nan])
def test_a_roll_that_is_no_number_has_no_quaternion_and_no_warning(roll):
    assert np.isnan(frames.roll_to_quaternion(roll)[[0, 3]]).all()


@settings(deadline=None)
@given(fours)
def test_rates_and_wrenches_come_back(values):
    assert np.array_equal(frames.twist_to_rates(*frames.rates_to_twist(values)), values)
    assert np.array_equal(frames.wrench_to_force(*frames.force_to_wrench(values)), values)


@settings(deadline=None)
@given(arrays(float, (5, 3), elements=numbers), angles)
def test_coordinates_come_back(positions, roll):
    coordinates = np.column_stack([positions, roll])
    assert np.allclose(frames.pose_to_coordinates(*frames.coordinates_to_pose(coordinates)), coordinates, atol=1e-12)


@settings(deadline=None)
@given(fours, angles)
def test_a_twist_in_the_cradle_axes_comes_back(rates, roll):
    linear, angular = frames.rates_to_body_twist(rates, roll)
    assert np.allclose(frames.body_twist_to_rates(linear, angular, roll), rates, atol=1e-9)
    assert np.allclose(np.linalg.norm(linear, axis=-1), np.linalg.norm(rates[:, :3], axis=-1))


def test_words_stand_in_ros_order():
    linear, angular = frames.rates_to_twist([15.0, 0.1, -0.2, 0.3])
    assert linear.tolist() == [15.0, 0.1, -0.2]
    assert angular.tolist() == [0.3, 0.0, 0.0]
    # The same from the paper's (x, y, z) = (sway, heave, surge) and its rotation about z.
    assert frames.paper_to_ros([0.1, -0.2, 15.0]).tolist() == [15.0, 0.1, -0.2]
    assert frames.paper_to_ros([0.0, 0.0, 0.3]).tolist() == [0.3, 0.0, 0.0]


def test_an_accelerometer_at_rest_shows_gravity_upwards():
    assert frames.accelerations_to_specific_force([0, 0, 0], 0.0) == pytest.approx([0, 0, 9.81])
    # Rolled by θ (left side up), the left axis points up by sin θ.
    tilted = frames.accelerations_to_specific_force([0, 0, 0], 0.1)
    assert tilted == pytest.approx([0, 9.81 * np.sin(0.1), 9.81 * np.cos(0.1)])


def test_an_accelerometer_in_free_fall_shows_nothing():
    assert frames.accelerations_to_specific_force([0, 0, -9.81], 0.7) == pytest.approx([0, 0, 0])


@settings(deadline=None)
@given(triples, angles, st.floats(0, 20))
def test_specific_force_comes_back(accelerations, roll, gravity):
    felt = frames.accelerations_to_specific_force(accelerations, roll, gravity)
    assert np.allclose(frames.specific_force_to_accelerations(felt, roll, gravity), accelerations, atol=1e-9)


def test_nothing_is_changed_in_place():
    force, acceleration = np.ones(3), np.ones(3)
    frames.specific_force_to_accelerations(force, 0.0)
    frames.accelerations_to_specific_force(acceleration, 0.0)
    assert force.tolist() == acceleration.tolist() == [1, 1, 1]
