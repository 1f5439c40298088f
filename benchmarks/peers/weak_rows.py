# SPDX-License-Identifier: Apache-2.0
"""A run's equations of motion in PySINDy's weak form, and what each effect and each sensor fault would leave of
them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from pysindy.feature_library import PolynomialLibrary, WeakPDELibrary
from scipy.interpolate import make_smoothing_spline

from inductrack_ros.core.kernel import QUANTITIES
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import ACCELERATIONS, COORDINATES, GAPS, MOVING, RATES
from inductrack_ros.data.measurement import Run
from inductrack_ros.estimation.problem import RunData
from inductrack_ros.estimation.response import STATE_STEPS, gap_geometry
from inductrack_ros.estimation.structure import Structure

#: Half-width (s) of the test functions, their number for each half-width of a run, and the spacing (s) of the grid they
#: live on.
HALF_WIDTH, DENSITY, GRID = 0.06, 3.0, 2e-3
#: Cut-off (Hz) of the smoothing splines: well above what the cradle does, for the test functions smooth too.
CUTOFF = 40.0
#: A gap (m) this small may be contact, whose force no smoothed measurement gives; a hole (s) that no spline should
#: bridge.
CONTACT, HOLE = 2e-4, 0.025
#: Step of the parameters' differences, in typical sizes.
STEP = 2e-3
#: Prior width (m, rad) of the coordinates where gaps do not tell them all; what follows the gaps by less than `TOLD` is
#: not told.
WIDE, TOLD = 2.0, 0.9


@dataclass(frozen=True)
class Smoothed:
    """A run as the weak form sees it: states (n, 8) on a uniform grid, measured accelerations (n, 4; NaN where none),
    and for each channel that tells a place what a unit of it moves the coordinates (4,), and what a unit of each
    coordinate moves it (4,)."""

    times: np.ndarray
    states: np.ndarray
    accelerations: np.ndarray
    placing: Mapping[str, tuple[np.ndarray, np.ndarray]]


def smooth(run: Run, values: np.ndarray, model: Model, sigma: Mapping[str, float]) -> Smoothed:
    """One smoothing spline for each channel; coordinates by weighted least squares where gaps are measured."""
    times = np.linspace(0.0, run.duration, int(run.duration / GRID) + 1)
    splines = {}
    for c, column in zip(run.channels, values.T, strict=True):
        here = np.isfinite(column)
        rate = here.sum() / run.duration
        splines[c] = make_smoothing_spline(run.times[here], column[here], lam=rate / (2 * np.pi * CUTOFF) ** 4)

    def value(c: str, order: int = 0) -> np.ndarray:
        return splines[c](times, nu=order)

    placing = [c for c in run.channels if c in COORDINATES or c in GAPS]
    geometry = np.array(
        [np.eye(4)[COORDINATES.index(c)] if c in COORDINATES else gap_geometry(model)[GAPS.index(c)] for c in placing]
    )
    weight = np.array([sigma[c] ** -2.0 for c in placing])
    to_coordinates = np.linalg.solve(
        geometry.T @ (weight[:, None] * geometry) + np.eye(4) * WIDE**-2.0, geometry.T * weight
    )
    offset = np.array([model.parameters["nominal_gap"] if c in GAPS else 0.0 for c in placing])

    states, accelerations = np.zeros((len(times), 8)), np.full((len(times), 4), np.nan)
    states[:, :4] = (np.array([value(c) for c in placing]) - offset[:, None]).T @ to_coordinates.T
    states[:, 4:] = np.array([value(c, 1) for c in placing]).T @ to_coordinates.T
    for i, (rate, acceleration) in enumerate(zip(RATES, ACCELERATIONS, strict=True)):
        if rate in run.channels:
            states[:, 4 + i] = value(rate)
        if acceleration in run.channels:
            accelerations[:, i] = value(acceleration)

    return Smoothed(
        times, states, accelerations, dict(zip(placing, zip(to_coordinates.T, geometry, strict=True), strict=True))
    )


class WeakRun:
    """One run's equations in weak form: rows for the accelerations of the coordinates that move, for those
    accelerations that are measured, and for rates measured beside their coordinates."""

    def __init__(self, data: RunData, structure: Structure, sigma: Mapping[str, float], dof: int):
        self.data, self.structure, self.sigma = data, structure, sigma
        run = data.run
        self.smoothed = self.smooth(run.values)
        told = sum(np.outer(*pair) for pair in self.smoothed.placing.values())
        moving = [i for i, c in enumerate(COORDINATES) if c in MOVING[dof] and told[i, i] > TOLD]
        self.equations = [("force", i) for i in moving]
        self.equations += [("rate", i) for i in moving if RATES[i] in run.channels and COORDINATES[i] in run.channels]
        self.equations += [("measured", i) for i in moving if ACCELERATIONS[i] in run.channels]
        times = self.smoothed.times
        library = WeakPDELibrary(
            PolynomialLibrary(degree=1, include_bias=False),
            spatiotemporal_grid=times,
            K=max(int(DENSITY * run.duration / HALF_WIDTH), 4),
            H_xt=min(HALF_WIDTH, 0.24 * run.duration),
        )
        self.nominal, gaps = self.evaluate(self.structure.model)
        sampled = np.sort(run.times[run.measured.any(axis=1)])
        bad = gaps.min(axis=1) < CONTACT
        for a, b in zip(sampled[:-1], sampled[1:], strict=True):
            if b - a > HOLE:
                bad |= (times > a) & (times < b)
        kept = np.array([not bad[np.asarray(inside[0])].any() for inside in library.inds_k])
        unit = np.eye(len(times))  # PySINDy's integral and weak derivative are linear: matrices (K, n) hold them
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)  # PySINDy's AxesWarning about its own arrays
            self.integral = np.asarray(library.fit_transform(unit))[kept]
        self.derivative = library.convert_u_dot_integral(unit)[kept]
        self.by_state = np.zeros((len(times), 4, 8))
        for k, h in enumerate(STATE_STEPS):
            step = np.zeros(8)
            step[k] = h
            high, low = (self.evaluate(structure.model, states=self.smoothed.states + s * step)[0] for s in (1, -1))
            self.by_state[:, :, k] = (high - low) / (2 * h)

    def smooth(self, values: np.ndarray) -> Smoothed:
        """These values (n, c) of the run's channels, smoothed."""
        return smooth(self.data.run, values, self.structure.model, self.sigma)

    def evaluate(
        self, model: Model, P: np.ndarray | None = None, states: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (n, 4) and gaps (n, 3) of a model along the run, or along other ``states`` (n, 8)."""
        kernel, data, times = model.kernel, self.data, self.smoothed.times
        states = self.smoothed.states if states is None else states
        P = (model.vector if P is None else P).copy()
        P[kernel.parameters.index("drive_current")] = data.run.drive_current
        extra = len(kernel.states) - 8
        carried = [s for s in range(extra) if kernel.states[8 + s].partition(".")[0] in model.effects]
        rows = np.hstack([states, np.zeros((len(times), extra))])
        dx, q = np.zeros(8 + extra), np.zeros(len(QUANTITIES))
        found, gaps = np.empty((len(times), 4)), np.empty((len(times), 3))
        origin = float(states[0, 0])

        def slope(t: float, x: np.ndarray) -> np.ndarray:
            kernel.evaluate(t, x, P, model.switches, model.moving, origin, data.averaged, *data.pulses, dx, q)
            return dx

        if carried:
            rows[:, 8:] = self._follow(slope, rows)
        for k, (t, x) in enumerate(zip(times, rows, strict=True)):
            found[k], gaps[k] = slope(t, x)[4:8], q[:3]
        return found, gaps

    def _follow(self, slope: Callable, rows: np.ndarray) -> np.ndarray:
        """Effects' own states (n, e), whose rates are linear in them, lagging behind their steady values: y = s + A⁻¹
        ṡ."""
        times, extra = self.smoothed.times, rows.shape[1] - 8
        steady, inverse = np.zeros((len(times), extra)), np.zeros((len(times), extra, extra))
        for k, (t, row) in enumerate(zip(times, rows, strict=True)):
            x = row.copy()
            b = slope(t, x)[8:].copy()
            A = np.empty((extra, extra))
            for j in range(extra):
                x[8:] = np.eye(extra)[j]
                A[:, j] = slope(t, x)[8:] - b
            inverse[k] = np.linalg.pinv(A)
            steady[k] = -inverse[k] @ b
        return steady + np.einsum("nij,nj->ni", inverse, np.gradient(steady, times, axis=0))

    def _rows(self, accelerations: np.ndarray, states: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Rows (equations, K, l): what is left of each equation for histories (n, 4, l), (n, 8, l) and (n, 4, l)."""
        found = []
        for kind, i in self.equations:
            if kind == "force":
                found.append(self.derivative @ states[:, 4 + i] - self.integral @ accelerations[:, i])
            elif kind == "rate":
                found.append(self.derivative @ states[:, i] - self.integral @ states[:, 4 + i])
            else:
                found.append(self.integral @ (measured[:, i] - accelerations[:, i]))
        return np.array(found)

    def target(self) -> np.ndarray:
        """What the nominal model leaves, (equations, K)."""
        s = self.smoothed
        return self._rows(self.nominal[..., None], s.states[..., None], s.accelerations[..., None])[..., 0]

    def perturbed(self, rng: np.random.Generator) -> np.ndarray:
        """How the target changes with further noise on the data, (equations, K)."""
        run = self.data.run
        noisy = self.smooth(run.values + rng.standard_normal(run.values.shape) * [self.sigma[c] for c in run.channels])
        accelerations = self.evaluate(self.structure.model, states=noisy.states)[0]
        return (
            self._rows(accelerations[..., None], noisy.states[..., None], noisy.accelerations[..., None])[..., 0]
            - self.target()
        )

    def of_forces(self, accelerations: np.ndarray) -> np.ndarray:
        """Rows (equations, K, l) that missing accelerations (n, 4, l) would leave."""
        n, _, width = accelerations.shape
        return self._rows(-accelerations, np.zeros((n, 8, width)), np.zeros((n, 4, width)))

    def of_fault(self, fault: str, channel: str) -> np.ndarray:
        """Rows (equations, K, 1) that a unit of a sensor's fault would leave, to first order.

        The slopes are the nominal model's: those of the measurements hold the target's own noise, and FROLS would find
        it there."""
        s, run = self.smoothed, self.data.run
        if channel not in run.channels:
            return np.zeros((len(self.equations), len(self.integral), 1))
        n = len(s.times)
        wrong, slope = np.zeros((n, 8)), np.zeros((n, 8))  # of the states, and its rate
        measured = np.zeros((n, 4))  # of the accelerations' readings
        onward = np.hstack([s.states[:, 4:], self.nominal])
        jerk = np.einsum("nij,nj->ni", self.by_state, onward)
        if channel in s.placing:
            into, out = s.placing[channel]
            place, rate, acceleration, third = (
                history @ out for history in (s.states[:, :4], s.states[:, 4:], self.nominal, jerk)
            )
            offset = self.structure.model.parameters["nominal_gap"] if channel in GAPS else 0.0
            order = {
                "sensor_bias": (np.ones(n), 0 * rate, 0 * rate),
                "sensor_scale": (place + offset, rate, acceleration),
                "sensor_delay": (-rate, -acceleration, -third),
            }
            h, h1, h2 = order[fault]
            unmeasured = np.array([r not in run.channels for r in RATES])
            wrong[:, :4], wrong[:, 4:] = np.outer(h, into), np.outer(h1, into) * unmeasured
            slope[:, :4], slope[:, 4:] = np.outer(h1, into), np.outer(h2, into) * unmeasured
        elif channel in RATES:
            i = RATES.index(channel)
            order = {
                "sensor_bias": (1.0, 0.0),
                "sensor_scale": (s.states[:, 4 + i], self.nominal[:, i]),
                "sensor_delay": (-self.nominal[:, i], -jerk[:, i]),
            }
            wrong[:, 4 + i], slope[:, 4 + i] = order[fault]
        else:
            i = ACCELERATIONS.index(channel)
            order = {"sensor_bias": 1.0, "sensor_scale": self.nominal[:, i], "sensor_delay": -jerk[:, i]}
            measured[:, i] = order[fault]
        by_state = np.einsum("nij,nj->ni", self.by_state, wrong)
        found = []
        for kind, i in self.equations:
            if kind == "force":
                found.append(slope[:, 4 + i] - by_state[:, i])
            elif kind == "rate":
                found.append(slope[:, i] - wrong[:, 4 + i])
            else:
                found.append(measured[:, i] - by_state[:, i])
        return np.array([(self.integral @ f)[:, None] for f in found])

    def of_parameter(self, structure: Structure, k: int) -> np.ndarray:
        """Accelerations (n, 4, 1) by a free parameter where it stands."""
        low, high = (b[k] for b in structure.bounds)
        theta = np.tile(structure.start, (2, 1))
        theta[0, k], theta[1, k] = min(theta[0, k] + STEP, high), max(theta[1, k] - STEP, low)
        P = structure.vectors(theta)
        up, down = (self.evaluate(structure.model, p)[0] for p in P)
        return ((up - down) / (theta[0, k] - theta[1, k]))[..., None]

    def of_switch(self, structure: Structure) -> np.ndarray:
        """Accelerations (n, 4, 1) that an effect without parameters adds."""
        return (self.evaluate(structure.model)[0] - self.nominal)[..., None]

    def of_waves(self, wave_numbers: np.ndarray) -> np.ndarray:
        """Accelerations (n, 4, 2 l) by a sine and a cosine of the track's height at each wave number (rad/m)."""
        s = self.smoothed.states
        phase = np.outer(s[:, 0], wave_numbers)
        height = np.stack([np.sin(phase), np.cos(phase)], axis=2)
        rate = np.stack([np.cos(phase), -np.sin(phase)], axis=2) * wave_numbers[:, None] * s[:, 4, None, None]
        flat = (len(s), 1, 2 * len(wave_numbers))
        return -self.by_state[:, :, 2, None] * height.reshape(flat) - self.by_state[:, :, 6, None] * rate.reshape(flat)
