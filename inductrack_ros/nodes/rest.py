# SPDX-License-Identifier: Apache-2.0
"""A run that is over, because the cradle stands or is past its track: what to say, and whether a new one begins."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from .listeners import recorders
from .simulation import Simulation

STANDS = 0.01  # m/s; friction lets a cradle creep for ever


class Rest:
    """Looked at once a second. A cradle that began at rest is left alone. Of the ``listeners`` that time waited for,
    all but the controllers may record."""

    def __init__(self, node: Node, options: Mapping[str, object], controllers: int) -> None:
        self._node = node
        recorded = options["listeners"] > controllers
        self._waits = options["lockstep"]  # for a controller, who says how long a run is
        self._may_begin_anew = options["again"] and not self._waits and not recorded
        self._end_of_track = options["track_length"]
        self._said = self._over = False

    def is_past_track(self, simulation: Simulation) -> bool:
        """Whether the run ends here: nothing holds a cradle beyond its track."""
        return not self._waits and simulation.travelled > self._end_of_track

    def look(self, simulation: Simulation) -> bool:
        """Whether a new run is due: this one has been over for two looks, and nobody records. Says once why it is
        over."""
        rests = abs(simulation.x[4]) < STANDS and abs(simulation.begun_at) > STANDS
        over = rests or simulation.travelled > self._end_of_track
        due = over and self._over and self._may_begin_anew and not recorders(self._node, "pose")
        self._over = over and not due
        if over and not self._said:
            self._said = True
            self._node.get_logger().warning(self._rested(simulation) if rests else self._ran_away(simulation))
        return due

    @property
    def _what_follows(self) -> str:
        if self._may_begin_anew:
            return "Runs begin anew while nobody records, until this node ends (again:=false: they do not)"
        return "Reset begins anew"

    def _rested(self, simulation: Simulation) -> str:
        model = simulation.model
        if model.drive == "pulses":
            why = "no controller holds its speed; start track_controller with -p mode:=speed"
        else:
            why = (
                f"below its balance speed drag beats the thrust of {model.parameters['drive_current']:g} A; start it"
                " faster (initial_state:=surge_rate=17), or hold its speed: drive:=pulses here, and track_controller"
                " -p mode:=speed"
            )
        return f"the cradle has come to rest after {simulation.travelled:.1f} m: {why}. {self._what_follows}"

    def _ran_away(self, simulation: Simulation) -> str:
        if simulation.model.drive == "pulses":
            why = ". A larger track_length lets it fly on"
        else:
            why = (
                ": above its balance speed thrust beats drag; hold its speed: drive:=pulses here, and track_controller"
                " -p mode:=speed"
            )
        return (
            f"the cradle is past the {self._end_of_track:g} m of its track (track_length), at"
            f" {simulation.x[4]:.0f} m/s{why}. {self._what_follows}"
        )
