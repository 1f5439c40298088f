# SPDX-License-Identifier: Apache-2.0
"""Which parameters a handful of measurements fix, and how well: the identification (28) of the paper, with its errors.

The paper's measurements are travel distances: the cradle is shot off at a known speed and one notes how far it got.
Everything here works on a misfit, a function from parameter values to residuals. So distances, time series or both
are fitted by the same lines. Least squares and Nelder–Mead (the paper's method) must agree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import optimize, stats
from scipy.interpolate import PchipInterpolator

from ..core.errors import InputError
from .misfits import Array, Misfit

LEVEL = 0.95  # of every interval stated here
#: Past this relative half width of an interval, or without an end to it, the answer is called a flat valley.
FLAT = 0.25
#: Profiles are followed to this relative distance from the best value; an interval that does not end there has no end.
REACH = 0.9
#: Points of a profile on each side of the best value, about.
POINTS = 7
#: Residual where the model cannot be simulated.
FAR = 1e9
#: Residuals less likely than this under the stated noise alone are remarked upon.
IMPLAUSIBLE = 1e-4


# ---------------------------------------------------------------- fitting


@dataclass(frozen=True)
class Fit:
    """Best values of the free parameters (p,), and what the data say about them.

    ``jacobian`` (n, p) is that of the residuals; ``misfit`` is the sum of their squares; ``covariance`` (p, p) is that
    of the linearised problem at the best values; ``noise`` multiplies the residuals' unit (1 where the noise was
    known). ``nelder_mead`` (p,) is the paper's method's answer to the same question."""

    free: tuple[str, ...]
    values: Array
    jacobian: Array
    covariance: Array
    misfit: float
    noise: float
    degrees: int
    noise_known: bool
    residuals: Array
    start: Array
    nelder_mead: Array | None = None
    evaluations: Mapping[str, int] = field(default_factory=dict)

    @property
    def std(self) -> Array:
        """Standard errors (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlation matrix (p, p)."""
        return self.covariance / np.outer(self.std, self.std)

    @property
    def chance(self) -> float:
        """Probability of residuals this large or larger from the stated noise alone; 1 where the noise was
        estimated."""
        return float(stats.chi2.sf(self.misfit, self.degrees)) if self.noise_known and self.degrees > 0 else 1.0

    @property
    def threshold(self) -> float:
        """By how much the misfit may rise inside the 95 % interval of one parameter (χ², or F where the noise was
        estimated)."""
        if self.noise_known:
            return float(stats.chi2.ppf(LEVEL, 1))
        return float(self.noise**2 * stats.f.ppf(LEVEL, 1, self.degrees))


class Identification:
    """One question to the data: which values of ``misfit.free`` make ``misfit`` least?

    Parameters are moved in units of their starting values, so that steps and tolerances are relative.
    """

    def __init__(self, misfit: Misfit, start: Sequence[float]):
        self.misfit = misfit
        self.start = np.array(start, float)
        self.unit = np.array([abs(s) or d.typical or 1.0 for s, d in zip(self.start, misfit.declared, strict=True)])
        self.low = np.array([d.low for d in misfit.declared]) / self.unit
        self.high = np.array([d.high for d in misfit.declared]) / self.unit
        self.evaluations = 0
        self._count: int | None = None

    def _residuals(self, u: Array) -> Array:
        self.evaluations += 1
        try:
            r = self.misfit((u * self.unit).tolist())
        except InputError:  # values at which nothing flies; wrong input shows at the start already
            if self._count is None:
                raise
            return np.full(self._count, FAR)
        self._count = len(r)
        return np.where(np.isfinite(r), r, FAR)

    def _least_squares(self, u: Array, precise: bool = True) -> tuple[Array, Array, Array]:
        """Minimise over all coordinates from u; returns u, the residuals (n,) and the Jacobian (n, p)."""
        inside = np.clip(u, self.low + 1e-9, self.high - 1e-9)
        found = optimize.least_squares(
            self._residuals,
            inside,
            jac="3-point" if precise else "2-point",
            diff_step=1e-5 if precise else 1e-6,
            bounds=(self.low, self.high),
            xtol=1e-10 if precise else 1e-5,
            ftol=1e-9 if precise else 1e-4,
            gtol=1e-14,
            max_nfev=60,
        )
        return found.x, found.fun, found.jac

    def _held(self, u: Array, held: int, jacobian: Array, tolerance: float) -> tuple[Array, float]:
        """Minimise over all coordinates but ``held``; returns u and the misfit, the latter good to ``tolerance``.

        Gauss–Newton with the ``jacobian`` (n, p) of a point near by, which costs one simulation a step. Where that does
        not go down, or goes down slowly, the derivatives are taken afresh. If that does not help, the step is halved.
        """
        moving = np.flatnonzero(np.arange(len(u)) != held)
        r, fresh, halvings, last = self._residuals(u), False, 0, math.inf
        for _ in range(40):
            if not len(moving):
                break
            step = np.linalg.lstsq(jacobian[:, moving], -r, rcond=None)[0]
            promised = float(np.sum((jacobian[:, moving] @ step) ** 2))
            if promised < tolerance or halvings > 12:
                break
            better = False
            if fresh or promised < 0.25 * last:
                there = u.copy()
                there[moving] = np.clip(u[moving] + 0.5**halvings * step, self.low[moving], self.high[moving])
                r_there = self._residuals(there)
                better = bool(r_there @ r_there < r @ r)
            if better:
                u, r, fresh, halvings, last = there, r_there, False, 0, promised
            elif fresh:
                halvings += 1
            else:
                jacobian, fresh, last = self._jacobian(u, r, moving.tolist()), True, math.inf
        return u, float(r @ r)

    def _jacobian(self, u: Array, r: Array, moving: Sequence[int]) -> Array:
        """Derivatives (n, p) of the residuals r at u by forward differences; columns that do not move are zero."""
        jacobian = np.zeros((len(r), len(u)))
        for i in moving:
            there = u.copy()
            step = 1e-6 * max(abs(u[i]), 1e-3)
            there[i] += step if u[i] + step <= self.high[i] else -step
            jacobian[:, i] = (self._residuals(there) - r) / (there[i] - u[i])
        return jacobian

    def fit(self, nelder_mead: bool = True) -> Fit:
        """Fit by least squares, and by Nelder–Mead from the same start unless told not to. Raises `InputError` where
        data cannot decide at all."""
        u0 = self.start / self.unit
        rough, _, _ = self._least_squares(u0, precise=False)
        best, residuals, jacobian = self._least_squares(rough)
        counts = {"least squares": self.evaluations}
        simplex = None
        if nelder_mead:
            self.evaluations = 0
            simplex = self._nelder_mead(u0)
            counts["Nelder–Mead"] = self.evaluations
            noise_floor = 1.0 if self.misfit.noise_known else 0.0
            other, r, j = self._least_squares(simplex)
            # The simplex looked farther: another minimum.
            if r @ r < residuals @ residuals - 1e-4 * (r @ r + noise_floor):
                best, residuals, jacobian = other, r, j
        degrees = len(residuals) - len(best) - self.misfit.nuisance
        if degrees < 0 or (degrees == 0 and not self.misfit.noise_known):
            need = len(best) + self.misfit.nuisance + (not self.misfit.noise_known)
            raise InputError(
                f"{len(residuals)} measurements cannot fix {len(best)} parameters; give at least {need}, or free fewer"
            )
        noise = 1.0 if self.misfit.noise_known else math.sqrt(max(residuals @ residuals / degrees, 1e-300))
        normal = jacobian.T @ jacobian
        unit = np.outer(self.unit, self.unit)
        return Fit(
            self.misfit.free, best * self.unit, jacobian / self.unit, _inverse(normal) * unit * noise**2,
            float(residuals @ residuals), noise, degrees, self.misfit.noise_known, residuals, self.start,
            None if simplex is None else simplex * self.unit, counts,
        )  # fmt: skip

    def _nelder_mead(self, u: Array) -> Array:
        """Nelder–Mead, started afresh where it stopped until that no longer helps: a simplex that has collapsed in a
        valley stops early."""
        best, size = np.inf, 0.1
        for _ in range(12):
            simplex = np.vstack([u, u + size * np.diag(np.where(u != 0, u, 1.0))])
            found = optimize.minimize(
                lambda v: float(np.sum(self._residuals(np.clip(v, self.low, self.high)) ** 2)), u, method="Nelder-Mead",
                options={"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-8, "maxiter": 300, "maxfev": 500},
            )  # fmt: skip
            moved, u = np.max(np.abs(found.x - u)), found.x
            if found.success and (moved < 1e-6 or best - found.fun <= 1e-7 * max(found.fun, 1.0)):
                break
            best, size = found.fun, 0.02
        return np.clip(u, self.low, self.high)

    # -- how well ----------------------------------------------------------------------------------------------

    def rise(self, fit: Fit, name: str, value: float, near: Array | None = None) -> tuple[float, Array]:
        """How much the least misfit rises when ``name`` is held at ``value``, and where the others (all, (p,)) then
        are."""
        i = fit.free.index(name)
        if near is None:
            near = self._along(fit, i, fit.values, value - fit.values[i])
        u = near / self.unit
        u[i] = value / self.unit[i]
        best, misfit = self._held(u, i, fit.jacobian * self.unit, 1e-5 * fit.threshold)
        return misfit - fit.misfit, best * self.unit

    def _along(self, fit: Fit, i: int, values: Array, change: float) -> Array:
        """Where the linearised valley leads from ``values`` when parameter i moves by ``change``."""
        there = values + fit.covariance[:, i] / max(fit.covariance[i, i], 1e-300) * change
        return np.clip(there, self.low * self.unit, self.high * self.unit)

    def covers(self, fit: Fit, name: str, value: float) -> bool:
        """Whether ``value`` lies in the 95 % profile-likelihood interval of ``name``, without computing the interval's
        ends."""
        return self.rise(fit, name, value)[0] <= fit.threshold

    def profile(self, fit: Fit, name: str) -> Profile:
        """Profile likelihood of one parameter, out to where it has left the 95 % interval on both sides, or to
        `REACH`."""
        i = fit.free.index(name)
        declared = self.misfit.declared[i]
        centre, std = float(fit.values[i]), float(fit.std[i])
        std = std if 0 < std < abs(centre) else 0.05 * self.unit[i]
        limit = fit.threshold
        reach = REACH * abs(centre) if centre else math.inf
        lowest, highest = max(declared.low, centre - reach), min(declared.high, centre + reach)
        found = [(centre, 0.0, fit.values)]
        for sign in (-1.0, 1.0):
            last, rise, near, step = centre, 0.0, fit.values, 2.6 * std / POINTS
            for _ in range(4 * POINTS):
                value = float(np.clip(last + sign * step, lowest, highest))
                if value == last:
                    break
                rise, near = self.rise(fit, name, value, self._along(fit, i, near, value - last))
                found.append((value, max(rise, 0.0), near))
                last = value
                if rise > 1.6 * limit:
                    break
                if len(found) % POINTS == 0:
                    step *= 1.7
        found.sort(key=lambda item: item[0])
        values = np.array([f[0] for f in found])
        rises = np.array([f[1] for f in found])
        low, high = _crossing(values, rises, centre, limit, -1), _crossing(values, rises, centre, limit, 1)
        unit = 1.0 if fit.noise_known else fit.noise**2
        return Profile(name, centre, values, rises / unit, limit / unit, low, high)


def _inverse(normal: Array) -> Array:
    """Inverse of JᵀJ; a direction that the data do not show at all gets a variance that is huge, not none."""
    curvature, axes = np.linalg.eigh(normal)
    floor = max(curvature.max() * 1e-14, 1e-300)
    return (axes / np.maximum(curvature, floor)) @ axes.T


@dataclass(frozen=True)
class Profile:
    """Profile likelihood of one parameter.

    values (n,), the rise of the least misfit over noise² at each (n,), the threshold of the 95 % interval, and the
    interval's ends. An end is infinite where the profile never leaves the threshold.
    """

    name: str
    best: float
    values: Array
    rise: Array
    threshold: float
    low: float
    high: float

    @property
    def flat(self) -> bool:
        """Whether the data leave this parameter open: no end, or wider than a quarter of its value."""
        half = 0.5 * (self.high - self.low)
        return not math.isfinite(half) or half > FLAT * abs(self.best)


def _crossing(values: Array, rises: Array, centre: float, limit: float, side: int) -> float:
    """Where the profile crosses ``limit`` on one side: the signed root of the rise is almost a straight line there."""
    part = values <= centre if side < 0 else values >= centre
    x, y = values[part], np.sqrt(rises[part])
    if side < 0:
        x, y = x[::-1], y[::-1]
    beyond = np.flatnonzero(y > math.sqrt(limit))
    if not len(beyond):
        return side * math.inf
    last = beyond[0]
    y = np.maximum.accumulate(y[: last + 1]) + 1e-12 * np.arange(last + 1)
    return float(PchipInterpolator(y, x[: last + 1])(math.sqrt(limit)))


# ---------------------------------------------------------------- in words


@dataclass(frozen=True)
class Valley:
    """Best and worst determined combination Π θ^w of the parameters: exponents (p,), the largest being 1, and relative
    std of the best."""

    best_exponents: Array
    best_std: float
    worst_exponents: Array


def valley(fit: Fit) -> Valley | None:
    """Directions of the misfit's valley in relative changes of the parameters; None for one parameter or where one is
    zero."""
    if len(fit.values) < 2 or not fit.values.all():
        return None
    relative = fit.covariance / np.outer(fit.values, fit.values)
    variance, axes = np.linalg.eigh(relative)
    best, worst = (v / v[np.argmax(np.abs(v))] for v in (axes[:, 0], axes[:, -1]))
    return Valley(best, math.sqrt(max(variance[0], 0.0)) * float(1.0 / np.max(np.abs(axes[:, 0]))), worst)


def verdict(fit: Fit, profiles: Sequence[Profile]) -> str:
    """What the data fix, in one or two sentences; it says so when the valley is flat."""
    along = valley(fit)
    combination = ""
    if along is not None:
        named = " · ".join(
            _SYMBOLS.get(n, n) + ("" if abs(e - 1) < 5e-3 else f"^{e:.2f}")
            for n, e in sorted(zip(fit.free, along.best_exponents, strict=True), key=lambda pair: -pair[1])
            if abs(e) >= 0.005
        )
        combination = f"What they fix best is {named}, to {_percent(max(along.best_std, 1e-6))}."
    wrong = ""
    if fit.chance < IMPLAUSIBLE:
        ratio = math.sqrt(fit.misfit / fit.degrees)
        wrong = (
            f"The model does not fit: the residuals are {ratio:.2g} times what the stated noise allows. It misses"
            " something, or the measurements contradict each other. "
        )
    flat = [p for p in profiles if p.flat]
    if flat:
        names = [_SYMBOLS.get(p.name, p.name) for p in flat]
        names = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        return f"{wrong}The valley is flat: these data do not determine {names}. {combination}".strip()
    widths = ", ".join(
        f"{_SYMBOLS.get(p.name, p.name)} = {_rounded(p)}"
        + (f" ±{_percent(0.5 * (p.high - p.low) / abs(p.best))}" if p.best else "")
        for p in profiles
    )
    tied = ""
    if len(fit.values) > 1 and (r := np.abs(fit.correlation - np.eye(len(fit.values))).max()) > 0.9:
        tied = f" They are tied to each other (correlation {r:.3f})."
    if wrong:
        return f"{wrong}Its best values are {widths} (95 %, too narrow).{tied} {combination}".strip()
    return f"These data determine {widths} (95 %).{tied} {combination}".strip()


def _rounded(p: Profile) -> str:
    """The best value to the digits that its interval leaves."""
    half = 0.5 * (p.high - p.low)
    return (
        f"{p.best:.{int(np.clip(1 - math.floor(math.log10(half)), 0, 12))}f}"
        if 0 < half < math.inf
        else f"{p.best:.4g}"
    )


def _percent(x: float) -> str:
    return f"{100 * x:.2g} %"


_SYMBOLS = {"eta": "η", "gamma": "γ"}
