# SPDX-License-Identifier: Apache-2.0
"""A campaign too long to be held in memory: what is left of it, and that this is said."""

from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.data import Campaign, Run
from inductrack_ros.data.thinning import LEAST_RUNS, thinned

SPACING = 2.5e-3


def campaign_of(runs: int, seconds: float, rate: float, slow: int = 1) -> Campaign:
    """Runs of ``surge`` in every row and ``heave`` in every ``slow``-th."""
    times = np.arange(round(seconds * rate)) / rate
    values = np.column_stack([times, np.where(np.arange(len(times)) % slow == 0, 1.0, np.nan)])
    parts = [
        Run(f"run_{k}", Path("."), ("surge", "heave"), times, values + k, times, numbers=np.arange(len(times)) + 2)
        for k in range(runs)
    ]
    return Campaign("long", Path("."), tuple(parts), {"surge": 1.0, "heave": 1.0})


def test_what_fits_is_left_alone():
    campaign = campaign_of(3, 2.0, 500.0)
    assert thinned(campaign, 3000, SPACING) == (campaign, "")


@pytest.mark.parametrize("slow", [1, 5])
def test_readings_go_first_where_the_runs_are_short(slow):
    campaign = campaign_of(4, 5.0, 1000.0, slow)
    less, said = thinned(campaign, 10_000, SPACING)
    rows, heaves = {1: (2500, 2500), 5: (3000, 1000)}[slow]  # every reading of a slow sensor stays
    assert [len(r.times) for r in less.runs] == [rows] * 4
    assert f"{4 * rows:,} of 20,000 rows are used (one reading of each channel in 2 rows)" in said
    first = less.runs[1]
    there = np.isfinite(first["surge"])
    assert first.times[0] == 0.0 and first.numbers[1] == 4 and there.sum() == 2500
    assert (first["surge"] == first.times + 1)[there].all() and np.isfinite(first["heave"]).sum() == heaves


def test_an_hour_keeps_some_runs_whole():
    campaign = campaign_of(720, 5.0, 100.0)
    less, said = thinned(campaign, 60_000, SPACING)
    assert len(less.runs) == 30 and said.startswith("15,000 of 360,000 rows are used (30 of 720 runs)")
    assert {len(r.times) for r in less.runs} == {500} and less.runs[-1].name == "run_719"


def test_long_runs_are_shortened():
    less, said = thinned(campaign_of(1, 3600.0, 100.0), 60_000, SPACING)
    assert less.runs[0].duration == pytest.approx(150.0, abs=0.02) and "their first 150 s" in said
    less, said = thinned(campaign_of(60, 60.0, 100.0), 60_000, SPACING)
    assert len(less.runs) == LEAST_RUNS and "8 of 60 runs and their first 18.8 s" in said
