# SPDX-License-Identifier: Apache-2.0
"""The look at the data: what sensors, loggers and clocks do to a run that is otherwise good."""

import html
import warnings
from dataclasses import replace

import numpy as np
import pytest
from test_checks import IMPACTS, NOISE, POSE, changed, flown, kinds, measured

from inductrack_ros.checks import IMPOSSIBLE, SET_ASIDE, WARNING, admit, impossible, look
from inductrack_ros.checks.check import check
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model, Pulses
from inductrack_ros.core.state import CHANNELS, STATES
from inductrack_ros.data import read_bag, read_csv, write_bag
from inductrack_ros.reports.check_report import check_report


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


@pytest.mark.parametrize("seed", [5, 16, 18, 47, 56])
def test_a_burst_of_noise_is_no_zero_that_moves(seed, pose, model):
    """Its large steps add up to a jump now and then: with these five of sixty seeds a jump was named."""

    def burst(y):
        rng = np.random.default_rng(seed)
        first = rng.integers(len(y) - 60)
        there = (np.arange(len(y)) >= first) & (np.arange(len(y)) < first + 60)
        return y + there * 10.0 * pose.noise_std["sway"] * rng.standard_normal(len(y))

    assert impossible(look(changed(pose, "sway", burst, "b"), model)) == ()


@pytest.mark.parametrize("hole", [3, 13, 40])
def test_what_a_cradle_travels_during_a_hole_is_no_jump(hole, pose, model):
    """A bad sample in front of the hole is one, and no more."""

    def spoiled(run):
        kept = np.delete(np.arange(len(run.times)), np.arange(151, 151 + hole))
        values = run.values[kept].copy()
        values[150, list(run.channels).index("surge")] += 0.2
        return replace(run, times=run.times[kept], stamps=run.stamps[kept], values=values)

    findings = look(of_run(pose, "b", spoiled), model)
    assert not impossible(findings) and "outliers" in {f.kind for f in findings}


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


def coarse_swing(decay, change=lambda y: y):
    """A swing of heave that dies away (1/s), read in steps of a tenth of a millimetre."""
    hum = flown([(0.0, {"surge_rate": 20.0})], ("heave",), count=170, step=1e-2)
    t = np.arange(170) * 1e-2
    swing = -0.0055 + 2e-3 * np.exp(-decay * t) * np.cos(45.0 * t)
    return changed(hum, "heave", lambda y: np.round(change(swing), 4))


def test_coarse_readings_of_a_cradle_that_comes_to_rest_do_not_hang(model):
    rest = coarse_swing(2.6)
    assert np.ptp(rest.runs[0]["heave"][-20:]) == 0.0  # so long that it would hang, were it in motion
    assert not [f for f in look(rest, model) if f.kind == "stuck"]


def test_coarse_readings_that_hang_amid_a_swing(model):
    def hang(y):
        y[40:75] = y[40]
        return y

    (found,) = [f for f in look(coarse_swing(0.5, hang), model) if f.kind == "stuck"]
    assert found.size["count"] == pytest.approx(35, abs=1)


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


@pytest.mark.parametrize("stated", [True, False])
def test_a_travel_in_km_is_named(stated, pose, model):
    short = changed(pose if stated else replace(pose, noise_std={}), "surge", lambda y: 1e-3 * y)
    (found,) = impossible(look(short, model))
    assert (found.kind, found.channel) == ("unit", "surge") and "in km" in found.remedy


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "mm"), (1e2, "cm")])
def test_a_unit_of_heave_is_no_turned_frame(factor, unit, pose, model):
    """A run whose heave sinks steadily: in mm, that is a straight line far out of its room."""
    run = pose.runs[0]
    sinking = changed(replace(pose, runs=(run,)), "heave", lambda y: factor * (y - np.linspace(0.0, 6e-3, len(y))))
    (found,) = [f for f in impossible(look(sinking, model)) if f.channel == "heave"]
    assert found.kind == "unit" and f"in {unit}" in found.remedy


@pytest.mark.parametrize("runs", [1, None])
def test_the_gap_in_the_place_of_heave_is_named(runs, pose, model):
    gap = model.parameters["nominal_gap"]
    (found,) = impossible(look(changed(replace(pose, runs=pose.runs[:runs]), "heave", lambda y: y + gap), model))
    assert (found.kind, found.channel) == ("zero", "heave") and "the gap of the top array" in found.text
    assert f"subtract the nominal gap, {gap:g} m" in found.remedy


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


