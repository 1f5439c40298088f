# SPDX-License-Identifier: Apache-2.0
"""What a rig's log does besides: each kind of dirt drawn with its size, and put on runs and readings.

A dirt is a dict: "name", its sizes, and "findings", what a diagnosis should say of it in the words of campaign.md.
`drawn` draws one or two, `on_runs` changes how runs are flown (kicks, currents, a rig that differs), `on_readings`
changes what is logged of one run. Sizes of noise are in units of the stated noise. Nothing of `inductrack_ros` is
imported.
"""

import numpy as np

from independent import simulator as sim
from independent.hidden_effects import log_uniform

COORDINATES = ("surge", "sway", "heave", "roll")
#: A common shaking, N/sqrt(Hz) and N m/sqrt(Hz), two-sided: the impulse of T seconds has the standard deviation
#: size * sqrt(T).
SHAKING = {"surge": 0.42, "sway": 0.042, "heave": 0.021, "roll": 1e-3}
INERTIA = np.array([sim.FIELDS["mass"]] * 3 + [sim.FIELDS["roll_inertia"]])
KICK_EVERY = 5e-4  # s between kicks
#: Parameters that may be named for a current, or for magnets, that differ from run to run.
CURRENTS, MAGNETS = ["gamma", "drive_current"], ["eta", "gamma", "peak_field"]


def drawn_size(rng, low, high):
    """A size between two, in three digits."""
    return float(f"{log_uniform(rng, low, high):.3g}")


def _some(rng, names, every=0.6):
    """All names, or a few of them."""
    names = list(names)
    if len(names) == 1 or rng.random() < every:
        return names
    few = rng.choice(len(names), rng.integers(1, len(names)), replace=False)
    return [names[k] for k in sorted(few)]


def _by_channel(kind, channels, **sizes):
    return [{"kind": kind, "channel": c, **{n: v[c] if isinstance(v, dict) else v for n, v in sizes.items()}}
            for c in channels]  # fmt: skip


# ---- drawing: each takes (rng, plan, runs) -------------------------------------------------------


def spikes(rng, plan, runs):
    channels, share = _some(rng, plan["channels"]), drawn_size(rng, 0.003, 0.02)
    return {"channels": channels, "share": share, "findings": _by_channel("outliers", channels, share=share)}


def tails(rng, plan, runs):
    channels, nu = _some(rng, plan["channels"]), float(f"{rng.uniform(2.5, 5):.2g}")
    return {"channels": channels, "nu": nu, "findings": []}  # telling them from spikes is a matter of taste


def rounding(rng, plan, runs):
    channels, steps, left = _some(rng, plan["channels"]), drawn_size(rng, 1.5, 6), drawn_size(rng, 0.1, 1)
    found = _by_channel("quantised", channels, step={c: float(f"{steps * plan['noise'][c]:.3g}") for c in channels})
    return {"channels": channels, "steps": {f["channel"]: f["step"] for f in found}, "noise": left, "findings": found}


def coloured(rng, plan, runs):
    channels, time = _some(rng, plan["channels"]), drawn_size(rng, 2, 15) / plan["rate"]
    return {"channels": channels, "time": time, "findings": _by_channel("coloured_noise", channels,
                                                                       correlation_time=time)}  # fmt: skip


def jitter(rng, plan, runs):
    std = float(f"{rng.uniform(0.05, 0.15) / plan['rate']:.3g}")
    return {"std": std, "findings": [{"kind": "time_jitter", "std": std}]}


def hum(rng, plan, runs):
    able = [f for f in (16.7, 50.0, 60.0, 100.0) if f < 0.4 * plan["rate"]]
    channels, frequency, amplitude = _some(rng, plan["channels"]), float(rng.choice(able)), drawn_size(rng, 0.7, 3)
    sizes = {c: float(f"{amplitude * plan['noise'][c]:.3g}") for c in channels}
    found = _by_channel("hum", channels, frequency=frequency, amplitude=sizes)
    return {"channels": channels, "frequency": frequency, "amplitude": amplitude, "findings": found}


def noise_by_channel(rng, plan, runs):
    ratios = {c: drawn_size(rng, 0.4, 3) for c in _some(rng, plan["channels"], 0.3)}
    told = [c for c, r in ratios.items() if not 0.75 < r < 1.3]
    return {"ratios": ratios, "findings": _by_channel("noise_differs", told, ratio=ratios)}


def noise_by_run(rng, plan, runs):
    return {"run": int(rng.integers(len(runs))), "ratio": drawn_size(rng, 1.7, 4), "findings": []}


