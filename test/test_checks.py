# SPDX-License-Identifier: Apache-2.0
"""The look at the data: each kind of fault planted into a clean campaign of our own, and clean campaigns left alone."""

from __future__ import annotations

import html
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.checks import IMPOSSIBLE, SET_ASIDE, WARNING, admit, impossible, look, set_aside
from inductrack_ros.checks.check import check
from inductrack_ros.checks.finding import Finding
from inductrack_ros.checks.local import predictions
from inductrack_ros.checks.noise_found import channels_of
from inductrack_ros.checks.saying import counted
from inductrack_ros.checks.windows import windows_of
from inductrack_ros.cli import main
from inductrack_ros.compare import compare
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model, Pulses
from inductrack_ros.core.state import CHANNELS
from inductrack_ros.data import Campaign, Run, load_campaign, write_csv
from inductrack_ros.diagnosis.add import add_effect
from inductrack_ros.diagnosis.diagnose import diagnose
from inductrack_ros.reports.check_report import check_report

NOISE = {
    "surge": 5e-4,
    "sway": 3e-5,
    "heave": 3e-5,
    "roll": 1e-4,
    "surge_rate": 0.01,
    "sway_rate": 3e-3,
    "heave_rate": 3e-3,
    "roll_rate": 0.01,
}
NOISE |= dict.fromkeys(("gap_top", "gap_right", "gap_left"), 3e-5) | dict.fromkeys(
    ("surge_acceleration", "sway_acceleration", "heave_acceleration"), 0.05
)
NOISE |= {"coil_current": 1.0}
POSE = ("surge", "sway", "heave", "roll")
PRACTICE = Path(__file__).parent / "data" / "practice"


def measured(channels: tuple[str, ...] = POSE, count: int = 301, step: float = 2e-3, seed: int = 1) -> Campaign:
    """Three runs of the package's own model with white noise."""
    model = Model.default()

    def start(speed: float, sway: float) -> dict[str, float]:
        return {"surge_rate": speed, "sway": sway, "roll": 3e-3, "heave": model.equilibrium_heave(speed) + 5e-4}

    return flown(
        [(7000.0, start(17.0, 3e-3)), (5000.0, start(22.0, -2e-3)), (3600.0, start(26.0, 2e-3))],
        channels,
        count,
        step,
        seed,
    )


def flown(
    starts: list[tuple[float, dict[str, float]]],
    channels: tuple[str, ...],
    count: int,
    step: float,
    seed: int = 1,
    model: Model | None = None,
) -> Campaign:
    """Runs named a, b, … of a model, the package's own or another, with white noise, each from a drive current and
    states."""
    model, rng = model or Model.default(), np.random.default_rng(seed)
    runs, times = [], np.arange(count) * step
    for name, (current, states) in zip("abcdefgh", starts, strict=False):
        flight = model.simulate(times, model.initial_state(**states), current, further=True)
        values = np.column_stack([flight[c] + NOISE[c] * rng.standard_normal(count) for c in channels])
        runs.append(Run(name, Path(f"{name}.csv"), channels, times, values, times, current))
    return Campaign("rig", Path("rig"), tuple(runs), {c: NOISE[c] for c in channels})


@pytest.fixture(scope="module")
def everything() -> Campaign:
    return measured(tuple(c for c in CHANNELS))


def times_of(campaign: Campaign, factor: float) -> Campaign:
    return replace(
        campaign, runs=tuple(replace(r, times=factor * r.times, stamps=factor * r.stamps) for r in campaign.runs)
    )


def changed(campaign: Campaign, channel: str, change, runs: str = "abc") -> Campaign:
    """The campaign with a channel of some runs replaced by ``change`` of it."""

    def one(run: Run) -> Run:
        values = run.values.copy()
        k = run.channels.index(channel)
        values[:, k] = change(values[:, k].copy())
        return replace(run, values=values) if run.name in runs else run

    return replace(campaign, runs=tuple(map(one, campaign.runs)))


def put(*cells: tuple[int, float]):
    """A change that writes values into rows."""

    def change(column):
        for row, value in cells:
            column[row] = value
        return column

    return change


def kinds(findings, severity=None) -> set[tuple[str, str | None]]:
    return {(f.kind, f.channel) for f in findings if severity in (None, f.severity)}


# ---------------------------------------------------------------- nothing where nothing is


def test_a_clean_campaign_is_clean(pose, everything, model):
    assert look(pose, model) == ()
    assert kinds(look(everything, model)) <= {("offset", "heave_acceleration")}


@pytest.mark.parametrize("name", sorted(p.name for p in PRACTICE.iterdir() if p.is_dir()))
def test_contact_bounces_and_holes_are_no_faults(name, model):
    campaign = load_campaign(PRACTICE / name)
    assert {f.kind for f in look(campaign, model)} <= {"hole", "uneven_stamps", "still"}


