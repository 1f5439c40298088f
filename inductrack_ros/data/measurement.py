# SPDX-License-Identifier: Apache-2.0
"""One measured run, whatever file it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..core.model import Pulses

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Run:
    """Samples of one run on one time axis; a channel that was not sampled at a time is NaN there.

    - name: unique in its campaign; names the output files
    - file: the CSV or the bag
    - channels: (c,) names out of `core.state.CHANNELS`, in that order
    - times: (n,) s, strictly increasing, 0 at the first sample
    - values: (n, c) SI units, NaN where not measured; no column and no time is wholly NaN in a bag, no column in a CSV
    - stamps: (n,) time as the file has it: float seconds, or whole nanoseconds (a bag, or times since 1970 in a CSV: a
      float would lose 0.2 µs)
    - drive_current: A; 0 is coasting; the mean where it was measured in time and stands in ``inputs``
    - initial_state: what is known of the state at time 0, by name; the rest is to be estimated
    - pulses: the drive, where the bag holds the pulses that were fired, by time on the run's clock; None:
      `drive_current`, averaged
    - pulse_counts: by pulse, how many had fired with it since the drive was switched on; None where nobody counts
    - numbers: (n,) where each sample stands in its file, from 1: the row as an editor counts (CSV), or the message on
      the pose's topic (bag); None where samples are of several topics, or of no file
    - seconds_stated: whether the file itself says that its time is in seconds: a bag, or a unit in a CSV's header
    - converted: by channel, the unit that a CSV's header gives it, where it is not SI's
    - inputs: what else was measured in time, by the name a model or an effect calls it: times (m,) s on the run's
      clock, values (m,)
    - conditions: numbers of this run: one with a model parameter's name takes its place, others are there for effects
    - notes: what was converted, sorted or left out while reading, one line each, without the file's name
    """

    name: str
    file: Path
    channels: tuple[str, ...]
    times: Array
    values: Array
    stamps: Array | NDArray[np.int64]
    drive_current: float = 0.0
    initial_state: Mapping[str, float] = field(default_factory=dict)
    pulses: Pulses | None = None
    pulse_counts: Array | None = None
    numbers: NDArray[np.integer] | None = None
    seconds_stated: bool = False
    converted: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    conditions: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __getitem__(self, channel: str) -> Array:
        """Column (n,) of a channel, NaN where not measured. KeyError if the run has no such channel."""
        if channel not in self.channels:
            raise KeyError(channel)
        return self.values[:, self.channels.index(channel)]

    def samples(self, channel: str) -> tuple[Array, Array]:
        """Times and values (m,) at which a channel was measured."""
        column = self[channel]
        present = ~np.isnan(column)
        return self.times[present], column[present]

    @property
    def pulsed(self) -> bool:
        """Whether single pulses drive the run."""
        return self.pulses is not None and len(self.pulses.times) > 0

    @property
    def driven(self) -> str:
        """What drives the run, in words: pulses, a current or nothing."""
        if self.pulses is not None:
            return f"{len(self.pulses.times)} pulses"
        return f"{self.drive_current:.4g} A" if self.drive_current else "coasting"

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(n, c) True where there is a measurement."""
        return ~np.isnan(self.values)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.times[-1])
