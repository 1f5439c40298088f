# SPDX-License-Identifier: Apache-2.0
"""PySINDy's weak form and FROLS, over the catalogue's signatures, with η and γ projected out.

PySINDy gives the test functions, the weak derivatives and integrals (`WeakPDELibrary`), and the order in which terms
enter (`FROLS`). `pysindy.SINDy` itself has one set of coefficients for each equation, and no terms that differ between
equations. So the rest is ours:

- one smoothing spline for each channel;
- the columns: what each effect does to the accelerations along the smoothed measurements, and what each sensor fault
  does to both sides;
- the rows: all equations of all runs, each over its noise. Adding further noise to the data gives that noise;
- the projection;
- the stop: BIC along the order that FROLS gives. What FROLS 2.1 minimises to stop is the part explained, and that is
  least with no term at all.

What helps it: a wavy track's columns have the wavelengths and phases that explain most (for three parameters each). An
effect without parameters costs one. Measured rates and accelerations have equations of their own. BIC counts
overlapping test functions in part. Slopes in a sensor fault's column are the model's, not those of the noisy data.

What hurts it: stretches at or near contact are left out, so sliding friction hardly shows. Signatures are of first
order, so a large sensor fault looks like several terms."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from pysindy.optimizers import FROLS
from scipy.linalg import LinAlgWarning

from inductrack_ros.core.model import Model
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.diagnosis.candidates import SHORTEST_WAVE, names
from inductrack_ros.estimation import noise
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.structure import Structure

from . import Found
from .weak_rows import DENSITY, WeakRun

#: Most terms that may enter.
MOST = 8
#: Draws of further noise that give the rows' noise.
DRAWS = 6
#: Wavelengths offered for a wavy track.
WAVES = 3


def diagnose(campaign: Campaign, model: Model) -> Found:
    """Weak rows of all runs, nuisance out, FROLS, BIC."""
    np.random.seed(0)  # PySINDy draws its test functions' places from numpy's one generator
    sigma = noise.from_samples(campaign) | dict(campaign.noise_std)
    problem = Problem(campaign, model, sigma)
    structure = Structure(problem.model, tuple(campaign.free))
    runs = [WeakRun(d, structure, sigma, problem.dof) for d in problem.runs]
    kinds = sorted({e for r in runs for e in r.equations})
    scale = noise_of_equations(runs, kinds)

    def stack(parts: list[np.ndarray]) -> np.ndarray:
        """Rows (N, l) over noise from (equations, K, l) per run."""
        return np.vstack(
            [
                (p / np.array([scale[e] for e in r.equations])[:, None, None]).reshape(-1, p.shape[2])
                for r, p in zip(runs, parts, strict=True)
            ]
        )

    target = stack([r.target()[..., None] for r in runs])[:, 0]
    nuisance = np.hstack(
        [stack([r.of_forces(r.of_parameter(structure, k)) for r in runs]) for k in range(len(structure.free))]
    )
    u, s, _ = np.linalg.svd(nuisance / np.maximum(np.linalg.norm(nuisance, axis=0), 1e-12), full_matrices=False)
    basis = u[:, s > 1e-8]

    def project(columns: np.ndarray) -> np.ndarray:
        return columns - basis @ (basis.T @ columns)

    target = project(target)
    terms: list[tuple[str, int, np.ndarray]] = []  # name, what it costs in parameters, column
    for name in names(problem, structure):
        with_it = structure.plus(name)
        new = range(len(structure.free), len(with_it.free))
        if ":" in name:
            terms.append((name, 1, stack([r.of_fault(*name.split(":")) for r in runs])))
        elif name == "guideway_waviness":
            terms += [(name, 3, c) for c in waves(runs, stack, project, target)]
        elif new:
            terms += [(name, 1, stack([r.of_forces(r.of_parameter(with_it, k)) for r in runs])) for k in new]
        else:
            terms.append((name, 1, stack([r.of_forces(r.of_switch(with_it)) for r in runs])))
    seen = []
    for name, cost, column in terms:
        left = project(column[:, 0])
        if np.linalg.norm(left) > 1e-6 * np.linalg.norm(column) > 0:
            seen.append((name, cost, left / np.linalg.norm(left)))
    n = len(target) / max(DENSITY, 1.0) - basis.shape[1]  # rows that overlap count in part
    return Found(select(seen, target, n) if n > 2 * MOST else ())


def noise_of_equations(runs: Sequence[WeakRun], kinds: Sequence[tuple[str, int]]) -> dict[tuple[str, int], float]:
    """Standard deviation of each equation's rows, from further noise on the data."""
    rng = np.random.default_rng(0)
    changes: dict[tuple[str, int], list[np.ndarray]] = {e: [] for e in kinds}
    for _ in range(DRAWS):
        for r in runs:
            for e, rows in zip(r.equations, r.perturbed(rng), strict=True):
                changes[e].append(rows)
    return {e: float(np.std(np.concatenate(c))) or 1.0 for e, c in changes.items()}


def waves(runs: Sequence[WeakRun], stack: Callable, project: Callable, target: np.ndarray) -> list[np.ndarray]:
    """Columns (N, 1) of the wavelengths that explain most of the target, each at its best phase."""
    reach = max(float(np.ptp(r.smoothed.states[:, 0])) for r in runs)
    wave_numbers = 2 * np.pi * np.arange(1, int(1.5 * reach / SHORTEST_WAVE) + 1) / (1.5 * reach)
    tried = []
    for chunk in np.array_split(wave_numbers, max(1, len(wave_numbers) // 60)):
        raw = stack([r.of_forces(r.of_waves(chunk)) for r in runs])
        left = project(raw)
        for j, k in enumerate(chunk):
            pair = slice(2 * j, 2 * j + 2)
            mix = np.linalg.lstsq(left[:, pair], target, rcond=None)[0]
            tried.append((float(target @ (left[:, pair] @ mix)), k, raw[:, pair] @ mix[:, None]))
    best: list[tuple[float, float, np.ndarray]] = []
    for one in sorted(tried, key=lambda t: -t[0]):
        if all(abs(one[1] - other[1]) > 2 * np.pi * 1.5 / reach for other in best):
            best.append(one)
        if len(best) == WAVES:
            break
    return [column for _, _, column in best]


def select(terms: Sequence[tuple[str, int, np.ndarray]], target: np.ndarray, n: float) -> tuple[str, ...]:
    """Names of the terms, in FROLS's order, up to the lowest BIC, n ln(RSS) + k ln n, for n independent rows."""
    X = np.column_stack([c for _, _, c in terms])
    frols = FROLS(max_iter=min(MOST, X.shape[1] - 1), alpha=0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)  # near-twins: their order counts, FROLS's coefficients do not
        frols.fit(X, target)
    order: list[int] = []
    for coefficients in frols.history_:
        order += [int(k) for k in np.flatnonzero(coefficients[0]) if k not in order]
    best, chosen, k = n * np.log(target @ target), 0, 0
    for length in range(1, len(order) + 1):
        k += terms[order[length - 1]][1]
        inside = X[:, order[:length]]
        rest = target - inside @ np.linalg.lstsq(inside, target, rcond=None)[0]
        bic = n * np.log(rest @ rest) + k * np.log(n)
        if bic < best:
            best, chosen = bic, length
    return tuple(dict.fromkeys(terms[j][0] for j in order[:chosen]))
