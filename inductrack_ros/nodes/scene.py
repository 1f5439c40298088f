# SPDX-License-Identifier: Apache-2.0
"""What a viewer such as RViz draws of the rig: the track near the cradle, the cradle's arrays, the gaps between."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker

from .. import frames

LENGTH = 6.0  # m of track that is drawn; it moves on by whole metres as the cradle does
THICKNESS = 0.015  # m, of track and arrays
NARROW = 2e-3  # m; a gap below this is drawn as a warning
TRACK = (0.6, 0.6, 0.6, 0.5)
CRADLE = (0.2, 0.35, 0.6, 0.9)
WIDE_GAP = (0.1, 0.7, 0.2, 1.0)
NARROW_GAP = (0.9, 0.1, 0.1, 1.0)
#: Tilt (rad about the travel) and outward normal (y left, z up) of the top, right and left faces of the track.
TILTS = (0.0, 0.75 * np.pi, -0.75 * np.pi)
_C = np.sqrt(0.5)
OUTWARD = ((0.0, 1.0), (-_C, -_C), (_C, -_C))


def arrays(parameters: Mapping[str, float]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name, centre (2,) in m and outward normal (2,) of the cradle's arrays, y left and z up of its centre of mass."""
    offset, side = parameters["magnet_side_offset"], parameters["magnet_side_height"]
    centres = (0.0, parameters["magnet_top_height"]), (-offset, side), (offset, side)
    return [(n, np.array(c), np.array(o)) for n, c, o in zip(("top", "right", "left"), centres, OUTWARD, strict=True)]


def scene(
    parameters: Mapping[str, float], coordinates: np.ndarray, gaps: Iterable[float], stamp: Time, frame: str
) -> list[Marker]:
    """Markers of the track, the cradle at ``coordinates`` (4,) and the ``gaps`` (3,) in m: top, right, left."""
    p = parameters
    surge, sway, heave, roll = coordinates.tolist()
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    near = float(np.floor(surge))
    markers = []

    def add(
        kind: int, name: str, colour: tuple[float, ...], scale: tuple[float, float, float], place, tilt=0.0
    ) -> Marker:
        marker = Marker(ns=name, id=0, type=kind)
        marker.header.stamp, marker.header.frame_id = stamp, frame
        marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = map(float, place)
        turned = marker.pose.orientation
        turned.x, turned.y, turned.z, turned.w = frames.roll_to_quaternion(tilt).tolist()
        marker.scale.x, marker.scale.y, marker.scale.z = scale
        marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour
        markers.append(marker)
        return marker

    for (face, centre, outward), tilt, gap in zip(arrays(p), TILTS, gaps, strict=True):
        width = p["width_top" if face == "top" else "width_side"]
        surface = centre - p["nominal_gap"] * outward  # where the track ends
        array = turn @ centre + (sway, heave)
        add(
            Marker.CUBE,
            f"track {face}",
            TRACK,
            (LENGTH, width, THICKNESS),
            (near, *(surface - 0.5 * THICKNESS * outward)),
            tilt,
        )
        outside = array + 0.5 * THICKNESS * (turn @ outward)
        add(Marker.CUBE, f"array {face}", CRADLE, (p["array_length"], width, THICKNESS), (surge, *outside), tilt + roll)
        colour = NARROW_GAP if gap < NARROW else WIDE_GAP
        line = add(Marker.LINE_LIST, f"gap {face}", colour, (0.003, 0.0, 0.0), (0.0, 0.0, 0.0))
        front = surge + 0.5 * p["array_length"]
        line.points = [Point(x=front, y=float(y), z=float(z)) for y, z in (array, array - gap * outward)]
        words = add(
            Marker.TEXT_VIEW_FACING, f"gap {face} (mm)", colour, (0.0, 0.0, 0.03), (front, *(array + 0.04 * outward))
        )
        words.text = f"{1e3 * gap:.1f} mm"
    return markers
