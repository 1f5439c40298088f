# SPDX-License-Identifier: Apache-2.0
"""The runs of a campaign as a plan: what ``campaign.yaml`` says of each, whether it has been measured yet or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.state import STATES
from ..core.yaml_files import Lines, read_yaml
from .campaign import FILE, load_campaign
from .campaign_keys import KEYS, RUN_KEYS, Section, exists, read_conditions, read_model, read_name, shown
from .measurement import Run

#: The start of a measured run is the median of so many of a channel's first samples.
FIRST = 5
#: Time (s) from whose samples of the travel alone the speed is taken, by a parabola.
SLOPE = 0.2


@dataclass(frozen=True)
class PlannedRun:
    """A run by ``name``, and what is known of it: states at its start, ``drive_current`` and conditions, SI."""

    name: str
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class PlannedCampaign:
    """The runs of ``campaign.yaml``, the rig's parameter file if it names one, and what is to be said of how they were
    read."""

    name: str
    folder: Path
    runs: tuple[PlannedRun, ...]
    model: Path | None
    notes: tuple[str, ...] = ()


def planned_runs(folder: str | Path) -> PlannedCampaign:
    """The runs of a campaign's folder. Where all are measured, what the file does not say of a start is read off the
    data.

    Raises `InputError` naming file, line and remedy.
    """
    folder = Path(folder)
    file = folder if folder.suffix in (".yaml", ".yml") and folder.is_file() else folder / FILE
    if not exists(file) or file.is_dir():
        raise InputError(f"{file}: no such file; a campaign is a folder with {FILE} in it")
    mapping = Section(file, "", read_yaml(file, aliases=True), KEYS)
    entries = mapping.get("runs")
    if not isinstance(entries, list) or not entries:
        raise mapping.error(
            "runs",
            "runs must list at least one run, e.g. - {file: run_00.csv, drive_current: 7000.0}, not"
            f" {shown(entries)}",
        )
    line = mapping.line_of("runs")
    sections = [
        Section(file, f"runs[{i}]", e, RUN_KEYS, min(e.lines.values(), default=line) if isinstance(e, Lines) else line)
        for i, e in enumerate(entries)
    ]
    name, model = read_name(mapping, file.parent), read_model(mapping, file.parent)
    if all(exists(file.parent / s.text("file")) for s in sections):
        campaign = load_campaign(folder)
        runs = tuple(
            PlannedRun(r.name, _measured_start(r) | _told(s)) for r, s in zip(campaign.runs, sections, strict=True)
        )
        return PlannedCampaign(name, file.parent, runs, model, campaign.notes)
    runs = tuple(PlannedRun(Path(s.text("file")).stem, _told(s)) for s in sections)
    return PlannedCampaign(name, file.parent, runs, model)


def _told(section: Section) -> dict[str, float]:
    known = section.section("initial_state", STATES)
    values = {state: known.number(state) for state in known} if known else {}
    if section.get("drive_current") is not None:
        values["drive_current"] = section.number("drive_current")
    return values | read_conditions(section)


def _measured_start(run: Run) -> dict[str, float]:
    """The states that a run's first samples show, its speed by the slope of its travel where that alone is measured,
    and its current."""
    states = {
        c: float(np.median(run.samples(c)[1][:FIRST])) for c in run.channels if c in STATES and run.samples(c)[1].size
    }
    if "surge" in states and "surge_rate" not in states:
        times, travel = run.samples("surge")
        soon = times <= times[0] + SLOPE
        if soon.sum() >= FIRST:
            states["surge_rate"] = float(np.polynomial.Polynomial.fit(times[soon], travel[soon], 2).deriv()(times[0]))
    return states | ({} if run.pulses is not None else {"drive_current": run.drive_current})
