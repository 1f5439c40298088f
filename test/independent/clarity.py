# SPDX-License-Identifier: Apache-2.0
"""How clearly a hidden effect shows in a campaign, in units of noise.

Why: a campaign is only a fair question if its effect is neither invisible nor absorbed by what every fit is free to
move (eta, gamma, initial states). Two numbers, both norms of (with the effect - without it) over noise, all runs and
channels together:

- signal_to_noise: nothing refitted;
- signal_after_nuisance: what is left after eta, gamma and the initial states are refitted. Its square is about the
  fall of chi-square that adding the effect brings. It is linear about the truth: the effect's signature and the
  nuisance's are finite differences there. (A difference of whole trajectories would not do: a powered run leaves its
  balance speed exponentially, and a linear refit would not follow.) Effects that are only on or off are refitted by
  Gauss-Newton instead.

Samples after the first contact are left out, for there a nanometre becomes a millimetre; only where sliding friction
is hidden does travel count after it.
"""

import numpy as np

from independent import hidden_effects
from independent import simulator as sim

STEPS = {"far_step": 5e-4, "near_step": 5e-5}  # coarse: only differences between runs count
# finite-difference steps of the start (surge, sway, heave, roll, rates) and of eta, gamma
START_STEPS = np.array([1e-4, 1e-6, 1e-6, 3e-6, 1e-3, 3e-5, 3e-5, 1e-4])
GLOBAL_STEPS = {"eta": 1e-5, "gamma": 1e-4}


def rig_of(eta, gamma, hidden, conditions=None):
    """Rig with the hidden effects, each {"effect": ..., "fields": {...}}; a sensor fault leaves the rig alone.

    conditions: of a run, {"track_temperature": 31.0, ...}.
    """
    changes = {"eta": eta, "gamma": gamma}
    for name, value in (conditions or {}).items():
        changes[hidden_effects.CONDITIONS[name]] = value
    for effect in hidden:
        changes.update(effect.get("fields", {}))
    return sim.rig(**changes)


def faults_of(hidden):
    return [effect for effect in hidden if effect["effect"].startswith("sensor_")]


class Experiment:
    """Runs {"times", "start", "drive_current"}, the channels logged and their noise; predicts in units of noise."""

    cannot_judge = ()  # effects of which it cannot say how clearly they show

    def __init__(self, runs, channels, noise, eta, gamma, past_contact=False):
        self.runs, self.channels, self.eta, self.gamma = runs, list(channels), eta, gamma
        self.noise = np.array([noise[name] for name in channels])
        self.past_contact = past_contact
        self.starts = [np.asarray(run["start"], dtype=float) for run in runs]

    def one(self, index, start, eta, gamma, hidden):
        run = self.runs[index]
        rigs = rig_of(eta, gamma, hidden, run.get("conditions"))
        faults, options = faults_of(hidden), {"stop_at_contact": not self.past_contact, **STEPS}
        values, contact = sim.measure(run["times"], start, run["drive_current"], rigs, self.channels, faults, **options)
        if self.past_contact:
            others = [i for i, name in enumerate(self.channels) if name not in ("surge", "surge_rate")]
            values[np.ix_(run["times"] >= contact, others)] = np.nan
        return (values / self.noise).ravel()

    def predict(self, hidden, starts=None, eta=None, gamma=None):
        starts = self.starts if starts is None else starts
        eta, gamma = self.eta if eta is None else eta, self.gamma if gamma is None else gamma
        return [self.one(i, start, eta, gamma, hidden) for i, start in enumerate(starts)]

    def nuisance(self, hidden, starts=None, eta=None, gamma=None):
        """Jacobians, about the true values unless others are given: per run (rows, 8) to its start, (rows, 2) to eta
        and gamma.
        """
        starts = self.starts if starts is None else starts
        eta, gamma = self.eta if eta is None else eta, self.gamma if gamma is None else gamma
        local, shared = [], []
        for i, start in enumerate(starts):
            base = self.one(i, start, eta, gamma, hidden)
            columns = []
            for j, h in enumerate(START_STEPS):
                moved = start.copy()
                moved[j] += h
                columns.append((self.one(i, moved, eta, gamma, hidden) - base) / h)
            local.append(np.stack(columns, axis=1))
            to_eta = (self.one(i, start, eta + GLOBAL_STEPS["eta"], gamma, hidden) - base) / GLOBAL_STEPS["eta"]
            to_gamma = (self.one(i, start, eta, gamma + GLOBAL_STEPS["gamma"], hidden) - base) / GLOBAL_STEPS["gamma"]
            shared.append(np.stack([to_eta, to_gamma], axis=1))
        return local, shared


def scaled_basis(matrix):
    """Column scales and thin SVD of the scaled matrix, without its null directions."""
    scales = np.linalg.norm(matrix, axis=0)
    scales[scales == 0] = 1
    u, s, vt = np.linalg.svd(matrix / scales, full_matrices=False)
    keep = s > 1e-8 * s[0] if len(s) and s[0] > 0 else np.zeros(len(s), bool)
    return scales, u[:, keep], s[keep], vt[keep]


def regress(difference, local, shared):
    """Least squares of per-run vectors on per-run columns and shared columns; NaN rows are left out.

    Returns residual (one vector), shared coefficients, per-run coefficients.
    """
    residuals, reduced, bases, masks = [], [], [], []
    for d, a, b in zip(difference, local, shared, strict=True):
        rows = np.isfinite(d) & np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        basis = scaled_basis(a[rows])
        u = basis[1]
        residuals.append(d[rows] - u @ (u.T @ d[rows]))
        reduced.append(b[rows] - u @ (u.T @ b[rows]))
        bases.append(basis)
        masks.append(rows)
    r, g = np.concatenate(residuals), np.concatenate(reduced)
    scales, u, s, vt = scaled_basis(g)
    coefficients = (vt.T @ ((u.T @ r) / s)) / scales
    starts = []
    for d, b, rows, (column_scales, u_i, s_i, vt_i) in zip(difference, shared, masks, bases, strict=True):
        left = d[rows] - b[rows] @ coefficients
        starts.append((vt_i.T @ ((u_i.T @ left) / s_i)) / column_scales)
    return r - u @ (u.T @ r), coefficients, starts


