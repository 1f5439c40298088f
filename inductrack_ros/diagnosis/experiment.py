"""The run that would settle what is open: T-optimal design over a menu (Atkinson and Fedorov).

For each run of the menu the truth is taken to be the chosen model; each rival is given its best chance by refitting the run's initial state
and the shared parameters within what is known of them, and what difference remains is its separation in sigmas.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.state import INDEX
from ..data.measurement import Run
from ..estimation.fit import fit
from ..estimation.problem import Problem, lay_out
from ..estimation.structure import Structure
from .result import Unknown
from .search import Search, Trial

SPEEDS = (12.0, 16.0, 20.0, 26.0, 34.0, 42.0)
CURRENTS = (0.0, 3500.0, 7000.0)
OFFSETS = ((0.0, 0.0, 0.0), (1e-3, 3e-3, 4e-3))  # heave over equilibrium, sway (m), roll (rad)
DURATION = 3.0
RATE = 250.0


@dataclass(frozen=True)
class Proposal:
    """One run of the menu and how far apart it puts the rivals."""

    speed: float
    current: float
    offsets: tuple[float, float, float]
    duration: float
    sigmas: Mapping[str, float]

    @property
    def words(self) -> str:
        """The run in words."""
        drive = f"driven at {self.current:.0f} A" if self.current else "coasting"
        heave, sway, roll = self.offsets
        start = f", released {1e3 * heave:g} mm over the equilibrium heave, {1e3 * sway:g} mm aside and rolled {1e3 * roll:g} mrad" if any(self.offsets) else ""
        return f"start at {self.speed:g} m/s {drive}{start}, for {self.duration:g} s"


def propose(search: Search, chosen: Trial, twins: Mapping[str, tuple[str, ...]], unknown: Unknown | None) -> tuple[str | None, dict[str, float]]:
    """The next run in words with the separation it gives, and that separation in sigmas by rival; None where none helps."""
    rivals = _rival_trials(search, chosen, twins)
    if not rivals:
        if unknown is None:
            return None, {}
        return _look_closer(unknown), {}
    best = None
    for speed in SPEEDS:
        for current in CURRENTS:
            for offsets in OFFSETS:
                try:
                    sigmas = {n: _separation(search, chosen, t, speed, current, offsets, DURATION) for n, t in rivals.items()}
                except InputError:
                    continue
                worst = min(sigmas.values())
                if best is None or worst > min(best.sigmas.values()):
                    best = Proposal(speed, current, offsets, DURATION, sigmas)
    if best is None:
        return None, {}
    gains = ", ".join(f"{n} by {s:.1f} sigmas" for n, s in best.sigmas.items())
    if min(best.sigmas.values()) < 3.0:
        hint = _other_means(twins)
        return f"no single run of this kind settles it; the best ({best.words}) sets apart {gains}. {hint}", dict(best.sigmas)
    return f"{best.words}: sets apart {gains}", dict(best.sigmas)


def _rival_trials(search: Search, chosen: Trial, twins: Mapping[str, tuple[str, ...]]) -> dict[str, Trial]:
    found = {}
    for name, others in twins.items():
        parent = frozenset(n for n in chosen.names if n != name)
        for other in others:
            if (key := parent | {other}) in search.trials:
                found[other] = search.trials[key]
    return found


def _separation(search, chosen, rival, speed, current, offsets, duration) -> float:
    """√χ² that a rival is left with on a run made by the chosen model, after refitting the initial state."""
    model, problem = chosen.fit.model, search.problem
    start = model.initial_state(surge_rate=speed)
    for i, offset in zip((INDEX["heave"], INDEX["sway"], INDEX["roll"]), offsets, strict=True):
        start[i] += offset
    times = np.arange(0.0, duration, 1.0 / RATE)
    made = model.simulate(times, start, drive_current=current)
    channels = problem.channels
    values = np.column_stack([made[c] for c in channels])
    if not np.isfinite(values).all():
        raise InputError("the run leaves all bounds")
    run = Run("proposal", Path("proposal"), channels, times, values, times, current)
    single = problem.subset([])
    single.runs = (lay_out(run, model, problem.channels, problem.dof),)
    truth = _read(single, chosen.fit.model, start[:8])
    data = single.runs[0]
    object.__setattr__(data, "y", truth)
    object.__setattr__(data, "guess", start[:8].copy())
    refit = fit(single, Structure(rival.fit.model, ()), [start[:8]], iterations=6, tolerance=0.1)
    return float(np.sqrt(max(refit.chi2, 0.0)))


def _read(problem: Problem, model, start: np.ndarray) -> np.ndarray:
    structure = Structure(model, ())
    thetas = np.zeros((1, 0))
    out = problem.simulate(structure, 0, thetas, start[None])
    read = problem.predict(structure, 0, thetas, out)[0]
    return np.where(np.isfinite(read), read, problem.runs[0].y)


def _other_means(twins: Mapping[str, tuple[str, ...]]) -> str:
    names = {n for pair in ((k, *v) for k, v in twins.items()) for n in pair}
    if any(n.startswith("sensor_") for n in names):
        return "Check that sensor against another instrument, with the cradle at rest and in motion."
    if names & {"track_resistance", "track_inductance"}:
        return "Only their ratio shows in motion: measure one of them on the bench."
    return "Measure a further channel, or the suspected quantity itself."


def _look_closer(unknown: Unknown) -> str:
    variable = unknown.depends_on[0] if unknown.depends_on else "time"
    where = ""
    if unknown.at.size:
        on = np.abs(unknown.force) > 0.2 * np.abs(unknown.force).max()
        where = f" between {unknown.at[on].min():.3g} and {unknown.at[on].max():.3g}" if on.any() else ""
    if variable == "surge":
        return f"coast slowly and at two further speeds over the track{where + ' m' if where else ''}, with gaps recorded: what depends on the place alone repeats there at every speed"
    if variable == "time":
        return "repeat one run after a pause and once again at another place: what depends on time alone follows the clock, not the track"
    return f"runs that cover {variable}{where} (SI) slowly and quickly, driven and coasting: what depends on {variable} alone repeats there"
