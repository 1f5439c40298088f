# SPDX-License-Identifier: Apache-2.0
"""A measurement campaign: a folder with `campaign.yaml` and one file per run."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import frames
from ..core.errors import InputError
from ..core.model import Model
from ..core.parameters import PARAMETERS
from ..core.paths import NOT_THERE, missing
from ..core.state import CHANNELS, STATES
from ..core.yaml_files import Lines, read_yaml
from .bag_storage import is_bag, storage_inside, unpacked_name
from .bags import read_bag
from .campaign_keys import (
    FREE,
    KEYS,
    RUN_KEYS,
    Section,
    exists,
    looked_for,
    read_conditions,
    read_dof,
    read_drive_current,
    read_free,
    read_inputs,
    read_model,
    read_name,
    read_noise_std,
    read_sharpen,
    read_topics,
    shown,
)
from .csv_files import read_csv
from .limits import Limits, read_limits
from .measurement import Run

FILE = "campaign.yaml"


@dataclass(frozen=True)
class Campaign:
    """Runs of one rig and what is known about it.

    runs: at least one, each with a name of its own
    noise_std: standard deviation by channel, SI, positive; channels that are absent are to be estimated
    model: the rig's parameter file, or None for the package's default
    free: names of the parameters a fit may move besides initial states
    dof: what moves: 1, 2, 4 or names of coordinates, or None where the campaign leaves that to the model
    remarks: what is to be said of the campaign as a whole, one line each
    limits: what a run of the rig may not leave
    sharpen: the parameter that the next run is to determine better, or None
    rounding: standard deviation (SI) of the rounding by channel that reads in steps, as a look at the data finds it
    """

    name: str
    folder: Path
    runs: tuple[Run, ...]
    noise_std: Mapping[str, float] = field(default_factory=dict)
    model: Path | None = None
    free: tuple[str, ...] = FREE
    dof: int | tuple[str, ...] | None = None
    remarks: tuple[str, ...] = ()
    limits: Limits = field(default_factory=Limits)
    sharpen: str | None = None
    rounding: Mapping[str, float] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel that any run has, in canonical order."""
        return tuple(c for c in CHANNELS if any(c in run.channels for run in self.runs))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was converted, sorted or left out while the runs were read: one line each, with the names of its
        runs."""
        runs_by_note: dict[str, list[str]] = {}
        for run in self.runs:
            for note in run.notes:
                runs_by_note.setdefault(note, []).append(run.name)
        return self.remarks + tuple(f"{_some(names)}: {note}" for note, names in runs_by_note.items())

    def against(self, model: Model) -> Campaign:
        """The campaign with a remark for each condition and input that neither this model nor any effect that it knows
        asks for, and for each condition that an effect asks for and runs do not say: where the effect is on, or other
        runs do."""
        asked = {c for item in model.known_effects.values() for c in item.conditions}
        asked |= {*PARAMETERS, *(f"{e}.{p}" for e, item in model.known_effects.items() for p in item.parameters)}
        given = dict.fromkeys(name for run in self.runs for name in run.conditions)
        lines = [
            f"condition '{name}' is not used: neither the model nor an effect asks for it"
            for name in given
            if name not in asked
        ]
        on = [model.known_effects[name.partition(":")[0]] for name in model.effects]
        wanted = {
            c: d
            for item in model.known_effects.values()
            for c, d in item.conditions.items()
            if item in on or c in given
        }
        for name, default in wanted.items():
            silent = [run.name for run in self.runs if name not in run.conditions]
            if silent and name not in PARAMETERS:
                lines.append(f"{_some(silent)}: no condition '{name}'; {model.condition(name, default):g} is taken")
        measured = dict.fromkeys(name for run in self.runs for name in run.inputs if name != "drive_current")
        lines += [
            f"input '{name}' is read and not used: the model takes only drive_current as it was measured in time"
            for name in measured
        ]
        return replace(self, remarks=(*self.remarks, *lines))

    def load_model(self, file: str | Path | None = None, effect_files: Iterable[str | Path] = ()) -> Model:
        """The model the campaign is held against: that of ``file``, else the campaign's own, else the package's
        default.

        A campaign is data: its own model may name no effect files that are not among ``effect_files``. Raises
        `InputError` for a track of single coils.
        """
        if file is not None:
            model = Model.load(file, effect_files).averaged(str(file))
        elif self.model is not None:
            model = Model.load(self.model, effect_files, trusted=False).averaged(str(self.model))
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
    mapping = Section(file, "", _content(file), KEYS)
    reading = _Reading(read_topics(mapping), read_inputs(mapping), gravity)
    runs, noise_std = _runs(file.parent, mapping, reading), read_noise_std(mapping)
    return Campaign(
        name=read_name(mapping, file.parent),
        folder=file.parent,
        runs=runs,
        noise_std=noise_std,
        model=read_model(mapping, file.parent),
        free=read_free(mapping),
        dof=read_dof(mapping),
        remarks=tuple(_unused(runs, noise_std, reading)),
        limits=read_limits(mapping),
        sharpen=read_sharpen(mapping),
    )


def _unused(runs: tuple[Run, ...], noise_std: Mapping[str, float], reading: _Reading) -> list[str]:
    """A word for each key of the campaign that no run asks for."""
    lines = [
        f"noise_std of {channel} is not used: no run has that channel"
        for channel in noise_std
        if all(channel not in run.channels for run in runs)
    ]
    if reading.topics and not any(is_bag(run.file) for run in runs):
        lines.append("topics: is not used: no run is a bag")
    held = {name for run in runs for name in run.inputs}
    return lines + [f"input '{name}' is in no run" for name in reading.inputs if name not in held]


def _content(file: Path) -> Any:
    if why := missing(file.parent):
        why = why.replace(NOT_THERE, "no such folder", 1)
        raise InputError(f"{file.parent}: {why}; a campaign is a folder with {FILE}")
    if not exists(file) and (file.parent.is_file() or storage_inside(file.parent)):
        line = f"runs: [{{file: {file.parent.name}, drive_current: 7000.0}}]"
        raise InputError(f"{file.parent}: is one run; write a {FILE} beside it, `{line}`, and name the folder of both")
    if not exists(file) or file.is_dir():
        if (why := missing(file)) and not why.startswith(NOT_THERE):
            raise InputError(f"{file}: {why}")
        others = sorted(p.name for p in file.parent.glob("*") if "campaign" in p.name.lower() or p.suffix == ".yml")
        meant = f"; rename {others[0]}?" if others else ""
        raise InputError(f"{file}: no such file; a campaign is a folder with {FILE} in it{meant}")
    content = read_yaml(file, aliases=True)
    if content is None:
        raise InputError(f"{file}: empty; it needs at least `runs:` with a file and a drive_current for each")
    return content


@dataclass(frozen=True)
class _Reading:
    """What all files of a campaign are read with."""

    topics: Mapping[str, str | None]
    inputs: Mapping[str, str]
    gravity: float

    def run(self, file: Path, name: str) -> Run:
        in_bags = {n: where for n, where in self.inputs.items() if where.startswith("/") and ":" in where}
        if is_bag(file):
            return read_bag(file, self.topics, name, self.gravity, in_bags)
        return read_csv(file, name, {n: where for n, where in self.inputs.items() if n not in in_bags})


def _runs(folder: Path, mapping: Section, reading: _Reading) -> tuple[Run, ...]:
    entries = mapping.get("runs")
    if not isinstance(entries, list) or not entries:
        example = "- {file: run_00.csv, drive_current: 7000.0}"
        raise mapping.error("runs", f"runs must list at least one run, e.g. {example}, not {shown(entries)}")
    line = mapping.line_of("runs")
    sections = [
        Section(mapping.file, f"runs[{i}]", entry, RUN_KEYS, _line(entry, line)) for i, entry in enumerate(entries)
    ]
    files: list[Path] = []
    for before, section in zip([None, *sections], sections, strict=False):
        if before is not None and "file" in before and "file" not in section and (key := next(iter(section), "")):
            raise section.error(
                key, f"has no file; where {key} belongs to the run above it, write it without - as far in as its file"
            )
        file = folder / section.text("file")
        if not exists(file):
            why = missing(file)
            meant = f"; {looked_for(folder, section.text('file'))}" if why.startswith(NOT_THERE) else ""
            raise section.error("file", f"{file}: {why}{meant}")
        if os.path.realpath(file) in map(os.path.realpath, files):
            raise section.error("file", f"{file} is listed twice; delete one")
        files.append(file)
    names = _names(folder, files)
    return tuple(_run(section, file, name, reading) for section, file, name in zip(sections, files, names, strict=True))


def _run(section: Section, file: Path, name: str, reading: _Reading) -> Run:
    known = section.section("initial_state", STATES)
    initial_state = {state: known.number(state) for state in known} if known else {}
    current = read_drive_current(section)
    conditions = read_conditions(section)
    run, notes = reading.run(file, name), ()
    if "drive_current" in run.inputs:
        current, notes = _mean_current(run.inputs["drive_current"][1], current)
    if current is None and run.pulses is None:
        raise section.error(
            "file",
            f"drive_current of {file.name} is missing; give it in A, 0 for coasting, or name what measured it:"
            " inputs: {drive_current: COLUMN}",
        )
    return replace(
        run,
        drive_current=current or 0.0,
        initial_state=initial_state,
        conditions=conditions,
        notes=(*run.notes, *notes),
    )


def _mean_current(measured: np.ndarray, given: float | None) -> tuple[float | None, tuple[str, ...]]:
    """The mean current of a run whose current was measured in time, and what is to be said of that; ``given`` is what
    the campaign says of it."""
    if not measured.size:
        return given, ()
    low, mean, high = float(measured.min()), float(measured.mean()), float(measured.max())
    steady = high - low <= 0.01 * abs(mean)
    notes = [] if steady else [f"drive_current was measured from {low:.4g} to {high:.4g} A; the drive follows it"]
    if given is not None and abs(given - mean) > 0.01 * abs(mean):
        notes.append(f"drive_current is {given:.4g} A in campaign.yaml and {mean:.4g} A as measured, which is taken")
    return mean, tuple(notes)


def _line(entry: Any, default: int) -> int:
    return min(entry.lines.values(), default=default) if isinstance(entry, Lines) else default


def _names(folder: Path, files: list[Path]) -> list[str]:
    """Run names, each once, for results are stored under them: the file's without suffix; its path where alike."""
    names = [file.name if file.is_dir() else Path(unpacked_name(file)).stem for file in files]
    taken = Counter(names)
    return [
        (
            "_".join(part for part in Path(os.path.relpath(file, folder)).parts if part != "..")
            if taken[name] > 1
            else name
        )
        for name, file in zip(names, files, strict=True)
    ]