def test_a_cradle_that_swings_does_not_hum(model):
    """Its own oscillation in heave, at some 7 Hz, is as sharp a line as a hum."""
    swings = [(7000.0, {"surge_rate": v, "heave": -4.6e-3}) for v in (16.0, 18.0, 20.0, 22.0)]
    slow = flown(swings, ("surge", "gap_top", "heave_acceleration"), count=300, step=8e-3, seed=3)
    assert not [f.line for f in look(slow, model) if f.kind == "hum"]


# ---------------------------------------------------------------- of two sources, counted, filled in


def pattern(name):
    """Which samples are of another rig, by how its messages fall among one's own."""
    n = np.arange(301)
    return {"in turn": n % 2 == 1, "every third": n % 3 == 1, "every tenth": n % 10 == 4}[name]


@pytest.mark.parametrize("stated", [True, False])
@pytest.mark.parametrize("name", ["in turn", "every third", "every tenth"])
def test_samples_of_two_rigs_in_one_run_are_named(name, stated, pose, model):
    """Without a noise that is stated, what goes to and fro would pass for noise."""
    other = measured(seed=4)
    apart = np.array([3.0, 3e-3, 1e-3, 2e-2])

    def mixed(run):
        theirs = next(r.values for r in other.runs if r.name == run.name) + apart
        return replace(run, values=np.where(pattern(name)[:, None], theirs, run.values))

    both = of_run(pose if stated else replace(pose, noise_std={}), "b", mixed)
    (found,) = impossible(look(both, model))
    assert (found.kind, found.run, found.channel) == ("interleaved", "b", "heave")
    assert "go to and fro between two courses" in found.text and "two files" in found.remedy
    assert set(found.samples["b"]) == set(np.flatnonzero(pattern(name)))


def test_what_is_no_second_source(pose, everything, model):
    """Bad bits of one sensor, coarse readings, hum at half the sampling rate."""
    rng = np.random.default_rng(5)
    bits = changed(pose, "heave", lambda y: y + 2.56e-3 * (rng.random(len(y)) < 0.08))
    coarse = changed(changed(pose, "heave", lambda y: np.round(y, 4)), "sway", lambda y: np.round(y, 4))
    hum = changed(pose, "heave", lambda y: y + 1e-3 * (-1.0) ** np.arange(len(y)))
    for campaign in (bits, coarse, hum, everything):
        assert "interleaved" not in {f.kind for f in look(campaign, model)}


def test_a_travel_that_is_counted_within_a_length_is_named(pose, model):
    (found,) = look(changed(pose, "surge", lambda y: np.mod(y, 0.4)), model)
    assert (found.kind, found.channel, found.severity) == ("value_jump", "surge", IMPOSSIBLE)
    assert found.size["jump"] == pytest.approx(-0.4, rel=0.01) and found.size["count"] > 20


@pytest.mark.parametrize(("channel", "first", "count"), [("heave", 100, 40), ("roll", 30, 14), ("surge", 200, 30)])
def test_what_was_filled_in_by_a_line_is_set_aside(channel, first, count, pose, model):
    def line(y):
        y[first : first + count] = np.linspace(y[first], y[first + count - 1], count)
        return y

    used, (found,) = admit(changed(pose, channel, line, "b"), model)
    assert (found.kind, found.channel, found.severity) == ("filled", channel, SET_ASIDE)
    assert np.isnan(used.runs[1][channel]).sum() == pytest.approx(count - 2, abs=2)


def test_smooth_or_clipped_channels_are_not_filled_in(pose, model):
    smooth = changed(pose, "heave", lambda y: -0.005 + 1e-4 * np.sin(np.arange(len(y)) / 40))
    clipped = changed(pose, "sway", lambda y: np.clip(y, -1e-3, 1e-3))
    for campaign in (smooth, clipped):
        assert "filled" not in {f.kind for f in look(campaign, model)}


# ---------------------------------------------------------------- which unit, which axis


@pytest.mark.parametrize(
    ("channel", "factor", "unit"),
    [
        ("roll_rate", 30 / np.pi, "rpm"),
        ("roll_rate", 180 / np.pi, "degrees/s"),
        ("surge_rate", 3.6, "km/h"),
        ("heave_rate", 1e3, "mm/s"),
        ("heave_acceleration", 1 / 9.80665, "g"),
        ("sway_acceleration", 1e3 / 9.80665, "mg"),
    ],
)
def test_a_rate_in_another_unit_is_named_with_that_unit(channel, factor, unit, everything, model):
    found = impossible(look(changed(everything, channel, lambda y: factor * y), model))
    assert any(f.kind == "unit" and f"is {channel} in {unit} instead of" in f.remedy for f in found)


