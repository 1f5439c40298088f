# SPDX-License-Identifier: Apache-2.0
"""How clearly an effect shows in a dirty campaign: the same numbers as `clarity`, where the noise is not white and the
plant is shaken.

Each run is linearised about the rig without effects. A Kalman filter that knows the dirt (colour, shaking, jitter,
ratios) whitens every prediction; differences of whitened predictions are in units of what the best possible observer
has left. A parameter that differs from run to run is free in each run, a run that does not belong is left out. The
filter is written here, apart from the package's. Hum and spikes are taken as known, lost cells as lost samples.
"""

import numpy as np
from numba import njit

from independent import clarity, dirt
from independent import simulator as sim

SMALL = 1e-3  # of the noise, so that no variance is zero
FREE = {"current_differs": 1, "magnets_differ": 0}  # the shared column (eta, gamma) that is each run's own


@njit(cache=True)
def transitions(times, states, current, rigs, steps, found):
    """found (n - 1, 8, 8): what a small change of the state at one sample is at the next."""
    at, moved = np.empty(1), np.empty((1, sim.STATES))
    no_times, no_kicks = np.zeros(0), np.zeros((0, 8))
    for row in range(len(times) - 1):
        at[0] = times[row + 1] - times[row]
        for j in range(8):
            for sign in (-1.0, 1.0):
                s = states[row].copy()
                s[j] += sign * steps[j]
                sim.integrate(at, s, current, rigs, 5e-4, 5e-5, False, no_times, no_kicks, moved)
                found[row, :, j] = found[row, :, j] + sign * moved[0, :8] / (2 * steps[j])


@njit(cache=True)
def gains(F, Q, C, R, P):
    """Kalman gains (n, s, c) and inverse square roots (n, c, c) of the innovations' covariances."""
    n, c, s = C.shape
    K, W = np.zeros((n, s, c)), np.zeros((n, c, c))
    for k in range(n):
        PC = P @ C[k].T
        S = C[k] @ PC + R[k]
        W[k] = np.linalg.inv(np.linalg.cholesky(0.5 * (S + S.T)))
        K[k] = PC @ (W[k].T @ W[k])
        P = P - K[k] @ PC.T
        if k < n - 1:
            P = F[k] @ P @ F[k].T + Q[k]
            P = 0.5 * (P + P.T)
    return K, W


@njit(cache=True)
def innovations(y, F, C, K, W):
    """Whitened innovations (n, c) of readings (n, c), from a start that is known."""
    n, s = len(y), C.shape[2]
    found, x = np.full(y.shape, np.nan), np.zeros(s)
    for k in range(n):
        if np.isnan(y[k]).any():
            break
        e = y[k] - C[k] @ x
        found[k] = W[k] @ e
        if k < n - 1:
            x = F[k] @ (x + K[k] @ e)
    return found


