"""A measurement campaign: a folder with `campaign.yaml` and one file per run."""

from __future__ import annotations

import math
import os
import reprlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from .. import frames
from ..core.errors import InputError, did_you_mean
from ..core.model import Model
from ..core.state import CHANNELS, MOVING, STATES
from ..core.yaml_files import Lines, read_yaml
from .bag_files import is_bag, unpacked_name
from .bag_messages import TYPES
from .bags import read_bag
from .csv_files import read_csv
from .measurement import Run

FILE = "campaign.yaml"
KEYS = ("name", "runs", "noise_std", "topics", "model", "free", "dof")
RUN_KEYS = ("file", "drive_current", "initial_state")
#: What a fit may move besides the initial states, where the campaign does not say.
FREE = ("eta", "gamma")


@dataclass(frozen=True)
class Campaign:
    """Runs of one rig and what is known about it.

    runs: at least one, each with a name of its own
    noise_std: standard deviation by channel, SI, positive; channels that are absent are to be estimated
    model: the rig's parameter file, or None for the package's default
    free: names of the parameters a fit may move besides initial states
    dof: degrees of freedom that move (1, 2 or 4), or None where the campaign leaves that to the model
    remarks: what is to be said of the campaign as a whole, one line each
    """

    name: str
    folder: Path
    runs: tuple[Run, ...]
    noise_std: Mapping[str, float] = field(default_factory=dict)
    model: Path | None = None
    free: tuple[str, ...] = FREE
    dof: int | None = None
    remarks: tuple[str, ...] = ()

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel that any run has, in canonical order."""
        return tuple(c for c in CHANNELS if any(c in run.channels for run in self.runs))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was converted, sorted or left out while the runs were read: one line each, with the names of its runs."""
        runs_by_note: dict[str, list[str]] = {}
        for run in self.runs:
            for note in run.notes:
                runs_by_note.setdefault(note, []).append(run.name)
        return self.remarks + tuple(f"{_some(names)}: {note}" for note, names in runs_by_note.items())

    def load_model(self, file: str | Path | None = None, effect_files: Iterable[str | Path] = ()) -> Model:
        """The model the campaign is held against: that of ``file``, else the campaign's own, else the package's default.

        A campaign is data: its own model may name no effect files that are not among ``effect_files``.
        """
        if file is not None:
            model = Model.load(file, effect_files)
        elif self.model is not None:
            model = Model.load(self.model, effect_files, trusted=False)
        else:
            model = Model.create(effect_files=effect_files)
        return model if self.dof in (None, model.dof) else model.with_changes(dof=self.dof)


def _some(names: list[str]) -> str:
    """The first three names, and how many more there are."""
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def load_campaign(folder: str | Path, gravity: float = frames.GRAVITY) -> Campaign:
    """Read a campaign's folder (or its `campaign.yaml`) with all its runs.

    gravity: m/s², what an Imu at rest shows. Raises InputError naming file, line and remedy.
    """
    folder = Path(folder)
    file = folder if folder.suffix in (".yaml", ".yml") and folder.is_file() else folder / FILE
    mapping = _Section(file, "", _content(file), KEYS)
    runs = _runs(file.parent, mapping, _topics(mapping), gravity)
    return Campaign(
        name=_name(mapping, file.parent),
        folder=file.parent,
        runs=runs,
        noise_std=_noise_std(mapping),
        model=_model(mapping, file.parent),
        free=_free(mapping),
        dof=_dof(mapping),
    )


def _content(file: Path) -> Any:
    if not _exists(file.parent):
        raise InputError(f"{file.parent}: no such folder; a campaign is a folder with {FILE}")
    if not _exists(file) or file.is_dir():
        raise InputError(f"{file}: no such file; a campaign is a folder with {FILE} in it")
    content = read_yaml(file, aliases=True)
    if content is None:
        raise InputError(f"{file}: empty; it needs at least `runs:` with a file and a drive_current for each")
    return content


# ---------------------------------------------------------------- the keys


class _Section:
    """One mapping of the YAML: where it stands, and its values with complaints that name file and line."""

    def __init__(self, file: Path, place: str, content: Any, known: Iterable[str], line: int = 1) -> None:
        self.file, self.place, self.line = file, place, line
        self.content = content if isinstance(content, Lines) else Lines()
        if self.content is not content:
            raise self.error(None, f"must be `key: value` lines, not {_shown(content)}")
        known = tuple(known)
        for key in content:
            if key not in known:
                raise self.error(key, f"unknown key {_shown(key)}{did_you_mean(str(key), known)}")

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

    def section(self, key: str, known: Iterable[str]) -> _Section | None:
        """The mapping under a key; None where the key is absent or has no value."""
        if self.get(key) is None:
            return None
        place = f"{self.place}.{key}" if self.place else key
        return _Section(self.file, place, self.get(key), known, self.line_of(key))

    def number(self, key: str) -> float:
        """A finite number; in quotes it is one too."""
        value = self.get(key)
        try:
            if isinstance(value, bool) or not isinstance(value, (int, float, str)):
                raise ValueError
            number = float(value)
        except (ValueError, OverflowError):
            raise self.error(key, f"{key} must be a number, not {_shown(value)}") from None
        if not math.isfinite(number):
            raise self.error(key, f"{key} must be finite, not {_shown(value)}")
        return number

    def text(self, key: str) -> str:
        value = self.get(key)
        if not isinstance(value, str) or not value.strip():
            raise self.error(key, f"{key} must be text, not {_shown(value)}; put it in quotes")
        return value


