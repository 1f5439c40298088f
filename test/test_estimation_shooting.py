# SPDX-License-Identifier: Apache-2.0
"""Multiple shooting on runs of the independent simulator: still and shaken, complete and with something missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent import simulator

from inductrack_ros.core.model import Model
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.data.measurement import Run
from inductrack_ros.diagnosis import moves, screening, strategy
from inductrack_ros.estimation import likelihood, shooting
from inductrack_ros.estimation.problem import Problem
from inductrack_ros.estimation.processes import IMPACT, LOOSE, Process
from inductrack_ros.estimation.run_model import RunModel
from inductrack_ros.estimation.structure import Structure

NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}
MASS, TICK, SECONDS = 9.3, 2e-3, 0.6
#: Force on the cradle (N/√Hz, two-sided) in surge, sway and heave, and moment in roll, of the shaken rig.
SHAKING = np.array([0.42, 0.042, 0.021, 1e-3])


def flown(rng, speed: float, current: float, rigs, shaking: np.ndarray) -> np.ndarray:
    """States (n, 8) at every tick, kicked between any two by impulses of the standard deviation shaking · √T."""
    states = np.zeros((int(SECONDS / TICK) + 1, 8))
    states[0, [1, 2, 3, 4]] = 1e-3, simulator.equilibrium_heave(speed, rigs) + 3e-4, 2e-3, speed
    if not shaking.any():
        return simulator.simulate(np.arange(len(states)) * TICK, states[0], current, rigs)[0][:, :8]
    inertia = np.array([MASS, MASS, MASS, rigs[0]["roll_inertia"]])
    for k in range(1, len(states)):
        states[k] = simulator.simulate(np.array([0.0, TICK]), states[k - 1], current, rigs)[0][-1, :8]
        states[k, 4:] += rng.standard_normal(4) * shaking * np.sqrt(TICK) / inertia
    return states


def problem(shaking: np.ndarray, seed: int = 0, channels: tuple[str, ...] = tuple(NOISE), **changes: float) -> Problem:
    """Three runs at three speeds, coasting and driven."""
    rng, rigs = np.random.default_rng(seed), simulator.rig(eta=0.72, gamma=3.9, **changes)
    times = np.arange(int(SECONDS / TICK) + 1) * TICK
    runs = []
    for k, (speed, current) in enumerate([(16.0, 7000.0), (22.0, 0.0), (30.0, 7000.0)]):
        values = flown(rng, speed, current, rigs, shaking)[:, :4] + rng.standard_normal((len(times), 4)) * list(
            NOISE.values()
        )
        kept = values[:, [list(NOISE).index(c) for c in channels]]
        runs.append(Run(f"run_{k}", Path(f"run_{k}"), channels, times, kept, times, current))
    noise = {c: NOISE[c] for c in channels}
    return Problem(Campaign("rig", Path("rig"), tuple(runs), noise), Model.default(), noise)


def fitted(of: Problem) -> shooting.Fit:
    return shooting.fit(of, Structure(of.model, ("eta", "gamma")))


def test_a_still_complete_rig_is_the_deterministic_fit():
    still = problem(np.zeros(4))
    fit = fitted(still)
    assert moves.shaken(moves.Task(still), moves.State(fit)) == []
    counted = sum(int(system.scored.sum()) for system in shooting.linearise_all(still, fit))
    assert fit.chi2 == pytest.approx(counted, rel=0.03)
    for name, true in {"eta": 0.72, "gamma": 3.9}.items():
        assert abs(fit.values[name] - true) < 4 * fit.deviations[name]
    assert fit.deviations["eta"] < 1e-4
    assert strategy.search(moves.Task(still, tuple(NOISE)), moves.State(fit)).added == ()


def test_a_shaken_rig_shows_its_power_and_lacks_nothing():
    rig = problem(SHAKING)
    fit = fitted(rig)
    inertia = np.array([MASS, MASS, MASS, rig.model.parameters["roll_inertia"]])
    found = np.sqrt(fit.power) * inertia
    assert found == pytest.approx(SHAKING, rel=0.35)
    assert set(moves.shaken(moves.Task(rig), moves.State(fit))) == {"surge", "sway", "heave", "roll"}
    assert strategy.search(moves.Task(rig, tuple(NOISE)), moves.State(fit)).added == ()


def test_a_missing_drag_is_found_and_leaves_nothing_shaken():
    rig = problem(np.zeros(4), seed=1, aerodynamic_drag__drag_area=0.06)
    state = strategy.search(moves.Task(rig, tuple(NOISE)), moves.State(fitted(rig)))
    assert state.added == ("aerodynamic_drag",)
    value, std = (getattr(state.fit, x)["aerodynamic_drag.drag_area"] for x in ("values", "deviations"))
    assert abs(value - 0.06) < 4 * std
    assert moves.shaken(moves.Task(rig), state) == []


@pytest.mark.parametrize("apart", [0.05, 0.8, 1.3, 4.0])
def test_what_other_variances_would_gain(apart):
    """That of n values of a variance: n (log q + s / q) from q to s; what falls gains no more than n (1 − s / q)."""
    n, q = 12.0, 2.0
    s = apart * q
    truth = n * (np.log(q) + s / q) - n * (np.log(s) + 1.0)
    gain = likelihood.to_gain(np.array([n * apart]), np.array([n]))
    assert gain == pytest.approx(truth if apart > 0.3 else n * (1.0 - apart))


def test_a_fit_goes_on_while_the_disturbance_still_falls():
    """A missing drag shakes the plant at first: the fit with it does not end before the power is gone."""
    of = problem(np.zeros(4), aerodynamic_drag__drag_area=0.04)
    without = fitted(of)
    structure = without.structure.plus("aerodynamic_drag")
    theta = np.append(without.theta, structure.start[-1])
    point = replace(without.point, theta=theta)
    new = shooting.fit(of, structure, point)
    last = likelihood.maximise_evidence(of, structure, shooting.linearise_all(of, new), new.point, 1)
    assert new.converged and last.to_gain < 1.0 and (new.power < 1e-6).all()


def test_what_shakes_a_coordinate_that_nothing_measures_explains_nothing():
    """Sway and roll show in heave at second order alone: free to go anywhere, they would explain what heave does."""
    rig = problem(SHAKING, seed=3, channels=("surge", "heave"))
    fit = fitted(rig)
    assert moves.shaken(moves.Task(rig), moves.State(fit)) == ["surge", "heave"]
    off = [(fit.values[n] - true) / fit.deviations[n] for n, true in (("eta", 0.72), ("gamma", 3.9))]
    assert np.abs(off).max() < 4.0


def test_a_blow_at_one_place_is_told_beside_what_shakes_the_rest():
    """A patch of moment in roll shakes the roll, and no other coordinate: beside less of all that shakes, it would
    have to explain the rest too."""
    rig = problem(SHAKING, seed=4, roll_patch__moment=0.6, roll_patch__place=6.0, roll_patch__width=0.3)
    fit = fitted(rig)
    systems = shooting.linearise_all(rig, fit)
    shaking = moves.shaken(moves.Task(rig), moves.State(fit), systems)
    assert len(shaking) > 1 and "roll" in shaking
    best = screening.laws(rig, fit, systems, shaking)[0]
    assert (best.acts_on, best.variable) == ("roll", "surge") and best.gain > moves.law_price()
    still = [k for k in range(4) if k != 3]
    assert (best.power[still] == fit.power[still]).all() and best.power[3] < fit.power[3]


def test_a_ripple_of_the_thrust_is_told_as_finely_as_a_force_in_surge():
    """A share of the thrust pushes in surge, so what shakes the surge may be one that changes along the track."""
    rig = problem(np.zeros(4), seed=5, thrust_ripple__relative_amplitude=0.4, thrust_ripple__wavelength=2.2)
    fit = fitted(rig)
    systems = shooting.linearise_all(rig, fit)
    shaking = moves.shaken(moves.Task(rig), moves.State(fit), systems)
    assert "surge" in shaking
    best = screening.laws(rig, fit, systems, shaking)[0]
    assert (best.acts_on, best.variable) == ("thrust", "surge") and best.gain > moves.law_price()
    new = moves.with_law(moves.Task(rig), moves.State(fit), best).fit
    assert new.converged and new.deviance < fit.deviance - 0.8 * best.gain and new.power[0] < 1e-3 * fit.power[0]
    k = int(np.argmax(np.where([".values[" in n for n in new.structure.free], new.theta, 0.0)))
    thetas = new.theta + np.outer([0.01, -0.01], np.arange(len(new.theta)) == k)
    _, ends = RunModel(rig, new.structure, 0).pieces(new.paths[0], thetas)
    really = (ends[:-1, 0, 4] - ends[:-1, 1, 4]) / 0.02
    said = shooting.linearise_all(rig, new)[0].inputs[:-1, 4, 1 + k]
    assert said @ really / (really @ really) == pytest.approx(1.0, abs=0.05)  # a share of the thrust without shares


def test_trajectories_beyond_all_numbers_explain_nothing():
    """A refit that a bad promise threw out of all bounds is a bad fit, no crash."""
    still = problem(np.zeros(4))
    fit = fitted(still)
    paths = tuple(path * np.where(np.arange(path.shape[1]) == 2, -1e200, 1.0) for path in fit.paths)
    new = shooting.fit(still, fit.structure, replace(fit.point, paths=paths))
    assert new.deviance == np.inf and not new.converged


def test_an_accelerometer_reads_the_blow_of_a_contact():
    """A shaken cradle rests on the track, which presses against it; the model lacks a lift of the air. Read as what the
    forces of flight do, the acceleration draws the trajectory off the track and away from where it is measured."""
    rng, rigs = np.random.default_rng(5), simulator.rig(aerodynamic_lift__lift_area=0.05)
    noise = NOISE | {"surge_acceleration": 0.07, "sway_acceleration": 0.05, "heave_acceleration": 0.1}
    times, channels = np.arange(301) * TICK, tuple(noise)
    size = np.sqrt(TICK) * SHAKING / np.array([MASS, MASS, MASS, Model.default().parameters["roll_inertia"]])
    runs = []
    for k, (speed, heave) in enumerate([(13.0, -6e-3), (10.0, -8e-3), (15.0, -5e-3)]):
        start = np.array([0.0, 1e-3, heave, 1e-3, speed, 0.0, 0.0, 0.0])
        kicks = np.hstack([np.zeros((len(times) - 1, 4)), rng.standard_normal((len(times) - 1, 4)) * size])
        states = simulator.simulate(times, start, 0.0, rigs, kicks=(times[1:], kicks))[0][:, :8]
        values = simulator.channels_of(times, states, 0.0, rigs, channels)
        values = values + rng.standard_normal(values.shape) * list(noise.values())
        runs.append(Run(f"run_{k}", Path(f"run_{k}"), channels, times, values, times, 0.0))
    of = Problem(Campaign("rig", Path("rig"), tuple(runs), noise), Model.default(), noise)
    first = (Process(IMPACT, size=LOOSE),)
    fit = shooting.fit(of, Structure(of.model, ("eta", "gamma")), processes=first)
    for data, path in zip(of.runs, fit.paths, strict=True):
        resting = (data.channel == channels.index("heave")) & (data.y < -9.7e-3)
        assert resting.sum() > 30
        off = (data.y[resting] - path[data.row[resting], 2]) / noise["heave"]
        assert np.sqrt(np.mean(off**2)) < 1.0
