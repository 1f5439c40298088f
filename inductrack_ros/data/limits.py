# SPDX-License-Identifier: Apache-2.0
"""What a rig may do: ``limits:`` of ``campaign.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..core.parameters import PARAMETERS
from ..core.state import STATES
from .campaign_keys import Section, shown

EXAMPLE = "limits: {surge_rate: [9, 30], drive_current: [0, 7000]}"


@dataclass(frozen=True)
class Limits:
    """Least and most that each state, or ``drive_current``, may be in a run, SI; and whether a run may touch the
    track."""

    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    contact: bool = True

    def allow(self, name: str, values: np.ndarray | float) -> bool:
        """Whether all ``values`` of a state or of the current lie within its limits; without any they do."""
        low, high = self.ranges.get(name, (-np.inf, np.inf))
        return bool(np.all(np.asarray(values) >= low - 1e-9) and np.all(np.asarray(values) <= high + 1e-9))


def read_limits(mapping: Section) -> Limits:
    """The limits of a campaign; none where it has none. With any, a run may touch the track only by ``contact: true``.

    Raises `InputError` naming file, line and remedy.
    """
    section = mapping.section("limits", (*STATES, "drive_current", "contact"))
    if section is None:
        return Limits()
    contact = section.get("contact") if "contact" in section else False
    if not isinstance(contact, bool):
        raise section.error("contact", f"contact must be true or false, not {shown(contact)}")
    return Limits({name: _range(section, name) for name in section if name != "contact"}, contact)


def _range(section: Section, name: str) -> tuple[float, float]:
    pair = section.get(name)
    numbers = (
        isinstance(pair, list)
        and len(pair) == 2
        and all(isinstance(v, (int, float)) and not isinstance(v, bool) and np.isfinite(v) for v in pair)
    )
    if not numbers or not pair[0] < pair[1]:
        raise section.error(
            name, f"{name} must be [least, most], two numbers that rise, not {shown(pair)}; e.g. {EXAMPLE}"
        )
    if name == "drive_current":
        for value in pair:
            PARAMETERS[name].check(name, value, f"{section.file}, line {section.line_of(name)}: {section.place}")
    return float(pair[0]), float(pair[1])
