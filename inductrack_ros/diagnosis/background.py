# SPDX-License-Identifier: Apache-2.0
"""What the log and the rig do besides: processes that are tried, kept where they pay, and told as findings.

A process stands beside the physics and competes with it: it stays only while the deviance without it, whatever physics
was added since, is higher than chance would make it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from ..checks import Finding
from ..estimation.kalman import LinearRun
from ..estimation.likelihood import TOLERANCE, MostLikely, Point, maximise_evidence
from ..estimation.problem import Problem
from ..estimation.processes import (
    COLOURED,
    HUM,
    IMPACT,
    JITTER,
    KINDS,
    LOOSE,
    NOISY_RUN,
    ROUNDED,
    RUN_TO_RUN,
    WHITE,
    Process,
    rounding,
)
from ..estimation.scores import Background
from ..estimation.shooting import ANEW, Fit, first_power, fit, linearise_all
from .humming import humming
from .settings import LEVEL, REFIT_STEPS

#: Passes of the search for the sizes of processes at one linearisation.
PASSES = 10
#: Shares of the fitted power from which they start: what a process takes over, the plant no longer does.
STARTS = (1.0, 1e-3)
#: Rounded readings count as if so many of them were one.
ALIKE = 2.0
#: Noise beside the rounding, in steps, that is tried, and that a first fit takes: half of the sawtooth is left by it,
#: nothing by the largest. A trajectory is not known to less than a tenth of a step.
DITHERS, FIRST_DITHER = (0.1, 0.15, 0.2, 0.3, 0.5), 0.2
#: Stamps further off than this part of the time between samples would come in the wrong order.
MOST_JITTER = 0.3
#: Fewer runs say nothing of what differs from run to run.
FEWEST_RUNS = 3
#: Lags at which a memory of the noise shows, and the chance that a channel without one is suspected.
LAGS, SUSPICION = (1, 2, 4, 8), 0.05
#: Steps of a time in its logarithm, of a frequency in turns over a run, when it is looked for.
TIME_STEP, TURN_STEP, LONGEST_STEP = 0.3, 0.1, 3.0


def noise_of_rounding(hints: Sequence[Finding]) -> dict[str, float]:
    """Noise to be reckoned with in channels whose readings are rounded: `ALIKE` times the variance of a rounding error.

    Rounding errors of neighbouring readings are alike where the coordinate moves by nearly a whole number of steps
    between them, so several tell little more than one. A likelihood of intervals in place of a Gaussian would make this
    needless."""
    return {h.channel: float(np.sqrt(ALIKE / 12.0) * h.size["step"]) for h in hints if h.kind == ROUNDED and h.channel}


def processes_at_first(problem: Problem, given: Sequence[str], hints: Sequence[Finding] = ()) -> tuple[Process, ...]:
    """Those of every fit: contact is never exact, noise that is not ``given`` has to be found, and rounding is not
    noise alone."""
    rounded = tuple(
        Process(ROUNDED, h.channel, FIRST_DITHER, h.size["step"])
        for h in hints
        if h.kind == ROUNDED and h.channel in problem.channels
    )
    touch = (Process(IMPACT, size=LOOSE),) if problem.model.parameters["contact_stiffness"] else ()
    return touch + rounded + tuple(Process(WHITE, c) for c in problem.channels if c not in given)


def optional(p: Process, given: Sequence[str]) -> bool:
    """Whether a process has to pay for itself; it does not where it is held, or is noise that is not ``given`` and has
    to be found."""
    return p.freedom > 0 and not (p.kind == WHITE and p.on not in given)


def price(problem: Problem, given: Sequence[str], processes: Sequence[Process]) -> float:
    """Fall of the deviance that chance reaches with these processes in `LEVEL` of campaigns, all that are tried
    counted."""
    family = len(problem.channels) * sum(KINDS[k][1] for k in (COLOURED, HUM, WHITE)) + len(problem.runs) + 3
    return sum(float(stats.chi2.isf(LEVEL / family, p.freedom)) for p in processes if optional(p, given))


def improved(
    problem: Problem, f: Fit, given: Sequence[str], hints: Sequence[Finding], tell: Callable[[str], None]
) -> Fit:
    """A fit with all processes that pay, and without those that do not."""
    f = dithered(problem, f)
    while True:
        plain = linearise_all(problem, f)
        here = f.deviance + price(problem, given, f.processes)
        tried = [_tried(problem, f, plain, (*f.processes, *more)) for more in families(problem, f, plain, hints)]
        best = min(tried, key=lambda s: _cost(problem, given, s), default=None)
        if best is None or _cost(problem, given, best) > here:
            return f
        s = _lean(problem, f, plain, given, best)
        new = fit(problem, f.structure, replace(f.point, power=s.power, processes=s.processes), REFIT_STEPS)
        new = timed(problem, new)
        dearer = new.deviance + price(problem, given, new.processes) > here
        if dearer or {(p.kind, p.on) for p in new.processes} == {(p.kind, p.on) for p in f.processes}:
            return f
        added = (f"{p.kind} {p.on}".strip() for p in new.processes if p not in f.processes)
        tell("beside the model: " + ", ".join(added))
        f = new


def remembering(problem: Problem, whitened: Sequence[np.ndarray]) -> set[str]:
    """Channels whose neighbouring innovations are correlated more than chance makes them; ``whitened`` (m,) of each
    run, NaN where they do not count."""
    found = set()
    for c, channel in enumerate(problem.channels):
        parts = [w[d.channel == c] for d, w in zip(problem.runs, whitened, strict=True)]
        pairs = sum(int(np.isfinite(r).sum()) for r in parts)
        parts = [np.nan_to_num(r) for r in parts]
        power = sum(float(r @ r) for r in parts)
        products = [abs(sum(float(r[lag:] @ r[:-lag]) for r in parts if len(r) > lag)) for lag in LAGS]
        limit = stats.norm.isf(SUSPICION / (2 * len(problem.channels) * len(LAGS))) * np.sqrt(max(pairs, 1))
        if power and max(products) / (power / pairs) > limit:
            found.add(channel)
    return found


def uneven(problem: Problem, whitened: Sequence[np.ndarray]) -> list[str]:
    """Runs in which the innovations of every channel are larger, or of every channel smaller, than in most runs, by
    more than chance makes them.

    Physics that is missing does not show in all channels alike."""
    shape = len(problem.runs), len(problem.channels)
    powers, counts = np.ones(shape), np.zeros(shape)
    for i, (d, w) in enumerate(zip(problem.runs, whitened, strict=True)):
        for c in np.unique(d.channel):
            mine = w[(d.channel == c) & np.isfinite(w)]
            if not len(mine):
                continue
            powers[i, c], counts[i, c] = np.mean(mine**2), len(mine)
    usual = np.array([np.median(powers[counts[:, c] > 0, c]) if counts[:, c].any() else 1.0 for c in range(shape[1])])
    limit = stats.norm.isf(SUSPICION / (2 * shape[0])) * np.sqrt(2.0 / np.maximum(counts, 1.0))
    apart = powers / np.maximum(usual, 1e-300) - 1.0
    odd = [
        ((a > most) | (n == 0)).all() or ((a < -most) | (n == 0)).all()
        for a, most, n in zip(apart, limit, counts, strict=True)
    ]
    return [d.run.name for d, one in zip(problem.runs, odd, strict=True) if one]


def families(
    problem: Problem, f: Fit, plain: Sequence[LinearRun], hints: Sequence[Finding]
) -> list[tuple[Process, ...]]:
    """Processes that could be there besides: those of one kind together, for they mostly come together."""
    have = {(p.kind, p.on) for p in f.processes}
    spacing = float(np.median(np.concatenate([np.diff(np.unique(d.time)) for d in problem.runs])))
    memory = {h.channel: h.size["correlation_time"] for h in hints if h.kind == COLOURED}
    rounded = {h.channel for h in hints if h.kind == ROUNDED and h.channel}
    white = tuple(Process(WHITE, c) for c in problem.channels if (WHITE, c) not in have and c not in rounded)
    here = maximise_evidence(problem, f.structure, plain, f.point, 1)
    whitened = [np.where(s.scored, w, np.nan) for s, w in zip(here.systems, here.evidence.whitened, strict=True)]
    suspects = remembering(problem, whitened) | set(memory)
    hums = humming(problem, whitened) | {h.channel: 1.0 / h.size["frequency"] for h in hints if h.kind == HUM}
    coloured = tuple(
        Process(COLOURED, c, 0.7, memory.get(c, 5 * spacing))
        for c in problem.channels
        if c in suspects and (COLOURED, c) not in have
    )
    jitter = (Process(JITTER, size=0.1 * spacing, most=MOST_JITTER * spacing),) if (JITTER, "") not in have else ()
    hum = tuple(Process(HUM, c, 1.0, t) for c, t in hums.items() if c in problem.channels and (HUM, c) not in have)
    own = tuple(p for p in white if p.on in suspects)
    odd = [] if rounded else uneven(problem, whitened)  # the noise of rounded readings is their step
    noisy = tuple(Process(NOISY_RUN, n) for n in odd if (NOISY_RUN, n) not in have)
    found = [white, noisy, coloured + own if coloured else (), jitter, hum]
    if len(problem.runs) >= FEWEST_RUNS:
        free = [n for n in f.structure.free if "." not in n and (RUN_TO_RUN, n) not in have]
        found += [(Process(RUN_TO_RUN, n, 0.05),) for n in free]
    return [one for one in found if one]


def backgrounds(problem: Problem, given: Sequence[str], fits: Sequence[Fit]) -> list[Background]:
    """The background of each fit."""
    return [Background(x.power, x.processes, price(problem, given, x.processes)) for x in fits]


def quieter(problem: Problem, f: Fit, given: Sequence[str], plain: Sequence[LinearRun]) -> list[Fit]:
    """A fit, then that without each kind of its processes and without any: physics may do what one of them seems to do,
    or several together.

    The disturbances are settled along the trajectories of the fit, which stay."""
    kinds = list(dict.fromkeys(p.kind for p in f.processes if optional(p, given)))
    left_out = [{k} for k in kinds] + ([set(kinds)] if len(kinds) > 1 else [])
    power = np.maximum(f.power, ANEW * first_power(problem, plain)) if kinds else f.power
    found = [f]
    for out in left_out:
        fewer = tuple(p for p in f.processes if p.kind not in out or not optional(p, given))
        s = _settled(problem, f, plain, power, fewer)
        found.append(replace(f, power=s.power, processes=s.processes, deviance=s.evidence.deviance))
    return found


def _settled(
    problem: Problem, f: Fit, plain: Sequence[LinearRun], power: np.ndarray, processes: Sequence[Process], passes=PASSES
) -> MostLikely:
    """Processes and the disturbances beside them as they are likeliest along a fit's trajectories."""
    return maximise_evidence(problem, f.structure, plain, Point(f.theta, f.paths, power, tuple(processes)), passes)


