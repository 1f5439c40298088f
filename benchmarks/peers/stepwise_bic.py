# SPDX-License-Identifier: Apache-2.0
"""Stepwise selection by BIC over `scipy.optimize.least_squares` fits in simulation.

Forward: every effect of the catalogue and every sensor fault is fitted beside what was accepted, with η, γ and each
    run's initial state free; the one that lowers BIC most stays, until none does. Backward: whatever BIC prefers
    without goes.

What helps it: the compiled simulator and its derivatives, the growing horizon of the first fit, the noise level of
    channels for which none is given, and a switch (an effect without parameters) costs one parameter. There is no
    screen: every candidate gets `QUICK` evaluations, which take the initial states' derivatives from the fit before,
    and the `CLOSEST` of them `FULL` with all derivatives fresh. What hurts it: BIC does not allow for how many
    candidates are tried; and a candidate is not fitted over growing horizons again, so where the model without it loses
    long powered runs, the true effect may not be recognised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lombscargle

from inductrack_ros.core.model import Model
from inductrack_ros.core.state import INDEX
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.diagnosis.candidates import SHORTEST_WAVE, names
from inductrack_ros.estimation import noise
from inductrack_ros.estimation.problem import STATE_PRIOR, Linearisation, Problem
from inductrack_ros.estimation.structure import THETA_PRIOR, Structure

from . import Found

#: Evaluations for every candidate, for the closest few, and those few.
QUICK, FULL, CLOSEST = 4, 15, 8
#: Horizons (s) over which the first fit grows, for one long fit from a noisy start loses powered runs; evaluations on
#: each.
HORIZONS, FIRST = (0.15, 0.4, 0.8, 1.1, 1.4, 1.7), 30
#: Effects at the most. No campaign hides more than three; where none fits, BIC would go on for as long as there are
#: any.
MOST = 5
#: Residuals and derivatives over noise are cut here: those of a simulation that has left all bounds.
LOST = 1e8
#: Wavelengths that are tried for a wavy track.
WAVES = 2
WAVE_CHANNELS = ("heave", "gap_top", "gap_left", "heave_rate")

Linear = Sequence[Linearisation]


@dataclass(frozen=True)
class Fitted:
    """A structure at its least squares: z holds theta, then each run's free initial states over their prior's width."""

    structure: Structure
    z: np.ndarray
    chi2: float

    def bic(self, samples: int) -> float:
        """χ² + k ln N; η, γ and the initial states are in every rival alike and are left out."""
        effects = self.structure.effects
        k = sum(max(sum(f.startswith(f"{e}.") for f in self.structure.free), 1) for e in effects)
        return self.chi2 + k * np.log(samples)


class Refitter:
    """Least squares of one campaign for any structure."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.guesses = [d.guess for d in problem.runs]
        #: Residuals to keep for samples that a late sensor's model cannot predict, so that leaving them out wins
        #: nothing.
        self.known = [np.ones(len(d.y)) for d in problem.runs]
        self.splits = np.cumsum([0] + [len(d.free_states) for d in problem.runs])

    def states(self, z: np.ndarray, g: int) -> list[np.ndarray]:
        """Initial states (8,) of every run."""
        found = []
        for d, guess, a, b in zip(self.problem.runs, self.guesses, self.splits[:-1], self.splits[1:], strict=True):
            x = guess.copy()
            x[d.free_states] += z[g + a : g + b] * STATE_PRIOR[d.free_states]
            found.append(x)
        return found

    def linearise(self, structure: Structure, z: np.ndarray, reuse: Linear | None = None) -> Linear:
        """Residuals and derivatives at z; with ``reuse`` those by the initial states are an earlier fit's nearby."""
        g = len(structure.free)
        if reuse is None:
            return self.problem.linearise(structure, z[:g], self.states(z, g))
        parts = self.problem.linearise(structure, z[:g], self.states(z, g), sides=())
        return [replace(part, by_state=old.by_state) for part, old in zip(parts, reuse, strict=True)]

    def fit(self, structure: Structure, z: np.ndarray, evaluations: int, reuse: Linear | None = None) -> Fitted:
        """From z, at most so many evaluations. A weak prior holds what the data say nothing about.

        Each run's rows are rotated onto the few columns they meet (QR): sums of squares stay as they are, and scipy's
        algebra costs next to nothing beside the simulations.
        """
        g = len(structure.free)
        low, high = structure.bounds
        free = np.full(self.splits[-1], np.inf)
        bounds = np.concatenate([low, -free]), np.concatenate([high, free])
        weight = np.concatenate([np.full(g, 1 / THETA_PRIOR), np.ones(self.splits[-1])])
        centre = np.concatenate([structure.start, np.zeros(self.splits[-1])])
        last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

        def rotated(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            if z.tobytes() not in last:
                f, J = [weight * (z - centre)], [np.diag(weight)]
                parts = self.linearise(structure, z, reuse)
                for part, known, a, b in zip(parts, self.known, self.splits[:-1], self.splits[1:], strict=True):
                    rest = np.where(np.isnan(part.residual), known, part.residual)
                    rows = np.hstack([-part.by_theta, -part.by_state * STATE_PRIOR[part.free_states], rest[:, None]])
                    R = np.linalg.qr(np.clip(np.nan_to_num(rows), -LOST, LOST), "r")
                    wide = np.zeros((len(R), z.size))
                    wide[:, :g], wide[:, g + a : g + b] = R[:, :g], R[:, g:-1]
                    f.append(R[:, -1])
                    J.append(wide)
                last.clear()
                last[z.tobytes()] = np.concatenate(f), np.vstack(J)
            return last[z.tobytes()]

        # dogbox, for it takes a start at a bound, where one-sided effects vanish
        result = least_squares(
            lambda z: rotated(z)[0],
            np.clip(z, *bounds),
            lambda z: rotated(z)[1],
            bounds,
            "dogbox",
            x_scale="jac",
            ftol=1e-6,
            max_nfev=evaluations,
        )
        rest = result.fun[z.size :]
        return Fitted(structure, result.x, float(rest @ rest))

    def with_effect(self, fitted: Fitted, name: str, near: Linear) -> Fitted:
        """A first look at one more effect, beside what is there."""
        g, best = len(fitted.structure.free), None
        for start in self.starts(fitted, name):
            structure = fitted.structure.plus(name, start)
            z = np.concatenate([fitted.z[:g], structure.start[g:], fitted.z[g:]])
            new = self.fit(structure, z, QUICK, reuse=near)
            best = new if best is None or new.chi2 < best.chi2 else best
        return best

    def without(self, fitted: Fitted, name: str) -> Fitted:
        """Refitted with one effect taken out."""
        structure = fitted.structure.minus(name)
        keep = [fitted.structure.free.index(f) for f in structure.free]
        z = np.concatenate([fitted.z[keep], fitted.z[len(fitted.structure.free) :]])
        return self.fit(structure, z, FULL)

    def starts(self, fitted: Fitted, name: str) -> Sequence[dict[str, float]]:
        """Where an effect's parameters start: where it vanishes; a wave at the peaks of the residual's spectrum along
        the track."""
        if name != "guideway_waviness":
            return [{}]
        g = len(fitted.structure.free)
        states = self.states(fitted.z, g)
        channel = next((c for c in WAVE_CHANNELS if c in self.problem.channels), None)
        if channel is None:
            return [{}]
        rest = self.problem.residuals(fitted.structure, fitted.z[:g], states)
        place, value = [], []
        for i, (d, r) in enumerate(zip(self.problem.runs, rest, strict=True)):
            out = self.problem.simulate(fitted.structure, i, fitted.z[None, :g], states[i][None])[0]
            mine = (d.channel == self.problem.channels.index(channel)) & np.isfinite(r)
            place.append(out[d.row[mine], INDEX["surge"]])
            value.append(r[mine] - r[mine].mean())
        place, value = np.concatenate(place), np.clip(np.concatenate(value), -LOST, LOST)
        reach = np.ptp(place)
        wave_numbers = 2 * np.pi * np.arange(1, int(1.5 * reach / SHORTEST_WAVE) + 1) / (1.5 * reach)
        power = lombscargle(place, value, wave_numbers)
        starts = []
        for _ in range(WAVES):
            peak = int(np.argmax(power))
            starts += [
                {"amplitude": 5e-5, "wavelength": 2 * np.pi / wave_numbers[peak], "phase": phase}
                for phase in (0.0, np.pi / 2)
            ]
            power[max(peak - 2, 0) : peak + 3] = 0.0
        return starts


def diagnose(campaign: Campaign, model: Model) -> Found:
    """Forward selection and backward pass."""
    problem = Problem(campaign, model, noise.from_samples(campaign) | dict(campaign.noise_std))
    refit = Refitter(problem)
    structure = Structure(problem.model, tuple(campaign.free))
    z = np.concatenate([structure.start, np.zeros(refit.splits[-1])])
    longest = max(d.grid[-1] for d in problem.runs)
    for horizon in (*(h for h in HORIZONS if h < 0.8 * longest), np.inf):
        z = Refitter(problem.within(horizon)).fit(structure, z, FIRST).z
    current = refit.fit(structure, z, FULL)
    if len(campaign.noise_std) < len(problem.channels):
        g = len(structure.free)
        rest = problem.residuals(structure, current.z[:g], refit.states(current.z, g))
        refit.problem = problem = problem.with_changes(sigma=noise.from_residuals(problem, rest, campaign.noise_std))
        current = refit.fit(structure, current.z, FULL)
    for _ in range(MOST):
        near = refit.linearise(current.structure, current.z)
        refit.known = [
            np.where(np.isnan(part.residual), old, part.residual) for part, old in zip(near, refit.known, strict=True)
        ]
        field = sorted(
            (refit.with_effect(current, n, near) for n in names(problem, current.structure)),
            key=lambda f: f.bic(problem.samples),
        )
        closest = [refit.fit(f.structure, f.z, FULL) for f in field[:CLOSEST]]
        best = min(closest, key=lambda f: f.bic(problem.samples), default=current)
        if best.bic(problem.samples) >= current.bic(problem.samples):
            break
        current = best
    while current.structure.effects:
        smaller = min(
            (refit.without(current, n) for n in current.structure.effects), key=lambda f: f.bic(problem.samples)
        )
        if smaller.bic(problem.samples) > current.bic(problem.samples):
            break
        current = smaller
    return Found(current.structure.effects)
