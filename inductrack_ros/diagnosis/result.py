# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis found, as the report shows it and `diagnosis.json` holds it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..checks import Finding
from ..core.model import Model
from ..core.plain_json import file_text, plain
from ..core.uncertainty import Uncertainty
from .factor import Factor
from .laws.result import Laws

#: Unit of an unknown change of the thrust.
OF_THRUST = "of the thrust"


@dataclass(frozen=True)
class Step:
    """The model with some effects: its error on the fitted runs and on runs the fit never saw.

    ``errors`` and ``heldout_errors`` are RMS error over noise by channel; ``by_run`` by run name, fitted on all.
    """

    effects: tuple[str, ...]
    reduced_chi2: float
    heldout_nrmse: float
    errors: Mapping[str, float] = field(default_factory=dict)
    heldout_errors: Mapping[str, float] = field(default_factory=dict)
    by_run: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Test:
    """One test of what an answer leaves: its name, statistic, degrees of freedom and log p-value if it were the only
    one."""

    name: str
    statistic: float
    dof: int
    log_p: float

    @property
    def p_value(self) -> float:
        """The p-value itself, 0 where it underflows."""
        return math.exp(self.log_p)


@dataclass(frozen=True)
class Rival:
    """One candidate in one round of the search.

    - ``chi2_fall``: what adding it to ``beside`` takes off χ²; ``threshold``: what chance alone would; ``size`` and
      ``std`` by parameter; ``words`` say for and against.
    - ``where``: part of the fall by run, and by stretch of speed, gap and contact (label → part of the fall).
    - ``refitted``: False where the fall is only what it promises to first order.
    """

    name: str
    beside: tuple[str, ...]
    chi2_fall: float
    threshold: float
    size: Mapping[str, float] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    chosen: bool = False
    words: str = ""
    where: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    refitted: bool = True


@dataclass(frozen=True)
class Limit:
    """The smallest size of an effect that these data would have shown, in its parameter's unit."""

    name: str
    parameter: str
    unit: str
    size: float


@dataclass(frozen=True)
class Unknown:
    """A misfit no effect explains: its coordinate, what it depends on, its peak, and its curve with a 95 % band.

    The curve is over the first of ``depends_on``; a change of the thrust is its share, and depends on the drive too.
    A force on two variables is the curve times the ``factor``. ``seen`` (k, 1 or 2): where the runs have been.
    """

    channel: str
    depends_on: tuple[str, ...]
    unit: str
    at: np.ndarray
    force: np.ndarray
    band: np.ndarray
    rivals: tuple[str, ...] = ()
    factor: Factor | None = None
    seen: np.ndarray = field(default_factory=lambda: np.empty((0, 1)), repr=False)

    def times(self, factor: Factor) -> Unknown:
        """The same, on two variables."""
        return replace(self, depends_on=(*self.depends_on, factor.variable), factor=factor)

    @classmethod
    def of(cls, acts_on: str, variable: str, *curve: np.ndarray) -> Unknown:
        """The unknown of a stand-in that acts on a coordinate or on the thrust."""
        at, force, band = curve or (np.empty(0),) * 3
        if acts_on == "thrust":
            return cls("surge", (variable, "drive"), OF_THRUST, at, force, band)
        return cls(acts_on, (variable,), "N·m" if acts_on == "roll" else "N", at, force, band)

    @property
    def place(self) -> float:
        """Where on its first variable it is largest, as far as that is sure: a table's ends are not. NaN where there is
        no curve."""
        return float(self.at[np.argmax(np.abs(self.force) - self.band)]) if self.at.size else math.nan

    @property
    def peak(self) -> float:
        """What it is there."""
        return float(self.force[np.argmax(np.abs(self.force) - self.band)]) if self.at.size else math.nan


@dataclass(frozen=True)
class Proposal:
    """A run to make next: speed (m/s), drive current (A), offsets of heave, sway (m) and roll (rad) at the start,
    duration (s), and by how many sigmas each rival would miss it.

    ``std_after`` are standard deviations that parameters would have then, SI. A ``second`` run is to be made too; what
    is told is told by both together."""

    speed: float
    current: float
    offsets: tuple[float, float, float]
    duration: float
    sigmas: Mapping[str, float]
    std_after: Mapping[str, float] = field(default_factory=dict)
    second: Proposal | None = None

    def to_json(self) -> dict[str, object]:
        """The run in numbers, SI."""
        heave, sway, roll = self.offsets
        numbers: dict[str, object] = {
            "surge_rate": self.speed, "drive_current": self.current, "heave_offset": heave, "sway": sway, "roll": roll,
            "duration": self.duration, "separation": dict(self.sigmas),
        }  # fmt: skip
        if self.std_after:
            numbers["std_after"] = dict(self.std_after)
        return numbers | ({"second": self.second.to_json()} if self.second else {})

    @property
    def least(self) -> float:
        """By how many sigmas the rival nearest to the model would miss it."""
        return min(self.sigmas.values(), default=0.0)

    @property
    def words(self) -> str:
        """The run, or both, in words."""
        drive = f"driven at {self.current:.0f} A" if self.current else "coasting"
        heave, sway, roll = self.offsets
        start = (
            f", released {1e3 * heave:g} mm over the equilibrium heave, {1e3 * sway:g} mm aside and rolled"
            f" {1e3 * roll:g} mrad"
            if any(self.offsets)
            else ""
        )
        own = f"start at {self.speed:g} m/s {drive}{start}, for {self.duration:g} s"
        return f"{own}, and {self.second.words}" if self.second else own