def _cost(problem: Problem, given: Sequence[str], s: MostLikely) -> float:
    """The deviance with what the processes cost by chance."""
    return s.evidence.deviance + price(problem, given, s.processes)


def _refitted(problem: Problem, f: Fit, **changes: object) -> Fit:
    """A fit from its own point with another power or other processes; as it was where that is lost."""
    new = fit(problem, f.structure, replace(f.point, **changes), REFIT_STEPS)
    return f if new.lost else new


def _tried(problem: Problem, f: Fit, plain: Sequence[LinearRun], processes: Sequence[Process]) -> MostLikely:
    """Processes settled, the better of `STARTS`; those of which nothing is left are dropped."""
    starts = STARTS if processes[-1].kind == RUN_TO_RUN else STARTS[:1]
    settled = [_settled(problem, f, plain, share * f.power, processes) for share in starts]
    best = min(settled, key=lambda s: s.evidence.deviance)
    return replace(best, processes=tuple(p for p in best.processes if not p.gone or p.kind == WHITE))


def _lean(problem: Problem, f: Fit, plain: Sequence[LinearRun], given: Sequence[str], tried: MostLikely) -> MostLikely:
    """Without each process beside the fit's own that does not pay for itself."""
    for p in tried.processes:
        if p in f.processes or not optional(p, given):
            continue
        fewer = tuple(q for q in tried.processes if (q.kind, q.on) != (p.kind, p.on))
        without = _settled(problem, f, plain, tried.power, fewer)
        if _cost(problem, given, without) < _cost(problem, given, tried):
            tried = without
    return tried


