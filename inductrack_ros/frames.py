# SPDX-License-Identifier: Apache-2.0
"""Between the paper's frame and ROS (REP-103): the only module that knows both.

Paper: x lateral (left), y up, z forward, roll about z. ROS: x forward, y left, z up, roll about x.
`(x, y, z)_ros = (z, x, y)_paper`, a proper rotation, so forces, moments and angular rates map like positions.
The vehicle-dynamics words stand in ROS order: surge, sway, heave are ROS x, y, z and roll turns about ROS x.

Every function takes arrays of any leading shape, and single vectors. Quaternions are (x, y, z, w), as in messages.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: m/s², the paper's value; what an accelerometer at rest shows upwards.
GRAVITY = 9.81


def paper_to_ros(vectors: ArrayLike) -> Array:
    """Turn vectors (..., 3) of the paper's frame into ROS axes."""
    return np.asarray(vectors, float)[..., [2, 0, 1]]


def ros_to_paper(vectors: ArrayLike) -> Array:
    """Turn vectors (..., 3) in ROS axes into the paper's frame."""
    return np.asarray(vectors, float)[..., [1, 2, 0]]


def roll_to_quaternion(roll: ArrayLike) -> Array:
    """Quaternions (..., 4) of a roll (...) in rad about ROS x; NaN where the roll is no number or infinite."""
    half = 0.5 * np.asarray(roll, float)
    zero = np.zeros_like(half)
    with np.errstate(invalid="ignore"):
        return np.stack([np.sin(half), zero, zero, np.cos(half)], axis=-1)


def quaternion_to_roll(quaternion: ArrayLike) -> Array:
    """Roll (...) in rad, within ±π, of quaternions (..., 4); NaN where the quaternion is zero.

    The length does not matter. A pitch or yaw (a sensor mounted askew) is left out, as in the roll of roll-pitch-yaw.
    """
    x, y, z, w = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    roll = np.arctan2(2.0 * (w * x + y * z), w * w + z * z - x * x - y * y)
    return np.where((x == 0) & (y == 0) & (z == 0) & (w == 0), np.nan, roll)


def coordinates_to_pose(coordinates: ArrayLike) -> tuple[Array, Array]:
    """(surge, sway, heave, roll) (..., 4) → position (..., 3) in m and orientation (..., 4)."""
    coordinates = np.asarray(coordinates, float)
    return coordinates[..., :3], roll_to_quaternion(coordinates[..., 3])


def pose_to_coordinates(position: ArrayLike, orientation: ArrayLike) -> Array:
    """Position (..., 3) and orientation (..., 4) → (surge, sway, heave, roll) (..., 4)."""
    return np.concatenate([np.asarray(position, float), quaternion_to_roll(orientation)[..., None]], axis=-1)


def rates_to_twist(rates: ArrayLike) -> tuple[Array, Array]:
    """Rates of the four coordinates (..., 4) → linear and angular velocity (..., 3) in the track's axes."""
    return _split(rates)


def twist_to_rates(linear: ArrayLike, angular: ArrayLike) -> Array:
    """Linear and angular velocity (..., 3) in the track's axes → rates of the four coordinates (..., 4)."""
    return _join(linear, angular)


def rates_to_body_twist(rates: ArrayLike, roll: ArrayLike) -> tuple[Array, Array]:
    """Like `rates_to_twist` in the axes of the rolled cradle: what `nav_msgs/Odometry` wants (its child frame)."""
    linear, angular = _split(rates)
    return _rotate(linear, -np.asarray(roll, float)), angular


def body_twist_to_rates(linear: ArrayLike, angular: ArrayLike, roll: ArrayLike) -> Array:
    """Inverse of `rates_to_body_twist`."""
    return _join(_rotate(linear, roll), angular)


def force_to_wrench(force: ArrayLike) -> tuple[Array, Array]:
    """Generalised force in (surge, sway, heave, roll) (..., 4) → force, N, and torque, N·m (..., 3), track's axes."""
    return _split(force)


def wrench_to_force(force: ArrayLike, torque: ArrayLike) -> Array:
    """Force and torque (..., 3) → generalised force in (surge, sway, heave, roll) (..., 4)."""
    return _join(force, torque)


def specific_force_to_accelerations(specific_force: ArrayLike, roll: ArrayLike, gravity: float = GRAVITY) -> Array:
    """What an Imu measures (..., 3), body axes → second derivatives of surge, sway, heave (..., 3), m/s².

    An accelerometer feels everything but gravity: f = Rᵀ(a + g ẑ) with R the roll about ROS x, so a = R f − g ẑ.
    This is exact for a sensor at the centre of mass (no lever arm) and a level track.
    """
    accelerations = _rotate(specific_force, roll)
    accelerations[..., 2] -= gravity
    return accelerations


def accelerations_to_specific_force(accelerations: ArrayLike, roll: ArrayLike, gravity: float = GRAVITY) -> Array:
    """Inverse of `specific_force_to_accelerations`: at rest and level it is (0, 0, +gravity)."""
    felt = np.array(accelerations, float)
    felt[..., 2] += gravity
    return _rotate(felt, -np.asarray(roll, float))


def _rotate(vectors: ArrayLike, roll: ArrayLike) -> Array:
    """Rotate (..., 3) about ROS x by roll (...)."""
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack(np.broadcast_arrays(x, c * y - s * z, s * y + c * z), axis=-1)


def _split(four: ArrayLike) -> tuple[Array, Array]:
    four = np.asarray(four, float)
    angular = np.zeros((*four.shape[:-1], 3))
    angular[..., 0] = four[..., 3]
    return four[..., :3], angular


def _join(linear: ArrayLike, angular: ArrayLike) -> Array:
    return np.concatenate([np.asarray(linear, float), np.asarray(angular, float)[..., :1]], axis=-1)
