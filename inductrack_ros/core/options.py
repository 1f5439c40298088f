# SPDX-License-Identifier: Apache-2.0
"""Parameters that are no numbers of the physics: what else a model is made of, and the `sim` node's own.

The node's stand here and not with the node, so that a parameter file made for it can be read as a model without ROS.
"""

from __future__ import annotations

from dataclasses import dataclass

from .errors import InputError
from .parameters import OURS, Parameter

DRIVES = ("averaged", "pulses")
TRACKS = ("averaged", "coils")
#: Stands in a list of coil numbers for no coil: an empty list has no type in ROS 2.
NO_COIL = -1
#: What people call the types of YAML and ROS 2.
_CALLED = {bool: "true or false, without quotes", int: "a whole number", str: "text, in quotes"}


@dataclass(frozen=True)
class Option:
    """A parameter that is not a real number: a switch, a name, a whole number, a list of either; the default of a list
    means an empty one."""

    default: bool | int | str | list
    meaning: str
    choices: tuple[str, ...] = ()
    low: int = 0
    high: int = 2**31

    def check(self, name: str, value: object, where: str = "") -> object:
        """Return the value, or raise `InputError` naming the parameter and what it may be."""
        place = f"{where}: " if where else ""
        if isinstance(self.default, list):
            if value == []:
                return self.default
            kind = type(self.default[0])
            if not isinstance(value, list) or any(type(v) is not kind for v in value):
                raise InputError(f"{place}{name} = {value!r:.60} must be a list; each entry {_CALLED[kind]}")
        elif type(value) is not type(self.default):
            raise InputError(f"{place}{name} = {value!r} must be {_CALLED[type(self.default)]}")
        elif self.choices and value not in self.choices:
            raise InputError(f"{place}{name} = {value!r} must be one of {', '.join(self.choices)}")
        elif type(value) is int and not self.low <= value <= self.high:
            raise InputError(f"{place}{name} = {value} is out of range; it must lie in [{self.low}, {self.high}]")
        return value


#: Of a track of single coils, ``track: coils``.
COIL_OPTIONS: dict[str, Parameter | Option] = {
    "coil_pitch": Parameter(
        0.0, "m", 0.0, 1.0, "distance from coil to coil; 0: wavelength / coils_per_wavelength, as averaged", OURS
    ),
    "array_spacing": Parameter(0.55, "m", 0.0, 100.0, "from the middle of the front set of arrays to the rear's", OURS),
    "array_wavelengths": Parameter(1.0, "", 0.5, 100.0, "length of each set, front and rear, in wavelengths", OURS),
    "mutual_inductance": Parameter(
        0.0, "H", -1e-2, 1e-2, "mutual inductance M of a coil and its neighbour, the next but one, …", OURS, count=6
    ),
    "failed_coils": Option([NO_COIL], "numbers of coils that are open or missing; coil n stands at n × coil_pitch"),
    "damaged_coils": Option([NO_COIL], "numbers of coils whose resistance is damage_factor times that of others"),
    "damage_factor": Parameter(
        2.0,
        "",
        1e-3,
        1e6,
        "resistance of damaged coils over that of whole ones: one for all, or one each",
        OURS,
        count=64,
    ),
}

#: Parameters of the model that say where coils stand: currents in flight are of these places.
COIL_PLACES = frozenset({"wavelength", "coils_per_wavelength"})

#: What a model is made of besides its numbers.
MODEL_OPTIONS: dict[str, Parameter | Option] = {
    "dof": Option(4, "degrees of freedom: 1 (heave), 2 (surge, heave) or 4", low=1, high=4),
    "drive": Option("averaged", "thrust by the averaged law, or by the pulses on drive_pulses", DRIVES),
    "track": Option("averaged", "lift and drag by the averaged law, or from the current of each lifting coil", TRACKS),
    **COIL_OPTIONS,
    "effects": Option([""], "effects that are on, e.g. aerodynamic_drag"),
    "effect_files": Option([""], "Python files with effects of your own"),
}

#: The `sim` node's own, besides its sensors', which all begin with ``measured.``
SIM: dict[str, Parameter | Option] = {
    "rate": Parameter(500.0, "Hz", 1.0, 1000.0, "ticks to a simulated second; pose and twist are published at each"),
    "details_rate": Parameter(50.0, "Hz", 0.1, 1000.0, "how often odometry, gaps and wrenches are published"),
    "speed_factor": Parameter(1.0, "", 1e-3, 1e3, "simulated seconds to a real second"),
    "lockstep": Option(False, "wait at each tick for a controller's answer on lockstep/done"),
    "lockstep_timeout": Parameter(5.0, "s", 0.1, 3600.0, "say so when no answer came for so long"),
    "command_timeout": Parameter(
        1.0, "s", 0.01, 3600.0, "simulated time without a drive pulse after which the controller counts as lost"
    ),
    "again": Option(
        True,
        "a cradle that stands, or is past the end of its track, begins its run anew, and stamps go on; not in lockstep,"
        " with listeners other than a controller, or while a node listens whose name has record in it",
    ),
    "paused": Option(False, "start standing still, until the pause service says otherwise"),
    "listeners": Option(0, "time begins when so many subscribe to pose, so that a recorder misses nothing", high=1000),
    "publish_clock": Option(False, "publish /clock; simulated time then begins at 0, else at the time of the start"),
    "clock_rate": Parameter(
        100.0, "Hz", 0.1, 1000.0, "how often /clock is published, in simulated time; no more than rate"
    ),
    "initial_state": Option("surge_rate=15.5", "name=value,…; heave is the equilibrium's unless given"),
    "track_length": Parameter(1000.0, "m", 0.1, 1e6, "length of track that has drive coils, one every λ/2"),
    "max_pulse_current": Parameter(2e4, "A", 0.0, 1e6, "a drive pulse of more is refused"),
    "track_frame": Option("track", "frame of poses, twists and wrenches"),
    "cradle_frame": Option("cradle", "frame that moves with the cradle"),
    "frame_prefix": Option("", "put before the name of every frame, e.g. rig1/"),
    "reliability": Option(
        "reliable",
        "quality of service of what is published; sensor_data: best effort for what is under measured/; transforms and "
        "/clock are always reliable",
        ("reliable", "best_effort", "sensor_data"),
    ),
    "seed": Option(-1, "seed of the sensors' noise; −1: another at every start", low=-1),
}
SENSORS = "measured."
#: How the names of parameters begin that ROS 2 gives every node.
OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def is_of_the_node(name: str) -> bool:
    """Whether a parameter is the node's and no business of the model."""
    return name in SIM or name.startswith((SENSORS, *OF_ROS))