def norm(vectors):
    stacked = np.concatenate(vectors)
    return float(np.linalg.norm(stacked[np.isfinite(stacked)]))


def refit(experiment, measured, lacking, iterations=6):
    """Distance (in noise) from `measured` to the nearest prediction of the model with the effects `lacking`: Gauss-
    Newton with halved steps.
    """
    starts, eta, gamma = experiment.starts, experiment.eta, experiment.gamma

    def distance(starts, eta, gamma):
        residual = [m - p for m, p in zip(measured, experiment.predict(lacking, starts, eta, gamma), strict=True)]
        return residual, norm(residual)

    residual, best = distance(starts, eta, gamma)
    for _ in range(iterations):
        local, shared = experiment.nuisance(lacking, starts, eta, gamma)
        _, change, moves = regress(residual, local, shared)
        for shrink in (1.0, 0.3, 0.1, 0.03):
            trial = (
                [s + shrink * m[: len(s)] for s, m in zip(starts, moves, strict=True)],
                eta + shrink * change[0],
                gamma + shrink * change[1],
            )
            new_residual, size = distance(*trial)
            if size < best:
                break
        else:
            break
        improvement = best - size
        (starts, eta, gamma), residual, best = trial, new_residual, size
        if improvement < 0.01 * best:
            break
    return best


def signature(experiment, hidden, j, fraction=1e-3):
    """Effect j of `hidden` to first order: what its present strength does, extrapolated from the last thousandth of
    it; (in noise).
    """
    weaker = hidden[:j] + [hidden[j]["scaled"](1 - fraction)] + hidden[j + 1 :]
    return [(m - p) / fraction for m, p in zip(experiment.predict(hidden), experiment.predict(weaker), strict=True)]


def signals(experiment, hidden):
    """For each hidden effect: signal_to_noise, signal_after_nuisance, and signal_after_others (the other hidden
    effects refitted too).

    Effects that are on or off have no signature of first order; their whole difference stands in for it when the
    others are projected out.
    """
    local, shared = experiment.nuisance(hidden)
    measured = experiment.predict(hidden)
    lacking = [hidden[:j] + hidden[j + 1 :] for j in range(len(hidden))]
    whole = [[m - p for m, p in zip(measured, experiment.predict(others), strict=True)] for others in lacking]
    first_order = [signature(experiment, hidden, j) if hidden[j]["scaled"] else whole[j] for j in range(len(hidden))]
    answers = []
    for j, others in enumerate(lacking):
        linear = float(np.linalg.norm(regress(first_order[j], local, shared)[0]))
        alone = linear if hidden[j]["scaled"] else refit(experiment, measured, others)
        answer = {"signal_to_noise": norm(whole[j]), "signal_after_nuisance": alone}
        if len(hidden) > 1:
            more = [
                np.column_stack([b] + [first_order[i][run] for i in range(len(hidden)) if i != j])
                for run, b in enumerate(shared)
            ]
            with_others = float(np.linalg.norm(regress(first_order[j], local, more)[0]))
            answer["signal_after_others"] = alone * with_others / max(linear, 1e-300)
        answers.append(answer)
    return answers


def imitations(experiment, hidden, index, candidates):
    """What of effect `index` one candidate leaves unexplained, in noise: {name: signal}, smallest first.

    Near zero means a twin in this campaign. candidates: name -> small effects (several where the effect has a shape).
    Linear, about the truth; the other hidden effects stay free.
    """
    local, shared = experiment.nuisance(hidden)
    measured = experiment.predict(hidden)

    def change(effect_list):
        return [m - p for m, p in zip(measured, experiment.predict(effect_list), strict=True)]

    def shown(j):
        return signature(experiment, hidden, j) if hidden[j]["scaled"] else change(hidden[:j] + hidden[j + 1 :])

    # columns: the effect sought, then what stays free, then every candidate's
    free = [shown(j) for j in range(len(hidden)) if j != index]
    taken = {key for effect in hidden for key in effect.get("fields", {})}  # a hidden effect is not its own rival
    owners, columns = [], []
    for name, shapes in candidates.items():
        for shape in shapes:
            if taken.isdisjoint(shape.get("fields", {})):
                owners.append(name)
                columns.append(change([*hidden, shape]))
    everything = []
    sought = shown(index)
    for run in range(len(measured)):
        table = np.column_stack([sought[run], shared[run]] + [c[run] for c in free + columns])
        rows = np.isfinite(table).all(axis=1) & np.isfinite(local[run]).all(axis=1)
        basis = scaled_basis(local[run][rows])[1]
        everything.append(table[rows] - basis @ (basis.T @ table[rows]))
    everything = np.concatenate(everything)
    fixed = 3 + len(free)  # sought, eta, gamma, the other hidden effects
    basis = scaled_basis(everything[:, 1:fixed])[1]
    everything = everything - basis @ (basis.T @ everything)
    target, rivals = everything[:, 0], everything[:, fixed:]
    left = {}
    for name in dict.fromkeys(owners):
        basis = scaled_basis(rivals[:, [i for i, owner in enumerate(owners) if owner == name]])[1]
        left[name] = float(np.linalg.norm(target - basis @ (basis.T @ target)))
    return dict(sorted(left.items(), key=lambda item: item[1]))
