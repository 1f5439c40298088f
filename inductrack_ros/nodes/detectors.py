# SPDX-License-Identifier: Apache-2.0
"""Photodiodes along the track, as a controller sees them. Without ROS; emulated from the cradle's position."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, order=True)
class Edge:
    """A diode goes dark as the cradle's flag arrives: when it says so (s), and where the diode stands (m)."""

    time: float
    place: float


class Photodiodes:
    """Diodes every `spacing` (m) that a flag of `width` (m) below the cradle's centre darkens.

    A diode reports `latency` (s) late. Those in `failed` never report. `false_rate` (1/s) reports come from nothing,
    of a diode within a metre. Positions may come as seldom as one to a millisecond: edges are interpolated between.
    """

    def __init__(
        self,
        spacing: float,
        width: float,
        latency: float = 0.0,
        failed: Collection[int] = (),
        false_rate: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.spacing = spacing
        self.width = width
        self.latency = latency
        self.failed = frozenset(failed)
        self.false_rate = false_rate
        self._random = np.random.default_rng(seed)
        self._last: tuple[float, float] | None = None
        self._on_their_way: list[Edge] = []

    def see(self, time: float, surge: float) -> list[Edge]:
        """The cradle's centre is at `surge` (m) at `time` (s): edges that have been reported by now, oldest first."""
        if self._last is not None and time > self._last[0]:
            self._cross(*self._last, time, surge)
            self._invent(self._last[0], time, surge)
        self._last = time, surge
        self._on_their_way.sort()
        arrived = [e for e in self._on_their_way if e.time <= time]
        self._on_their_way = self._on_their_way[len(arrived) :]
        return arrived

    def _cross(self, t0: float, z0: float, t1: float, z1: float) -> None:
        """Diodes that the flag's leading end reaches between two positions, travelling forward."""
        lead = 0.5 * self.width
        first = math.floor((z0 + lead) / self.spacing) + 1
        last = math.floor((z1 + lead) / self.spacing)
        for number in range(first, last + 1):
            if number not in self.failed:
                place = number * self.spacing
                crossed = t0 + (t1 - t0) * (place - lead - z0) / (z1 - z0)
                self._on_their_way.append(Edge(crossed + self.latency, place))

    def _invent(self, t0: float, t1: float, surge: float) -> None:
        for _ in range(self._random.poisson(self.false_rate * (t1 - t0))):
            place = self.spacing * round((surge + self._random.uniform(-1.0, 1.0)) / self.spacing)
            self._on_their_way.append(Edge(self._random.uniform(t0, t1), place))