@pytest.mark.parametrize("slopes", [(-1.0, 1.0), (0.0, 1.0), (-1.0, 0.3)])
def test_a_kink_is_no_outlier_wherever_it_lies(slopes):
    """The bound that `levels.KINK` is set above: an impact turns a coordinate's slope between any two samples."""
    times = np.arange(13.0) - 6
    for at in np.linspace(-6, 6, 121):
        values = np.where(times < at, slopes[0], slopes[1]) * (times - at)
        predicted, _ = predictions(times, values)
        a, b, c = predicted[:, 0]
        agree = min(abs(a - b), abs(a - c), abs(b - c))
        assert abs(values[6] - predicted[:, 0]).min() <= 3.0 * agree + 1e-9


#: A crash, drops onto the track on its top and on its sides, bounces, and a run that only flies.
IMPACTS = [
    (0.0, {"surge_rate": 10.0, "heave": 4e-3, "sway": 2e-3, "roll": 0.02}),
    (3000.0, {"surge_rate": 14.0, "sway": -3e-3, "heave": 5e-3}),
    (7000.0, {"surge_rate": 18.0, "sway_rate": 0.8}),
    (7000.0, {"surge_rate": 18.0, "heave_rate": -1.2}),
    (7000.0, {"surge_rate": 20.0}),
]
POSE_AND_IMU = (*POSE, "surge_acceleration", "sway_acceleration", "heave_acceleration")


