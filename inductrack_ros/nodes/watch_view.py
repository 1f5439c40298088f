# SPDX-License-Identifier: Apache-2.0
"""The live view: what is known of a namespace, as a screen of tables and as one line. No ROS here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.columns import Columns
from rich.console import Group
from rich.table import Table
from rich.text import Text

from ..core.state import COORDINATES, FURTHER, GAPS, RATES
from ..reports.words import number, shown, title

ROWS = (*COORDINATES, *RATES, *GAPS, *FURTHER)
#: Order of the forces; effects come before the total.
_FIRST = ("lift", "slip", "drag", "thrust", "contact", "weight")
_MISSING = ("missing_force", "missing_force_sigma")
_LEVELS = {0: "green", 1: "yellow", 2: "red", 3: "red"}
#: Seconds without a message after which that is said; nodes speak once a second.
SILENT = 2.5
#: Facts of a node that are worth a place on the screen, in the words of its diagnostics.
_COUNTED = ("fired pulses", "late pulses", "refused pulses", "deadline misses", "contacts")


@dataclass(frozen=True)
class Status:
    """A node's last word on /diagnostics, heard ``at`` (s on the view's clock); ``level`` 0 is well."""

    level: int
    message: str
    facts: Mapping[str, str]
    at: float


@dataclass
class View:
    """What is known: values by channel (SI), forces by name (surge, sway, heave in N, roll in N·m), nodes' statuses.

    ``time`` is the last stamp (s); ``now`` the clock of who looks (s), and ``state_at`` when a state was heard last.
    """

    namespace: str
    time: float | None = None
    truth: dict[str, float] = field(default_factory=dict)
    measured: dict[str, float] = field(default_factory=dict)
    wrenches: dict[str, tuple[float, ...]] = field(default_factory=dict)
    statuses: dict[str, Status] = field(default_factory=dict)
    last_pulse: tuple[float, float] | None = None
    now: float = 0.0
    state_at: float = 0.0

    def heard(self, which: str, values: Mapping[str, float]) -> None:
        """Take values of the ``truth`` or of what is ``measured``."""
        getattr(self, which).update(values)
        self.state_at = self.now

    def diagnosed(self, name: str, level: int, message: str, facts: Mapping[str, str]) -> None:
        """Take a node's status, if it is one of this namespace: ``/inductrack/sim: simulation``."""
        node = name.partition(":")[0]
        if node.rpartition("/")[0] == self.namespace:
            self.statuses[node.rpartition("/")[2]] = Status(level, message, facts, self.now)

    def words(self, status: Status) -> str:
        """What a node said last, and that it has fallen silent where it has."""
        silent = self.now - status.at
        return f"{status.message} (silent for {silent:.0f} s)" if silent > SILENT else status.message

    @property
    def counts(self) -> dict[str, str]:
        """The counters of all nodes."""
        return {k: s.facts[k] for s in self.statuses.values() for k in _COUNTED if k in s.facts}

    @property
    def when(self) -> str:
        """The stamp of the last pose, and since when nothing came."""
        if self.time is None:
            return ""
        return f"{self.time:.3f} s" + (f", nothing new for {self.silence:.0f} s" if self.silence else "")

    @property
    def silence(self) -> float:
        """Seconds since the last state; 0 while states come."""
        silent = self.now - self.state_at
        return silent if silent > SILENT else 0.0

    @property
    def is_empty(self) -> bool:
        return not (self.truth or self.measured or self.statuses)


def screen(view: View) -> Group:
    """The whole as tables, for a terminal of 80 by 24."""
    head = Text(": ".join(filter(None, [view.namespace, view.when])), style="bold")
    if view.is_empty:
        return Group(head, Text("Nothing is heard yet. Start sim, or name another namespace with --namespace."))
    parts = [head, Columns([_state(view), _forces(view)], padding=(0, 3))]
    if pulses := _pulse_words(view):
        parts.append(Text(pulses))
    parts += [
        Text.assemble((f"{name}: ", "bold"), (view.words(status), _LEVELS.get(status.level, "red")))
        for name, status in sorted(view.statuses.items())
    ]
    if missing := missing_words(view):
        parts.append(Text(f"missing now: {missing}"))
    return Group(*parts)


