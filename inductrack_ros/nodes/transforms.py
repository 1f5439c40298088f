# SPDX-License-Identifier: Apache-2.0
"""Where frames stand: the cradle in the track's, each gap sensor in the cradle's."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from scipy.spatial.transform import Rotation

from .. import frames
from .scene import arrays


def transform(stamp: Time, parent: str, child: str, position: np.ndarray, quaternion: np.ndarray) -> TransformStamped:
    """``position`` (3,) in m and ``quaternion`` (4,), x y z w, of the child in its parent."""
    message = TransformStamped(child_frame_id=child)
    message.header.stamp, message.header.frame_id = stamp, parent
    to, turned = message.transform.translation, message.transform.rotation
    to.x, to.y, to.z = map(float, position)
    turned.x, turned.y, turned.z, turned.w = map(float, quaternion)
    return message


def cradle_transform(stamp: Time, track: str, cradle: str, coordinates: np.ndarray) -> TransformStamped:
    """Of the cradle at ``coordinates`` (4,), in its track's frame."""
    return transform(stamp, track, cradle, *frames.coordinates_to_pose(coordinates))


def gap_transforms(stamp: Time, cradle: str, prefix: str, parameters: Mapping[str, float]) -> list[TransformStamped]:
    """Of ``gap_top``, ``gap_right``, ``gap_left``: in the middle of each array, x towards the track, as a Range has
    it."""
    made = []
    for face, centre, outward in arrays(parameters):
        x = np.array([0.0, *(-outward)])
        travel = np.array([1.0, 0.0, 0.0])
        turned = Rotation.from_matrix(np.column_stack([x, np.cross(travel, x), travel])).as_quat()
        made.append(transform(stamp, cradle, f"{prefix}gap_{face}", np.array([0.0, *centre]), turned))
    return made
