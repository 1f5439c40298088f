# SPDX-License-Identifier: Apache-2.0
"""The one place where measurements come out of states: `core.sensors`, whole runs and tick by tick."""

import math

import numpy as np
import pytest

from inductrack_ros.core.effects import catalogue
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.rig import SENSORS, Rig
from inductrack_ros.core.sensors import Sensors, counts_from_start
from inductrack_ros.core.state import INDEX, OUTPUTS

#: Every effect of a sensor at a size that shows, and the value at which it vanishes.
SIZES = {
    "sensor_bias": {"bias": 2e-3},
    "sensor_scale": {"scale": 1.2},
    "sensor_delay": {"delay": 3.3e-3},
    "sensor_lag": {"time_constant": 4e-3},
    "sensor_drift": {"rate": 1e-3},
    "sensor_clock": {"rate": -2e-3},
    "sensor_saturation": {"limit": 5e-3},
    "sensor_misalignment": {"angle": 0.03},
}


@pytest.fixture(scope="module")
def run():
    """A swaying run at irregular times."""
    model = Model.default()
    steps = np.random.default_rng(5).uniform(2e-4, 2.5e-3, 500)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    return model.simulate(times, model.initial_state(surge_rate=17.0, sway=1e-3, heave=-4e-3, roll=5e-3))


def full(name, channel="heave"):
    return f"{name}:{channel}" if catalogue()[name].of_channel else name


def read(run, effects, channel="heave", **given):
    sensors = Sensors.of(Model.create(effects=effects))
    return sensors.read(channel, run.times, run.times, run.outputs[None], **given)[0]


def between(run, channel, at):
    """The run at other times, by simulating it to them."""
    model = Model.default()
    times = np.union1d(run.times, at)
    fine = model.simulate(times, model.initial_state(surge_rate=17.0, sway=1e-3, heave=-4e-3, roll=5e-3))
    return fine[channel][np.searchsorted(times, at)]


# ---- formulas and signs --------------------------------------------------------------------------------------------


def test_what_each_effect_does(run):
    """measured = true + bias, scale·true, true + rate·t, true clipped to ±limit; sway′ and heave′ as a turned sensor
    reads them."""
    t, heave, sway = run.times, run["heave"], run["sway"]
    assert read(run, {"sensor_bias:heave": {"bias": 2e-3}}) == pytest.approx(heave + 2e-3)
    assert read(run, {"sensor_scale:heave": {"scale": 1.2}}) == pytest.approx(1.2 * heave)
    assert read(run, {"sensor_drift:heave": {"rate": -4e-3}}) == pytest.approx(heave - 4e-3 * t)
    clipped = read(run, {"sensor_saturation:heave": {"limit": 5e-3}})
    assert clipped == pytest.approx(np.clip(heave, -5e-3, 5e-3)) and (clipped == -5e-3).any()
    turned = {"sensor_misalignment": {"angle": 0.03}}
    c, s = math.cos(0.03), math.sin(0.03)
    for suffix in ("", "_rate"):
        sway, heave = run[f"sway{suffix}"], run[f"heave{suffix}"]
        assert read(run, turned, f"sway{suffix}") == pytest.approx(sway * c + heave * s)
        assert read(run, turned, f"heave{suffix}") == pytest.approx(heave * c - sway * s)
    assert (read(run, turned, "roll") == run["roll"]).all()


@pytest.mark.parametrize("channel", ["surge", "heave", "sway_rate", "gap_left"])
def test_when_a_late_sensor_and_a_wrong_clock_look(run, channel):
    """measured(t) = true(t − δ) and true((1 + ε)t), between irregular samples; before and after the run nobody
    knows."""
    for effects, looks_at in (
        ({f"sensor_delay:{channel}": {"delay": 3.3e-3}}, run.times - 3.3e-3),
        ({f"sensor_clock:{channel}": {"rate": 4e-3}}, 1.004 * run.times),
        ({f"sensor_clock:{channel}": {"rate": -4e-3}}, 0.996 * run.times),
    ):
        values = read(run, effects, channel)
        inside = (looks_at >= 0) & (looks_at <= run.times[-1])
        assert np.isnan(values[~inside]).all() and inside.sum() > 450
        inside &= looks_at >= run.times[1]  # a gap is a straight line before it
        truth = between(run, channel, looks_at[inside])
        assert np.abs(values[inside] - truth).max() < (1e-4 if channel == "gap_left" else 2e-5) * np.ptp(truth)
    assert read(run, {f"sensor_delay:{channel}": {"delay": 3.3e-3}}, channel, held=True)[0] == run[channel][0]


