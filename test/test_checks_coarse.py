# SPDX-License-Identifier: Apache-2.0
"""The look at the data: readings in steps that the motion skips, overloads, and channels that the model holds still."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_checks import NOISE, changed, kinds

from inductrack_ros.checks import IMPOSSIBLE, SET_ASIDE, WARNING, admit, look
from inductrack_ros.checks.steps import step_of
from inductrack_ros.compare import compare
from inductrack_ros.core.errors import InputError
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.estimation.misfits import SeriesMisfit
from inductrack_ros.estimation.processes import ROUNDED, Process, rounding
from inductrack_ros.estimation.shooting import linearise_all


def in_steps(campaign, step, channel="surge", runs="abc"):
    """The campaign with a channel of some runs read by an encoder: rounded, and written with six decimals."""
    return changed(campaign, channel, lambda y: np.round(np.round(y / step) * step, 6), runs)


def unstated(campaign):
    return replace(campaign, noise_std={})


def only(campaign, name):
    return replace(campaign, runs=tuple(r for r in campaign.runs if r.name == name))


# ---------------------------------------------------------------- steps


@pytest.mark.parametrize("step", [1.4272e-3, 2e-3, 5e-3, 1e-2, 2e-2])
def test_a_step_is_found_where_the_motion_skips_most_readings(step, pose):
    times, surge = only(pose, "b").runs[0].samples("surge")
    assert np.median(np.diff(surge)) > 2 * step  # no two readings are neighbours
    read = np.round(np.round(surge / step) * step, 6)
    assert step_of(read, least=NOISE["surge"]) == pytest.approx(step, rel=1e-4)
    assert step_of(surge, least=NOISE["surge"]) == 0.0
    assert step_of(np.where(times == times[40], read + 0.3 * step, read), least=NOISE["surge"]) == pytest.approx(
        step, rel=1e-4
    )


@pytest.mark.parametrize("runs", ["a", "b", "c", "abc"])
@pytest.mark.parametrize("step", [2e-3, 5e-3, 1e-2, 2e-2])
def test_steps_are_said_and_nothing_else(step, runs, pose, model):
    coarse = in_steps(pose, step)
    coarse = coarse if runs == "abc" else only(coarse, runs)
    for campaign in (coarse, unstated(coarse)):
        (found,) = look(campaign, model)
        assert (found.kind, found.channel, found.severity) == ("quantised", "surge", WARNING)
        assert found.size["step"] == pytest.approx(step, rel=1e-3)
        assert ("noise_std" in found.text) <= bool(campaign.noise_std)


def test_no_noise_is_estimated_to_be_less_than_its_steps(pose, model):
    """Rounded readings of a heave that hardly moves are all the same: their noise is not 0."""
    coarse = unstated(in_steps(pose, 5e-4, "heave"))
    (found,) = [f for f in look(coarse, model) if f.kind == "quantised"]
    assert "0.144 mm is taken" in found.text and "noise_std" not in found.text and "e-" not in found.text


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("name", ["b", "abc"])
def test_the_model_is_held_against_the_noise_of_the_steps(name, stated, pose, model):
    step = 1e-2
    coarse = in_steps(pose if name == "abc" else only(pose, name), step)
    result = compare(coarse if stated else unstated(coarse), model)
    assert result.noise["surge"] == pytest.approx(step / np.sqrt(12), rel=0.15)
    k = result.runs[0].run.channels.index("surge")
    assert all(np.sqrt(np.mean(r.sigmas[:, k] ** 2)) < 1.3 for r in result.runs)


def test_a_fit_takes_the_noise_of_the_steps(pose, model):
    coarse, _ = admit(only(unstated(in_steps(pose, 5e-4, "heave")), "c"), model)
    problem = SeriesMisfit(coarse, model, ("mass",)).problem
    assert problem.sigma[problem.channels.index("heave")] >= 0.999 * 5e-4 / np.sqrt(12)


@pytest.mark.parametrize("name", "abc")
def test_a_run_that_alone_reads_in_steps_is_named(name, pose, model):
    (found,) = look(in_steps(pose, 1e-2, runs=name), model)
    assert (found.kind, found.channel, found.run) == ("quantised", "surge", name)
    assert f"in steps of 10 mm in {name}," in found.text
    campaign, _ = admit(in_steps(pose, 1e-2, runs=name), model)
    assert campaign.noise_std["surge"] == pytest.approx(1e-2 / np.sqrt(12), rel=0.05)


def test_a_run_without_the_steps_of_another_is_not_rounded(pose, model):
    campaign, seen = admit(in_steps(pose, 1e-2, runs="b"), model)
    problem, base, _ = base_fit(campaign, model, seen)
    (process,) = (p for p in base.processes if p.kind == ROUNDED)
    shares = [
        np.abs(rounding(problem, data, system, Process(ROUNDED, "surge", 0.2, process.time))).max()
        for data, system in zip(problem.runs, linearise_all(problem, base), strict=True)
    ]
    assert shares[0] == shares[2] == 0.0 < shares[1]


# ---------------------------------------------------------------- what steps make alike is no copy


def test_five_digits_far_along_the_track_are_steps(pose, model):
    far = changed(pose, "surge", lambda y: np.array([float(f"{v:.5g}") for v in 5000.0 + y]))
    (found,) = look(far, model)
    assert (found.kind, found.channel) == ("quantised", "surge")
    assert found.size["step"] == pytest.approx(0.1)


def test_a_run_listed_twice_is_found_where_channels_are_coarse(pose, model):
    coarse = in_steps(in_steps(pose, 5e-4, "heave"), 1e-2)
    for campaign in (coarse, in_steps(in_steps(coarse, 5e-4, "sway"), 5e-3, "roll")):
        again = replace(campaign.runs[0], name="d", file=Path("d.csv"))
        twice = replace(campaign, runs=(*campaign.runs, again))
        (found,) = [f for f in look(twice, model) if f.kind == "copied"]
        assert (found.severity, found.run) == (SET_ASIDE, "d")


# ---------------------------------------------------------------- overloads


@pytest.mark.parametrize("value", [9.9e37, 9.99e37, -3.4028235e38, 1e31, 1.797e308, -77777.0])
@pytest.mark.parametrize("every", [40, 9, 2])
@pytest.mark.parametrize("channel", ["surge", "heave"])
def test_a_value_far_outside_that_is_written_again_and_again_is_no_reading(value, every, channel, pose, model):
    def spoiled(column):
        column[5::every] = value
        return column

    (found,) = look(changed(pose, channel, spoiled, "b"), model)
    assert (found.kind, found.channel, found.severity) == ("fillers", channel, SET_ASIDE)
    assert found.samples == {"b": tuple(range(5, 301, every))}
    assert "overload" in found.text and f"{len(range(5, 301, every))} times" in found.text and "b.csv" in found.text


def test_an_instrument_has_two_overloads_and_a_value_for_none(pose, model):
    """What SCPI writes: ±9.9e37 for an overload, 9.91e37 for not a number."""
    values = np.array([9.9e37, -9.9e37, 9.91e37])

    def spoiled(column):
        column[7::6] = values[np.arange(len(column[7::6])) % 3]
        return column

    (found,) = look(changed(only(pose, "a"), "heave", spoiled), model)
    assert found.kind == "fillers" and found.samples == {"a": tuple(range(7, 301, 6))}


def test_half_a_run_in_another_unit_is_no_filler(pose, model):
    late = np.arange(301) > 150

    for digits in (7, 1):
        mixed = changed(pose, "heave", lambda y, d=digits: np.where(late, np.round(1e3 * y, d), y), "b")
        found = look(mixed, model)
        assert IMPOSSIBLE in {f.severity for f in found}
        assert "fillers" not in {f.kind for f in found}


# ---------------------------------------------------------------- what the model holds still


def test_channels_that_move_are_not_held_still(pose):
    held = replace(pose, dof=2)
    model = held.load_model()
    (found,) = look(held, model)
    assert (found.kind, found.severity) == ("held_still", IMPOSSIBLE)
    assert "dof: 2 holds sway and roll" in found.text and "dof: 4" in found.remedy
    with pytest.raises(InputError, match="they span"):
        compare(held, model)


def test_channels_that_do_not_move_may_be_held_still(pose):
    """Sensors of a guided cradle read noise, and a little more."""
    rng = np.random.default_rng(3)
    quiet = changed(pose, "sway", lambda y: 1e-4 + NOISE["sway"] * rng.standard_normal(len(y)))
    quiet = changed(quiet, "roll", lambda y: NOISE["roll"] * rng.standard_normal(len(y)))
    held = replace(quiet, dof=2)
    assert "held_still" not in {kind for kind, _ in kinds(look(held, held.load_model()))}


def test_neither_an_even_motion_nor_one_bad_reading_is_a_step():
    rng = np.random.default_rng(5)
    for count in (20, 60, 300):
        even = 0.0884 * np.arange(count) + NOISE["surge"] * rng.standard_normal(count)
        assert step_of(even, least=NOISE["surge"]) == 0.0
        off = NOISE["heave"] * rng.standard_normal(count)
        off[count // 2] = 0.05
        assert step_of(off, least=NOISE["heave"]) == 0.0
