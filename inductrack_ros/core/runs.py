# SPDX-License-Identifier: Apache-2.0
"""What drives a run, and what a simulated run gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .state import INDEX


@dataclass(frozen=True)
class Pulses:
    """Drive pulses in the order they begin: ``times`` (s, start of the half sine), ``coils`` (index) and ``currents``
    (A, signed), each (n,)."""

    times: np.ndarray
    coils: np.ndarray
    currents: np.ndarray

    def arrays(self, wavelength: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times, coil places (m) and currents as the kernel takes them.

        Coil n stands at n λ/2. Neighbours are wound in opposite sense, so that the current alternates from coil to
        coil as the paper has it; the sign below undoes that.
        """
        order = np.argsort(self.times, kind="stable")
        coils = np.asarray(self.coils, float)[order]
        sign = 1.0 - 2.0 * (np.round(coils) % 2)
        currents = np.asarray(self.currents, float)[order] * sign
        return np.asarray(self.times, float)[order], coils * wavelength / 2, currents


@dataclass(frozen=True)
class Trajectory:
    """A simulated run: ``times`` (n,) and ``outputs`` (n, w), the columns of `state.MOTION` or all of `state.OUTPUTS`;
    ``final`` is the whole last state."""

    times: np.ndarray
    outputs: np.ndarray
    final: np.ndarray

    def __getitem__(self, channel: str) -> np.ndarray:
        if INDEX[channel] >= self.outputs.shape[1]:
            raise KeyError(f"{channel} was not simulated; simulate(…, further=True) does")
        return self.outputs[:, INDEX[channel]]

    @property
    def states(self) -> np.ndarray:
        """The eight states, (n, 8)."""
        return self.outputs[:, :8]