def line(view: View) -> str:
    """The whole in one line, for a file or a pipe. It stays the same while nothing new comes."""
    if view.is_empty:
        return f"{view.namespace}: nothing is heard yet"
    statuses = [f"{name}: {words}" for name, s in sorted(view.statuses.items()) if (words := _beside_counts(view, s))]
    if view.silence and view.time is not None:
        return "; ".join([f"nothing new since {view.time:.3f} s", *statuses])
    values = view.truth or view.measured
    parts = [view.when]
    parts += [
        f"{name} {_value(name, values.get(name))} {shown(name)[1]}"
        for name in ("surge", "surge_rate", *GAPS)
        if name in values
    ]
    if "total" in view.wrenches:
        parts.append("total force " + " ".join(f"{f:.1f}" for f in view.wrenches["total"][:3]) + " N")
    parts += [f"{name} {count}" for name, count in view.counts.items() if count != "0"]
    parts += statuses
    if missing := missing_words(view):
        parts.append(f"missing {missing}")
    return "; ".join(filter(None, parts))


def _beside_counts(view: View, status: Status) -> str:
    """What a node said last, without the counters that have grown: those stand in the line with their numbers."""
    said = [words for words in status.message.split(", ") if words not in (*view.counts, "running")]
    return ", ".join([*said, "silent"] if view.now - status.at > SILENT else said)


def missing_words(view: View) -> str:
    """``surge −0.31 ± 0.20 N (1.5 σ), …``: what the monitor's last window lacks; empty without a monitor."""
    if not all(name in view.wrenches for name in _MISSING):
        return ""
    parts = []
    for name, force, sigma in zip(COORDINATES, *(view.wrenches[m] for m in _MISSING), strict=True):
        if sigma > 0.0:
            unit = "N·m" if name == "roll" else "N"
            parts.append(f"{name} {number(force, 3)} ± {number(sigma, 2)} {unit} ({abs(force) / sigma:.1f} σ)")
    return ", ".join(parts)


def words_of_list(rows: Sequence[tuple[str, str, int, int]]) -> str:
    """Topics in columns: name, type, publishers, subscribers."""
    if not rows:
        return "no topics: no node runs on this machine, or its ROS_DOMAIN_ID is another"
    table = [("topic", "type", "publishers", "subscribers"), *((a, b, str(c), str(d)) for a, b, c, d in rows)]
    width = [max(len(row[i]) for row in table) for i in range(2)]
    return "\n".join(f"{a:<{width[0]}}  {b:<{width[1]}}  {c:>10}  {d:>11}" for a, b, c, d in table)


def _state(view: View) -> Table:
    table = _table("", "truth", "measured", "")
    for name in ROWS:
        if name in view.truth or name in view.measured:
            values = (_value(name, view.truth.get(name)), _value(name, view.measured.get(name)))
            table.add_row(title(name), *values, shown(name)[1])
    return table


def _forces(view: View) -> Table:
    table = _table("N, N·m", *COORDINATES)
    effects = sorted(n for n in view.wrenches if n not in (*_FIRST, *_MISSING, "total"))
    for name in (*_FIRST, *effects, "total"):
        if name in view.wrenches:
            table.add_row(name.replace("_", " "), *(f"{f:.2f}" for f in view.wrenches[name]))
    return table


def _table(*header: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    for number_, name in enumerate(header):
        table.add_column(name, justify="right" if number_ and name else "left", no_wrap=True)
    return table


def _pulse_words(view: View) -> str:
    counts = [f"{name} {count}" for name, count in view.counts.items()]
    if view.last_pulse is not None:
        counts.append("last: coil {:.0f}, {:.0f} A".format(*view.last_pulse))
    return ", ".join(counts)


def _value(name: str, value: float | None) -> str:
    if value is None:
        return ""
    factor, unit = shown(name)
    digits = 2 if unit.startswith(("mm", "mrad")) else 3
    return f"{value * factor:.{digits}f}" if math.isfinite(value) else str(value)