@pytest.mark.parametrize("tau", [1e-8, 3e-4, 4e-3, 0.2, 1.0])
def test_a_lag_is_exact_at_irregular_samples(tau):
    """τ ṙ = u − r with u = 1 + 2t + 3t², settled at the start, in closed form."""
    t = np.concatenate([[0.0], np.cumsum(np.random.default_rng(1).uniform(1e-5, 2e-2, 200))])
    table = np.zeros((1, len(t), len(OUTPUTS)))
    table[0, :, INDEX["heave"]], table[0, :, INDEX["heave_rate"]] = 1.0 + 2.0 * t + 3.0 * t**2, 2.0 + 6.0 * t
    sensors = Sensors.of(Model.create(effects={"sensor_lag:heave": {"time_constant": tau}}))
    values = sensors.read("heave", t, t, table)[0]
    drawn = 1.0 - 2.0 * tau + 6.0 * tau**2 + (2.0 - 6.0 * tau) * t + 3.0 * t**2  # the particular solution
    expected = drawn + (1.0 - (1.0 - 2.0 * tau + 6.0 * tau**2)) * np.exp(-t / tau)
    assert np.abs(values - expected).max() < 1e-9 * max(1.0, tau**2)


def test_a_lag_and_a_delay_that_are_small_are_twins(run):
    """To first order in τ = δ, once the start is forgotten: why a diagnosis names both."""
    late = read(run, {"sensor_delay:heave": {"delay": 3e-4}}) - run["heave"]
    slow = read(run, {"sensor_lag:heave": {"time_constant": 3e-4}}) - run["heave"]
    later = run.times > 0.01
    assert np.abs(late - slow)[later].max() < 0.03 * np.abs(late)[later].max()


@pytest.mark.parametrize("name", SIZES)
def test_every_effect_vanishes(name, run):
    """At its default and, to first order, towards it; at the size of the other tests it shows."""
    item = catalogue()[name]
    (parameter, declared), (value,) = *item.parameters.items(), SIZES[name].values()
    assert np.nanmax(np.abs(read(run, {full(name): {}}) - run["heave"])) < 1e-15

    def difference(value):
        return np.nanmax(np.abs(read(run, {full(name): {parameter: value}}, held=True) - run["heave"]))

    assert difference(value) > 1e-5
    if math.isfinite(declared.default):
        whole, part = (difference(declared.default + share * (value - declared.default)) for share in (1e-2, 1e-4))
        assert part == pytest.approx(1e-2 * whole, rel=0.1)
    else:
        assert difference(1.0) == 0.0  # m, further than any heave


def test_several_effects_on_a_channel_apply_in_their_order(run):
    effects = {
        "sensor_bias:heave": {"bias": 1e-3},
        "sensor_lag:heave": {"time_constant": 4e-3},
        "sensor_scale:heave": {"scale": 2.0},
    }
    lagged = read(run, {"sensor_lag:heave": {"time_constant": 4e-3}})
    assert read(run, effects) == pytest.approx(2.0 * (lagged + 1e-3), abs=1e-9)
    assert read(run, dict(reversed(effects.items()))) == pytest.approx(2.0 * lagged + 1e-3, abs=1e-9)


def test_what_cannot_be_simulated_in_pieces_is_known():
    """A comparison starts windows of a run afresh only where that gives the same readings."""
    pieces = {name: not counts_from_start(Model.create(effects={full(name): values})) for name, values in SIZES.items()}
    assert {n for n, whole in pieces.items() if not whole} == {"sensor_lag", "sensor_drift", "sensor_clock"}
    assert counts_from_start(Model.create(effects=["magnet_warming"])) and not counts_from_start(
        Model.create(effects=["viscous_drag"])
    )


