# SPDX-License-Identifier: Apache-2.0
"""One run as a linear stochastic system: square-root filter, likelihood and smoother.

The run is cut at its nodes t_0 < t_1 < …. About a trajectory x_k the deviation δ_k obeys

    δ_{k+1} = Φ_k δ_k + U_k (1, θ) + w_k,    w_k ~ N(0, Q_k),        y_k = H_k δ_k + Y-columns (1, θ) + e,  e ~ N(0, R),

with all measurements scaled to unit noise. Column 0 of ``inputs`` and ``data`` is what the trajectory itself leaves
(defects, residuals); the others are derivatives by parameters θ. The filter carries one mean for each column, so that
its innovations are a regression of white noise on whitened columns (augmented Kalman filter, de Jong 1991), and Q = 0
is the deterministic fit.

Measurements are taken in one by one by Potter's square-root update; disturbances by Householder triangularisation. The
smoother is Bryson and Frazier's in its modified form (Bierman 1973), which never inverts Q or a covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.cache import compiled_once

#: A variance at which a reading says nothing.
MUTE = 1e12
#: A square below which a row of a square root is nothing: the squares of what is smaller lose their digits.
VANISHING = 1e-280


@dataclass(frozen=True)
class LinearRun:
    """A run about a trajectory of n nodes; N states, m measurements, columns c = 1 + g.

    - first (n + 1,): the measurements of node k are first[k]:first[k + 1]
    - sensitivity H (m, N), data (m, c), variance (m,): the measurements, in units of the stated noise
    - transitions Φ (n, N, N), inputs U (n, N, c), spacing (n,) s: the way to the next node (the last is not used)
    - start_root (N, N), start_mean (N, c): a square root of the initial covariance, and the mean
    - kicks (n, N): variances of white disturbances of each state on the way, beside those of the accelerations
    - touching (n,): where the cradle is in contact on the way
    - late (m, 4): what the coordinates' rates add to a reading because it is of another moment
    - struck (m,): readings that show what an impact changes
    - contact (n,): where such readings do not count in any fit; None: where this trajectory touches
    - blown (m,): what of the variance is blows of a contact
    - paced: whether its pulses were fired as the cradle came by (see `in_step`); its first state is then surge
    """

    first: np.ndarray
    sensitivity: np.ndarray
    data: np.ndarray
    variance: np.ndarray
    transitions: np.ndarray
    inputs: np.ndarray
    spacing: np.ndarray
    start_root: np.ndarray
    start_mean: np.ndarray
    kicks: np.ndarray
    touching: np.ndarray
    late: np.ndarray
    struck: np.ndarray
    contact: np.ndarray | None = None
    blown: np.ndarray | None = None
    paced: bool = False

    @property
    def known(self) -> np.ndarray:
        """Readings (m,) that tell anything: a late sensor's first ones are of before the run."""
        return (self.sensitivity != 0.0).any(axis=1)

    @property
    def forgiven(self) -> np.ndarray:
        """Nodes (n,) whose readings of what an impact changes do not count."""
        return self.touching if self.contact is None else self.contact

    @property
    def scored(self) -> np.ndarray:
        """Readings (m,) that count. What an impact changes is only conditioned on during a contact (a partial
        likelihood, Cox 1975)."""
        node = np.repeat(np.arange(len(self.spacing)), np.diff(self.first))
        return ~(self.forgiven[node] & self.struck)

    @property
    def charged(self) -> np.ndarray:
        """Readings (m,) whose noise a deviance counts: those that count, and the others where another fit may count
        them."""
        return self.scored | (self.contact is None)

    @cached_property
    def in_step(self) -> LinearRun:
        """The run as far as its variances go (no columns) where a cradle that is late finds its pulses late as well.

        With its pulses taken as given, a cradle may fall out of step with them, faster than exponentially where they
        push it on. Whoever fires them sees to it that it does not, but how is not known. So how well a run keeps step
        by itself is no evidence for or against a model."""
        F = self.transitions.copy()
        F[:, :, 0] = np.arange(F.shape[1]) == 0
        none = slice(0, 0)
        return replace(
            self, transitions=F, data=self.data[:, none], inputs=self.inputs[:, :, none],
            start_mean=self.start_mean[:, none], paced=False,
        )  # fmt: skip

    def muted(self, which: np.ndarray) -> LinearRun:
        """The run in which some readings (m,) say nothing."""
        return replace(self, variance=np.where(which, MUTE, self.variance))


