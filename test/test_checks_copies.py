# SPDX-License-Identifier: Apache-2.0
"""The look at the data: what stands twice in a campaign, and what a sensor's raw counts and wraps are told by."""

from dataclasses import replace

import numpy as np
import pytest
from test_checks import NOISE, POSE, changed, flown, measured

from inductrack_ros.checks import IMPOSSIBLE, SET_ASIDE, admit, impossible, look


def with_channel(campaign, name, channel, values):
    return changed(campaign, channel, lambda y: values(y), name)


def with_run(campaign, run, name, **changes):
    file = run.file.with_name(f"{name}.csv")
    return replace(campaign, runs=(*campaign.runs, replace(run, name=name, file=file, **changes)))


# ---------------------------------------------------------------- channels of another run


@pytest.mark.parametrize("channel", POSE)
@pytest.mark.parametrize(
    "copied",
    [lambda y: y, lambda y: np.round(y, 6), lambda y: 1e3 * y + 2.0, lambda y: np.concatenate([y[7:], y[-7:] + 1e-3])],
    ids=["as it is", "rounded", "in mm from another zero", "shifted"],
)
def test_a_channel_of_another_run_is_named(channel, copied, pose, model):
    other = pose.runs[2][channel]
    found = impossible(look(changed(pose, channel, lambda y: copied(other), "a"), model))
    named = [f for f in found if f.kind == "copied"]
    assert [(f.channel, f.run, f.size["of_run"]) for f in named] == [(channel, "c", "a")]
    assert f"{channel} in c.csv is that of a.csv, reading for reading" in named[0].text


def test_a_channel_of_its_neighbour_is_named(pose, model):
    everything = measured((*POSE, "gap_right", "gap_left"))
    left = everything.runs[1]["gap_left"]
    found = impossible(look(changed(everything, "gap_right", lambda y: left, "b"), model))
    assert ("copied", "b", ["gap_right", "gap_left"]) in [(f.kind, f.run, f.size.get("channels")) for f in found]


# ---------------------------------------------------------------- whole runs


@pytest.mark.parametrize(
    "rows", [slice(None), slice(0, None, 2), slice(40, 260)], ids=["all", "every second row", "cut at both ends"]
)
def test_a_run_that_stands_twice_counts_once(rows, pose, model):
    run = pose.runs[1]
    times = run.times[rows] - run.times[rows][0]
    again = with_run(pose, run, "again", times=times, stamps=times + 1.7e9, values=run.values[rows])
    used, findings = admit(again, model)
    (found,) = [f for f in findings if f.kind == "copied"]
    assert (found.severity, found.run) == (SET_ASIDE, "again") and "the same samples as b.csv" in found.text
    assert [r.name for r in used.runs] == ["a", "b", "c"]


def test_a_run_that_stands_twice_in_other_digits_counts_once(pose, model):
    again = with_run(pose, pose.runs[1], "again", values=np.round(pose.runs[1].values, 6))
    used, _ = admit(again, model)
    assert [r.name for r in used.runs] == ["a", "b", "c"]


def test_the_same_samples_under_two_currents_cannot_be(pose, model):
    found = impossible(look(with_run(pose, pose.runs[1], "again", drive_current=3000.0), model))
    assert [f.kind for f in found][0] == "copied" and "two other drive_current" in found[0].text


def test_what_a_ring_buffer_hands_on_counts_once(model):
    """A recorder that keeps what was before the trigger begins a run with the end of the one before."""
    long = flown([(7000.0, {"surge_rate": 17.0, "sway": 3e-3, "heave": -5e-3})], POSE, 500, 2e-3)
    (run,) = long.runs
    first = replace(run, times=run.times[:300], stamps=run.stamps[:300], values=run.values[:300])
    start = run.times[200:] - run.times[200]
    overlap = with_run(replace(long, runs=(first,)), run, "b", times=start, stamps=start, values=run.values[200:])
    used, findings = admit(overlap, model)
    (found,) = [f for f in findings if f.kind == "copied"]
    assert found.samples == {"b": tuple(range(100))} and len(used.runs[1].times) == 200


# ---------------------------------------------------------------- what is no copy


def test_runs_with_the_same_noise_are_no_copies(model):
    """A simulator's seed gives each run the same noise; their motion differs. Sway and roll are at rest."""
    starts = [{"surge_rate": v, "heave": model.equilibrium_heave(v) + 5e-4} for v in (17.0, 17.5, 18.0)]
    runs = [flown([(7000.0, start)], POSE, 301, 2e-3, seed=4).runs[0] for start in starts]
    named = [replace(run, name=n, file=run.file.with_name(f"{n}.csv")) for n, run in zip("abc", runs, strict=True)]
    campaign = replace(flown([(7000.0, starts[0])], POSE, 301, 2e-3), runs=tuple(named))
    assert not [f for f in look(campaign, model) if f.kind == "copied"]


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_runs_flown_alike_are_no_copies(noise, model):
    """With and without noise, read in coarse digits, with a hum of one phase."""
    start = {"surge_rate": 17.0, "sway": 3e-3, "heave": model.equilibrium_heave(17.0)}
    alike = [{**start, "surge_rate": 17.0 + 0.01 * k} for k in range(4)]
    flight = flown([(7000.0, s) for s in alike], POSE, 301, 2e-3)
    if not noise:
        clean = [model.simulate(flight.runs[0].times, model.initial_state(**s), 7000.0) for s in alike]
        flight = replace(
            flight,
            runs=tuple(
                replace(r, values=np.column_stack([c[n] for n in POSE]))
                for r, c in zip(flight.runs, clean, strict=True)
            ),
        )
    hum = 20 * NOISE["heave"] * np.sin(2 * np.pi * 50.0 * flight.runs[0].times)
    for campaign in (flight, changed(flight, "heave", lambda y: y + noise * hum, "abcd")):
        for digits in (9, 4, 3):
            coarse = replace(campaign, runs=tuple(replace(r, values=np.round(r.values, digits)) for r in campaign.runs))
            assert not [f for f in look(coarse, model) if f.kind == "copied"]


# ---------------------------------------------------------------- counts


@pytest.mark.parametrize(
    ("channel", "count"),
    [
        ("heave", lambda y: np.round((y + 0.02) / 0.04 * 4095)),
        ("sway", lambda y: np.round(y / 0.02 * 2**23)),
        ("roll", lambda y: np.round((y + 0.3) / 0.6 * 1023)),
        ("surge", lambda y: np.round(8192.0 * y)),
    ],
    ids=["12 bits", "24 bits", "10 bits", "an encoder"],
)
def test_raw_counts_are_not_called_a_unit(channel, count, pose, model):
    raw = replace(changed(pose, channel, count), noise_std={})
    found = [f for f in impossible(look(raw, model)) if f.channel == channel]
    assert found and "raw counts" in found[0].remedy and "seems to be in" not in found[0].line


def test_whole_micrometres_are_a_unit(pose, model):
    found = impossible(look(replace(changed(pose, "heave", lambda y: np.round(1e6 * y)), noise_std={}), model))
    assert "it seems to be in µm" in found[0].remedy


def test_a_converter_that_wraps_is_named(pose, model):
    found = impossible(look(changed(pose, "sway", lambda y: np.mod(y, 0.0655)), model))
    assert (found[0].kind, found[0].severity) == ("value_jump", IMPOSSIBLE)
    assert "counter or converter that wraps at 65" in found[0].remedy