def test_an_accelerometer_in_g_beside_gaps_alone_is_named(model):
    gaps = measured(("surge", "gap_top", "gap_right", "gap_left", "heave_acceleration"))
    assert look(gaps, model) == ()
    (found,) = impossible(look(changed(gaps, "heave_acceleration", lambda y: y / 9.80665), model))
    assert "second derivative of gap_top" in found.text and "in g instead of" in found.remedy


def test_gravity_in_an_accelerometer_in_g_hides_no_unit(everything, model):
    upright = changed(everything, "heave_acceleration", lambda y: (y + 9.80665) / 9.80665)
    (found,) = [f for f in impossible(look(upright, model)) if f.channel == "heave_acceleration"]
    assert "heave_acceleration in g" in found.remedy


def test_accelerations_that_changed_places_are_named(model):
    sensed = measured((*POSE, "sway_acceleration", "heave_acceleration"))

    def exchanged(run):
        values = run.values.copy()
        values[:, -2:] = values[:, [-1, -2]]
        return replace(run, values=values)

    swapped = replace(sensed, runs=tuple(map(exchanged, sensed.runs)))
    found = impossible(look(swapped, model))
    assert [f.channel for f in found] == ["sway_acceleration", "heave_acceleration"]
    assert "heave_acceleration is: exchange the two columns" in found[0].remedy


@pytest.mark.parametrize(("factor", "unit"), [(1e6, "µm"), (1 / 2.54e-5, "mil")])
def test_a_small_unit_is_named(factor, unit, everything, model):
    found = impossible(look(changed(everything, "gap_top", lambda y: factor * y), model))
    assert any(f.channel == "gap_top" and f"'gap_top [{unit}]'" in f.remedy for f in found)


@pytest.mark.parametrize("channel", ["heave", "sway"])
def test_a_travel_along_another_axis_is_named(channel, pose, model):
    """A frame with z along the travel, as cameras have it."""

    def turned(run):
        values = run.values.copy()
        columns = [run.channels.index("surge"), run.channels.index(channel)]
        values[:, columns] = values[:, columns[::-1]]
        return replace(run, values=values)

    found = impossible(look(replace(pose, runs=tuple(map(turned, pose.runs))), model))
    assert [(f.kind, f.channel) for f in found] == [("axis_flipped", channel)]
    assert "like a travel" in found[0].text and "the axes are exchanged" in found[0].text


# ---------------------------------------------------------------- dead channels


def test_a_dead_channel_is_not_said_to_move_otherwise_too(pose, model):
    """One finding for one cause."""
    for stated in (pose, replace(pose, noise_std={})):
        (found,) = look(changed(stated, "sway", lambda y: 0 * y), model)
        assert (found.kind, found.channel) == ("constant", "sway")


def test_a_gap_that_stands_still_while_the_cradle_heaves_is_dead(everything, model):
    found = impossible(look(changed(everything, "gap_left", lambda y: 0 * y + 5.0), model))
    assert [(f.kind, f.channel) for f in found] == [("constant", "gap_left")] and "while heave moves" in found[0].text


# ---------------------------------------------------------------- where it stands


@pytest.fixture
def rig():
    """All states, as a bag has them."""
    return measured(tuple(STATES))


def test_findings_name_rows_and_messages(tmp_path, pose, rig, model):
    """Of a table under any name, though rows before were left out; of a bag the message."""
    run = pose.runs[1]
    values = run.values.copy()
    values[60, 2] += 0.05
    lines = ["\t".join(("time", *run.channels)), "s\tm\tm\tm\trad"]
    lines += ["\t".join(f"{v:.9g}" for v in (t, *row)) for t, row in zip(run.times, values, strict=True)]
    (tmp_path / "b.dat").write_text("\r\n".join(["made by hand", *lines]), encoding="utf-16")
    read = read_csv(tmp_path / "b.dat")
    (found,) = look(replace(pose, runs=(pose.runs[0], replace(read, drive_current=5000.0), pose.runs[2])), model)
    assert "heave in b.dat, row 64, at 0.12 s is off by" in found.text
    rig.runs[1].values[60, 2] += 0.05
    write_bag(tmp_path / "b", run.times, dict(zip(STATES, rig.runs[1].values.T, strict=True)))
    bag = replace(read_bag(tmp_path / "b"), drive_current=5000.0)
    (found,) = look(replace(rig, runs=(bag,)), model)
    assert "heave in b, message 61, at 0.12 s is off by" in found.text