@dataclass(frozen=True)
class Columns:
    """What small causes do to one run: ``inputs`` (n, N, c) to the state between nodes and ``data`` (m, c) to the
    readings over noise."""

    inputs: np.ndarray
    data: np.ndarray

    def some(self, which: slice) -> Columns:
        """Some of the columns."""
        return Columns(self.inputs[:, :, which], self.data[:, which])

    @staticmethod
    def beside(parts: Sequence[Columns]) -> Columns:
        """The columns of several side by side."""
        return Columns(
            np.concatenate([p.inputs for p in parts], axis=2), np.concatenate([p.data for p in parts], axis=1)
        )


@dataclass(frozen=True)
class Filtered:
    """Innovations (m, c) of every column, their variances (m,), and what the smoother needs of the way there; of a
    paced run also those of the run `in_step`, whose variances are charged."""

    innovations: np.ndarray
    variances: np.ndarray
    gains: np.ndarray
    roots: np.ndarray
    means: np.ndarray
    in_step: Filtered | None = None

    @property
    def charged_variances(self) -> np.ndarray:
        """Variances (m,) of which a deviance counts the logarithms."""
        return self.variances if self.in_step is None else self.in_step.variances

    @property
    def whitened(self) -> np.ndarray:
        """Innovations over their standard deviations, (m, c)."""
        return self.innovations / np.sqrt(self.variances)[:, None]

    def scored(self, run: LinearRun) -> np.ndarray:
        """Whitened innovations (m, c) of the readings that count, 0 for the others."""
        found = self.whitened
        found[~run.scored] = 0.0
        return found

    def tally(self, run: LinearRun, channel: np.ndarray, channels: int) -> np.ndarray:
        """What `log_determinant` needs of a run, (5, channels), from the channel (m,) of each reading.

        Of those that count: Σ log of their variances, Σ log of the variances over their noise's, their number. Of the
        others, where they are not the same in all fits: Σ log of their noise's variance without blows, their
        number."""
        counts = run.scored
        others = run.charged & ~counts
        of_noise, whole = np.log(run.variance), np.log(self.charged_variances)
        without = of_noise if run.blown is None else np.log(run.variance - run.blown)
        parts = (whole * counts, (whole - of_noise) * counts, counts, without * others, others)
        return np.array([np.bincount(channel, weights=w.astype(float), minlength=channels) for w in parts])


def log_determinant(tally: np.ndarray) -> float:
    """Σ log of all innovations' variances, from what all runs tell (5, channels); 1 more for each reading that does not
    count here, but may in another fit.

    Such a reading costs what others of its channel cost that are nothing but noise to the model. So a deviance compares
    with that of other contacts, and how stiff a node's contact happens to be does not matter."""
    counted, wider, many, of_noise, rest = tally
    return float(np.sum(counted + of_noise + rest * (1.0 + wider / np.maximum(many, 1.0))))


@dataclass(frozen=True)
class Smoothed:
    """Deviations (n, N) of the nodes, and what the data show (found, expected) of each variance.

    Twice the log likelihood's derivative is found − expected.

    - of_power (2, 4): by a power of the disturbances
    - of_states (2, N): by the logarithm of the variance of a state's kicks and start
    - of_readings (2, m): by that of a reading; counts (m,): which of these count
    """

    deviations: np.ndarray
    of_power: np.ndarray
    of_states: np.ndarray
    of_readings: np.ndarray
    counts: np.ndarray


def run_filter(run: LinearRun, power: np.ndarray, smooth: bool = True) -> Filtered:
    """Filter a run with disturbances of ``power`` (4,), the spectral density (two-sided) of a white acceleration in
    each coordinate, m²/s³ or rad²/s³. Without ``smooth`` nothing is kept for the smoother: with many columns that is
    most of the memory."""
    m, n_states = run.sensitivity.shape
    columns, kept = run.data.shape[1], len(run.spacing) if smooth else 1
    innovations, variances, gains = np.empty((m, columns)), np.empty(m), np.empty((m, n_states))
    roots, means = np.empty((kept, n_states, n_states)), np.empty((kept, n_states, columns))
    _filter(
        run.first, run.sensitivity, run.data, run.variance, (run.transitions, run.inputs, run.spacing, run.kicks),
        run.start_root.copy(), run.start_mean.copy(), np.asarray(power, float), (innovations, variances, gains), roots,
        means,
    )  # fmt: skip
    beside = run_filter(run.in_step, power, smooth) if run.paced else None
    return Filtered(innovations, variances, gains, roots, means, beside)