def _shown(value: Any) -> str:
    return "nothing" if value is None else reprlib.repr(value)


def _name(mapping: _Section, folder: Path) -> str:
    value = mapping.get("name")
    if isinstance(value, (Lines, list)):
        raise mapping.error("name", f"name must be text, not {_shown(value)}")
    name = folder.resolve().name if value is None else str(value)
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")  # a folder may have any bytes for its name


def _topics(mapping: _Section) -> dict[str, str | None]:
    section = mapping.section("topics", TYPES)
    if section is None:
        return {}
    return {key: None if section.get(key) is None else section.text(key) for key in section}


def _noise_std(mapping: _Section) -> dict[str, float]:
    section = mapping.section("noise_std", CHANNELS)
    noise: dict[str, float] = {}
    if section is None:
        return noise
    for channel in section:
        noise[channel] = section.number(channel)
        if noise[channel] <= 0:
            raise section.error(channel, f"{channel} must be above 0; leave it out to have it estimated")
    return noise


def _model(mapping: _Section, folder: Path) -> Path | None:
    if mapping.get("model") is None:
        return None
    model = folder / mapping.text("model")
    if not _exists(model) or model.is_dir():
        raise mapping.error("model", f"model {model}: no such file; the path is relative to the campaign's folder")
    return model


def _free(mapping: _Section) -> tuple[str, ...]:
    names = mapping.get("free")
    if names is None:
        return FREE if "free" not in mapping else ()
    if not isinstance(names, list) or not all(isinstance(n, str) and n.strip() for n in names):
        raise mapping.error("free", f"free must be a list of parameter names, e.g. [eta, gamma], not {_shown(names)}")
    if twice := [n for n, count in Counter(names).items() if count > 1]:
        raise mapping.error("free", f"free names '{twice[0]}' twice")
    return tuple(names)


def _dof(mapping: _Section) -> int | None:
    dof = mapping.get("dof")
    if dof is not None and (isinstance(dof, bool) or not isinstance(dof, int) or dof not in MOVING):
        raise mapping.error("dof", f"dof must be one of {', '.join(map(str, MOVING))}, not {_shown(dof)}")
    return dof


def _runs(folder: Path, mapping: _Section, topics: Mapping[str, str | None], gravity: float) -> tuple[Run, ...]:
    entries = mapping.get("runs")
    if not isinstance(entries, list) or not entries:
        example = "- {file: run_00.csv, drive_current: 7000.0}"
        raise mapping.error("runs", f"runs must list at least one run, e.g. {example}, not {_shown(entries)}")
    line = mapping.line_of("runs")
    sections = [
        _Section(mapping.file, f"runs[{i}]", entry, RUN_KEYS, _line(entry, line)) for i, entry in enumerate(entries)
    ]
    files: list[Path] = []
    for section in sections:
        file = folder / section.text("file")
        if not _exists(file):
            raise section.error("file", f"{file}: no such file; the path is relative to the campaign's folder")
        if file.resolve() in [f.resolve() for f in files]:
            raise section.error("file", f"{file} is listed twice; delete one")
        files.append(file)
    names = _names(folder, files)
    return tuple(
        _run(section, file, name, topics, gravity) for section, file, name in zip(sections, files, names, strict=True)
    )


def _run(section: _Section, file: Path, name: str, topics: Mapping[str, str | None], gravity: float) -> Run:
    known = section.section("initial_state", STATES)
    initial_state = {state: known.number(state) for state in known} if known else {}
    current = section.number("drive_current") if section.get("drive_current") is not None else None
    run = read_bag(file, topics, name, gravity) if is_bag(file) else read_csv(file, name)
    if current is None and run.pulses is None:
        raise section.error("file", f"drive_current of {file.name} is missing; give it in A, 0 for coasting")
    return replace(run, drive_current=current or 0.0, initial_state=initial_state)


def _line(entry: Any, default: int) -> int:
    return min(entry.lines.values(), default=default) if isinstance(entry, Lines) else default


def _names(folder: Path, files: list[Path]) -> list[str]:
    """Run names, each once, for results are stored under them: the file's without suffix; its path where alike."""
    names = [file.name if file.is_dir() else Path(unpacked_name(file)).stem for file in files]
    taken = Counter(names)
    return [
        "_".join(part for part in Path(os.path.relpath(file, folder)).parts if part != "..")
        if taken[name] > 1
        else name
        for name, file in zip(names, files, strict=True)
    ]


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):  # a name too long, a NUL in it, a loop of links
        return False