def test_units_of_a_bag_are_not_written_in_a_header(tmp_path, rig, model):
    columns = dict(zip(STATES, rig.runs[1].values.T, strict=True))
    write_bag(tmp_path / "b", rig.runs[1].times, columns | {"heave": 1e3 * columns["heave"]})
    alone = replace(rig, runs=(replace(read_bag(tmp_path / "b"), drive_current=5000.0),))
    (found,) = [f for f in impossible(look(alone, model)) if f.kind == "unit"]
    assert found.channel == "heave" and "publish it so" in found.remedy and "header" not in found.remedy


def test_a_unit_that_the_header_gives_wrongly_is_named(pose, model):
    """Metres below a header that says mm."""
    short = changed(pose, "heave", lambda y: 1e-3 * y)
    short = replace(short, runs=tuple(replace(r, converted={"heave": "mm"}) for r in short.runs))
    (found,) = impossible(look(short, model))
    assert (found.kind, found.channel) == ("unit", "heave") and found.size["factor"] == 1e3
    assert "the header says 'mm'" in found.remedy and "km" not in found.remedy


def test_a_stamp_whose_fractions_are_in_another_unit_is_named(tmp_path, rig, model):
    """Microseconds in nanosec: a thousand times as fast."""
    columns = dict(zip(STATES, rig.runs[1].values.T, strict=True))
    write_bag(tmp_path / "b", 1e-3 * rig.runs[1].times, columns)
    (found,) = impossible(look(replace(rig, runs=(replace(read_bag(tmp_path / "b"), drive_current=5000.0),)), model))
    assert "does nanosec hold microseconds" in found.remedy and "column" not in found.remedy


def test_a_time_that_counts_samples_is_named(pose, model):
    counted = replace(pose, runs=tuple(replace(r, times=np.arange(301.0), stamps=np.arange(301.0)) for r in pose.runs))
    (found,) = impossible(look(counted, model))
    assert found.kind == "time_unit" and "does it count the samples?" in found.remedy


def test_channels_of_runs_of_their_own_are_not_held_against_each_other(everything, model):
    """A coordinate in one run, its rate in another."""

    def only(run, channels):
        return replace(run, channels=channels, values=np.column_stack([run[c] for c in channels]))

    a, b, _ = everything.runs
    apart = replace(everything, runs=(only(a, POSE), only(b, ("surge_rate", "heave_rate"))))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not impossible(look(apart, model))


def test_the_page_shows_jumps_and_two_courses(pose, model):
    """What a sentence says a picture shows: the clock over the samples, the second course beside the first."""
    ahead = np.where(np.arange(301) < 150, 0.0, 3600.0)
    summer = of_run(pose, "b", lambda r: replace(r, times=r.times + ahead, stamps=r.stamps + ahead))
    turns = of_run(pose, "b", lambda r: replace(r, values=r.values + pattern("in turn")[:, None] * [0, 3e-3, 1e-3, 0]))
    moved = changed(pose, "heave", lambda y: y - 2e-3 * (np.arange(len(y)) >= 120), "b")
    for campaign, words in (
        (summer, "Times of b: the clock of b.csv jumps ahead by 60 minutes at sample 151"),
        (turns, "Heave of b: the samples of b.csv go to and fro"),
        (moved, "Heave of b: heave jumps by"),
    ):
        assert words in html.unescape(check_report(check(campaign, model)))


# ---------------------------------------------------------------- some runs only, and the current


@pytest.mark.parametrize(
    ("channel", "change", "kind", "words"),
    [
        ("roll_rate", lambda y: 180 / np.pi * y, "unit", "in degrees/s"),
        ("surge_rate", lambda y: 3.6 * y, "unit", "in km/h"),
        ("heave_acceleration", lambda y: y / 9.81, "unit", "in g"),
        ("sway_rate", lambda y: -y, "sign", "runs against sway"),
    ],
)
def test_a_rate_that_is_written_otherwise_in_one_run_is_named(channel, change, kind, words, everything, model):
    """All runs together hide it: their increments have little in common."""
    found = [f for f in impossible(look(changed(everything, channel, change, "b"), model)) if f.channel == channel]
    assert [f.kind for f in found] == [kind] and found[0].text.startswith("in b alone of 3 runs")
    assert words in found[0].line and found[0].size["runs"] == ["b"]