def lean(problem: Problem, f: Fit, given: Sequence[str]) -> Fit:
    """A fit without the processes that no longer pay."""
    plain = linearise_all(problem, f)
    here = maximise_evidence(problem, f.structure, plain, f.point, 1)
    here = replace(here, evidence=replace(here.evidence, deviance=f.deviance))  # with what its trajectories miss
    best = _lean(problem, replace(f, processes=()), plain, given, here)
    if len(best.processes) == len(f.processes):
        return f
    return _refitted(problem, f, power=best.power, processes=best.processes)


def dithered(problem: Problem, f: Fit) -> Fit:
    """A fit with the noise beside each rounding that leaves the smallest residuals."""
    if not any(p.kind == ROUNDED for p in f.processes):
        return f
    plain = linearise_all(problem, f)

    def left(p: Process) -> float:
        kept = (s.data[:, 0] - rounding(problem, d, s, p) for d, s in zip(problem.runs, plain, strict=True))
        return sum(float(r @ r) for r in kept)

    processes = tuple(
        min((replace(p, size=size) for size in DITHERS), key=left) if p.kind == ROUNDED else p for p in f.processes
    )
    return f if processes == f.processes else _refitted(problem, f, processes=processes)


def timed(problem: Problem, f: Fit) -> Fit:
    """A fit with the times of its coloured noise and the frequency of its hum where the deviance is least."""
    for _ in range(PASSES):
        processes = f.processes if f.lost else _likeliest_times(problem, f)
        if processes == f.processes:
            break
        new = _refitted(problem, f, processes=processes)
        if not new.deviance < f.deviance - TOLERANCE:
            break
        f = new
    return f