@pytest.mark.parametrize("step", [5e-4, 2e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("channels", [tuple(CHANNELS), POSE_AND_IMU])
def test_impacts_are_not_set_aside(channels, step, model):
    """They last for samples, show in several channels at once, and look like spikes where they are sampled slowly."""
    hit = flown(IMPACTS, channels, count=max(round(0.6 / step), 76), step=step)
    assert [f.line for f in look(hit, model) if f.severity in (IMPOSSIBLE, SET_ASIDE)] == []


def test_bad_cells_beside_impacts_are_set_aside_all_the_same(model):
    """No contact throws a cradle so far from one sample to the next."""
    hit = flown(IMPACTS, POSE_AND_IMU, count=301, step=2e-3)
    touching = 20 + int(np.argmax(hit.runs[3]["heave_acceleration"][20:]))
    for channel, size in (("heave", 0.05), ("roll", 0.5), ("heave_acceleration", 8e3)):
        spoiled = changed(hit, channel, lambda y, s=size: y + s * (np.arange(len(y)) == touching), "d")
        (found,) = [f for f in look(spoiled, model) if f.severity == SET_ASIDE]
        assert (found.channel, found.samples) == (channel, {"d": (touching,)})


def test_a_spike_of_an_accelerometer_away_from_the_track_is_set_aside(model):
    calm = measured(POSE_AND_IMU)
    spoiled = changed(calm, "sway_acceleration", put((150, 40.0)), "b")
    (found,) = [f for f in look(spoiled, model) if f.severity == SET_ASIDE]
    assert found.samples == {"b": (150,)}


def test_the_one_run_that_swings_is_no_outlier_of_those_that_do_not(model):
    """It goes fifty times as far as the others, and enters and leaves that range as a cradle does."""
    still = [(7000.0, {"surge_rate": speed}) for speed in (17.0, 18.0, 19.0, 20.0, 21.0, 22.0)]
    released = flown([*still, (7000.0, {"surge_rate": 18.0, "sway": 6e-3, "roll": 0.02})], POSE, count=301, step=2e-3)
    assert {f.severity for f in look(released, model)} <= {"note"}


# ---------------------------------------------------------------- units, signs and clocks

FACTORS = [
    ("surge", 1e3), ("sway", 1e3), ("heave", 1e3), ("roll", 1e3), ("roll", 180 / np.pi), ("heave", 1e2),
]  # fmt: skip


@pytest.mark.parametrize(("channel", "factor"), FACTORS)
def test_a_wrong_unit_is_named(channel, factor, pose, model):
    (found,) = impossible(look(changed(pose, channel, lambda y: factor * y), model))
    assert (found.kind, found.channel) == ("unit", channel)
    assert found.size["factor"] == pytest.approx(1 / factor)


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_a_clock_in_other_units_is_named(factor, pose, model):
    found = impossible(look(times_of(pose, factor), model))
    assert [f.kind for f in found] == ["time_unit"]
    assert found[0].size["factor"] == pytest.approx(factor)


def test_several_wrong_units_are_all_named(pose, model):
    spoiled = pose
    for channel, factor in (("sway", 1e3), ("heave", 1e3), ("roll", 180 / np.pi)):
        spoiled = changed(spoiled, channel, lambda y, f=factor: f * y)
    assert kinds(impossible(look(spoiled, model))) == {("unit", "sway"), ("unit", "heave"), ("unit", "roll")}


def test_a_current_in_kiloamperes_is_named(pose, model):
    spoiled = replace(pose, runs=tuple(replace(r, drive_current=r.drive_current / 1e3) for r in pose.runs))
    (found,) = impossible(look(spoiled, model))
    assert (found.kind, found.channel, found.size["factor"]) == ("unit", "drive_current", 1e3)


@pytest.mark.parametrize(
    ("channel", "candidates"),
    [("sway", {"sway", "roll"}), ("roll", {"sway", "roll"}), ("heave", {"heave"}), ("surge", {"surge"})],
)
def test_a_flipped_axis_is_named_with_its_mirror_twin(channel, candidates, pose, model):
    (found,) = impossible(look(changed(pose, channel, lambda y: -y), model))
    assert found.kind == "axis_flipped"
    assert set(found.size["candidates"]) == candidates


@pytest.mark.parametrize(
    ("channel", "change", "kind"),
    [
        ("heave_rate", -1.0, "sign"),
        ("roll_rate", 180 / np.pi, "unit"),
        ("surge_rate", 3.6, "unit"),
        ("sway_rate", 1e3, "unit"),
        ("surge_acceleration", -1.0, "sign"),
    ],
)
def test_a_rate_that_is_no_derivative_is_named(channel, change, kind, everything, model):
    found = impossible(look(changed(everything, channel, lambda y: change * y), model))
    assert (kind, channel) in kinds(found)


@pytest.mark.parametrize("gap", ["gap_top", "gap_right", "gap_left"])
def test_a_gap_in_millimetres_is_named(gap, everything, model):
    found = impossible(look(changed(everything, gap, lambda y: 1e3 * y), model))
    assert ("unit", gap) in kinds(found)


def test_swapped_gaps_are_named(everything, model):
    right, left = (np.concatenate([r[g] for r in everything.runs]) for g in ("gap_right", "gap_left"))
    count = len(everything.runs[0].times)
    spoiled = everything
    for k, name in enumerate("abc"):
        rows = slice(k * count, (k + 1) * count)
        spoiled = changed(
            changed(spoiled, "gap_right", lambda _, r=rows: left[r], name), "gap_left", lambda _, r=rows: right[r], name
        )
    assert "swapped" in impossible(look(spoiled, model))[0].text


@pytest.mark.parametrize("pair", [("sway", "heave"), ("sway", "roll"), ("heave", "roll")])
def test_channels_that_changed_places_are_named(pair, pose, model):
    order = list(POSE)
    i, j = (order.index(c) for c in pair)
    order[i], order[j] = order[j], order[i]
    columns = [POSE.index(c) for c in order]
    (found,) = impossible(
        look(replace(pose, runs=tuple(replace(r, values=r.values[:, columns]) for r in pose.runs)), model)
    )
    assert f"{pair[0]} and {pair[1]} are swapped" in found.text


@pytest.mark.parametrize(
    ("channel", "factor", "kind"),
    [("heave", 1e3, "unit"), ("sway", -1.0, "axis_flipped"), ("roll", 180 / np.pi, "unit")],
)
def test_one_run_that_is_written_otherwise_is_named(channel, factor, kind, pose, model):
    (found,) = impossible(look(changed(pose, channel, lambda y: factor * y, "b"), model))
    assert found.kind == kind and found.text.startswith("in b alone of 3 runs ")


@pytest.mark.parametrize(
    ("channel", "factor", "unit", "either"),
    [("roll", -180 / np.pi, "degrees", ["sway", "roll"]), ("heave", -1e3, "mm", ["heave"])],
)
def test_a_unit_and_a_sign_of_one_channel_are_both_named(channel, factor, unit, either, pose, model):
    """Neither alone makes it belong; whose sign it is the data tell once the unit is right."""
    found = {f.kind: f for f in impossible(look(changed(pose, channel, lambda y: factor * y), model))}
    assert found.keys() == {"unit", "axis_flipped"}
    assert found["unit"].channel == channel and f"it seems to be in {unit};" in found["unit"].remedy
    assert found["axis_flipped"].size["candidates"] == either


@pytest.mark.parametrize("often", [2.0, 4.0])
def test_a_travel_that_is_counted_too_often_is_named_and_no_current(often, pose, model):
    """Edges of an encoder for its lines."""
    (found,) = impossible(look(changed(pose, "surge", lambda y: often * y), model))
    assert found.kind == "unit" and found.channel == "surge" and found.run is None
    assert found.text == f"surge is {often:g} times the travel that moves as the model's forces say"
    assert found.remedy.endswith("A known distance along the track settles it")


def test_where_a_travel_and_a_current_explain_the_same_both_are_named(pose, model):
    windows = windows_of(pose, channels_of(pose))
    travel = Finding("unit", "impossible", "surge is 2 times the travel", "look", "surge")
    current = Finding("unlike", "warning", "drive_current is 0.4 times what accelerates", "look at it", "drive_current")
    found = counted(travel, 0.5, windows, [current])
    assert found.severity == "warning" and found.channel == "drive_current"
    assert found.text == f"{current.text}; or is it that surge is 2 times the true travel"
    assert "A known distance along the track settles it. If that is right, look at it" in found.remedy
    assert counted(travel, 0.5, windows, []) == travel


@pytest.mark.parametrize("kind", ["constant", "computed", "outliers"])
def test_a_channel_of_which_nothing_is_left_is_left_out(kind, pose):
    """Whatever the finding; where a sample is left the channel stays."""
    every = tuple(range(len(pose.runs[0].times)))
    for samples, stays in ((every, False), (every[1:], True)):
        run, other, _ = set_aside(pose, [Finding(kind, SET_ASIDE, "", channel="roll", samples={"a": samples})]).runs
        assert ("roll" in run.channels) == stays and "roll" in other.channels
        assert len(run.times) == len(pose.runs[0].times)


def test_a_current_in_kiloamperes_of_one_run_is_named(pose, model):
    runs = (replace(pose.runs[0], drive_current=7.0), *pose.runs[1:])
    (found,) = impossible(look(replace(pose, runs=runs), model))
    assert found.channel == "drive_current" and found.text.startswith("in a alone of 3 runs drive_current (7 A)")


def test_forces_that_no_reading_explains_are_said(pose, model):
    """A rig ten times as heavy as its model: no physics of the catalogue makes up for that."""
    result = check(pose, model.with_changes({"mass": 93.0}))
    (found,) = [f for f in result.findings if f.kind == "unlike"]
    page = check_report(result)
    assert "model's motion, as written" in html.unescape(page) and found.channel in page
    assert found.severity == WARNING and "heave" in found.size["channels"]


@pytest.mark.parametrize(
    ("state", "value", "severity", "hint"),
    [
        ("surge_rate", 61.2, IMPOSSIBLE, "km/h"),
        ("sway", 3.0, IMPOSSIBLE, "mm"),
        ("heave", 5e-3, IMPOSSIBLE, "correct it"),
        ("surge_rate", 18.5, WARNING, "leave it out"),
    ],
)
def test_an_initial_state_is_held_against_the_samples(state, value, severity, hint, pose, model):
    def told(value):
        return replace(
            pose, runs=tuple(replace(r, initial_state={state: value} if r.name == "a" else {}) for r in pose.runs)
        )

    (found,) = [f for f in look(told(value), model) if f.kind == "initial_state"]
    assert (found.severity, found.channel) == (severity, state) and hint in found.remedy
    right = 17.0 if state == "surge_rate" else float(pose.runs[0][state][:3].mean())
    assert look(told(right), model) == ()


def test_a_condition_that_is_no_value_of_its_parameter(pose, model):
    weighed = replace(pose, runs=tuple(replace(r, conditions={"mass": 9300.0}) for r in pose.runs))
    (found,) = [f for f in look(weighed, model) if f.kind == "condition"]
    assert found.severity == IMPOSSIBLE and "1000 times the model's 9.3 kg" in found.text
    assert look(replace(pose, runs=tuple(replace(r, conditions={"mass": 9.42}) for r in pose.runs)), model) == ()


def test_repeats_of_a_sensor_that_is_read_slowly_are_no_measurements(pose, model):
    slow = changed(pose, "heave", lambda y: np.repeat(y[::5], 5)[: len(y)])
    used, (found,) = admit(slow, model)
    assert (found.kind, found.channel, found.size["every"]) == ("held", "heave", 5.0)
    assert np.array_equal(used.runs[0].samples("heave")[1], pose.runs[0]["heave"][::5])
    assert not any(f.kind == "held" for f in look(changed(pose, "roll", lambda y: np.round(y, 3)), model))


@pytest.mark.parametrize("share", [0.03, 0.2])
def test_readings_that_repeat_the_one_before_now_and_then_are_no_measurements(share, pose, model):
    def missed(y):
        late = np.random.default_rng(3).random(len(y)) < share
        late[0] = False
        return y[np.maximum.accumulate(np.where(late, 0, np.arange(len(y))))]

    (found,) = look(changed(pose, "sway", missed), model)
    assert (found.kind, found.channel, found.severity) == ("held", "sway", SET_ASIDE)
    assert found.size["count"] == pytest.approx(share * sum(len(r.times) for r in pose.runs), rel=0.3)


@pytest.mark.parametrize("steps", [0.3, 1.0, 3.0])
def test_coarse_readings_that_repeat_by_themselves_are_kept(steps, pose, model):
    """Also those of a travel that stands still for half of the run."""
    step, rng = steps * pose.noise_std["surge"], np.random.default_rng(5)
    moving = changed(pose, "surge", lambda y: step * np.round(y / step))
    assert not any(f.kind == "held" for f in look(moving, model))

    def stopped(y):
        noise = pose.noise_std["surge"] * rng.standard_normal(len(y))
        return step * np.round((np.minimum(y, y[len(y) // 2]) + noise) / step)

    assert not any(f.kind == "held" for f in look(changed(pose, "surge", stopped), model))


def test_another_zero_is_told_from_another_unit(pose, model):
    (found,) = impossible(look(changed(pose, "heave", lambda y: y + 0.3), model))
    assert found.kind == "zero"


def test_a_rate_with_another_clock_is_named(everything, model):
    (found,) = [
        f
        for f in look(changed(everything, "roll_rate", lambda y: np.roll(y, 3)), model)
        if f.kind == "offset" and f.channel == "roll_rate"
    ]
    assert found.size["offset"] == pytest.approx(6e-3, abs=1e-3)


# ---------------------------------------------------------------- clocks


def test_a_jump_of_the_clock_is_named(pose, model):
    run = pose.runs[0]
    times = run.times + np.where(np.arange(len(run.times)) > 150, 3600.0, 0.0)
    (found,) = impossible(look(replace(pose, runs=(replace(run, times=times, stamps=times), *pose.runs[1:])), model))
    assert found.kind == "clock_jump"
    assert "sample 152" in found.text


def test_a_slow_logger_says_so(pose, model):
    """Its file names the unit; where it does not the time is more likely in milliseconds."""
    slow = times_of(pose, 150.0)
    (found,) = impossible(look(slow, None))
    assert found.kind == "time_unit"
    assert "name it 'time [s]'" in found.remedy
    stated = replace(slow, runs=tuple(replace(r, seconds_stated=True) for r in slow.runs))
    assert impossible(look(stated, None)) == ()


def test_a_first_stamp_of_zero_is_set_aside(pose, model):
    run = pose.runs[0]
    stamps = (1_700_000_000_000_000_000 + np.rint(run.times * 1e9)).astype(np.int64)
    stamps[0] = 0
    spoiled = replace(pose, runs=(replace(run, stamps=stamps, times=(stamps - stamps[0]) / 1e9), *pose.runs[1:]))
    used, findings = admit(spoiled, model)
    assert kinds(findings, SET_ASIDE) == {("first_stamp", None)}
    assert used.runs[0].duration == pytest.approx(run.duration - 2e-3, abs=1e-6)
    assert used.runs[0].times[0] == 0.0


def test_a_hole_is_a_note_and_a_pause_is_none(pose, model):
    run = pose.runs[0]
    kept = np.r_[0:100, 130:301]
    hole = replace(run, times=run.times[kept], stamps=run.stamps[kept], values=run.values[kept])
    assert kinds(look(replace(pose, runs=(hole, *pose.runs[1:])), model)) == {("hole", None)}
    late = np.where(np.arange(len(kept)) < 100, hole.times, hole.times + 50.0)
    values = hole.values.copy()
    values[100:, 0] += 50.0 * 17.0
    paused = replace(hole, times=late, stamps=late, values=values)
    assert kinds(impossible(look(replace(pose, runs=(paused, *pose.runs[1:])), model))) == {("hole", None)}


def test_stamps_off_by_chance_are_told_from_noise(pose, model):
    rng, flown = np.random.default_rng(5), []
    for run in pose.runs:
        true = run.times + 3e-4 * rng.standard_normal(len(run.times))
        flown.append(replace(run, values=np.column_stack([np.interp(true, run.times, run[c]) for c in run.channels])))
    start = [m for m in look(replace(pose, runs=tuple(flown)), model) if m.kind == "time_jitter"]
    assert len(start) == 1
    assert 1e-4 < start[0].size["std"] < 5e-4


# ---------------------------------------------------------------- bad samples


def test_one_bad_cell_is_set_aside_and_placed(pose, model):
    spoiled = changed(pose, "heave", put((60, 0.045)), "b")
    used, (found,) = admit(spoiled, model)
    assert (found.kind, found.channel, found.samples) == ("outliers", "heave", {"b": (60,)})
    assert "b.csv" in found.text
    assert np.isnan(used.runs[1]["heave"][60])
    assert not np.isnan(used.runs[1]["sway"][60])


@pytest.mark.parametrize("value", [-9999.0, 999.0, 1e20, 32767.0, -3e5])
def test_fillers_are_set_aside(value, pose, model):
    used, (found,) = admit(changed(pose, "heave", put((60, value), (61, value), (200, value)), "b"), model)
    assert (found.severity, found.channel, found.size["count"]) == (SET_ASIDE, "heave", 3)
    assert found.samples == {"b": (60, 61, 200)}
    assert f"{value:.6g}" in found.text


def test_zeros_where_the_sensor_was_lost_are_set_aside(pose, model):
    _, (found,) = admit(changed(pose, "heave", put((60, 0.0), (61, 0.0), (120, 0.0)), "b"), model)
    assert found.samples == {"b": (60, 61, 120)}


def test_spikes_are_found_and_little_else(pose, model):
    rng = np.random.default_rng(3)
    spoiled, planted = pose, {}
    for channel in POSE:
        rows = np.sort(rng.choice(np.arange(8, 293), 4, replace=False))
        sizes = NOISE[channel] * rng.uniform(15, 60, 4) * rng.choice([-1, 1], 4)
        planted[channel] = set(rows.tolist())
        spoiled = changed(spoiled, channel, lambda y, r=rows, s=sizes: y + np.bincount(r, s, len(y)), "b")
    found = {f.channel: set(f.samples["b"]) for f in look(spoiled, model) if f.kind == "outliers"}
    assert found == planted


def test_a_run_of_nonsense_is_not_set_aside_but_refused(pose):
    rng = np.random.default_rng(0)
    noisy = changed(pose, "roll", lambda y: y + 0.3 * (rng.random(len(y)) < 0.25))
    assert any(f.severity == IMPOSSIBLE or f.kind == "noise_differs" for f in look(noisy) if f.channel == "roll")


# ---------------------------------------------------------------- sensors and noise


def test_a_constant_channel_says_so(pose, model):
    with pytest.raises(InputError, match=r"sway is 0 in every sample.*leave the channel out"):
        admit(replace(changed(pose, "sway", np.zeros_like), noise_std={}), model)
    used, (found,) = admit(changed(pose, "roll", lambda y: np.full_like(y, 0.001), "c"), model)
    assert (found.kind, found.severity) == ("constant", SET_ASIDE)
    assert "roll" not in used.runs[2].channels and "roll" in used.runs[0].channels


def test_a_coarse_sensor_at_rest_is_not_called_dead(pose, model):
    """Its step is wider than what it would see there."""
    rng = np.random.default_rng(0)
    calm = changed(pose, "heave", lambda y: -0.0053 + 1e-5 * rng.standard_normal(len(y)), "c")
    used, findings = admit(changed(calm, "heave", lambda y: np.round(y, 3)), model)
    (found,) = [f for f in findings if f.kind == "constant"]
    assert (found.channel, found.severity) == ("heave", WARNING)
    assert used.runs[2].measured.all()


def test_a_saturated_and_a_stuck_sensor(pose, model):
    limit = float(np.quantile(pose.runs[0]["roll"], 0.8))
    assert ("saturated", "roll") in kinds(look(changed(pose, "roll", lambda y: np.minimum(y, limit)), model), WARNING)

    def hang(y):
        y[100:180] = y[100]
        return y

    found = next(f for f in look(changed(pose, "surge", hang, "a"), model) if f.kind == "stuck")
    assert found.samples["a"][0] in (100, 101)


def test_a_sensor_that_is_clipped_now_and_then_is_saturated(pose, model):
    """Noise takes its readings off the end of the range again, so few are in a row; only the end repeats exactly."""
    rng = np.random.default_rng(3)
    noisy = changed(pose, "roll", lambda y: y + 3e-4 * rng.standard_normal(len(y)))
    assert ("saturated", "roll") not in kinds(look(noisy, model), WARNING)
    limit = float(np.sort(np.concatenate([run["roll"] for run in noisy.runs]))[-30])
    found = next(
        f for f in look(changed(noisy, "roll", lambda y: np.minimum(y, limit)), model) if f.kind == "saturated"
    )
    assert found.size["count"] == 30 and found.size["value"] == limit


def test_coarse_readings_raise_the_noise(pose, model):
    used, (found,) = admit(changed(pose, "heave", lambda y: np.round(y, 4)), model)
    assert (found.kind, found.size["step"]) == ("quantised", pytest.approx(1e-4))
    assert 3.5e-5 < used.noise_std["heave"] <= 4.2e-5  # 30 µm of noise and 29 µm of rounding


@pytest.mark.parametrize(
    ("factor", "severity"), [(1e3, IMPOSSIBLE), (1e-3, IMPOSSIBLE), (3.0, WARNING), (0.4, WARNING)]
)
def test_noise_that_is_not_as_stated(factor, severity, pose, model):
    stated = replace(pose, noise_std={**pose.noise_std, "sway": factor * NOISE["sway"]})
    (found,) = look(stated, model)
    assert (found.kind, found.channel, found.severity) == ("noise_differs", "sway", severity)
    assert found.size["ratio"] == pytest.approx(1 / factor, rel=0.1)


def test_pulses_of_the_drive_are_no_noise_of_an_accelerometer(model):
    """Where the log holds them; else what jumps between neighbours is noise."""
    pulsed = changed(
        measured(POSE_AND_IMU),
        "surge_acceleration",
        lambda y: y + 50.0 * np.random.default_rng(3).standard_normal(len(y)),
    )
    assert ("noise_differs", "surge_acceleration") in kinds(look(pulsed, model), IMPOSSIBLE)
    fired = Pulses(np.arange(200) * 3e-3, np.arange(200), np.full(200, 7000.0))
    logged = replace(pulsed, runs=tuple(replace(run, pulses=fired) for run in pulsed.runs))
    assert ("noise_differs", "surge_acceleration") not in kinds(look(logged, model))


def test_a_variance_given_as_standard_deviation_is_named(pose, model):
    found, *_ = impossible(look(replace(pose, noise_std={c: NOISE[c] ** 2 for c in POSE}), model))
    assert "not its square" in found.remedy


def test_gravity_in_an_accelerometer_is_named(everything, model):
    (found,) = impossible(look(changed(everything, "heave_acceleration", lambda y: y + 9.81), model))
    assert (found.kind, found.channel) == ("zero", "heave_acceleration")
    assert "subtract 9.81" in found.remedy


def test_speeds_that_nothing_has_are_another_unit_also_on_the_track(model):
    """No force tells the unit where the cradle touches throughout."""
    touching = flown([(0.0, {"surge_rate": 9.0, "heave": -0.01})], POSE, count=151, step=2e-3)
    found = impossible(look(replace(changed(touching, "surge", lambda y: 1e3 * y, "a"), noise_std={}), model))
    assert [(f.kind, f.channel) for f in found] == [("unit", "surge")]


def test_hum_and_colour(model):
    campaign = measured(count=601)
    times = campaign.runs[0].times
    (hum,) = look(changed(campaign, "roll", lambda y: y + 1.5e-4 * np.sin(2 * np.pi * 50 * times)), model)
    assert (hum.kind, hum.size["frequency"]) == ("hum", pytest.approx(50.0, abs=1.0))
    assert hum.size["amplitude"] == pytest.approx(1.5e-4, rel=0.2)
    rng, r = np.random.default_rng(2), 0.8

    def coloured(y):
        noise = np.empty(len(y))
        noise[0] = rng.standard_normal()
        for i, kick in enumerate(rng.standard_normal(len(y) - 1)):
            noise[i + 1] = r * noise[i] + np.sqrt(1 - r * r) * kick
        return y + 10 * NOISE["sway"] * noise

    spoiled = replace(changed(campaign, "sway", coloured), noise_std={**campaign.noise_std, "sway": 10 * NOISE["sway"]})
    (colour,) = [f for f in look(spoiled, model) if f.kind == "coloured_noise"]
    assert colour.size["correlation_time"] == pytest.approx(-2e-3 / np.log(r), rel=0.4)


# ---------------------------------------------------------------- what the runs can tell


def test_more_samples_than_freedom(pose, model):
    run = pose.runs[0]
    two = replace(run, times=run.times[:2], stamps=run.stamps[:2], values=run.values[:2])
    with pytest.raises(InputError, match="any model would fit"):
        admit(replace(pose, runs=(two,)), model)
    used, findings = admit(replace(pose, runs=(two, *pose.runs[1:])), model)
    assert kinds(findings) == {("too_few_samples", None)}
    assert [r.name for r in used.runs] == ["b", "c"]


def test_a_coordinate_at_rest_tells_nothing(pose, model):
    rng = np.random.default_rng(0)
    still = pose
    for c in ("sway", "roll"):
        still = changed(still, c, lambda y, c=c: NOISE[c] * rng.standard_normal(len(y)))
    (found,) = look(still, model)
    assert (found.kind, found.size["channels"]) == ("still", ["sway", "roll"])


def test_a_plant_without_magnets_has_no_room_to_leave():
    model = Model.create({"width_top": 0.0, "width_side": 0.0, "contact_stiffness": 1e3, "nominal_gap": 1.0}, dof=1)
    times = np.arange(60) / 20
    rng = np.random.default_rng(0)
    run = Run(
        "ball",
        Path("ball.csv"),
        ("heave",),
        times,
        (45 - 4.905 * times**2 + 0.01 * rng.standard_normal(60))[:, None],
        times,
        0.0,
        {"surge_rate": 0.0},
    )
    falling = Campaign("balls", Path("balls"), (run,))
    assert impossible(look(falling, model)) == ()


def test_memory_and_time_do_not_follow_a_bad_stamp(pose, model):
    run = pose.runs[0]
    times = run.times.copy()
    times[-1] = 1e15
    look(replace(pose, runs=(replace(run, times=times, stamps=times), *pose.runs[1:])), model)
    look(times_of(pose, 1e12), model)


# ---------------------------------------------------------------- the command


def write(folder: Path, campaign: Campaign) -> Path:
    folder.mkdir()
    lines = ["name: rig", "noise_std: {" + ", ".join(f"{c}: {s}" for c, s in campaign.noise_std.items()) + "}", "runs:"]
    for run in campaign.runs:
        write_csv(folder / f"{run.name}.csv", run.times, {c: run[c] for c in run.channels})
        lines.append(f"- {{file: {run.name}.csv, drive_current: {run.drive_current}}}")
    (folder / "campaign.yaml").write_text("\n".join(lines) + "\n")
    return folder


def test_check_writes_and_says_what_it_finds(pose, tmp_path, capsys):
    folder = write(tmp_path / "rig", changed(changed(pose, "roll", put((60, 0.3)), "b"), "sway", lambda y: 1e3 * y))
    assert main(["check", str(folder), "--output", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "The data cannot be meant as they are written."
    assert [line.partition(":")[0] for line in said[1:-1]] == ["cannot be so", "left out"]
    assert "b.csv, row 62," in said[2]
    written = json.loads((tmp_path / "out" / "check.json").read_text())
    assert written["verdict"] == "impossible"
    assert [(f["kind"], f["channel"]) for f in written["findings"]] == [("unit", "sway"), ("outliers", "roll")]
    assert written["channels"]["heave"]["noise"] == pytest.approx(3e-5, rel=0.1)
    assert "cannot be meant" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize("command", ["compare", "diagnose"])
def test_no_physics_is_named_where_units_are_wrong(command, pose, tmp_path, capsys):
    folder = write(tmp_path / "rig", changed(pose, "sway", lambda y: -y))
    assert main([command, str(folder), "--output", str(tmp_path / "out")]) == 2
    complaint = capsys.readouterr().err.strip()
    assert "\n" not in complaint
    assert "sensor_scale:sway or sensor_scale:roll" in complaint
    assert not (tmp_path / "out").exists()


def test_findings_stand_at_the_head_of_compare(pose, tmp_path, capsys):
    folder = write(tmp_path / "rig", changed(pose, "heave", put((60, 0.045)), "b"))
    assert main(["compare", str(folder), "--output", str(tmp_path / "out")]) == 0
    told = capsys.readouterr()
    assert told.err.startswith("left out: heave in b.csv, row 62,")
    assert told.out.startswith("The model predicts all 3 runs")
    written = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert [f["kind"] for f in written["findings"]] == ["outliers"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index("row 62") < page.index('<nav aria-label="Sections">')


def test_findings_stand_at_the_head_of_fit(pose, tmp_path, capsys):
    spoiled = changed(pose, "heave", put((60, 0.045)), "b")
    folder = write(tmp_path / "rig", replace(spoiled, runs=spoiled.runs[:2]))
    assert main(["fit", str(folder), "--free", "eta", "--output", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().err.startswith("left out: heave in b.csv, row 62,")
    assert [f["kind"] for f in json.loads((tmp_path / "out" / "fit.json").read_text())["findings"]] == ["outliers"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index("row 62") < page.index('<nav aria-label="Sections">')


def calls():
    """What holds a campaign against a model from Python, each with a function that hears the findings."""
    return {
        "compare": lambda campaign, model, hear: compare(campaign, model, hear),
        "diagnose": lambda campaign, model, hear: diagnose(campaign, model, hear=hear),
        "add": lambda campaign, model, hear: add_effect(campaign, model, "heave_damping", hear=hear),
    }


@pytest.mark.parametrize("name", ["compare", "diagnose", "add"])
def test_from_python_the_same_is_refused_and_found(name, pose, model):
    """The look is part of each call, not of the command line."""

    class Heard(Exception):
        """What was found; it ends the call before the fit."""

    def hear(findings):
        raise Heard(findings)

    with pytest.raises(InputError, match="axis of one of them is flipped"):
        calls()[name](changed(pose, "sway", lambda y: -y), model, hear)
    spoiled = changed(pose, "heave", put((60, 0.045)), "b")
    with pytest.raises(Heard) as heard:
        calls()[name](spoiled, model, hear)
    assert heard.value.args[0] == look(spoiled, model)


def test_set_aside_leaves_the_campaign_itself_alone(pose, model):
    spoiled = changed(pose, "heave", put((60, 0.045)), "b")
    set_aside(spoiled, look(spoiled, model))
    assert spoiled.runs[1]["heave"][60] == 0.045