def currents(campaign, *factors):
    """The campaign with the drive current of each run multiplied."""
    runs = zip(campaign.runs, factors, strict=True)
    return replace(campaign, runs=tuple(replace(run, drive_current=f * run.drive_current) for run, f in runs))


@pytest.mark.parametrize(
    ("factors", "severity", "words"),
    [
        ((-1, -1, -1), IMPOSSIBLE, "acts against"),
        ((1, -1, 1), IMPOSSIBLE, "in b alone of 3 runs drive_current (-5000 A) acts against"),
        ((10, 10, 10), IMPOSSIBLE, "times what accelerates the cradle"),
        ((1, 1, 0.1), IMPOSSIBLE, "in c alone of 3 runs drive_current (360 A) is"),
        ((2, 2, 2), WARNING, "drive_current (14000, 10000 and 7200 A) is 2"),
        ((0.5, 0.5, 0.5), WARNING, "a fit that may move gamma takes 7."),
        ((1, 2**0.5, 1), IMPOSSIBLE, "effective value"),
        ((1, 2, 1), IMPOSSIBLE, "in b alone of 3 runs drive_current (10000 A) is 2"),
        ((1, 0, 1), IMPOSSIBLE, "accelerated as by"),
    ],
)
def test_a_current_that_does_not_accelerate_as_measured_is_named(factors, severity, words, pose, model):
    (found,) = look(currents(pose, *factors), model)
    assert (found.channel, found.severity) == ("drive_current", severity) and words in found.line


def test_runs_said_to_coast_that_are_driven_are_named(pose, model):
    """No track falls like that."""
    found = look(currents(pose, 0, 0, 0), model)
    assert [f.severity for f in found] == 3 * [IMPOSSIBLE] and all("was the drive on" in f.remedy for f in found)


def test_a_drive_that_weakens_with_the_speed_is_no_wrong_current(model):
    """The fastest run may have the weakest drive."""
    starts = [{"surge_rate": v, "sway": 2e-3, "heave": model.equilibrium_heave(v)} for v in (16.0, 20.0, 28.0)]
    rig = flown(list(zip((7000.0, 6000.0, 5000.0), starts, strict=True)), POSE, 301, 2e-3)
    (found,) = look(currents(rig, 1, 1, 1.8), model)
    assert (found.channel, found.severity, found.run) == ("drive_current", WARNING, "c")


def test_a_coasting_run_that_is_said_to_be_driven_is_named(model):
    start = {"surge_rate": 24.0, "sway": 2e-3, "heave": -5e-3}
    rig = flown([(7000.0, start), (0.0, start), (5000.0, start)], POSE, 301, 2e-3)
    (found,) = look(of_run(rig, "b", lambda run: replace(run, drive_current=3500.0)), model)
    assert (found.severity, found.run) == (IMPOSSIBLE, "b") and "drive_current (3500 A) does nothing" in found.line


@pytest.mark.parametrize("current", [3500.0, 2500.0, 1800.0])
def test_a_force_that_all_runs_lack_is_no_wrong_current(current, model):
    """As a part of its current each run lacks another share."""
    rig = Model.create(effects={"track_inductance": {"relative_change": -0.25}})
    flights = [(7000.0, 22.0), (6500.0, 22.5), (0.0, 21.0), (current, 22.2)]
    starts = [(i, {"surge_rate": v, "sway": 2e-3, "heave": rig.equilibrium_heave(v)}) for i, v in flights]
    (found,) = look(flown(starts, POSE, 121, 2.5e-3, model=rig), model)
    assert (found.severity, found.channel) == (WARNING, "surge") and "pushed backwards besides" in found.text


def test_a_noise_of_one_run_that_is_in_another_unit_is_named(pose, model):
    """What no unit makes of the travel of one run its noise says alone; kilometres the model's forces tell too."""
    found = impossible(look(changed(pose, "surge", lambda y: y / 40.0, "b"), model))
    assert [(f.kind, f.channel, f.run) for f in found] == [("noise_differs", "surge", "b")]
    found = impossible(look(changed(pose, "surge", lambda y: 1e-3 * y, "b"), model))
    assert [(f.kind, f.channel, f.run) for f in found] == [("unit", "surge", "b")] and "in km" in found[0].remedy


