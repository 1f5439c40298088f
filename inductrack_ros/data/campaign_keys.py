# SPDX-License-Identifier: Apache-2.0
"""Every key of `campaign.yaml`: what it may hold, what it means, and how it is read.

python -m inductrack_ros.data.campaign_keys         prints the table of docs/campaigns.md
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import reprlib
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.errors import InputError, did_you_mean
from ..core.parameters import PARAMETERS
from ..core.paths import missing
from ..core.state import CHANNELS, COORDINATES, as_dof
from ..core.yaml_files import Lines
from .bag_messages import TYPES


@dataclass(frozen=True)
class Key:
    """What a key may hold, what holds where it is absent, and what it means."""

    holds: str
    absent: str
    meaning: str


#: What a fit may move besides the initial states, where the campaign does not say.
FREE = ("eta", "gamma")
KEYS = {
    "name": Key("text", "the folder's name", "what the reports call the campaign"),
    "runs": Key("list of the runs below", "needed", "the measured runs, at least one"),
    "noise_std": Key("channel: number, SI", "estimated", "standard deviation of a channel's noise"),
    "topics": Key(
        f"{', '.join(TYPES)}: topic, or null to leave it out",
        "beside the pose that is named, else under `/inductrack/measured/`, else under `/inductrack/`",
        "topics of the bags",
    ),
    "inputs": Key(
        "name: column of a CSV, or topic:field of a bag (`/bus:point.x`)",
        "none",
        "what else was measured in time, under the name that the model or an effect calls it",
    ),
    "model": Key(
        "file, from the campaign's folder", "the paper's model", "the rig's parameter file; `--model` goes before it"
    ),
    "free": Key("list of parameters", f"[{', '.join(FREE)}]", "what a fit may move besides the initial states"),
    "dof": Key(
        f"1, 2, 4, or a list out of {', '.join(COORDINATES)}",
        "the model's",
        "the coordinates that move; 1: heave, 2: surge and heave, 4: all. The others are held",
    ),
    "limits": Key(
        "state or `drive_current`: [least, most], SI; `contact`: true or false",
        "none; with any, `contact` is false",
        "what a run of the rig may not leave: the run that a diagnosis proposes stays within it from start to end",
    ),
    "sharpen": Key(
        "parameter, e.g. `aerodynamic_drag.drag_area`",
        "none",
        "where a diagnosis leaves nothing open it proposes the run, off the track, that determines this parameter best",
    ),
}
RUN_KEYS = {
    "file": Key("file or folder, from the campaign's folder", "needed", "a CSV, a rosbag2 folder, or one of its files"),
    "drive_current": Key(
        "number, A", "needed, but for a bag with pulses or where `inputs` has it", "the drive's current; 0 is coasting"
    ),
    "initial_state": Key("state: number, SI", "estimated", "what is known of the state at the first sample"),
    "conditions": Key(
        "name: number",
        "none",
        "numbers of this run: one with a model parameter's name takes its place (`mass: 9.42`), others are there for"
        " effects (`track_temperature: 31.0`)",
    ),
}


def table() -> str:
    """The keys in Markdown, as docs/campaigns.md shows them."""
    rows = ["| key | holds | where it is absent | meaning |", "|---|---|---|---|"]
    for prefix, keys in (("", KEYS), ("runs[]. ", RUN_KEYS)):
        rows += [
            f"| `{(prefix + name).replace(' ', '')}` | {k.holds} | {k.absent} | {k.meaning} |"
            for name, k in keys.items()
        ]
    return "\n".join(rows)


class Section:
    """One mapping of the YAML: where it stands, and its values with complaints that name file and line. ``known`` None:
    any name."""

    def __init__(self, file: Path, place: str, content: Any, known: Iterable[str] | None, line: int = 1) -> None:
        self.file, self.place, self.line = file, place, line
        self.content = content if isinstance(content, Lines) else Lines()
        if self.content is not content:
            raise self.error(None, f"must be `key: value` lines, not {shown(content)}")
        names = None if known is None else tuple(known)
        for key in content:
            if names is None and (not isinstance(key, str) or not key.strip()):
                raise self.error(key, f"{shown(key)} is no name; put it in quotes")
            if names is not None and key not in names:
                raise self.error(key, f"unknown key {shown(key)}{_as_meant(key, names)}")

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def __iter__(self) -> Iterator[str]:
        return iter(self.content)

    def get(self, key: str) -> Any:
        return self.content.get(key)

    def line_of(self, key: Any) -> int:
        return self.content.lines.get(key, self.line)

    def error(self, key: Any, message: str) -> InputError:
        place = f" {self.place}:" if self.place else ""
        return InputError(f"{self.file}, line {self.line_of(key)}:{place} {message}")

    def section(self, key: str, known: Iterable[str] | None) -> Section | None:
        """The mapping under a key (``known`` None: of any names); None where the key is absent or has no value."""
        if self.get(key) is None:
            return None
        place = f"{self.place}.{key}" if self.place else key
        return Section(self.file, place, self.get(key), known, self.line_of(key))

    def number(self, key: str) -> float:
        """A finite number; in quotes it is one too."""
        value = self.get(key)
        try:
            if isinstance(value, bool) or not isinstance(value, (int, float, str)):
                raise ValueError
            number = float(value)
        except (ValueError, OverflowError):
            raise self.error(key, f"{key} must be a number, not {shown(value)}") from None
        if not math.isfinite(number):
            raise self.error(key, f"{key} must be finite, not {shown(value)}")
        return number

    def text(self, key: str) -> str:
        value = self.get(key)
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, f"{key} must be text, not {shown(value)}; put it in quotes")
        return value


def _as_meant(key: Any, names: tuple[str, ...]) -> str:
    """What may have been meant by a key that none of the ``names`` is."""
    name, colon, _ = str(key).partition(":")
    if colon and name in names:
        return "; put a blank behind the colon"
    if not isinstance(key, str):
        return "; a number needs a decimal point, not a comma"
    if "runs" in names and key in RUN_KEYS:
        return "; it belongs to a run: indent it as far as the run's file"
    return did_you_mean(key, names)


def looked_for(folder: Path, name: str) -> str:
    """What to do about a run's ``file`` that is not there."""
    plain = name.replace("\\", "/")
    if name.startswith("~") or "$" in name:
        return "the home folder and variables are not filled in; write the path out"
    if re.search(r"[*?]|\[.+\]", name):
        with contextlib.suppress(ValueError, OSError, NotImplementedError):
            found = sorted(str(p.relative_to(folder)) for p in folder.glob(plain))
            matched = f" ({', '.join(found[:3])}, …)" if found else " (it matches nothing)"
            return f"patterns are not filled in{matched}; give each run its own entry"
    if plain != name and re.match("[A-Za-z]:", name):
        return "a path of Windows; copy the file here and name it from the campaign's folder"
    if plain != name and exists(folder / plain):
        return f"write / between folders: {plain}"
    if Path(name).is_absolute():
        return "write its path on this machine, or from the campaign's folder"
    there = folder / Path(plain).parent
    with contextlib.suppress(OSError, ValueError):
        names = sorted(p.name for p in there.iterdir() if p.name != "campaign.yaml")
        wanted = Path(plain.strip("“”‘’'\"")).name.lower()
        if any(n.startswith(f"{Path(plain).name} #") for n in names):
            return "a # behind a blank begins a comment; put the name in quotes"
        if _composed(Path(plain).name) in map(_composed, names):
            return (
                "a file that looks the same is there, but writes letters with marks (ä, é) in another way, as macOS"
                " does; rename it, or copy its name from `ls`"
            )
        if near := [n for n in names if wanted in (n.lower(), Path(n).stem.lower())]:
            return f"did you mean '{Path(plain).parent / near[0]}'?"
    return "the path is relative to the campaign's folder"