def dropouts(rng, plan, runs):
    channels, share = _some(rng, plan["channels"]), float(f"{rng.uniform(0.05, 0.3):.2g}")
    return {"channels": channels, "share": share, "length": drawn_size(rng, 0.01, 0.06), "findings": []}


def shaken(rng, plan, runs):
    return _shaking(rng, 0.0)


def shaken_coloured(rng, plan, runs):
    return _shaking(rng, drawn_size(rng, 0.005, 0.05))


def _shaking(rng, time):
    factor = drawn_size(rng, 0.3, 2)
    sizes = {c: float(f"{factor * SHAKING[c]:.3g}") for c in _some(rng, COORDINATES, 0.5)}
    found = [{"kind": "shaken", "coordinate": c, "size": s} for c, s in sizes.items()]
    return {"sizes": sizes, "time": time, "findings": found}


def current_differs(rng, plan, runs):
    if sum(run["drive_current"] > 0 for run in runs) < 4:
        return None
    return _differs(drawn_size(rng, 0.002, 0.015), CURRENTS)


def magnets_differ(rng, plan, runs):
    return _differs(drawn_size(rng, 0.0007, 0.004), MAGNETS) if len(runs) > 3 else None


def _differs(std, parameters):
    return {"std": std, "findings": [{"kind": "run_to_run", "parameter": parameters, "relative_std": std}]}


def odd_run(rng, plan, runs):
    if len(runs) < 5:
        return None
    k, what = int(rng.integers(len(runs))), str(rng.choice(["eta", "mass"]))
    factor = 1 + float(rng.choice([-1, 1])) * drawn_size(rng, 0.02, 0.08)
    return {"run": k, "what": what, "factor": factor, "findings": [{"kind": "bad_run", "run": f"run_{k:02d}"}]}


def saturated(rng, plan, runs):
    able = [c for c in ("sway", "heave", "roll") if c in plan["channels"]]
    if not able:
        return None
    return {"channel": str(rng.choice(able)), "share": float(f"{rng.uniform(0.03, 0.12):.2g}"), "findings": []}


DIRTS = {f.__name__: f for f in (
    spikes, tails, rounding, coloured, jitter, hum, noise_by_channel, noise_by_run, dropouts, shaken, shaken_coloured,
    current_differs, magnets_differ, odd_run, saturated,
)}  # fmt: skip
#: Kinds that would hide each other's size, so that no truth could be told of both.
APART = [{"spikes", "tails"}, {"shaken", "shaken_coloured"}, {"coloured", "tails"}, {"noise_by_channel", "rounding"},
         {"current_differs", "magnets_differ"}]  # fmt: skip


def drawn(rng, plan, runs, names=None):
    """One dirt or two, or those named; a name whose dirt these runs cannot have is left out."""
    number, found = (1 if rng.random() < 0.6 else 2), []
    for name in names or rng.permutation(list(DIRTS)).tolist():
        if not names and (len(found) == number or any({name, d["name"]} in APART for d in found)):
            continue
        one = DIRTS[name](rng, plan, runs)
        if one is not None:
            found.append({"name": name, **one})
    return found


# ---- putting it on -------------------------------------------------------------------------------


def on_runs(rng, runs, dirts):
    """The runs as they are really flown: "current" beside the stated one, "factors" of the rig, "kicks"."""
    flown = [{**run, "current": run["drive_current"], "factors": {}} for run in runs]
    for dirt in dirts:
        for k, run in enumerate(flown):
            if dirt["name"] == "current_differs":
                run["current"] *= 1 + dirt["std"] * rng.standard_normal()
            elif dirt["name"] == "magnets_differ":
                run["factors"]["eta"] = 1 + dirt["std"] * rng.standard_normal()
            elif dirt["name"] == "odd_run" and k == dirt["run"]:
                run["factors"][dirt["what"]] = dirt["factor"]
            elif dirt["name"] in ("shaken", "shaken_coloured"):
                run["kicks"] = kicks(rng, run["times"][-1], dirt)
    return flown


def kicks(rng, length, dirt):
    """Times (m,) s and jumps of the state (m, 8): impulses over inertia, of a white force or one that forgets itself
    in "time" (an Ornstein-Uhlenbeck force whose power at low frequency is the size's square).
    """
    times = KICK_EVERY * np.arange(1, int(length / KICK_EVERY) + 2)
    jumps = np.zeros((len(times), 8))
    for c, size in dirt["sizes"].items():
        white = rng.standard_normal(len(times)) * size * np.sqrt(KICK_EVERY)
        k = COORDINATES.index(c)
        jumps[:, 4 + k] = (correlated(white, times, dirt["time"], size) if dirt["time"] else white) / INERTIA[k]
    return times, jumps