def test_channels_that_changed_places_in_one_run_are_told_by_their_noise(pose, model):
    runs = []
    for run in pose.runs:
        order = [0, 1, 3, 2] if run.name == "b" else [0, 1, 2, 3]
        runs.append(replace(run, values=run.values[:, order]))
    found = impossible(look(replace(pose, runs=tuple(runs)), model))
    assert [(f.kind, f.run, f.size["candidates"]) for f in found] == [("axis_flipped", "b", ["heave", "roll"])]


@pytest.mark.parametrize(("unit", "factor"), [("tenths of a second", 10.0), ("hundredths of a second", 100.0)])
def test_a_clock_that_counts_parts_of_a_second_is_named(unit, factor, pose, model):
    runs = tuple(replace(r, times=factor * r.times, stamps=factor * r.stamps) for r in pose.runs)
    (found,) = impossible(look(replace(pose, runs=runs), model))
    assert found.kind == "time_unit" and unit in found.text and f"divide it by {factor:g}" in found.remedy


@pytest.mark.parametrize("odd", [(), (70,)])
def test_a_channel_that_stands_still_where_its_noise_would_show_is_dead(odd, pose, model):
    """Also with a blip, and where the model holds the coordinate it does no harm."""

    def still(y):
        y[:] = y[0]
        y[list(odd)] += 1e-4
        return y

    campaign = changed(pose, "sway", still)
    (found,) = impossible(look(campaign, model))
    assert (found.kind, found.channel) == ("constant", "sway") and "would show" in found.text
    held = model.with_changes(dof=2)
    assert ("constant", "sway") not in {(f.kind, f.channel) for f in impossible(look(campaign, held))}


def test_an_accelerometer_that_felt_no_pulse_is_the_same_one():
    """Pulses come and go between the samples, so they look like noise. A run in which all but one came late is
    quiet."""
    rig = flown([(0.0, {"surge_rate": v}) for v in (16.0, 20.0, 24.0)], (*POSE, "surge_acceleration"), 300, 2e-3)
    rng = np.random.default_rng(2)
    felt = changed(rig, "surge_acceleration", lambda y: y + 40.0 * np.sign(rng.standard_normal(len(y))), "ab")
    many, one = (Pulses(0.002 * np.arange(n), np.arange(n), np.full(n, 5000.0)) for n in (290, 1))
    runs = [replace(r, pulses=one if r.name == "c" else many) for r in felt.runs]
    found = look(replace(felt, runs=tuple(runs)), Model.create(drive="pulses"))
    assert not [f for f in found if f.kind == "noise_differs"]


# ---------------------------------------------------------------- before a run begins


def held(campaign, count, pull=0.0, step=2e-3):
    """Its runs begin with ``count`` samples at rest, let go at once or pulled off in ``pull`` seconds."""

    def one(run):
        rng, first = np.random.default_rng(ord(run.name)), run.values[0]
        speed = (run["surge"][20] - run["surge"][0]) / (20 * step)
        off = np.linspace(0.0, 1.0, round(pull / step), endpoint=False)
        begin = np.repeat(first[None], count + len(off), axis=0)
        begin[count:, 0] += 0.5 * speed * pull * off**2
        begin += [NOISE[c] for c in run.channels] * rng.standard_normal(begin.shape)
        rest = run.values + (0.5 * speed * pull) * (np.arange(len(run.channels)) == 0)
        times = np.arange(len(begin) + len(rest)) * step
        return replace(run, times=times, stamps=times, values=np.concatenate([begin, rest]))

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


@pytest.mark.parametrize("count", [5, 40, 1000])
def test_a_run_begins_where_the_cradle_is_let_go(count, pose, model):
    used, findings = admit(held(pose, count), model)
    (found,) = [f for f in findings if f.kind == "rest"]
    assert (found.severity, found.size["count"]) == (SET_ASIDE, 3 * count)
    assert f"first {count} samples" in found.text and "(and so b and c)" in found.text
    for mine, clean in zip(used.runs, pose.runs, strict=True):
        assert np.array_equal(mine.values, clean.values) and mine.times[0] == 0.0


def test_what_pulls_the_cradle_off_belongs_to_the_run(pose, model):
    (found,) = [f for f in look(held(pose, 250, pull=0.2), model) if f.kind == "rest"]
    assert all(200 < len(rows) <= 252 for rows in found.samples.values())


