"""Is anything missing at all? Many tests, one calibrated answer.

Every test is a quadratic form in the residual after the nuisance (free parameters, initial states) is projected out:
the score of each catalogue effect (Rao), and of a force of any shape on each thing it may act on and depend on (`signatures`),
plus whiteness (Ljung–Box) and the size of χ². Their smallest p-value is compared with its own distribution over
complete models, drawn from the joint Gaussian of all scores (Westfall and Young), so that a complete model is called adequate
in at least 95 of 100 campaigns whatever the campaign is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import linalg, special, stats

from ..estimation.fit import LOST, NOISE_TOLERANCE, Fit
from ..estimation.problem import STATE_PRIOR, Problem
from .signatures import VARIABLES, RunResponse, acts_on, basis, in_words, knots

#: A complete model is turned down in at most this part of campaigns by the scores, whiteness and χ²; whiteness is only a net for
#: what no force explains (its χ² has a heavier tail than the table's), and that shows strongly.
LEVEL_SCORES, LEVEL_WHITENESS, LEVEL_SIZE = 0.005, 0.0001, 0.002
#: Part of these levels above which a rejection is doubtful: it counts only if something explains what is left better than chance would.
DOUBTFUL = 0.1
DRAWS = 3000
#: Basis functions per variable: coarse for all, finer too for what can change abruptly along a run.
COARSE, FINE = 8, 40
LAGS = 12


@dataclass(frozen=True)
class Test:
    """One test: its name, statistic, degrees of freedom and log p-value if it were the only one.

    ``law`` is what a force of any shape acts on and depends on, where the test is of one.
    """

    name: str
    statistic: float
    dof: int
    log_p: float
    law: tuple[str, str] | None = None

    @property
    def p_value(self) -> float:
        """The p-value itself, 0 where it underflows."""
        return float(np.exp(self.log_p))


@dataclass(frozen=True)
class Gate:
    """The answer: ``adequate``, the calibrated p-values of its three parts, and all tests, most telling first."""

    adequate: bool
    p_scores: float
    p_whiteness: float
    p_size: float
    tests: tuple[Test, ...] = field(repr=False)

    @property
    def doubtful(self) -> bool:
        """Whether it was rejected by a hair."""
        parts = (self.p_scores, LEVEL_SCORES), (self.p_whiteness, LEVEL_WHITENESS), (self.p_size, LEVEL_SIZE)
        return not self.adequate and all(p > DOUBTFUL * level for p, level in parts)

    @property
    def smallest(self) -> float:
        """The smallest of the three p-values."""
        return min(self.p_scores, self.p_whiteness, self.p_size)


class Projector:
    """Takes the nuisance out of columns over all samples: initial states run by run, then the global parameters."""

    def __init__(self, problem: Problem, fit: Fit, leave: Sequence[int] = ()):
        """``leave``: indices of theta that are not nuisance and stay in."""
        nuisance = [k for k in range(len(fit.theta)) if k not in {*leave, *fit.structure.held}]
        self.rows, self.bases, residuals, thetas = [], [], [], []
        for part in fit.linear:
            good = np.isfinite(part.residual) & np.isfinite(part.by_theta).all(axis=1) & np.isfinite(part.by_state).all(axis=1)
            scaled = part.by_state[good] * STATE_PRIOR[part.free_states]
            q = _orthonormal(np.vstack([scaled, np.eye(scaled.shape[1])]))[: good.sum()] if scaled.shape[1] else scaled
            self.rows.append(good)
            self.bases.append(q)
            residuals.append(part.residual[good])
            thetas.append(part.by_theta[good][:, nuisance])
        self.sizes = [r.size for r in residuals]
        self.theta = np.zeros((sum(self.sizes), 0))
        self.theta = _orthonormal(self(np.vstack(thetas))) if thetas[0].shape[1] else self.theta
        self.residual = self(np.concatenate(residuals)[:, None])[:, 0]

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Columns (N, l) with the nuisance projected out."""
        parts = np.split(columns, np.cumsum(self.sizes)[:-1])
        # The prior rows behind each basis make this a ridge projection, which is what the fit does.
        out = np.vstack([c - q @ (q.T @ c) for c, q in zip(parts, self.bases, strict=True)])
        return out - self.theta @ (self.theta.T @ out)

    def stack(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Per-run columns (m_i, l), only the rows compared, one above the other; what cannot be predicted does not change."""
        columns = np.vstack([p[rows] for p, rows in zip(parts, self.rows, strict=True)])
        return np.where(np.abs(columns) < LOST, columns, 0.0)


def _orthonormal(a: np.ndarray) -> np.ndarray:
    u, s, _ = np.linalg.svd(a, full_matrices=False)
    return u[:, s > 1e-10 * max(s.max(initial=0.0), 1e-300)]


def force_families(problem: Problem, runs: Sequence[RunResponse]) -> list[tuple[tuple[str, str], list[np.ndarray]]]:
    """A force of any shape on all it may act on and depend on: laws (``heave``, ``surge``) and columns (m_i, l) per run."""
    laid = [(v, at, n) for v in VARIABLES for n in ((COARSE, FINE) if v in ("surge", "time") else (COARSE,)) if (at := knots(runs, v, n)) is not None]
    families = []
    for what, variables in acts_on(runs, problem.dof).items():
        shapes = [(v, [basis(r.variables[v], *at, n) for r in runs]) for v, at, n in laid if v in variables]
        edges = np.cumsum([0] + [parts[0].shape[1] for _, parts in shapes])
        columns = [r.respond(r.forces(what, np.hstack([parts[i] for _, parts in shapes]))) for i, r in enumerate(runs)]
        for (variable, _), a, b in zip(shapes, edges[:-1], edges[1:], strict=True):
            families.append(((what, variable), [c[:, a:b] for c in columns]))
    return families


def check(
    problem: Problem,
    fit: Fit,
    runs: Sequence[RunResponse],
    project: Projector,
    effect_columns: dict[str, list[np.ndarray]] | None = None,
    seed: int = 0,
) -> Gate:
    """Decide whether the fitted model is adequate. ``effect_columns`` are signatures (m_i, l) of catalogue effects by name."""
    named, blocks = [], []
    for name, parts in (effect_columns or {}).items():
        named.append((name, None))
        blocks.append(project(project.stack(parts)))
    for law, parts in force_families(problem, runs):
        named.append((in_words(*law), law))
        blocks.append(project(project.stack(parts)))
    tests, p_scores = _score_tests(named, blocks, project.residual, np.random.default_rng(seed))
    white = _whiteness(problem, fit)
    tests += white
    p_white = min([1.0, *(len(white) * t.p_value for t in white)])  # none where the runs are too short
    size = _size(problem, fit)
    tests.append(size)
    adequate = p_scores > LEVEL_SCORES and p_white > LEVEL_WHITENESS and size.p_value > LEVEL_SIZE
    return Gate(adequate, p_scores, p_white, size.p_value, tuple(sorted(tests, key=lambda t: t.log_p)))


def _score_tests(named, blocks, residual, rng) -> tuple[list[Test], float]:
    """Each block's score test, and the p-value of the smallest over their joint null distribution (or a bound on it, where tiny)."""
    kept, roots = [], []
    for name, block in zip(named, blocks, strict=True):
        values, vectors = np.linalg.eigh(block.T @ block)
        good = values > max(1e-8 * values.max(initial=0.0), 1e-10)
        if good.any():
            kept.append((name, block))
            roots.append(vectors[:, good] / np.sqrt(values[good]))
    if not kept:
        return [], 1.0
    dof = np.array([root.shape[1] for root in roots])
    observed = np.array([np.sum((root.T @ (block.T @ residual)) ** 2) for (_, block), root in zip(kept, roots, strict=True)])
    log_p = stats.chi2.logsf(observed, dof)
    tests = [Test(n, float(o), int(d), float(q), law) for ((n, law), _), o, d, q in zip(kept, observed, dof, log_p, strict=True)]
    if (bound := len(kept) * float(np.exp(log_p.min()))) < 0.1 * LEVEL_SCORES:  # Bonferroni settles it
        return tests, bound
    joint = np.hstack([block @ root for (_, block), root in zip(kept, roots, strict=True)])
    edges = np.cumsum([0, *dof])
    covariance = joint.T @ joint
    values, vectors = linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    keep = values > 1e-10 * values.max()
    draws = rng.standard_normal((DRAWS, int(keep.sum()))) @ root[:, keep].T
    null = np.add.reduceat(draws**2, edges[:-1], axis=1)
    smallest = special.chdtrc(dof, null).min(axis=1)
    p = float((1 + np.sum(smallest <= np.exp(log_p.min()))) / (DRAWS + 1))
    return tests, p


def _whiteness(problem: Problem, fit: Fit) -> list[Test]:
    """Ljung–Box of each channel, samples taken in their order, the products of all runs pooled: short runs by themselves
    have larger autocorrelations than its χ² says."""
    tests = []
    for c, channel in enumerate(problem.channels):
        power, samples = 0.0, 0
        products, pairs = np.zeros(LAGS), np.zeros(LAGS)
        for data, part in zip(problem.runs, fit.linear, strict=True):
            r = part.residual[(data.channel == c) & np.isfinite(part.residual)]
            if r.size < 5 * LAGS:
                continue
            power += r @ r
            samples += r.size
            products += [r[lag:] @ r[:-lag] for lag in range(1, LAGS + 1)]
            pairs += r.size - np.arange(1, LAGS + 1)
        if samples:
            statistic = float(samples * (samples + 2) * np.sum((products / power) ** 2 / pairs))
            tests.append(Test(f"whiteness of {channel}", statistic, LAGS, float(stats.chi2.logsf(statistic, LAGS))))
    return tests


def _size(problem: Problem, fit: Fit) -> Test:
    """χ² against the stated noise, a small error of which is allowed for."""
    used = len(fit.theta) + sum(len(p.free_states) for p in fit.linear)
    dof = max(fit.samples - used, 1)
    statistic = fit.chi2 / (1 + NOISE_TOLERANCE) ** 2
    return Test("size of χ²", statistic, dof, float(stats.chi2.logsf(statistic, dof)))
