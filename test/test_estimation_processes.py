# SPDX-License-Identifier: Apache-2.0
"""What a log does besides the model is found with its size, on runs of the independent simulator spoilt here."""

from dataclasses import replace

import numpy as np
import pytest
from test_estimation_shooting import NOISE, TICK, problem

from inductrack_ros.diagnosis import background
from inductrack_ros.estimation import shooting
from inductrack_ros.estimation.problem import Problem, lay_out
from inductrack_ros.estimation.processes import COLOURED, HUM, JITTER, WHITE, Process, resized
from inductrack_ros.estimation.structure import Structure

GIVEN = tuple(NOISE)


@pytest.fixture(scope="module")
def clean() -> Problem:
    return problem(np.zeros(4))


def spoilt(clean: Problem, change) -> Problem:
    """The problem with every run's values (n, 4) changed by ``change(rng, times, values)``."""
    rng, part = np.random.default_rng(3), clean.subset(range(len(clean.runs)))
    runs = [replace(d.run, values=change(rng, d.run.times, d.run.values.copy())) for d in clean.runs]
    part.runs = tuple(lay_out(run, clean.model, clean.channels, clean.dof) for run in runs)
    return part


def found(of: Problem) -> dict[tuple[str, str], Process]:
    base = shooting.fit(of, Structure(of.model, ("eta", "gamma")))
    return {(p.kind, p.on): p for p in background.improved(of, base, GIVEN, (), lambda _: None).processes}


def test_a_clean_log_has_none(clean):
    assert found(clean) == {}


def test_stamps_that_jitter(clean):
    def late(rng, times, values):
        moved = times + 2e-4 * rng.standard_normal(len(times))
        return values + np.gradient(values[:, 0], times)[:, None] * (moved - times)[:, None] * [1, 0, 0, 0]

    assert found(spoilt(clean, late))[JITTER, ""].size == pytest.approx(2e-4, rel=0.2)


def test_coloured_noise(clean):
    def coloured(rng, times, values):
        memory = np.zeros(len(times))
        for k in range(1, len(times)):
            memory[k] = (
                np.exp(-TICK / 0.02) * memory[k - 1] + np.sqrt(-np.expm1(-2 * TICK / 0.02)) * rng.standard_normal()
            )
        return values + 2 * NOISE["heave"] * memory[:, None] * [0, 0, 1, 0]

    processes = found(spoilt(clean, coloured))
    assert processes[COLOURED, "heave"].size == pytest.approx(2.0, rel=0.3)
    assert 0.01 < processes[COLOURED, "heave"].time < 0.04
    assert not {(COLOURED, c) for c in ("surge", "sway", "roll")} & set(processes)


def test_noise_of_another_size(clean):
    def louder(rng, times, values):
        return values + 2 * NOISE["sway"] * rng.standard_normal(len(times))[:, None] * [0, 1, 0, 0]

    processes = found(spoilt(clean, louder))
    assert set(processes) == {(WHITE, "sway")} and processes[WHITE, "sway"].size == pytest.approx(np.sqrt(5), rel=0.1)


def test_a_hum_has_its_amplitude(clean):
    spoiled = spoilt(
        clean, lambda rng, times, values: values + 3e-4 * np.sin(2 * np.pi * 50 * times + 1)[:, None] * [0, 0, 0, 1]
    )
    structure = Structure(spoiled.model, ("eta", "gamma"))
    fit = shooting.fit(spoiled, structure, None, 40, (Process(HUM, "roll", 1.0, 0.02),))
    assert fit.processes[0].size == pytest.approx(3.0 / np.sqrt(2), rel=0.5)  # a standard deviation from three runs
    assert fit.power[3] < 1e-3


def test_a_size_stays_within_its_bounds():
    (jitter,) = resized((Process(JITTER, size=1e-3, most=5e-4),), np.array([1.0]))
    assert jitter.size == 5e-4
