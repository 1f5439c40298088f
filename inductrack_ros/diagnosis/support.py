"""What the data can and cannot support, said before and after the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..core.errors import InputError
from ..data.campaign import Campaign
from ..estimation.fit import Fit, fit
from ..estimation.problem import Problem
from .gate import Gate

#: Fewer samples of all channels than this support no diagnosis.
FEWEST_SAMPLES = 60
#: Fewer runs than this leave none out with confidence.
FEW_RUNS = 3
#: Speeds within this part of each other count as one.
ONE_SPEED = 0.05
#: χ² over degrees of freedom up to which runs count as fitted when they are fitted apart.
FITS = 1.15


def inspect(campaign: Campaign) -> list[str]:
    """Notes on a campaign's limits. Raises `InputError` where there is too little to fit anything."""
    samples = sum(int(run.measured.sum()) for run in campaign.runs)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"{campaign.folder}: {samples} samples in all; a diagnosis needs at least {FEWEST_SAMPLES}")
    notes = []
    if len(campaign.runs) < FEW_RUNS:
        notes.append(f"only {len(campaign.runs)} run(s): how well the model predicts unseen runs is hardly tested; three or more would do")
    for channel in campaign.channels:
        values = np.concatenate([run.samples(channel)[1] for run in campaign.runs if channel in run.channels])
        if np.ptp(values) == 0:
            raise InputError(f"{campaign.folder}: {channel} is {values[0]:g} in every sample: the sensor is dead or the column wrong; leave it out")
    speeds = [_speed(run) for run in campaign.runs]
    speeds = [s for s in speeds if np.isfinite(s)]
    if len(speeds) > 1 and np.ptp(speeds) < ONE_SPEED * max(np.abs(speeds).max(), 1e-9):
        notes.append("all runs start at one speed: effects that differ in how they grow with speed are hard to tell apart")
    if all(run.pulses is None and run.drive_current == 0 for run in campaign.runs):
        notes.append("coasting runs only: nothing can be said about the drive")
    return notes


def _speed(run) -> float:
    if "surge_rate" in run.initial_state:
        return float(run.initial_state["surge_rate"])
    for channel in ("surge_rate", "surge"):
        if channel in run.channels:
            t, y = run.samples(channel)
            if channel == "surge_rate":
                return float(np.median(y[: max(5, len(y) // 50)]))
            n = min(len(t), max(5, len(t) // 20))
            return float(np.polyfit(t[:n], y[:n], 1)[0])
    return float("nan")


def undetermined(names: Sequence[str], base: Fit) -> list[str]:
    """A note for each free parameter that the data say nothing about."""
    return [f"{n} cannot be determined from these runs; it stays at {base.structure.model.parameters.get(n, float('nan')):g}" for n in names]


def disagreeing(problem: Problem, base: Fit) -> list[str]:
    """Names of the runs that, taken apart from the others, fit the model with parameters of their own; none if that does not help."""
    if len(problem.runs) < FEW_RUNS or not base.structure.free:
        return []
    apart: list[int] = []
    rest = list(range(len(problem.runs)))
    while len(apart) < len(problem.runs) // 2:
        inner = fit(problem.subset(rest), base.structure, [base.states[i] for i in rest], base.theta, iterations=10)
        if inner.reduced_chi2 < FITS:
            break
        worst = int(np.argmax([np.nanmean(p.residual**2) for p in inner.linear]))
        apart.append(rest.pop(worst))
    else:
        return []
    if not apart:
        return []
    own = fit(problem.subset(apart), base.structure, [base.states[i] for i in apart], base.theta, iterations=10)
    return [problem.runs[i].run.name for i in sorted(apart)] if own.reduced_chi2 < FITS else []


def leftover(problem: Problem, final: Fit, given: Mapping[str, float], gate: Gate) -> list[str]:
    """Notes on what the final fit shows: a large misfit, noise levels that do not fit, all-contact data."""
    notes = []
    if final.rough:
        notes.append(f"the runs still miss by {np.sqrt(final.reduced_chi2):.2g} times the noise: what is named is a lead, its size not to be relied on")
    touching = [bool((problem.simulate(final.structure, i, final.theta[None], final.states[i][None])[0][:, 8:11].min(axis=1) < 0).mean() > 0.9) for i in range(len(problem.runs))]
    if all(touching):
        notes.append("the cradle touches the track in every run: lift and damping show little; runs that fly would show them")
    if gate.adequate:
        for c, channel in enumerate(problem.channels):
            if channel in given:
                r = np.concatenate([p.residual[(d.channel == c) & np.isfinite(p.residual)] for d, p in zip(problem.runs, final.linear, strict=True)])
                ratio = float(np.sqrt(np.mean(r**2))) if r.size else 1.0
                if not 0.9 < ratio < 1.1:
                    notes.append(f"the noise of {channel} is {ratio:.2f} times the stated noise_std")
    return notes
