# SPDX-License-Identifier: Apache-2.0
"""What a look at the data finds: one record for the terminal, `check.json`, the reports and `diagnosis.json`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..core.plain_json import plain
from ..core.state import UNITS
from ..data import Run
from ..data.bag_storage import is_bag

#: Severities, worst first. IMPOSSIBLE: the data cannot be meant as they are written, so no physics is named.
#: SET_ASIDE: these samples are left out, the rest is used. WARNING: it may mislead. NOTE: good to know.
IMPOSSIBLE, SET_ASIDE, WARNING, NOTE = "impossible", "set_aside", "warning", "note"
SEVERITIES = (IMPOSSIBLE, SET_ASIDE, WARNING, NOTE)
#: How a severity is called.
CALLED = {IMPOSSIBLE: "cannot be so", SET_ASIDE: "left out", WARNING: "may mislead", NOTE: "note"}
#: Sample numbers of one run that `check.json` lists; their count is always there.
LISTED = 200


@dataclass(frozen=True)
class Finding:
    """One thing that a look found.

    - kind: what it is, a word of `docs/check.md`
    - severity: one of `SEVERITIES`
    - text: what is so and where, a sentence without its full stop
    - remedy: what to do about it; may be empty
    - channel: the channel it is about, None for the run's clock or the whole campaign
    - run: the run's name where it is about one run
    - samples: by run name the numbers (from 0) of the samples meant
    - size: how large it is, by name, SI units
    """

    kind: str
    severity: str
    text: str
    remedy: str = ""
    channel: str | None = None
    run: str | None = None
    samples: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    size: Mapping[str, Any] = field(default_factory=dict)

    @property
    def line(self) -> str:
        """Text and remedy in one line."""
        return f"{self.text}; {self.remedy}" if self.remedy else self.text

    @property
    def said(self) -> str:
        """The line as a terminal shows it, its severity first."""
        return f"{CALLED[self.severity]}: {self.line}"

    def to_json(self) -> dict[str, Any]:
        """The keys of a finding in `check.json` and `diagnosis.json`: kind, channel, its sizes, and what people
        read."""
        about = {"channel": self.channel, "run": self.run}
        rows = {run: list(numbers[:LISTED]) for run, numbers in self.samples.items()}
        return plain({
            "kind": self.kind,
            **{k: v for k, v in about.items() if v is not None},
            **self.size,
            "severity": self.severity,
            "text": self.text,
            "remedy": self.remedy or None,
            **({"samples": rows} if rows else {}),
        })  # fmt: skip


def worst_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sorted by severity, otherwise in the order they came."""
    return tuple(sorted(findings, key=lambda f: SEVERITIES.index(f.severity)))


def impossible(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Those that say that the data cannot be meant as they are written."""
    return tuple(f for f in findings if f.severity == IMPOSSIBLE)


def place(run: Run, sample: int) -> str:
    """Where a sample stands: file, row (as an editor counts) or message, and time."""
    where = "" if run.numbers is None else f", {spot(run, sample)},"
    return f"{run.file.name}{where} at {run.times[sample]:.6g} s"


def spot(run: Run, sample: int) -> str:
    """The row of a CSV, or the message of a bag's pose, that a sample is; its number in the run where it is neither."""
    if run.numbers is None or len(run.numbers) != len(run.times):
        return f"sample {sample + 1}"
    return f"{'message' if of_a_bag(run) else 'row'} {run.numbers[sample]}"


def of_a_bag(run: Run) -> bool:
    """Whether a run comes out of a bag, not out of a table with a header."""
    return is_bag(run.file)


def number(value: float, digits: int = 3) -> str:
    """A number as a message shows it, with as few signs as its digits need."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def quantity(channel: str, value: float) -> str:
    """A small size of a channel, in thousandths of its unit where that reads better."""
    unit = UNITS.get(channel, "")
    return f"{1e3 * value:.3g} m{unit}" if 0 < abs(value) < 0.1 else f"{value:.3g} {unit}"


def shared(names: Iterable[str], most: int = 4) -> str:
    """``a, b and 3 more``."""
    names = list(names)
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else ""


def as_samples(rows: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    """Sample numbers by run as plain integers; runs without any are left out."""
    return {run: tuple(int(i) for i in numbers) for run, numbers in rows.items() if len(numbers)}