# ---- tick by tick --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*SIZES, "all"])
def test_a_node_measures_what_a_whole_run_gives(name):
    """The same samples, noise and dropouts included; a clock that is fast delivers when what it reads has come true."""
    model = Model.default()
    times = np.arange(401) / 400.0
    run = model.simulate(times, model.initial_state(surge_rate=17.0, sway=1e-3))
    sizes = {**SIZES, "sensor_clock": {"rate": 3e-2}}
    model = Model.create(effects={full(n): v for n, v in sizes.items() if name in (n, "all")})
    values = {
        "measured.gap_top.rate": 70.0,
        "measured.pose.dropout": 0.1,
        "measured.heave.delay": 2e-3,
        "measured.sway.bias": 1e-4,
    }
    ticks, whole = Rig(values, model, 3), Rig(values, model, 3)
    samples: dict[str, list] = {s: [] for s in SENSORS}
    for t, row in zip(times, run.outputs, strict=True):
        for sample in ticks.step(t, row, 1 / 400):
            samples[sample.sensor].append(sample)
            assert sample.time <= t
    record = whole.record(times, run.outputs, 1 / 400)
    assert set(record) == {sensor for sensor, taken in samples.items() if taken}  # others are off unless a rig has them
    for sensor, channels in SENSORS.items():
        taken = samples[sensor]
        if not taken:
            continue
        assert [s.time for s in taken] == record[sensor].times.tolist()
        rows = np.array([[s.reading[c] for c in channels] for s in taken])
        assert np.abs(rows - record[sensor].readings).max() < 1e-9
    assert len(samples["gap_top"]) in (70, 71) and 330 < len(samples["pose"]) < 390


def test_a_node_forgets_what_no_sensor_looks_at():
    model = Model.create(effects={"sensor_lag:heave": {"time_constant": 4e-3}, "sensor_clock:sway": {"rate": -1e-3}})
    rig = Rig({"measured.heave.delay": 2e-3}, model, 0)
    row = np.zeros(len(OUTPUTS))
    for k in range(5000):
        rig.step(k / 500, row, 1 / 500)
    assert len(rig._times) <= 512  # a hundredth of a second late after ten


# ---- what may be asked for -----------------------------------------------------------------------------------------

HEAD = (
    "from inductrack_ros.core.effects import Parameter, effect\n\nP = {'size': Parameter(0.0, '', -1.0, 1.0, 'size',"
    " typical=1e-3)}\n\n\n"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "@effect(changes='measured', parameters=P)\ndef crooked(measured, temperatur, size):\n    return measured",
            "asks for 'temperatur', which a sensor does not know",
        ),
        (
            (
                "@effect(changes='sample_time', parameters=P)\ndef crooked(sample_time, heave, size):\n    return"
                " sample_time"
            ),
            "asks for 'heave'",
        ),
        (
            (
                "@effect(changes='measured', parameters=P, states={'r': 'lift'})\ndef crooked(measured, r, size):\n   "
                " return r, size"
            ),
            "starts on 'lift', which is not there",
        ),
        (
            (
                "@effect(changes='sample_time', parameters=P, states={'r': 'measured'})\ndef crooked(sample_time, r,"
                " size):\n    return r, size"
            ),
            "may carry states",
        ),
        (
            (
                "@effect(changes=('measured_sway', 'measured'), parameters=P)\ndef crooked(measured_sway, measured,"
                " size):\n    return 1.0, 2.0"
            ),
            "and nothing else",
        ),
        (
            "@effect(changes='measured', parameters=P)\ndef crooked(measured, size):\n    return measured, size",
            "returns 2 values",
        ),
    ],
)
def test_what_a_sensor_cannot_do_is_told(tmp_path, run, text, message):
    file = tmp_path / "crooked.py"
    file.write_text(HEAD + text + "\n")
    with pytest.raises(InputError, match=message):
        Sensors.of(Model.create(effects=["crooked:heave"], effect_files=[file])).read(
            "heave", run.times, run.times, run.outputs[None]
        )
