# SPDX-License-Identifier: Apache-2.0
"""What happened in a run, in words: how far it flew, when it touched the track, when it came to rest."""

from __future__ import annotations

import numpy as np

from .model import Model, Trajectory
from .state import GAPS

#: Slower than this (m/s) is at rest: noise is not a motion backwards.
AT_REST = 0.1
#: Time (s) without contact at the end of a run after which it flies again.
FLIES_AGAIN = 0.1
_TOUCHED = {"gap_top": "touched down", "gap_right": "touched the right side", "gap_left": "touched the left side"}


def story(run: Trajectory) -> str:
    """The run in one line: ``flew 17.1 m, touched down at 1.19 s with 13.2 m/s, at rest since 2.9 s after 29.4 m``."""
    times, speed = run.times, run["surge_rate"]
    travel = run["surge"] - run["surge"][0]
    touching = np.array([run[gap] < 0.0 for gap in GAPS])
    any_touch = touching.any(axis=0)
    ends = f"{travel[-1]:.1f} m and {speed[-1]:.1f} m/s at the end"
    if not any_touch.any():
        low, high = 1e3 * run["gap_top"].min(), 1e3 * run["gap_top"].max()
        return (
            f"flew {travel[-1]:.1f} m, from {speed[0]:.1f} to {speed[-1]:.1f} m/s, top gap {low:.1f} to {high:.1f} mm"
        )
    first = int(np.argmax(any_touch))
    if first:
        words = _TOUCHED[GAPS[int(np.argmax(touching[:, first]))]]
        parts = [f"flew {travel[first]:.1f} m", f"{words} at {times[first]:.2f} s with {speed[first]:.1f} m/s"]
    else:
        parts = ["began in contact with the track"]
    last = int(np.flatnonzero(any_touch)[-1])
    moving = np.flatnonzero(np.abs(speed) > AT_REST)
    if not moving.size:
        parts.append("at rest throughout")
    elif moving[-1] + 1 < len(times):
        rest = moving[-1] + 1
        parts.append(f"at rest since {times[rest]:.2f} s after {travel[rest]:.1f} m")
    elif times[-1] - times[last] > FLIES_AGAIN:
        parts.append(f"flew again from {times[last]:.2f} s, {ends}")
    else:
        parts.append(ends)
    return ", ".join(parts)


def why(model: Model, run: Trajectory, start: np.ndarray, drive_current: float | None = None) -> str:
    """Thrust and drag at ``start`` (8 + effect states,), where the run touched the track or doubled its speed; else
    empty."""
    landed = any((run[gap] < 0.0).any() for gap in GAPS)
    ran_away = run["surge_rate"][-1] > 2.0 * run["surge_rate"][0]
    wrenches = model.wrenches(start, drive_current=drive_current)
    thrust, total = wrenches["thrust"][0], wrenches["total"][0]
    forces = f"from the start: {thrust:.1f} N of thrust against {thrust - total:.1f} N of drag."
    if landed and total < 0.0:
        return f"It slowed down {forces}"
    return f"It sped up {forces}" if ran_away and total > 0.0 else ""