def _composed(name: str) -> str:
    """A name with each letter and its marks as one character."""
    return unicodedata.normalize("NFC", name)


def shown(value: Any) -> str:
    return "nothing" if value is None else reprlib.repr(value)


def read_name(mapping: Section, folder: Path) -> str:
    value = mapping.get("name")
    if isinstance(value, (Lines, list)):
        raise mapping.error("name", f"name must be text, not {shown(value)}")
    name = Path(os.path.realpath(folder)).name if value is None else str(value)
    # A folder may have any bytes for its name.
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def read_topics(mapping: Section) -> dict[str, str | None]:
    section = mapping.section("topics", TYPES)
    if section is None:
        return {}
    return {key: None if section.get(key) is None else section.text(key) for key in section}


def read_noise_std(mapping: Section) -> dict[str, float]:
    section = mapping.section("noise_std", CHANNELS)
    noise: dict[str, float] = {}
    if section is None:
        return noise
    for channel in section:
        noise[channel] = section.number(channel)
        if noise[channel] <= 0:
            raise section.error(channel, f"{channel} must be above 0; leave it out to have it estimated")
    return noise


def read_model(mapping: Section, folder: Path) -> Path | None:
    if mapping.get("model") is None:
        return None
    model = folder / mapping.text("model")
    if not exists(model) or model.is_dir():
        why = missing(model) or "no such file, but a folder"
        raise mapping.error("model", f"model {model}: {why}; the path is relative to the campaign's folder")
    return model


