# SPDX-License-Identifier: Apache-2.0
"""A fit from end to end without a start nearby: over growing horizons, so that instability and impacts are taken in bit
by bit."""

from __future__ import annotations

import numpy as np

from .fit import Fit, fit
from .problem import Problem
from .structure import Structure

#: The first horizon (s) and by what they grow. Those shorter than ``ENOUGH`` need so many samples; steps that lose the
#: runs are halved down to ``LEAST``.
SHORTEST, GROWTH, ENOUGH, SAMPLES, LEAST = 0.04, 1.35, 0.15, 100, 0.02
#: A fit that leaves so many times the noise's χ² may only be stuck; one that leaves so many has lost the runs, and only
#: their beginnings still tell anything.
ROUGH, HOPELESS = 1.5, 100.0
#: Where a horizon first misses by this many times the noise's χ², each free parameter is also started at these
#: multiples, unless all are known to this part of themselves by then.
FAR_OFF, MULTIPLES, KNOWN = 10.0, (0.05, 0.15, 0.4, 2.5, 7.0), 0.1


def fit_from_scratch(problem: Problem, structure: Structure) -> Fit:
    """Fit over growing horizons, then over all of the runs: the first take the initial states in, the last the
    instability.

    Far from the truth this arrives where a fit of whole runs does not: their errors grow a thousandfold and contact
    makes them jump."""
    near = _approached(problem, structure)
    if near is None:
        return fit(problem, structure, settle=True)
    lost = not near.chi2 < HOPELESS * near.samples
    return fit(problem, structure, near.states, near.theta, iterations=60, settle=not lost)


def _approached(problem: Problem, structure: Structure) -> Fit | None:
    """The fit over the last of the growing horizons (χ² within it), or the first that is hopeless; None where the runs
    are too short for any."""
    near, states, theta, far, reached = None, None, None, True, 0.0
    horizons = _growing(problem)
    while horizons:
        part = problem.within(horizons[0])
        step = fit(part, structure, states, theta, iterations=8, tolerance=1.0, settle=True)
        if far and not step.chi2 < FAR_OFF * part.samples:
            step, far = min([step, *_far_starts(part, structure)], key=lambda f: f.chi2), False
        rough = not step.chi2 < ROUGH * step.samples
        if rough and near and near.leaves_noise and horizons[0] - reached > LEAST:  # halfway first
            horizons.insert(0, 0.5 * (reached + horizons[0]))
            continue
        if np.isfinite(step.chi2):
            near, states, theta = step, step.states, step.theta
            known = zip(step.deviations.values(), step.values.values(), strict=True)
            far = far and any(s > KNOWN * abs(v) for s, v in known)
        if not step.chi2 < HOPELESS * step.samples:
            break
        reached = horizons.pop(0)
    return near


def _growing(problem: Problem) -> list[float]:
    """The growing horizons (s), all shorter than the longest run."""
    horizons = [SHORTEST]
    while horizons[-1] < problem.length:
        horizons.append(GROWTH * horizons[-1])
    horizons = [h for h in horizons if h >= ENOUGH or problem.within(h).samples >= SAMPLES]
    return [h for h in horizons if h < 0.8 * problem.length]


def _far_starts(problem: Problem, structure: Structure) -> list[Fit]:
    """Fits from multiples of each free parameter: a rig may be far from the paper's."""
    fits = []
    for k, name in enumerate(structure.free):
        for multiple in MULTIPLES:
            values = [structure.value(n) * (multiple if n == name else 1.0) for n in structure.free]
            if structure.value(name) and structure.declarations[k].low <= values[k] <= structure.declarations[k].high:
                fits.append(fit(problem, structure, theta=structure.encode(values), iterations=8, tolerance=1.0))
    return fits
