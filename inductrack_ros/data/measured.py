# SPDX-License-Identifier: Apache-2.0
"""What a rig's sensors delivered, on one time axis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.rig import SENSORS, Record
from ..core.state import CHANNELS
from .measurement import Array


def table(records: Mapping[str, Record]) -> tuple[Array, dict[str, Array]]:
    """Stamps (n,) at which any sensor delivered, and its channels (n,) each, NaN where one did not."""
    records = {sensor: record for sensor, record in records.items() if record.times.size}
    times = np.unique(np.concatenate([record.times for record in records.values()]))
    columns: dict[str, Array] = {}
    for sensor, record in records.items():
        rows = np.searchsorted(times, record.times)
        for channel, values in zip(SENSORS[sensor], record.readings.T, strict=True):
            columns[channel] = np.full(len(times), np.nan)
            columns[channel][rows] = values
    return times, {c: columns[c] for c in CHANNELS if c in columns}
