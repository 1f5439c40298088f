# SPDX-License-Identifier: Apache-2.0
"""Single coils as `Model` uses them: what a state carries of them, steady currents, a run, forces."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..kernel import QUANTITIES, Kernel
from .field import field_table
from .flight import SHORTEST_COIL_STEP, STEP_TIME, STEP_TRAVEL
from .seam import TAKEN
from .settings import CoilTrack

Array = NDArray[np.float64]

#: A steady current is that after so many time constants L/R of a straight flight; longer where coils are coupled.
SETTLING = 15.0
#: Resistance of an open coil over that of a whole one: what flows is nothing to twelve digits.
OPEN = 1e12
#: Steps of a steady flight at most: it may creep.
MOST_STEPS = 20_000
_INDEX = {name: QUANTITIES.index(name) for name in TAKEN}


@dataclass(frozen=True)
class Path:
    """Currents under a given path: ``times`` (n,), ``forces`` (n, 4), repulsion of top, right and left array and drag
    (N); ``heat``, ``work`` on the coils and ``stored`` energy (J), each (n,); ``tail`` is what is carried on."""

    times: Array
    forces: Array
    heat: Array
    work: Array
    stored: Array
    tail: Array


@dataclass(frozen=True)
class Coils:
    """The coils of one model: ``settings``, its ``wavelength`` (m) and the compiled ``kernel`` with them in it."""

    settings: CoilTrack
    wavelength: float
    kernel: Kernel = field(repr=False)

    @cached_property
    def reach(self) -> float:
        """Half the length of track that the field reaches (m)."""
        return 0.5 * self.settings.spacing + self._table.reach

    @cached_property
    def count(self) -> int:
        """Coils that are integrated at a time."""
        return int(2.0 * self.reach / self.settings.pitch) + 2

    @property
    def rest(self) -> Array:
        """What a state carries where no current flows: (1 + count,)."""
        return np.zeros(1 + self.count)

    @cached_property
    def _table(self):
        s = self.settings
        return field_table(self.wavelength, s.wavelengths, s.pitch)

    @cached_property
    def track(self) -> tuple[Array, ...]:
        """What `circuits` calls ``track``."""
        s, table = self.settings, self._table
        faults = [(n, OPEN) for n in s.failed] + list(zip(s.damaged, s.factors, strict=True))
        numbers, factors = np.array(sorted(faults)).reshape(-1, 2).T
        grid = [table.first_place, table.place_step, table.first_gap, table.gap_step, table.reach]
        grid += [s.pitch, s.spacing, 2.0 * np.pi / self.wavelength]
        table_copy = np.array(table.coefficients)  # compiled for an array that may be written to; nobody does
        mutual = np.array(s.mutual_inductance, float)
        return table_copy, np.array(grid), mutual, np.ascontiguousarray(numbers), np.ascontiguousarray(factors)

    def follow(self, times: Array, surges: Array, gaps: Array, q: Array, tail: Array | None = None) -> Path:
        """Currents under a path given at ``times`` (n,): ``surges`` (n,) and ``gaps`` (n, 3) in m, from ``tail`` or no
        current. ``q`` are the kernel's quantities, of which field and circuits are taken."""
        out, ledger = np.empty((len(times), 4)), np.empty((len(times), 3))
        tail = self.rest if tail is None else tail.copy()
        widths = q[[_INDEX[f"width_{side}"] for side in ("top", "right", "left")]]
        amplitude = np.sqrt(q[_INDEX["eta"]]) * q[_INDEX["peak_field"]]
        circuit = float(q[_INDEX["inductance"]]), float(q[_INDEX["resistance"]])
        arrays = (np.ascontiguousarray(a, float) for a in (times, surges, gaps))
        self.kernel.coils["follow_coils"](*arrays, widths, float(amplitude), circuit, self.track, tail, out, ledger)
        heat, work, stored = ledger.T
        return Path(np.asarray(times), out, heat, work, stored, tail)

    def steady(self, surge: float, speed: float, q: Array, further: float = 0.0) -> Path:
        """The last ``further`` metres of a straight flight that ends at ``surge``, at constant ``speed`` (m/s) and the
        gaps in ``q``. A run-up before them makes the currents steady. No current flows at speeds of 0 and below."""
        gaps = np.broadcast_to(q[:3], (2, 3))
        if speed <= 0.0:
            return self.follow(np.zeros(2), np.full(2, surge), gaps, q)
        inductance, resistance = q[_INDEX["inductance"]], q[_INDEX["resistance"]]
        coupled = inductance + 2.0 * np.abs(self.settings.mutual_inductance).sum()
        before = min(SETTLING * coupled / resistance, 2.0 * self.reach / speed)
        step = min(max(STEP_TIME * inductance / resistance, SHORTEST_COIL_STEP), STEP_TRAVEL * self.wavelength / speed)
        run_up = max(int(np.ceil(before / step)), 1)
        last = min(max(int(np.ceil(further / speed / step)), 1), MOST_STEPS)
        split = surge - further
        times = step * np.arange(run_up + 1)
        start = self.follow(times, split + speed * (times - times[-1]), np.broadcast_to(q[:3], (run_up + 1, 3)), q)
        if further == 0.0:
            return start
        surges = np.linspace(split, surge, last + 1)
        return self.follow((surges - split) / speed, surges, np.broadcast_to(q[:3], (last + 1, 3)), q, start.tail)

    def simulate(self, times: Array, start: float, x: Array, P: Array, arguments: tuple, outputs: Array) -> None:
        """Carry a whole state ``x``, coils' currents included, in place from ``start`` through ``times`` (n,); the
        outputs (n, w) go into ``outputs``. ``arguments`` are the kernel's, from its switches on; P is written to."""
        n = len(self.kernel.states)
        state, tail = x[:n].copy(), x[n:].copy()
        self.kernel.coils["simulate_coils"](times, start, state, tail, P, *arguments, self.track, outputs)
        x[:n], x[n:] = state, tail

    def mean_forces(self, surge: float, speed: float, q: Array) -> Array:
        """Repulsions and drag (4,), N, of steady flight, over one pitch that ends at ``surge``."""
        return self.steady(surge, speed, q, self.settings.pitch).forces[1:].mean(axis=0)

    def forces(self, surge: float, tail: Array, q: Array) -> Array:
        """Repulsions and drag (4,), N, of the currents in ``tail`` at a pose: ``q`` holds its gaps."""
        out = np.empty(4)
        self.kernel.coils["forces_now"](float(surge), q, self.track, tail, out)
        return out