def run_smoother(run: LinearRun, filtered: Filtered, theta: np.ndarray) -> Smoothed:
    """Smoothed deviations at parameters θ (g,) of the columns behind the first.

    What moves the cradle during a contact says nothing of the disturbances, for it may be the contact. Only surge goes
    on as it does without."""
    weights = np.concatenate([[1.0], theta])[: filtered.innovations.shape[1]]
    n, size, _ = filtered.roots.shape
    deviations, of_power = np.empty((n, size)), np.zeros((2, 4))
    forgiven = run.forgiven[:, None]
    lasting = np.where(forgiven & (np.arange(4) > 0), 0.0, run.spacing[:, None])
    of_states, of_readings = np.zeros((2, size)), np.zeros((2, len(run.variance)))
    _smoother(
        run.first, run.sensitivity, run.variance, (run.transitions, lasting, np.where(forgiven, 0.0, run.kicks)),
        (filtered.innovations @ weights, filtered.variances, filtered.gains), filtered.roots, filtered.means @ weights,
        deviations, of_power, of_states, of_readings,
    )  # fmt: skip
    if filtered.in_step is not None:  # what is expected is the derivative of what is charged
        even = run_smoother(run.in_step, filtered.in_step, np.empty(0))
        of_power[1], of_states[1], of_readings[1] = even.of_power[1], even.of_states[1], even.of_readings[1]
    return Smoothed(deviations, of_power, of_states, of_readings, run.scored)


@compiled_once
def _triangularised(a, rows, columns):
    """Householder reflections from the right make ``a`` (rows, columns) lower triangular in its first ``rows``
    columns."""
    for i in range(rows):
        norm = 0.0
        for j in range(i, columns):
            norm += a[i, j] * a[i, j]
        if norm < VANISHING:
            for j in range(i, columns):
                a[i, j] = 0.0
            continue
        norm = np.sqrt(norm)
        if a[i, i] > 0.0:
            norm = -norm
        head = a[i, i] - norm
        square = head * head
        for j in range(i + 1, columns):
            square += a[i, j] * a[i, j]
        for r in range(i + 1, rows):
            dot = a[r, i] * head
            for j in range(i + 1, columns):
                dot += a[r, j] * a[i, j]
            dot *= 2.0 / square
            a[r, i] -= dot * head
            for j in range(i + 1, columns):
                a[r, j] -= dot * a[i, j]
        a[i, i] = norm
        for j in range(i + 1, columns):
            a[i, j] = 0.0


@compiled_once
def _taken_in(some, S, C, H, Y, R, f, innovations, variances, gains):
    """Take in some readings (first and last + 1) one by one by Potter's update. It changes the root S (N, N) of the
    covariance and the means C (N, c). The last three are filled; f (N,) is for work."""
    N, columns = C.shape
    for j in range(some[0], some[1]):
        square = R[j]
        f[:] = 0.0
        for b in range(N):
            if H[j, b] != 0.0:
                for a in range(N):
                    f[a] += S[b, a] * H[j, b]
        for a in range(N):
            square += f[a] * f[a]
        shrink = 1.0 / (1.0 + np.sqrt(R[j] / square))
        for a in range(N):
            g = 0.0
            for b in range(N):
                g += S[a, b] * f[b]
            gains[j, a] = g / square
        for a in range(N):
            for b in range(N):
                S[a, b] -= shrink * gains[j, a] * f[b]
        for c in range(columns):
            innovations[j, c] = Y[j, c]
        for a in range(N):
            if H[j, a] != 0.0:
                for c in range(columns):
                    innovations[j, c] -= H[j, a] * C[a, c]
        for a in range(N):
            for c in range(columns):
                C[a, c] += gains[j, a] * innovations[j, c]
        variances[j] = square


@compiled_once
def _filter(first, H, Y, R, way, S, C, power, readings, roots, means):
    """Filter from the root S (N, N) and the means C (N, c) at the first node; ``way`` = (transitions, inputs, spacing,
    kicks) and ``readings`` = (innovations, variances, gains), ``roots`` and ``means`` are filled."""
    transitions, inputs, spacing, kicks = way
    innovations, variances, gains = readings
    n, N = transitions.shape[0], transitions.shape[1]
    columns = Y.shape[1]
    shaken = np.flatnonzero(power > 0.0)
    kicked = np.flatnonzero(kicks.sum(axis=0) > 0.0)
    end = N + 2 * shaken.size + kicked.size
    f, wide, moved = np.empty(N), np.zeros((N, end)), np.empty((N, columns))
    for k in range(n):
        if len(roots) == n:
            roots[k] = S
            means[k] = C
        _taken_in((first[k], first[k + 1]), S, C, H, Y, R, f, innovations, variances, gains)
        if k == n - 1:
            break
        F = transitions[k]
        for a in range(N):
            for b in range(N):
                total = 0.0
                for i in range(N):
                    total += F[a, i] * S[i, b]
                wide[a, b] = total
            for c in range(columns):
                moved[a, c] = inputs[k, a, c]
            for i in range(N):
                if F[a, i] != 0.0:
                    for c in range(columns):
                        moved[a, c] += F[a, i] * C[i, c]
        C[:] = moved
        if end > N:
            T = spacing[k]
            wide[:, N:] = 0.0
            for i, c in enumerate(shaken):
                r = np.sqrt(power[c])
                wide[c, N + 2 * i] = r * np.sqrt(T * T * T / 3.0)
                wide[4 + c, N + 2 * i] = r * np.sqrt(0.75 * T)
                wide[4 + c, N + 2 * i + 1] = r * 0.5 * np.sqrt(T)
            for i, a in enumerate(kicked):
                wide[a, N + 2 * shaken.size + i] = np.sqrt(kicks[k, a])
            _triangularised(wide, N, end)
        S[:] = wide[:, :N]