def correlated(white, times, time, size):
    """Impulses (m,) of a force of this correlation time (s), driven by the white ones; its standard deviation is
    size / sqrt(2 time).
    """
    std = size / np.sqrt(2 * time)
    force = recursive(white / (size * np.sqrt(KICK_EVERY)), times, time) * std
    return force * KICK_EVERY


def recursive(normal, times, time):
    """Standard normal numbers (n,) made to forget themselves in `time` (s), whatever the times are (n,)."""
    x = np.array(normal)
    for k in range(1, len(x)):
        phi = np.exp(-(times[k] - times[k - 1]) / time)
        x[k] = phi * x[k - 1] + np.sqrt(1 - phi * phi) * normal[k]
    return x


def moments(rng, times, dirts):
    """When the samples stamped `times` are really taken (s)."""
    off = np.zeros(len(times))
    for dirt in dirts:
        if dirt["name"] == "jitter":
            least = 0.45 * np.diff(times).min()
            off += np.clip(dirt["std"] * rng.standard_normal(len(times)), -least, least)
    return times + off


def on_readings(rng, times, values, plan, dirts, run):
    """What is logged of the true values (n, c) of run number `run`: noise, hum, spikes, ends of the range, rounding,
    lost cells (NaN).
    """
    sigma = np.array([plan["noise"][c] for c in plan["channels"]])
    noise, by = rng.standard_normal(values.shape), {d["name"]: d for d in dirts}
    column = {c: k for k, c in enumerate(plan["channels"])}
    if d := by.get("tails"):  # of the stated standard deviation
        for c in d["channels"]:
            noise[:, column[c]] = rng.standard_t(d["nu"], len(times)) * np.sqrt((d["nu"] - 2) / d["nu"])
    if d := by.get("coloured"):
        for c in d["channels"]:
            noise[:, column[c]] = recursive(noise[:, column[c]], times, d["time"])
    for c, ratio in by.get("noise_by_channel", {"ratios": {}})["ratios"].items():
        noise[:, column[c]] *= ratio
    if (d := by.get("noise_by_run")) and d["run"] == run:
        noise *= d["ratio"]
    if d := by.get("rounding"):
        noise[:, [column[c] for c in d["channels"]]] *= d["noise"]
    if d := by.get("hum"):
        phase = rng.uniform(-np.pi, np.pi, len(sigma))
        for c in d["channels"]:
            noise[:, column[c]] += d["amplitude"] * np.sin(2 * np.pi * d["frequency"] * times + phase[column[c]])
    if d := by.get("spikes"):
        for c in d["channels"]:
            hit = rng.random(len(times)) < d["share"]
            noise[hit, column[c]] += rng.choice([-1, 1], hit.sum()) * rng.uniform(10, 60, hit.sum())
    return _ends(rng, times, values + noise * sigma, by, column)


def _ends(rng, times, values, by, column):
    """What the logger does last: the ends of the range, rounding, lost cells."""
    if d := by.get("saturated"):
        k = column[d["channel"]]
        values[:, k] = np.clip(values[:, k], -d["limit"], d["limit"])
    if d := by.get("rounding"):
        for c, step in d["steps"].items():
            values[:, column[c]] = step * np.round(values[:, column[c]] / step)
    if d := by.get("dropouts"):
        number = max(1, round(d["share"] * times[-1] / d["length"]))
        for begin in rng.uniform(0.02, times[-1], number):
            lost = (times > begin) & (times < begin + d["length"])
            for c in d["channels"]:
                values[lost, column[c]] = np.nan
    return values


def set_limits(dirts, readings, plan):
    """The end of a saturated sensor's range, such that the share drawn of all readings [(n, c)] lies beyond it."""
    for dirt in dirts:
        if dirt["name"] == "saturated":
            k = list(plan["channels"]).index(dirt["channel"])
            sizes = np.abs(np.concatenate([v[:, k] for v in readings]))
            dirt["limit"] = float(f"{np.quantile(sizes, 1 - dirt['share']):.4g}")


def faults(dirts):
    """Those that are sensor faults by the catalogue: name -> parameters."""
    return {f"sensor_saturation:{d['channel']}": {"limit": d["limit"]} for d in dirts if d["name"] == "saturated"}
