# SPDX-License-Identifier: Apache-2.0
"""What the data can and cannot support, said before and after the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..core.errors import InputError
from ..data.campaign import Campaign
from ..estimation.problem import Problem
from ..estimation.shooting import Fit
from .result import Step

#: Fewer samples of all channels than this support no diagnosis.
FEWEST_SAMPLES = 60
#: Fewer runs than this leave none out with confidence.
FEW_RUNS = 3
#: Speeds within this part of each other count as one.
ONE_SPEED = 0.05
#: A run of which this part touches the track is one in contact.
ALL_TOUCHING = 0.9
#: χ² over samples of predictions from the start above which they are worth a word (three times the noise), and the part
#: of that of the model as it was which an answer leaves when it hardly lowers it. They decide about words alone.
FAR_OFF, HARDLY = 9.0, 0.5


def inspect(campaign: Campaign) -> list[str]:
    """Notes on a campaign's limits. Raises `InputError` where there is too little to fit anything."""
    samples = sum(int(run.measured.sum()) for run in campaign.runs)
    if samples < FEWEST_SAMPLES:
        raise InputError(f"{campaign.folder}: {samples} samples in all; a diagnosis needs at least {FEWEST_SAMPLES}")
    notes = []
    if len(campaign.runs) < FEW_RUNS:
        notes.append(
            f"only {len(campaign.runs)} run(s): how well the model predicts unseen runs is hardly tested; three or more"
            " would do"
        )
    for channel in campaign.channels:
        values = np.concatenate([run.samples(channel)[1] for run in campaign.runs if channel in run.channels])
        if np.ptp(values) == 0:
            raise InputError(
                f"{campaign.folder}: {channel} is {values[0]:g} in every sample: the sensor is dead or the column"
                " wrong; leave it out"
            )
    speeds = [_speed(run) for run in campaign.runs]
    speeds = [s for s in speeds if np.isfinite(s)]
    if len(speeds) > 1 and np.ptp(speeds) < ONE_SPEED * max(np.abs(speeds).max(), 1e-9):
        notes.append(
            "all runs start at one speed: effects that differ in how they grow with speed are hard to tell apart"
        )
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
    return [
        f"{n} cannot be determined from these runs; it stays at"
        f" {base.structure.model.parameters.get(n, float('nan')):g}"
        for n in names
    ]


def leftover(problem: Problem, final: Fit, far: bool) -> list[str]:
    """Notes on what the final fit shows: one that did not settle or is ``far`` from the rig, data from contact
    alone."""
    notes = []
    if far or not final.converged:
        why = "more is missing than could be found" if far else "the fit did not settle"
        notes.append(f"{why}: what is named is a lead, its size not to be relied on")
    if final.touching and all(t.mean() > ALL_TOUCHING for t in final.touching):
        notes.append(
            "the cradle touches the track in every run: lift and damping show little; runs that fly would show them"
        )
    return notes


def predicted(steps: Sequence[Step], shaken: bool) -> list[str]:
    """A note where the answer does not predict the runs from their start: what is named explains little, or a shaken
    rig is all that is left."""
    first, last = steps[0].reduced_chi2, steps[-1].reduced_chi2
    if not last > FAR_OFF:
        return []
    if len(steps) > 1 and last > HARDLY * first:
        return [
            f"{', '.join(steps[-1].effects)} hardly lowers the error of predictions from the start: it is a lead, not"
            " an answer"
        ]
    if len(steps) == 1 and shaken:
        return [
            f"predicted from their start, the runs are missed by {np.sqrt(last):.3g} times the noise: what shakes the"
            " cradle may be a force with a law of its own"
        ]
    return []


def held(f: Fit) -> list[str]:
    """A note for each parameter that stays as given beside a change of the thrust."""
    names = [f.structure.free[k] for k in f.structure.held]
    return [
        f"{n} is held at {f.values[n]:.4g} as given: the change of the thrust is relative to that, and only their"
        " product shows"
        for n in names
    ]


def check_noise(campaign: Campaign, noise: Mapping[str, float]) -> None:
    """Raise `InputError` for a channel whose noise can neither be had from its samples nor is given."""
    for channel, value in noise.items():
        if not np.isfinite(value) or value <= 0:
            raise InputError(
                f"{campaign.folder}: {channel} never changes from sample to sample, so its noise cannot be estimated; "
                f"give noise_std: {{{channel}: …}} in campaign.yaml, or leave the channel out"
            )