@compiled_once
def _given_back(some, lam, info, H, R, nu, variances, gains, work, of_readings):
    """Take the adjoint λ (N,) and its information Λ (N, N) back over some readings (first and last + 1), the last
    first: Λ ← h hᵀ/s + (I − K hᵀ)ᵀ Λ (I − K hᵀ). ``of_readings`` is filled, ``work`` (N,) is for work."""
    N = len(lam)
    for j in range(some[1] - 1, some[0] - 1, -1):
        along = nu[j] / variances[j]
        for a in range(N):
            along -= gains[j, a] * lam[a]
        for a in range(N):
            lam[a] += H[j, a] * along
        curved = 1.0 / variances[j]
        for a in range(N):
            total = 0.0
            for i in range(N):
                total += info[a, i] * gains[j, i]
            work[a] = total
            curved += total * gains[j, a]
        for a in range(N):
            if H[j, a] != 0.0:
                for b in range(N):
                    info[a, b] -= H[j, a] * work[b]
                    info[b, a] -= H[j, a] * work[b]
                    info[a, b] += H[j, a] * H[j, b] * curved
        of_readings[0, j], of_readings[1, j] = R[j] * along * along, R[j] * curved


@compiled_once
def _smoother(first, H, R, way, forward, roots, mean, deviations, of_power, of_states, of_readings):
    """Bryson and Frazier's smoother; ``way`` = (transitions, spacing by coordinate, kicks) and ``forward`` =
    (innovations, their variances, gains) of the filter. The last four are filled; see `Smoothed`."""
    transitions, lasting, kicks = way
    nu, variances, gains = forward
    n, N = transitions.shape[0], transitions.shape[1]
    lam, before = np.zeros(N), np.zeros(N)
    info, half = np.zeros((N, N)), np.zeros((N, N))
    for k in range(n - 1, -1, -1):
        if k < n - 1:
            for c in range(4):  # the adjoint is that of node k + 1
                T = lasting[k, c]
                a, b, d = T * T * T / 3.0, T * T, T
                of_power[0, c] += a * lam[c] * lam[c] + b * lam[c] * lam[4 + c] + d * lam[4 + c] * lam[4 + c]
                of_power[1, c] += a * info[c, c] + b * info[c, 4 + c] + d * info[4 + c, 4 + c]
            for a in range(N):
                of_states[0, a] += kicks[k, a] * lam[a] * lam[a]
                of_states[1, a] += kicks[k, a] * info[a, a]
            F = transitions[k]  # λ ← Fᵀ λ, Λ ← Fᵀ Λ F
            for a in range(N):
                before[a] = 0.0
                for i in range(N):
                    before[a] += F[i, a] * lam[i]
                for b in range(N):
                    total = 0.0
                    for i in range(N):
                        total += info[a, i] * F[i, b]
                    half[a, b] = total
            lam[:] = before
            for a in range(N):
                for b in range(N):
                    total = 0.0
                    for i in range(N):
                        total += F[i, a] * half[i, b]
                    info[a, b] = total
        _given_back((first[k], first[k + 1]), lam, info, H, R, nu, variances, gains, before, of_readings)
        for a in range(N):
            total = 0.0
            for b in range(N):
                total += roots[k, b, a] * lam[b]
            before[a] = total
        for a in range(N):
            total = mean[k, a]
            for b in range(N):
                total += roots[k, a, b] * before[b]
            deviations[k, a] = total
    for a in range(N):
        of_states[0, a] += roots[0, a, a] ** 2 * lam[a] * lam[a]
        of_states[1, a] += roots[0, a, a] ** 2 * info[a, a]