def read_free(mapping: Section) -> tuple[str, ...]:
    names = mapping.get("free")
    if names is None:
        return FREE if "free" not in mapping else ()
    if not isinstance(names, list) or not all(isinstance(n, str) and n.strip() for n in names):
        raise mapping.error("free", f"free must be a list of parameter names, e.g. [eta, gamma], not {shown(names)}")
    if twice := [n for n, count in Counter(names).items() if count > 1]:
        raise mapping.error("free", f"free names '{twice[0]}' twice")
    if unknown := [n for n in names if "." not in n and n not in PARAMETERS]:
        raise mapping.error("free", f"free: unknown parameter '{unknown[0]}'{did_you_mean(unknown[0], PARAMETERS)}")
    return tuple(names)


def read_sharpen(mapping: Section) -> str | None:
    name = mapping.get("sharpen")
    if name is not None and not isinstance(name, str):
        raise mapping.error("sharpen", f"sharpen must be a parameter's name, e.g. gamma, not {shown(name)}")
    if name is not None and "." not in name and name not in PARAMETERS:
        raise mapping.error("sharpen", f"sharpen: unknown parameter '{name}'{did_you_mean(name, PARAMETERS)}")
    return name


def read_dof(mapping: Section) -> int | tuple[str, ...] | None:
    value = mapping.get("dof")
    if value is None:
        return None
    dof = as_dof(value) if not isinstance(value, list) or all(isinstance(v, str) for v in value) else None
    if dof is None:
        raise mapping.error("dof", f"dof must be 1, 2, 4 or a list out of {', '.join(COORDINATES)}, not {shown(value)}")
    return dof


def read_inputs(mapping: Section) -> dict[str, str]:
    section = mapping.section("inputs", None)
    return {} if section is None else {name: section.text(name) for name in section}


def read_drive_current(section: Section) -> float | None:
    """The drive's current (A) of a run, None where it is not given; in either direction no larger than a model takes
    it."""
    if section.get("drive_current") is None:
        return None
    current, most = section.number("drive_current"), PARAMETERS["drive_current"].high
    if abs(current) > most:
        raise section.error(
            "drive_current", f"drive_current is {current:g} A, and a drive's is {most:g} A at most; is it in mA?"
        )
    return current


def read_conditions(section: Section) -> dict[str, float]:
    """Numbers of a run; one that takes a model parameter's place lies in its range."""
    known = section.section("conditions", None)
    if known is None:
        return {}
    if "drive_current" in known:
        raise known.error("drive_current", "drive_current stands beside file, not under conditions")
    conditions = {name: known.number(name) for name in known}
    for name, value in conditions.items():
        if name in PARAMETERS:
            PARAMETERS[name].check(name, value, f"{known.file}, line {known.line_of(name)}: {known.place}")
    return conditions


def exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long, a NUL in it, a loop of links
        return False


if __name__ == "__main__":
    print(table())
