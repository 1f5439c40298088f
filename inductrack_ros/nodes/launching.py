# SPDX-License-Identifier: Apache-2.0
"""What `inductrack.launch.py` starts, decided from its arguments before anything runs. No import of launch: see the
file itself.

An argument that is left empty leaves the matter to the parameter file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches

from ..core.options import DRIVES, SIM
from ..core.parameter_files import merged, read_blocks
from .runtime import NAMESPACE
from .simulation import parse_initial_state

ON_OFF = ("true", "false")
OPEN = ("", *ON_OFF)
AS_FILE = "; empty: as params_file says"
LOST = 255  # status that launch reports of a process whose own it has lost, see `failed`


@dataclass(frozen=True)
class Argument:
    """One argument of the launch file; without ``choices`` it takes any text."""

    default: str
    meaning: str
    choices: tuple[str, ...] = ()


ARGUMENTS = {
    "params_file": Argument(
        "",
        "parameter file for all nodes: a model that `inductrack diagnose` wrote, or a copy of config/default.yaml,"
        " which is the default",
    ),
    "namespace": Argument(NAMESPACE, "namespace of all nodes and topics"),
    "frame_prefix": Argument("", f"put before the name of every frame, e.g. rig1/{AS_FILE}"),
    "drive": Argument(
        "", f"averaged (no controller needed), or pulses (the controller fires the coils){AS_FILE}", ("", *DRIVES)
    ),
    "initial_state": Argument("", f"name=value,…, e.g. surge_rate=17{AS_FILE}"),
    "controller": Argument("", "start track_controller; empty: where the drive is pulses", OPEN),
    "lockstep": Argument("", f"simulated time waits for the controller{AS_FILE}", OPEN),
    "monitor": Argument("false", "start the monitor, which says where the model fails", ON_OFF),
    "bag": Argument("", "record the namespace's topics into this new folder, from the first message on; empty: do not"),
    "rviz": Argument("false", "start RViz with track, cradle, gaps and force arrows", ON_OFF),
    "rviz_config": Argument("", "configuration of RViz; empty: ours, with the topics and frames of this rig"),
    "publish_clock": Argument(
        "", "sim publishes /clock; empty: with use_sim_time:=true, else as params_file says", OPEN
    ),
    "use_sim_time": Argument("", f"the other nodes take their time from /clock{AS_FILE}", OPEN),
    "log_level": Argument("info", "least severity that the nodes log", ("debug", "info", "warn", "error", "fatal")),
}


@dataclass(frozen=True)
class Started:
    """A process to start. ``parameters`` come after the parameter file, where it ``reads_file``; if ``needed``, its end
    ends the launch."""

    executable: str
    parameters: dict[str, object] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()
    reads_file: bool = True
    needed: bool = True


def failed(status: int, ending: bool) -> bool:
    """Whether a process with this status failed; ``ending``: launch has told all processes to end.

    Where a process ends just as launch signals it, Python before 3.12.5 can lose its status (cpython#87744). asyncio
    then says "Unknown child process" and makes it 255. No node of ours ends with that."""
    return status != 0 and not (ending and status == LOST)


def misspelt(configurations: Iterable[str]) -> list[str]:
    """What to say of names that are nearly those of `ARGUMENTS`: launch passes over what it does not know, and a file
    that includes ours may have arguments of its own."""
    close = {
        name: get_close_matches(name, ARGUMENTS, n=1, cutoff=0.85) for name in configurations if name not in ARGUMENTS
    }
    return [f"no argument '{name}'; did you mean '{near[0]}'?" for name, near in close.items() if near]


def plan(given: Mapping[str, str], namespace: str) -> list[Started]:
    """What to start for arguments as they were given, in an absolute ``namespace``. Raises `InputError`."""
    file = merged(block for block in read_blocks(given["params_file"]) if block.is_for(f"{namespace.rstrip('/')}/sim"))
    asked = {name: given[name] for name in ("drive", "initial_state", "frame_prefix") if given[name]}
    asked |= {name: given[name] == "true" for name in ("lockstep", "publish_clock") if given[name]}
    parse_initial_state(asked.get("initial_state", ""))
    clock = {"use_sim_time": given["use_sim_time"] == "true"} if given["use_sim_time"] else {}
    if clock.get("use_sim_time"):
        asked.setdefault("publish_clock", True)
    known = {name: asked.get(name, file.get(name, SIM[name].default)) for name in ("lockstep", "listeners")}
    drive = asked.get("drive", file.get("drive", DRIVES[0]))

    others = []
    if given["controller"] == "true" or (not given["controller"] and drive == "pulses"):
        others.append(Started("track_controller", clock | {"lockstep": known["lockstep"]}))
    if given["bag"]:
        others.append(Started("record", clock, (f"--output={given['bag']}",), reads_file=False))
    if len(others) > known["listeners"]:  # time begins once all of them listen
        asked["listeners"] = len(others)
    if given["monitor"] == "true":
        others.append(Started("monitor", clock | {"drive": drive}, needed=False))
    return [*others, Started("sim", asked)]


def rviz_configuration(text: str, namespace: str, given: Mapping[str, str]) -> str:
    """Our configuration of RViz with a rig's topics and frames."""
    file = merged(block for block in read_blocks(given["params_file"]) if block.is_for(f"{namespace.rstrip('/')}/sim"))
    prefix = given["frame_prefix"] or file.get("frame_prefix", SIM["frame_prefix"].default)
    text = text.replace(f"Value: /{NAMESPACE}/", f"Value: {namespace.rstrip('/')}/")
    for role, frame in (("Fixed", "track"), ("Target", "cradle")):
        name = f"{prefix}{file.get(f'{frame}_frame', SIM[f'{frame}_frame'].default)}"
        text = text.replace(f"{role} Frame: {frame}\n", f"{role} Frame: {json.dumps(name)}\n")
    return text