@pytest.mark.parametrize("channels", [POSE, ("surge_rate", "heave")])
def test_a_run_that_begins_slowly_or_moves_evenly_was_not_held(channels, model):
    """From rest under a steady pull; and at the speed at which drive and drag are in balance."""
    rig = flown([(7000.0, {"surge_rate": 16.1})], channels, 301, 2e-3)
    assert not [f for f in look(rig, model) if f.kind == "rest"]
    (run,) = rig.runs
    k = 0 if "surge" in channels else None
    values = run.values.copy()
    times = run.times
    values[:, 0] = (4.0 * times**2 if k == 0 else 8.0 * times) + 5e-4 * np.random.default_rng(2).standard_normal(301)
    slow = replace(rig, runs=(replace(run, values=values),))
    assert not [f for f in look(slow, model) if f.kind == "rest"]


def test_a_cradle_that_waits_for_its_pulses_is_no_rest(pose, model):
    """A model waits for them as well."""
    pulses = Pulses(np.array([0.5]), np.array([3]), np.array([7000.0]))
    waiting = replace(held(pose, 250), runs=tuple(replace(r, pulses=pulses) for r in held(pose, 250).runs))
    assert not [f for f in look(waiting, model) if f.kind == "rest"]


# ---------------------------------------------------------------- behind a run's end


def stopped(campaign, force, count=60, step=2e-3):
    """Its runs go on into a catcher that slows the cradle down by ``force`` (m/s², infinite: at once), and ``count``
    samples more."""

    def one(run):
        rng, last = np.random.default_rng(ord(run.name)), run.values[-1]
        speed = (run["surge"][-1] - run["surge"][-21]) / (20 * step)
        stop = speed / force
        t = np.arange(1, count + round(stop / step)) * step
        end = np.repeat(last[None], len(t), axis=0)
        end[:, 0] += speed * np.minimum(t, stop) - 0.5 * np.minimum(t, stop) ** 2 * (force if stop else 0.0)
        end += [NOISE[c] for c in run.channels] * rng.standard_normal(end.shape)
        times = np.concatenate([run.times, run.times[-1] + t])
        return replace(run, times=times, stamps=times, values=np.concatenate([run.values, end]))

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


@pytest.mark.parametrize("force", [100.0, 400.0, np.inf])
def test_a_run_ends_where_the_cradle_is_caught(force, pose, model):
    used, findings = admit(stopped(pose, force), model)
    (found,) = [f for f in findings if f.kind == "rest"]
    assert found.severity == SET_ASIDE and "stands still to its end" in found.text
    for mine, clean in zip(used.runs, pose.runs, strict=True):
        assert len(clean.times) - 10 < len(mine.times) <= len(clean.times) + 2


def test_a_cradle_that_comes_to_rest_by_itself_was_not_caught(pose, model):
    """Evenly; as the drag of magnets takes its speed; and as it does below the speed at which they lift it."""
    times = np.arange(1501) * 2e-3
    noise = 5e-4 * np.random.default_rng(3).standard_normal(len(times))
    left = np.maximum(1.5 - times, 0.0)
    for travel in (-6.0 * left**2, -10.0 * left**1.5, 2.0 * (1.0 - np.exp(-times / 0.15))):
        values = np.column_stack([travel + noise, *(noise * k for k in (0.06, 0.06, 0.2))])
        run = replace(pose.runs[0], times=times, stamps=times, values=values)
        assert not [f for f in look(replace(pose, runs=(run,)), model) if f.kind == "rest"]


def test_a_cradle_that_stops_on_the_track_was_not_caught(pose, model):
    """Friction may stop it there, and is a force that can be missing."""
    gap = model.parameters["nominal_gap"]
    low = changed(stopped(pose, 400.0), "heave", lambda y: y - gap * (np.arange(len(y)) > len(y) - 110))
    assert not [f for f in look(low, model) if f.kind == "rest"]


# ---------------------------------------------------------------- channels that were computed


def with_computed(campaign, compute):
    """Its runs with rates that are ``compute`` of each coordinate and the times."""

    def one(run):
        rates = np.column_stack([compute(run[c], run.times) for c in POSE])
        channels = (*POSE, *(f"{c}_rate" for c in POSE))
        return replace(run, channels=channels, values=np.concatenate([run.values, rates], axis=1))

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


