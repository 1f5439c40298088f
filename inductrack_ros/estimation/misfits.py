# SPDX-License-Identifier: Apache-2.0
"""Misfits: residuals as a function of a few parameters' values, from travel distances, from time series, or from
both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError, did_you_mean
from ..core.model import Model
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import UNITS
from ..data.campaign import Campaign
from ..data.small_table import read_small_table
from .fit import fit
from .horizons import fit_from_scratch
from .problem import STATE_PRIOR, Problem
from .structure import Structure

Array = NDArray[np.float64]

DURATION = 2.0  # s, the time Figure 6 of the paper counts travel over
LATERAL = {"sway", "roll", "sway_rate", "roll_rate", "gap_right", "gap_left", "sway_acceleration", "roll_acceleration"}
#: Columns of a table of distances, with their units; the first two are needed.
COLUMNS = {"initial_speed": "m/s", "travel": "m", "duration": "s", "drive_current": "A", "std": "m"}
NEEDED = ("initial_speed", "travel")


class Misfit(Protocol):
    """Residuals (n,) at the values (p,) of the parameters ``free``.

    ``noise_known`` says whether residuals are over their standard deviation; where not, they share one that the fit
    estimates. ``nuisance`` is by how much the residuals' degrees of freedom fall short of their number, besides the
    parameters."""

    free: tuple[str, ...]
    declared: list[Parameter]
    noise_known: bool
    nuisance: int

    def __call__(self, values: Sequence[float]) -> Array: ...


# ---------------------------------------------------------------- travel distances


@dataclass(frozen=True)
class Travels:
    """Distances (m) covered in ``duration`` (s) after a start at ``initial_speed`` (m/s) on the equilibrium heave; all
    (n,).

    ``drive_current`` (A) and ``std`` (m, the distance's standard deviation) are NaN where unknown; ``notes`` say what
    was converted while reading."""

    initial_speed: Array
    travel: Array
    duration: Array
    drive_current: Array
    std: Array
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, initial_speed, travel, duration=DURATION, drive_current=math.nan, std=math.nan) -> Travels:
        """From numbers or sequences, each spread to the length of ``initial_speed``."""
        n = len(initial_speed)
        columns = (initial_speed, travel, duration, drive_current, std)
        speed, distance, time, current, error = (np.array(np.broadcast_to(np.asarray(c, float), (n,))) for c in columns)
        return cls(speed, distance, time, current, error)


def read_travels(file: str | Path, duration: float = DURATION, std: float = math.nan) -> Travels:
    """Read a CSV of pairs ``initial_speed,travel`` (m/s, m), with further columns of `COLUMNS` if wanted.

    ``duration`` and ``std`` serve where the file has no such column. Raises `InputError` naming file and row.
    """
    names, rows, notes = read_small_table(file, COLUMNS)
    for name in NEEDED:
        if names.count(name) != 1:
            raise InputError(
                f"{file}, row 1: needs one column '{name}'; the header is {','.join(NEEDED)}, both in SI units"
            )
    if not rows:
        raise InputError(f"{file}: no row of data under the header; add one initial speed and distance per row")
    for row, values in rows:
        for name, value in zip(names, values, strict=True):
            positive = name in ("initial_speed", "duration", "std")
            if not math.isfinite(value) or (positive and value <= 0):
                raise InputError(
                    f"{file}, row {row}, column '{name}': '{value:g}' is not a {'positive ' if positive else ''}number"
                )
    table = dict(zip(names, zip(*(values for _, values in rows), strict=True), strict=True))
    speeds = table.pop("initial_speed")
    return replace(Travels.of(speeds, **{"duration": duration, "std": std, **table}), notes=notes)


class TravelMisfit:
    """Residuals of travel distances as a function of the free parameters' values.

    ``std`` is the distances' standard deviation where the data state one; where they do not, residuals are in metres
    and the fit estimates their common size."""

    nuisance = 0

    def __init__(self, model: Model, free: Sequence[str], travels: Travels):
        self.model, self.free, self.travels = model, tuple(free), travels
        self.declared = declarations(model, self.free, sensors=False)
        self.noise_known = bool(np.isfinite(travels.std).all())
        if np.isfinite(travels.std).any() and not self.noise_known:
            raise InputError("travel distances: std is given for some rows only; give it for all or for none")
        self._scale = travels.std if self.noise_known else np.ones(len(travels.travel))
        self._column = [model.kernel.parameters.index(name) for name in self.free]
        self._shared = {name: getattr(model, name) for name in ("known_effects", "kernel", "switches", "moving")}

    def at(self, values: Sequence[float]) -> Model:
        """The model with the free parameters at ``values``; it shares the compiled kernel, for thousands of these are
        made."""
        vector = self.model.vector.copy()
        vector[self._column] = values
        trial = replace(self.model)
        trial.__dict__.update(self._shared, vector=vector)
        return trial

    def predict(self, values: Sequence[float]) -> Array:
        """Distances (n,) in m."""
        trial, t = self.at(values), self.travels
        out = np.empty(len(t.travel))
        for i, (speed, duration, current) in enumerate(zip(t.initial_speed, t.duration, t.drive_current, strict=True)):
            driven = None if math.isnan(current) else current
            run = trial.simulate(
                np.array([0.0, duration]), trial.initial_state(surge_rate=speed, drive_current=driven), driven
            )
            out[i] = run["surge"][-1]
        return out

    def __call__(self, values: Sequence[float]) -> Array:
        """Residuals (n,), measured − predicted, over their standard deviation where that is known."""
        return (self.travels.travel - self.predict(values)) / self._scale


def declarations(model: Model, free: Sequence[str], sensors: bool = True) -> list[Parameter]:
    """The declaration of each free parameter (``eta``, ``aerodynamic_drag.drag_area``), those of ``sensors`` too or
    not.

    Raises `InputError` for an unknown one.
    """
    known: dict[str, Parameter] = dict(PARAMETERS)
    for name in model.effects:
        base, _, channel = name.partition(":")
        item = model.known_effects[base]
        if sensors or not item.of_sensor:
            known |= {f"{name}.{p}": d.for_channel(channel) if channel else d for p, d in item.parameters.items()}
    for name in free:
        if name not in known:
            raise InputError(f"cannot fit '{name}'{did_you_mean(name, known)}")
    if len(set(free)) != len(free) or not free:
        raise InputError("free parameters: name each once, and at least one")
    return [known[name] for name in free]


# ---------------------------------------------------------------- time series


class SeriesMisfit:
    """Residuals over noise of every sample of a campaign, each run's initial state fitted beside the parameters.

    The first fit, over growing horizons, finds parameters and initial states. After it, the initial states are
    eliminated: what a small change of them could take from the residuals is taken, with the derivatives at that fit.
    ``start`` (p,) is what it found. Sway and roll are held at zero where nothing measured shows them and the campaign
    does not ask for them. They enter squared, and a fit that is free to use them soaks up noise."""

    noise_known = True

    def __init__(self, campaign: Campaign, model: Model, free: Sequence[str]):
        self.free = tuple(free)
        self.declared = declarations(model, self.free)
        self.campaign = campaign
        sigma = {c: campaign.noise_std.get(c) or _noise(campaign, c) for c in campaign.channels}
        if campaign.dof is None and model.dof == 4 and not LATERAL & set(campaign.channels):
            model = model.with_changes(dof=2)
        self.problem = Problem(campaign, model, sigma)
        self.structure = Structure(self.problem.model, self.free)
        rough = fit_from_scratch(self.problem, self.structure)
        self.found = fit(self.problem, self.structure, rough.states, rough.theta, tolerance=1e-4)
        self.start = np.array([self.found.values[name] for name in self.free])
        self._states = self.found.states
        self._eliminate = []
        for data, part in zip(self.problem.runs, self.found.linear, strict=True):
            present = np.isfinite(part.residual) & np.isfinite(part.by_state).all(axis=1)
            X = np.where(present[:, None], part.by_state, 0.0)
            weight = 1.0 / STATE_PRIOR[data.free_states]  # the prior of the fit, which holds what is not measured
            self._eliminate.append((X, np.linalg.solve(X.T @ X + np.diag(weight**2), X.T), weight))
        # A row of the prior for each state, and a degree of freedom for each that the data determine.
        self.nuisance = sum(len(weight) + round(np.trace(solve @ X)) for X, solve, weight in self._eliminate)

    def __call__(self, values: Sequence[float]) -> Array:
        """Residuals (n,) of all runs in order, with the initial states' prior; zero where the model has nothing to
        compare."""
        residuals = self.problem.residuals(self.structure, self.structure.encode(values), self._states)
        parts = []
        for r, (X, solve, weight) in zip(residuals, self._eliminate, strict=True):
            r = np.where(np.isnan(r), 0.0, r)
            step = solve @ r
            parts += [r - X @ step, weight * step]
        return np.concatenate(parts)


def _noise(campaign: Campaign, channel: str) -> float:
    """A channel's noise from third differences of its samples, which the motion hardly enters; the median over runs,
    and no less than its rounding."""
    found = []
    for run in campaign.runs:
        if channel in run.channels:
            _, y = run.samples(channel)
            if y.size > 8:
                found.append(float(np.sqrt(np.mean(np.diff(y, 3) ** 2) / 20.0)))
    noise = max(float(np.median(found)) if found else 0.0, campaign.rounding.get(channel, 0.0))
    if not noise > 0.0:
        raise InputError(
            f"{campaign.folder}: the noise of {channel} cannot be estimated; give noise_std: {{{channel}: …}}"
            f" ({UNITS[channel]}) in campaign.yaml"
        )
    return noise


class JointMisfit:
    """Several misfits of the same parameters, one after the other; each must know its noise, or their weights would be
    arbitrary."""

    noise_known = True

    def __init__(self, parts: Sequence[Misfit]):
        self.parts = tuple(parts)
        self.free, self.declared = parts[0].free, parts[0].declared
        self.nuisance = sum(p.nuisance for p in parts)
        if not all(p.noise_known for p in parts):
            raise InputError(
                "distances beside time series need their standard deviation: a column std in the CSV, or --std"
            )
        if any(p.free != self.free for p in parts):
            raise InputError("the parts of a joint fit must free the same parameters")

    def __call__(self, values: Sequence[float]) -> Array:
        return np.concatenate([part(values) for part in self.parts])
