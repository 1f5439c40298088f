# SPDX-License-Identifier: Apache-2.0
"""The nodes' topics, services and parameters as tables: ``python -m inductrack_ros.nodes.interface_tables``.

Topics and services are asked of the running nodes, parameters of their declarations; docs/interfaces.md holds what is
printed."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable, Mapping

import rclpy
from rclpy.qos import ReliabilityPolicy

from ..core import rig
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import CHANNEL, FURTHER_SENSORS, INSTRUMENTS
from . import monitor, play, record
from .domain import claim_domain
from .parameters import MODEL_OPTIONS, Option
from .sim import LIVE as SIM_LIVE
from .sim import OWN, SimNode
from .topics import TFMessage
from .track_controller import DECLARED, TrackController
from .track_controller import LIVE as CONTROLLER_LIVE

#: Topic (groups by `*`) → what it holds: frame and unit.
MEANINGS = {
    "pose": "the truth at every tick; frame `track`; m",
    "twist": "the truth at every tick; frame `track`; m/s, rad/s",
    "odometry": "pose in `track`, twist in `cradle`; `details_rate`",
    "gap_*": "`gap_top`, `gap_right`, `gap_left`, each in a frame of its name; m, negative in contact; `details_rate`",
    "wrench/*": (
        "`lift`, `slip`, `drag`, `thrust`, `contact`, `weight`, `total` and each active effect of the cradle; "
        "`track`; N, N·m; `details_rate`"
    ),
    "forces": "the wrenches' forces as arrows in `track`, 2 mm to a newton; `details_rate`",
    "scene": "track, cradle and gaps as markers in `track`; `details_rate`",
    "measured/pose": "what a rig would measure; `track`; m; `measured.pose.rate`",
    "measured/twist": "likewise; `track`; m/s, rad/s",
    "measured/imu": (
        "likewise, specific force in `cradle`, its noise as covariance; m/s²; orientation and turn rate not measured"
    ),
    "measured/gap_*": "likewise; m",
    "fired_pulses": "what was fired, as on `drive_pulses`; `point.z`: how many with this one",
    "drive_pulses": "stamp: begin of the half sine; `point.x`: coil; `point.y`: A, with sign",
    "residual/pose": "measured minus the model's run through the window, at the stamps measured; not in contact",
    "residual/twist": "likewise",
    "missing_force": (
        "the constant force that the model lacks in a window, stamped in its middle; `track`; N, N·m; not in contact"
    ),
    "missing_force_sigma": "its standard deviation",
    "lockstep/done": "[stamp of the pose answered (ns), pulses sent]; with `lockstep`",
    "/clock": "simulated time; `clock_rate`; with `publish_clock`",
    "/tf": "`track` → `cradle`; `details_rate`; on a distribution only (no wheel of `tf2_msgs`)",
    "/tf_static": "`cradle` → `gap_top`, `gap_right`, `gap_left`, x towards the track; transient local; likewise",
    "/diagnostics": (
        "once a second: deadline misses, late and refused pulses, contacts, lost controllers, others of the kind; "
        "misfits of photodiodes, missing poses; the monitor's verdict"
    ),
}
for _sensor in FURTHER_SENSORS:
    _what = ", ".join(
        f"`{CHANNEL[c].field}`: {CHANNEL[c].title[:1].lower()}{CHANNEL[c].title[1:]}, {CHANNEL[c].unit or '1'}"
        for c in INSTRUMENTS[_sensor].channels
    )
    _off = "" if INSTRUMENTS[_sensor].rate else f"; off unless `measured.{_sensor}.rate` is set"
    MEANINGS[f"measured/{_sensor}"] = f"what a rig would measure; `cradle`; {_what}{_off}"
    MEANINGS[f"residual/{_sensor}"] = f"as `residual/pose`; {_what}"
SERVICES = {
    "pause": "`data: true` holds simulated time, `false` goes on",
    "step": "one tick, only while paused",
    "reset": "back to the initial state",
}
_OURS_NOT = ("/rosout", "/parameter_events")


def text() -> str:
    """All tables, as Markdown."""
    model = {**PARAMETERS, **MODEL_OPTIONS}
    own = {n: p for n, p in OWN.items() if n not in rig.declared()}
    shared = [n for n in DECLARED if n in PARAMETERS]
    return "\n\n".join(
        [
            "**Topics**, in the namespace `inductrack` unless they begin with `/`. Keep last, volatile unless said."
            " Published by `sim` as `reliability` asks; `qos_overrides.TOPIC.publisher.reliability`, `.depth` and"
            " `.history` (`.subscription.…`) change any of them. `frame_prefix` stands before every frame.\n\n"
            + _topics(),
            "**Services** of `sim`\n\n" + _services(),
            "**Parameters of `sim`**; those with * may change while it runs\n\n" + _parameters(own, SIM_LIVE),
            "Its sensors, all *: SENSOR is "
            + ", ".join(f"`{s}`" for s in rig.SENSORS)
            + "; CHANNEL what they deliver.\n\n"
            + _sensors(),
            "The model's, of `sim` as well; those of effects are in [effects.md](effects.md), `EFFECT.PARAMETER`, all"
            " *\n\n" + _parameters(model, SIM_LIVE),
            "**Parameters of `track_controller`**; "
            + ", ".join(f"`{n}`" for n in shared)
            + " are declared as above, `drive_current` with *\n\n"
            + _parameters({n: p for n, p in DECLARED.items() if n not in PARAMETERS}, CONTROLLER_LIVE),
            "**Parameters of `monitor`**; the model's are declared as above, all *\n\n" + _monitor(),
            "**Options of `record`**, which has no parameters\n\n" + _options(record.parse),
            "**Options of `play`**, which has no parameters either\n\n" + _options(play.parse),
        ]
    )


def _ask(make_node: type, *parameters: str) -> tuple[list, list]:
    """(topic, type, direction, qos) of a node's topics and (name, type) of its services, without those of ROS
    itself."""
    rclpy.init(args=["--ros-args", *(word for p in parameters for word in ("-p", p)), "--log-level", "warn"])
    try:
        node = make_node()
        ends = [(e, "out") for e in node.publishers] + [(e, "in") for e in node.subscriptions]
        topics = [(_short(e.topic_name), _type(e.msg_type), way, _qos(e.qos_profile)) for e, way in ends]
        path = node.get_fully_qualified_name()
        services = [
            (s.srv_name.removeprefix("~/").removeprefix(f"{path}/"), _type(s.srv_type))
            for s in node.services
            if s.srv_type.__module__.startswith("std_srvs")
        ]
        node.destroy_node()
        return [t for t in topics if t[0] not in _OURS_NOT], services
    finally:
        rclpy.try_shutdown()


def _short(topic: str) -> str:
    topic = topic.removeprefix("/inductrack/")
    return re.sub(r"^wrench/.*", "wrench/*", re.sub(r"gap_\w+", "gap_*", topic))


def _type(kind: type) -> str:
    return kind.__module__.partition(".")[0] + "/" + kind.__name__


def _qos(profile: object) -> str:
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    return f"{'reliable' if reliable else 'best effort'}, {profile.depth}"


def _topics() -> str:
    found: dict[str, tuple[str, dict[str, None]]] = {}
    for name, make, parameters in (
        ("sim", SimNode, ("lockstep:=true", "publish_clock:=true")),
        ("track_controller", TrackController, ("lockstep:=true",)),
        ("track_controller", TrackController, ()),
        ("monitor", monitor.MonitorNode, ()),
    ):
        for topic, kind, way, qos in _ask(make, *parameters)[0]:
            ends = found.setdefault(topic, (kind, {}))[1]
            if f"{name} {way}: {qos}" not in ends:
                second = any(end.startswith(f"{name} {way}") for end in ends)  # another quality of service when free
                ends[f"{name} {way}{' (not in lockstep)' if second else ''}: {qos}"] = None
    if TFMessage is None:  # the wheels lack it; the table is the same everywhere
        found["/tf"] = ("tf2_msgs/TFMessage", dict(found["/clock"][1]))
        found["/tf_static"] = ("tf2_msgs/TFMessage", {"sim out: reliable, 1": None})
    rows = [
        f"| `{topic}` | {found[topic][0]} | {'<br>'.join(found[topic][1])} | {meaning} |"
        for topic, meaning in MEANINGS.items()
    ]
    if set(found) != set(MEANINGS):
        raise LookupError(f"topics without a meaning here, or the reverse: {set(found) ^ set(MEANINGS)}")
    return "\n".join(["| topic | type | who, direction: QoS, depth | frame, unit, rate |", "|---|---|---|---|", *rows])


def _services() -> str:
    found = dict(_ask(SimNode)[1])
    if set(found) != set(SERVICES):
        raise LookupError(f"services without a meaning here, or the reverse: {set(found) ^ set(SERVICES)}")
    rows = [f"| `/inductrack/sim/{n}` | {found[n]} | {meaning} |" for n, meaning in SERVICES.items()]
    return "\n".join(["| service | type | |", "|---|---|---|", *rows])


def _parameters(declared: Mapping[str, Parameter | Option], live: set[str]) -> str:
    rows = [_row(name + ("`*" if name in live else "`"), one) for name, one in declared.items()]
    return "\n".join([_HEAD, *rows])


_HEAD = "| parameter | default | range | |\n|---|---|---|---|"


def _row(name: str, one: Parameter | Option) -> str:
    if isinstance(one, Parameter):
        default, limits = f"{one.default:.6g}", f"{one.low:g} … {one.high:g}" + f" {one.unit}".rstrip()
    else:
        default = str(one.default).lower() if isinstance(one.default, bool) else str(one.default).replace("''", "")
        limits = ", ".join(one.choices) or (f"{one.low} … {one.high}" if type(one.default) is int else "")
    return f"| `{name} | {default} | {limits} | {one.meaning} |"


def _sensors() -> str:
    """One row for each kind of sensor parameter, with the values of all channels where they differ."""
    kinds: dict[str, dict[str, Parameter]] = {}
    for name, one in rig.declared().items():
        _, who, kind = name.split(".")
        kinds.setdefault(kind, {})[who] = one
    rows = []
    for kind, by in kinds.items():
        who = "SENSOR" if kind in ("rate", "dropout") else "CHANNEL"
        first = next(iter(by.items()))
        meaning = first[1].meaning.replace(first[0], who)
        values: dict[str, list[str]] = {}
        for name, one in by.items():
            unit = f" {one.unit}" if kind != "bias" and one.unit else ""
            values.setdefault(f"{one.default:g}{unit}", []).append(name)
        defaults = (
            list(values)[0] if len(values) == 1 else "<br>".join(f"{v}: {', '.join(n)}" for v, n in values.items())
        )
        rows.append(f"| `measured.{who}.{kind}` | {defaults} | {first[1].low:g} … {first[1].high:g} | {meaning} |")
    return "\n".join([_HEAD, *rows])


def _monitor() -> str:
    own = {n: p for n, p in monitor.OWN.items() if n not in rig.declared()}
    noise = (
        "| `measured.CHANNEL.noise` | as `sim`'s | | standard deviation of the noise; a larger one found is used, a"
        " smaller one is not |"
    )
    return _parameters(own, set()) + "\n" + noise


def _options(parse: Callable[[list[str]], object]) -> str:
    """From `record -h` and `play -h`, whose layout depends on the version of Python and is therefore not kept."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        parse(["-h"])
    rows = []
    for entry in re.split(r"\n  (?=\S)", said.getvalue().partition("positional arguments:")[2])[1:]:
        name, _, meaning = re.sub(r"\n\n.*|\n\w+:\s*$", "", entry, flags=re.DOTALL).partition("  ")
        if "\n" in name:
            name, _, meaning = entry.partition("\n")
        name = re.sub(r"^(-\w) .*?, (?=--)", r"\1, ", name.strip())  # Python before 3.13 says the value twice
        if "--help" not in name:
            rows.append(f"| `{name}` | {' '.join(meaning.split()).replace('<', chr(92) + '<')} |")
    return "\n".join(["| option | |", "|---|---|", *rows])


def main() -> None:
    with claim_domain():
        print(text())


if __name__ == "__main__":
    main()