@dataclass(frozen=True)
class RunTraces:
    """One run for the report: measurements and what each set of effects predicts, by channel."""

    name: str
    driven: str  # `Run.driven`
    times: np.ndarray
    measured: Mapping[str, np.ndarray]
    predicted: Mapping[tuple[str, ...], Mapping[str, np.ndarray]]


INTERRUPTED = "interrupted before the search was over: this is the best set found until then"
OUT_OF_TIME = "the time allowed was used up before the search was over: this is the best set found until then"


@dataclass(frozen=True)
class Diagnosis:
    """Everything a diagnosis found; see /campaign/ in the docs for the JSON."""

    campaign: str
    verdict: str
    effects: tuple[str, ...]
    model: Model
    parameters: Mapping[str, tuple[float, float]]
    indistinguishable: Mapping[str, tuple[str, ...]]
    unknown: Unknown | None
    next_experiment: str | None
    steps: tuple[Step, ...]
    rivals: tuple[Rival, ...] = ()
    limits: tuple[Limit, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict)
    noise_given: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    tests: tuple[Any, ...] = ()
    p_value: float = 1.0
    traces: tuple[RunTraces, ...] = ()
    proposal: Proposal | None = None
    log: tuple[str, ...] = ()
    uncertainty: Uncertainty | None = None
    laws: Laws | None = None  # of an unknown force: closed forms in the table's place

    @property
    def interrupted(self) -> bool:
        """Whether the search was broken off by the user: what was found is then only the best until then."""
        return INTERRUPTED in self.notes

    @property
    def unfinished(self) -> bool:
        """Whether the search was broken off for any reason."""
        return self.interrupted or OUT_OF_TIME in self.notes

    def to_json(self) -> dict[str, Any]:
        """The content of ``diagnosis.json``: the contract's keys, and beside them notes, limits, rivals and noise."""
        return plain(
            {
                "verdict": self.verdict,
                "effects": list(self.effects),
                "parameters": {n: {"value": v, "std": s} for n, (v, s) in self.parameters.items()},
                "indistinguishable": {n: list(r) for n, r in self.indistinguishable.items()},
                "unknown": (
                    None
                    if self.unknown is None
                    else {
                        "channel": self.unknown.channel,
                        "depends_on": list(self.unknown.depends_on),
                        "peak": self.unknown.peak,
                        "unit": self.unknown.unit,
                        **({"factor": asdict(self.unknown.factor)} if self.unknown.factor else {}),
                    }
                ),
                "next_experiment": self.next_experiment,
                "steps": [
                    {"effects": list(s.effects), "reduced_chi2": s.reduced_chi2, "heldout_nrmse": s.heldout_nrmse}
                    for s in self.steps
                ],
                "laws": [law.to_json() for law in self.laws.proposed] if self.laws else [],
                "laws_in_words": self.laws.sentence if self.laws else None,
                "proposal": None if self.proposal is None else self.proposal.to_json(),
                "findings": [f.to_json() for f in self.findings],
                "notes": list(self.notes),
                "log": list(self.log),
                "p_value": self.p_value,
                "noise_std": {c: {"value": v, "given": c in self.noise_given} for c, v in self.noise.items()},
                "limits": {x.name: {"parameter": x.parameter, "value": x.size, "unit": x.unit} for x in self.limits},
                "rivals": [
                    {
                        "effect": r.name,
                        "beside": list(r.beside),
                        "chi2_fall": r.chi2_fall,
                        "threshold": r.threshold,
                        "chosen": r.chosen,
                        "refitted": r.refitted,
                    }
                    for r in self.rivals
                ],
            }
        )

    def write(self, folder: Path) -> None:
        """Write ``diagnosis.json`` and ``model.yaml`` into a folder, and the laws that are proposed with a model that
        has the best of them."""
        (folder / "diagnosis.json").write_text(file_text(self.to_json()), encoding="utf-8")
        found = ", ".join(self.effects) or "no effect added"
        comment = f"Diagnosis of {self.campaign}: {self.verdict.replace('_', ' ')}; {found}."
        if any(n.startswith("stand_in") for n in self.model.effects):
            comment += "\nstand_in_* is a smooth force in place of unknown physics: it predicts, it explains nothing."
        self.model.save(folder / "model.yaml", comment, self.uncertainty)
        if self.laws is not None:
            self.laws.write(
                folder, f"{self.campaign}: the best law proposed in place of the table; see proposed_effects.py."
            )