class Experiment(clarity.Experiment):
    """As `clarity.Experiment`, in units of what the dirt leaves."""

    cannot_judge = ("sliding_friction",)  # it shows after the first contact

    def __init__(self, plain, dirts):
        super().__init__(
            plain.runs, plain.channels, dict(zip(plain.channels, plain.noise, strict=True)), plain.eta, plain.gamma
        )
        self.by = {d["name"]: d for d in dirts}
        self.filters = [self._filter(k) for k in range(len(self.runs))]

    def one(self, index, start, eta, gamma, hidden):
        values = super().one(index, start, eta, gamma, hidden).reshape(-1, len(self.channels))
        if self.by.get("odd_run", {"run": -1})["run"] == index:
            values[:] = np.nan
        F, C, K, W = self.filters[index]
        found = np.full(values.shape, np.nan)
        n = min(len(values), len(C))
        found[:n] = innovations(np.ascontiguousarray(values[:n]), F, C, K, W)
        return found.ravel()

    def nuisance(self, *given, **more):
        local, shared = super().nuisance(*given, **more)
        for name, column in FREE.items():
            if name in self.by:
                local = [np.column_stack([a, b[:, column]]) for a, b in zip(local, shared, strict=True)]
        return local, shared

    # -- the filter of one run

    def _filter(self, index):
        run = self.runs[index]
        rigs = clarity.rig_of(self.eta, self.gamma, [], run.get("conditions"))
        states, _ = sim.simulate(
            run["times"], run["start"], run["drive_current"], rigs, stop_at_contact=True, **clarity.STEPS
        )
        n = int(np.isfinite(states[:, 0]).sum())
        times, states = np.ascontiguousarray(run["times"][:n]), np.ascontiguousarray(states[:n])
        F8 = np.zeros((max(n - 1, 0), 8, 8))
        transitions(times, states, float(run["drive_current"]), rigs, clarity.START_STEPS, F8)
        C8 = self._slopes(times, states, run["drive_current"], rigs)
        F, Q, C, P = self._augmented(np.diff(times), F8, C8)
        rates = np.einsum("kcs,ks->kc", C8, np.gradient(states[:, :8], times, axis=0)) if n > 1 else C8[:, :, 0] * 0
        K, W = gains(F, Q, C, self._white(index, rates), P)
        return F, C, K, W

    def _slopes(self, times, states, current, rigs):
        """Readings over noise by state (n, c, 8)."""
        found = np.empty((len(times), len(self.channels), 8))
        for j, h in enumerate(clarity.START_STEPS):
            up, down = states.copy(), states.copy()
            up[:, j] += h
            down[:, j] -= h
            readings = [sim.channels_of(times, s, current, rigs, self.channels) for s in (up, down)]
            found[:, :, j] = (readings[0] - readings[1]) / (2 * h) / self.noise
        return found

    def _augmented(self, spans, F8, C8):
        """Transitions, covariances of what comes between, readings' slopes and the first covariance, with a state for
        each coloured noise and each coloured force.
        """
        shaking = self.by.get("shaken") or self.by.get("shaken_coloured") or {"sizes": {}, "time": 0.0}
        colour = self.by.get("coloured", {"channels": [], "time": 1.0})
        forces = list(shaking["sizes"]) if shaking["time"] else []
        size = 8 + len(colour["channels"]) + len(forces)
        n, c = len(C8), len(self.channels)
        F, Q = np.zeros((max(n - 1, 0), size, size)), np.zeros((max(n - 1, 0), size, size))
        C, P = np.zeros((n, c, size)), np.zeros((size, size))
        F[:, :8, :8], C[:, :, :8] = F8, C8
        for k, (channel, at) in enumerate(zip(colour["channels"], range(8, size), strict=False)):
            phi = np.exp(-spans / colour["time"])
            F[:, at, at], Q[:, at, at], P[at, at] = phi, 1 - phi**2, 1.0
            C[:, self.channels.index(channel), 8 + k] = 1.0
        for name, strength in shaking["sizes"].items():
            k = dirt.COORDINATES.index(name)
            q = (strength / dirt.INERTIA[k]) ** 2
            if forces:
                at = 8 + len(colour["channels"]) + forces.index(name)
                phi, variance = np.exp(-spans / shaking["time"]), q / (2 * shaking["time"])
                F[:, at, at], Q[:, at, at], P[at, at] = phi, variance * (1 - phi**2), variance
                F[:, k, at], F[:, 4 + k, at] = spans**2 / 2, spans
            else:
                Q[:, k, k], Q[:, 4 + k, 4 + k] = q * spans**3 / 3, q * spans
                Q[:, k, 4 + k] = Q[:, 4 + k, k] = q * spans**2 / 2
        return F, Q, C, P

    def _white(self, index, rates):
        """Covariance of white noise (n, c, c) over the stated noise's square."""
        variance = np.ones(len(self.channels))
        for k, c in enumerate(self.channels):
            if c in self.by.get("noise_by_channel", {"ratios": {}})["ratios"]:
                variance[k] *= self.by["noise_by_channel"]["ratios"][c] ** 2
            if (d := self.by.get("coloured")) and c in d["channels"]:
                variance[k] = SMALL**2
            if (d := self.by.get("rounding")) and c in d["channels"]:
                variance[k] = variance[k] * d["noise"] ** 2 + (d["steps"][c] / self.noise[k]) ** 2 / 12
            if (d := self.by.get("dropouts") or self.by.get("spikes")) and c in d["channels"]:
                variance[k] /= 1 - d["share"]
        if (d := self.by.get("noise_by_run")) and d["run"] == index:
            variance *= d["ratio"] ** 2
        found = np.tile(np.diag(variance), (len(rates), 1, 1))
        if d := self.by.get("jitter"):
            found += d["std"] ** 2 * rates[:, :, None] * rates[:, None, :]
        return found