def _likeliest_times(problem: Problem, f: Fit) -> tuple[Process, ...]:
    """The processes with the times that are likeliest about a fit's trajectories: these are linearised once, and the
    times go step by step."""
    plain, processes = linearise_all(problem, f), f.processes
    at_once = [{p.on} for p in processes if p.kind == COLOURED] + [{p.on for p in processes if p.kind == HUM}]
    kinds = [COLOURED] * (len(at_once) - 1) + [HUM]
    before = np.inf
    for _ in range(PASSES):
        here = _deviance(problem, f, plain, processes)
        if not here < before - TOLERANCE:
            break
        before = here
        for kind, on in zip(kinds, at_once, strict=True):
            if on:
                processes = _stepped(problem, f, plain, processes, kind, on)
    return processes


def _stepped(
    problem: Problem, f: Fit, plain: Sequence[LinearRun], processes: tuple[Process, ...], kind: str, on: set[str]
) -> tuple[Process, ...]:
    """One step of the time of some processes, by a parabola. What readings tell best of coloured noise is how it
    differs from one to the next, so its size moves with the root of its time."""
    period = next(p.time for p in processes if p.kind == kind and p.on in on)
    step = TIME_STEP if kind == COLOURED else TURN_STEP * period / problem.length

    def moved(by: float) -> tuple[Process, ...]:
        grows = 0.5 * by if kind == COLOURED else 0.0
        return tuple(
            replace(p, time=p.time * np.exp(by), size=p.size * np.exp(grows)) if p.kind == kind and p.on in on else p
            for p in processes
        )

    low, here, high = (_deviance(problem, f, plain, moved(by)) for by in (-step, 0.0, step))
    bend = low - 2 * here + high
    best = 0.5 * step * (low - high) / bend if bend > 0 else step * np.sign(low - high)
    best = float(np.clip(best, -LONGEST_STEP * step, LONGEST_STEP * step))
    return moved(best) if _deviance(problem, f, plain, moved(best)) < here else processes


def _deviance(problem: Problem, f: Fit, plain: Sequence[LinearRun], processes: Sequence[Process]) -> float:
    return _settled(problem, f, plain, f.power, processes, passes=1).evidence.deviance