@pytest.mark.parametrize(
    "compute",
    [
        np.gradient,
        lambda x, t: np.diff(x, prepend=x[0]) / np.diff(t, prepend=-t[1]),
        lambda x, t: np.convolve(np.gradient(x, t), np.ones(5) / 5, "same"),
    ],
)
def test_a_rate_that_is_computed_is_no_measurement(compute, pose, model):
    used, findings = admit(with_computed(pose, compute), model)
    found = [f for f in findings if f.kind == "computed"]
    assert [f.channel for f in found] == [f"{c}_rate" for c in POSE] and {f.severity for f in found} == {SET_ASIDE}
    assert found[0].text.startswith("surge_rate is computed from surge:")
    assert all(run.channels == POSE for run in used.runs)


def test_an_acceleration_that_is_computed_of_a_rate_in_one_run_is_left_out_there(everything, model):
    runs = list(everything.runs)
    run = runs[1]
    values = run.values.copy()
    values[:, run.channels.index("sway_acceleration")] = np.gradient(run["sway_rate"], run.times)
    runs[1] = replace(run, values=values)
    used, findings = admit(replace(everything, runs=tuple(runs)), model)
    (found,) = [f for f in findings if f.kind == "computed"]
    assert found.text.startswith("sway_acceleration is computed from sway_rate in b:")
    assert ["sway_acceleration" in run.channels for run in used.runs] == [True, False, True]


@pytest.mark.parametrize("step", [2e-3, 0.02])
def test_exact_rates_of_a_simulation_are_not_computed_of_its_coordinates(step, model):
    """What holds no noise is alike by its physics."""
    channels = tuple(c for c in CHANNELS if c != "coil_current")
    rig = flown([(7000.0, {"surge_rate": 17.0, "sway": 3e-3}), (0.0, {"surge_rate": 24.0})], channels, 301, step)
    exact = [
        replace(
            r,
            values=np.column_stack(
                [model.simulate(r.times, model.initial_state(**s), c, further=True)[x] for x in channels]
            ),
        )
        for r, (c, s) in zip(
            rig.runs, [(7000.0, {"surge_rate": 17.0, "sway": 3e-3}), (0.0, {"surge_rate": 24.0})], strict=True
        )
    ]
    for campaign in (rig, replace(rig, runs=tuple(exact), noise_std={})):
        assert not [f for f in look(campaign, model) if f.kind == "computed"]


# ---------------------------------------------------------------- the drive


def driven(run, lost=(), counted=True):
    """A run by 300 pulses, 2 ms apart, without those of these numbers, as it comes out of a bag."""
    kept = np.setdiff1d(np.arange(300), lost)
    pulses = Pulses(2e-3 * kept, kept, np.full(len(kept), 7000.0))
    return replace(run, pulses=pulses, pulse_counts=kept + 11.0 if counted else None)


def test_a_run_ends_where_a_pulse_is_missing(pose):
    """The cradle felt it, and no model can know. A last pulse that is missing nobody misses."""
    model = Model.create(drive="pulses")
    rig = replace(pose, runs=tuple(map(driven, pose.runs)))
    assert not [f for f in look(rig, model) if f.kind == "lost_pulses"]
    (found,) = [
        f for f in look(of_run(rig, "b", lambda r: driven(r, [200, 201, 250, 299])), model) if f.kind == "lost_pulses"
    ]
    assert (found.severity, found.samples) == (SET_ASIDE, {"b": tuple(range(200, 301))})
    assert "b.csv: 3 of 299 pulses that fired are not in the bag, the first after 0.398 s" in found.text
    unknown = of_run(rig, "b", lambda r: driven(r, [200, 201], counted=False))
    assert not [f for f in look(unknown, model) if f.kind == "lost_pulses"]


def test_a_run_of_which_little_is_left_is_left_out_and_all_are_refused(pose):
    model = Model.create(drive="pulses")
    rig = replace(pose, runs=tuple(driven(r, [3]) if r.name == "b" else driven(r) for r in pose.runs))
    used, findings = admit(rig, model)
    assert [r.name for r in used.runs] == ["a", "c"] and "too little of the run is left" in findings[0].text
    none = replace(pose, runs=tuple(driven(r, [3]) for r in pose.runs))
    with pytest.raises(InputError, match="1 of 300 pulses that fired are not in the bag, .* record again"):
        admit(none, model)


def test_a_bag_counts_its_pulses(tmp_path):
    run = driven(measured(STATES).runs[0])
    write_bag(tmp_path / "bag", run.times, {c: run[c] for c in run.channels}, pulses=run.pulses)
    assert read_bag(tmp_path / "bag", {"pose": "/inductrack/pose"}).pulse_counts.tolist() == list(range(1, 301))
