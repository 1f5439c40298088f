# SPDX-License-Identifier: Apache-2.0
"""The look at the data: what sensors, loggers and clocks do to a run that is otherwise good."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import IMPACTS, POSE, changed, flown, kinds, measured

from inductrack_ros.checks import IMPOSSIBLE, SET_ASIDE, WARNING, admit, impossible, look
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import CHANNELS


@pytest.fixture(scope="module")
def model():
    return Model.default()


@pytest.fixture(scope="module")
def pose():
    return measured()


@pytest.fixture(scope="module")
def everything():
    return measured(tuple(CHANNELS))


def of_run(campaign, name, change):
    """The campaign with one run replaced by ``change`` of it."""
    return replace(campaign, runs=tuple(change(r) if r.name == name else r for r in campaign.runs))


# ---------------------------------------------------------------- samples


@pytest.mark.parametrize(
    ("row", "channel", "size"), [(0, "surge", -0.5), (1, "heave", 0.02), (-1, "roll", 0.3), (-2, "sway", 0.01)]
)
def test_a_bad_sample_at_an_end_is_set_aside(row, channel, size, pose, model):
    (found,) = look(changed(pose, channel, lambda y: y + size * (np.arange(len(y)) == row % len(y)), "b"), model)
    assert (found.kind, found.channel, found.severity) == ("outliers", channel, SET_ASIDE)
    assert found.samples == {"b": (row % 301,)}


def test_a_run_that_begins_with_a_blow_keeps_its_samples(model):
    for seed in range(3):
        hit = flown(IMPACTS, POSE, count=200, step=2e-3, seed=seed)
        late = replace(hit, runs=tuple(_from(r, 4 + 7 * seed) for r in hit.runs))
        assert [f.line for f in look(late, model) if f.severity in (IMPOSSIBLE, SET_ASIDE)] == []


def _from(run, first):
    return replace(
        run, times=run.times[first:] - run.times[first], stamps=run.stamps[first:], values=run.values[first:]
    )


@pytest.mark.parametrize(("channel", "size"), [("surge", 0.5), ("heave", -2e-3), ("sway", 5e-3)])
def test_a_zero_that_moves_is_named(channel, size, pose, model):
    """Counts were lost: no physics is to explain it."""
    (found,) = impossible(look(changed(pose, channel, lambda y: y + size * (np.arange(len(y)) >= 120), "b"), model))
    assert (found.kind, found.channel, found.run) == ("value_jump", channel, "b")
    assert found.size["jump"] == pytest.approx(size, rel=0.3) and "b.csv" in found.text


def test_what_jumps_away_and_back_is_set_aside(pose, model):
    used, (found,) = admit(changed(pose, "heave", lambda y: y + 0.01 * (abs(np.arange(len(y)) - 120) < 12), "b"), model)
    assert (found.kind, found.channel, found.severity) == ("lost", "heave", SET_ASIDE)
    assert np.isnan(used.runs[1]["heave"]).sum() == 23


def test_a_block_that_was_written_twice_is_set_aside(pose, model):
    def twice(run):
        values = np.insert(run.values, 150, run.values[120:150], axis=0)[: len(run.times)]
        return replace(run, values=values)

    used, findings = admit(of_run(pose, "c", twice), model)
    (found,) = [f for f in findings if f.kind == "repeated"]
    assert found.samples == {"c": tuple(range(150, 180))} and len(used.runs[2].times) == 271


def test_coarse_readings_that_swing_evenly_repeat_nothing(model):
    hum = flown([(0.0, {"surge_rate": 20.0})], ("heave",), count=400, step=2e-3)
    swing = changed(hum, "heave", lambda y: np.round(-0.005 + 2e-4 * np.sin(np.arange(len(y)) * np.pi / 5), 4))
    assert not [f for f in look(swing, model) if f.kind == "repeated"]


# ---------------------------------------------------------------- sensors


@pytest.mark.parametrize(("channel", "first", "count"), [("heave", 100, 15), ("surge", 40, 12), ("roll", 200, 30)])
def test_a_sensor_that_hangs_for_a_moment(channel, first, count, pose, model):
    """A tracker that is lost repeats its last reading."""

    def hang(y):
        y[first : first + count] = y[first]
        return y

    used, (found,) = admit(changed(pose, channel, hang, "a"), model)
    assert (found.kind, found.channel, found.severity) == ("stuck", channel, SET_ASIDE)
    assert np.isnan(used.runs[0][channel]).sum() == pytest.approx(count, abs=1)


def test_a_logger_that_stands_still_is_no_saturation(pose, model):
    def still(run):
        values = run.values.copy()
        values[-60:] = values[-60]
        return replace(run, values=values)

    found = look(of_run(pose, "b", still), model)
    assert kinds(found, SET_ASIDE) == {("stuck", c) for c in POSE} and not impossible(found)


def test_a_dead_channel_beside_one_that_moves_is_refused(everything, model):
    (found,) = impossible(look(changed(everything, "heave", lambda y: 0.0 * y), model))
    assert (found.kind, found.channel) == ("constant", "heave") and "while heave_rate moves" in found.text


# ---------------------------------------------------------------- clocks


def test_samples_stamped_when_they_arrive_are_refused(pose, model):
    def batched(run):
        n = np.arange(len(run.times))
        times = 0.016 * (n // 8) + 1e-5 * (n % 8)
        return replace(run, times=times, stamps=times)

    found = look(replace(pose, runs=tuple(map(batched, pose.runs))), model)
    assert {f.kind for f in impossible(found)} == {"batches"} and "come 8 at a time" in found[0].text


# ---------------------------------------------------------------- units, zeros and pairs


@pytest.mark.parametrize(("factor", "unit"), [(1 / 0.0254, "inches"), (1 / 0.3048, "feet")])
def test_american_units_are_named(factor, unit, pose, model):
    found = impossible(look(changed(pose, "heave", lambda y: factor * y), model))[0]
    assert (found.kind, found.channel) == ("unit", "heave") and (unit in found.remedy or factor < 10)


@pytest.mark.parametrize(("factor", "unit"), [(1 / 60, "min"), (1 / 86400, "days")])
def test_a_clock_in_minutes_or_days_is_named(factor, unit, pose, model):
    slow = replace(pose, runs=tuple(replace(r, times=factor * r.times, stamps=factor * r.stamps) for r in pose.runs))
    found = impossible(look(slow, model))[0]
    assert (found.kind, found.size["factor"]) == ("time_unit", pytest.approx(factor)) and f"in {unit}" in found.line


@pytest.mark.parametrize("change", [lambda y: y - 0.02, lambda y: -y])
def test_a_gap_below_zero_is_named(change, everything, model):
    found = impossible(look(changed(everything, "gap_top", change), model))[0]
    assert found.channel == "gap_top"


def test_rates_that_changed_places_are_named(everything, model):
    a, b = (everything.channels.index(c) for c in ("heave_rate", "roll_rate"))

    def swapped(run):
        values = run.values.copy()
        values[:, [a, b]] = values[:, [b, a]]
        return replace(run, values=values)

    found = impossible(look(replace(everything, runs=tuple(map(swapped, everything.runs))), model))
    assert any({"heave_rate", "roll_rate"} <= {f.channel, *f.size.get("candidates", ())} for f in found)


def test_a_rate_whose_scale_is_off_may_mislead(everything, model):
    found = look(changed(everything, "surge_rate", lambda y: 1.5 * y), model)
    assert ("unit", "surge_rate") in kinds(found, WARNING)


def test_a_temperature_in_kelvin_is_named(pose, model):
    warm = of_run(pose, "a", lambda r: replace(r, conditions={"track_temperature": 304.15}))
    (found,) = impossible(look(warm, model))
    assert (found.kind, found.channel) == ("condition", "track_temperature") and "31 °C" in found.remedy


def test_nothing_of_this_in_a_clean_campaign(pose, everything, model):
    assert not look(pose, model) and not look(everything, model)


def test_a_short_clean_run_does_not_hum(model):
    """The median of eight spectra scatters further up than that of many."""
    short = flown([(7000.0, {"surge_rate": 18.0, "sway": 2e-3})], POSE, count=300, step=4e-3, seed=53)
    assert not [f.line for f in look(short, model) if f.kind == "hum"]
