# SPDX-License-Identifier: Apache-2.0
"""A cradle that has come to rest: what to say, and whether its run begins anew."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from .listeners import recorders
from .simulation import Simulation

STANDS = 0.01  # m/s; friction lets a cradle creep for ever


class Rest:
    """Looked at once a second. A cradle that began at rest is left alone."""

    def __init__(self, node: Node, options: Mapping[str, object]) -> None:
        self._node = node
        self._may_begin_anew = options["again"] and not options["lockstep"] and not options["listeners"]
        self._said = self._rested = False

    def look(self, simulation: Simulation) -> bool:
        """Whether a new run is due: it has been at rest for two looks, and nobody records. Says once that it rests, and
        why."""
        rests = abs(simulation.x[4]) < STANDS and abs(simulation.begun_at) > STANDS
        due = rests and self._rested and self._may_begin_anew and not recorders(self._node, "pose")
        self._rested = rests and not due
        if rests and not self._said:
            self._said = True
            self._node.get_logger().warning(self._sentence(simulation))
        return due

    def _sentence(self, simulation: Simulation) -> str:
        after = (
            "runs begin anew until this node ends (again:=false: they do not)"
            if self._may_begin_anew
            else "reset begins anew"
        )
        model = simulation.model
        if model.drive == "pulses":
            why = "no controller holds its speed; start track_controller with -p mode:=speed"
        else:
            why = (
                f"below its balance speed drag beats the thrust of {model.parameters['drive_current']:g} A; start it"
                " faster (initial_state:=surge_rate=17), or hold its speed: drive:=pulses here, and track_controller"
                " -p mode:=speed"
            )
        return f"the cradle has come to rest after {simulation.travelled:.1f} m: {why}. {after[0].upper()}{after[1:]}"
