# SPDX-License-Identifier: Apache-2.0
"""A sweep's numbers are those of single runs, and of algebra where there is any; what draws make of them is what the
covariance says."""

import json

import numpy as np
import pytest

from inductrack_ros.core.model import Model
from inductrack_ros.core.uncertainty import Uncertainty
from inductrack_ros.sweep.axes import read_axes
from inductrack_ros.sweep.draws import draw
from inductrack_ros.sweep.netcdf import dataset, write
from inductrack_ros.sweep.quantities import GROWTH, NAMES, QUANTITIES
from inductrack_ros.sweep.starts import on_equilibrium
from inductrack_ros.sweep.sweep import Plan, sweep


def plan(model, over, initial, **more):
    model, axes = read_axes(over, model)
    return Plan(model, axes, initial, **more)


def alone(model, times, **initial):
    """The quantities of one run, written again from their meaning, with `Model.simulate`."""
    run = model.simulate(times, model.initial_state(**initial))
    gap = np.min([run["gap_top"], run["gap_right"], run["gap_left"]], axis=0)
    late = slice(len(times) // 2, None)
    found = {
        "first_contact": times[np.argmax(gap < 0)] if (gap < 0).any() else np.nan,
        "smallest_gap": gap.min(),
        "hover_gap": np.nan if (gap[late] < 0).any() else run["gap_top"][late].mean(),
        "travel": run["surge"][-1] - run["surge"][0],
        "final_speed": run["surge_rate"][-1],
        "peak_speed": run["surge_rate"].max(),
        "peak_roll": np.abs(run["roll"]).max(),
        "peak_sway": np.abs(run["sway"]).max(),
    }
    third, growth = len(times) // 3, []
    for channel, still in (("gap_top", 2e-5), ("sway", 2e-5), ("roll", 2e-4)):
        ends = []
        for part in (slice(0, third), slice(len(times) - third, None)):
            t, y = times[part], run[channel][part]
            ends.append(np.std(y - np.polyval(np.polyfit(t, y, 1), t)) + still)
        growth.append(ends[1] / ends[0])
    found["swing_growth"] = max(growth)
    found["stable"] = float(gap.min() >= 0 and max(growth) <= GROWTH)
    return found


@pytest.mark.parametrize("effects", [(), ("viscous_drag", "coil_current_dynamics")])
def test_a_point_is_the_run_that_simulate_gives(effects):
    p = plan(
        Model.create(effects=effects), ["surge_rate=14:30:4", "drive_current=0,7000"], {"sway": 0.002}, duration=1.5
    )
    found = sweep(p)
    assert found.values["stable"].shape == (4, 2)
    touching = np.isfinite(found.values["first_contact"])
    assert touching.any() and not touching.all()
    for i, speed in enumerate(p.axes[0].values):
        for k, current in enumerate(p.axes[1].values):
            wanted = alone(p.model.with_changes({"drive_current": current}), p.times, surge_rate=speed, sway=0.002)
            got = {n: found.values[n][i, k] for n in NAMES}
            assert got == pytest.approx(wanted, rel=1e-6, abs=1e-9, nan_ok=True), (speed, current)


def test_lanes_give_the_same_as_few_runs():
    """Above `MANY` runs fly side by side."""
    many = sweep(plan(Model.default(), ["surge_rate=18:30:520"], {}, duration=0.5))
    few = sweep(
        plan(
            Model.default(),
            [f"surge_rate={','.join(repr(float(v)) for v in many.plan.axes[0].values[::173])}"],
            {},
            duration=0.5,
        )
    )
    for name in NAMES:
        assert many.values[name][::173] == pytest.approx(few.values[name], rel=1e-7, abs=1e-9, nan_ok=True), name


@pytest.mark.parametrize("effects", [(), ("aerodynamic_lift",), ("coil_current_dynamics",)])
def test_every_start_is_the_equilibrium_of_the_model(effects):
    model = Model.create(effects=effects)
    speeds = np.array([0.0, 3.0, 11.0, 15.5, 40.0])
    states = np.zeros((5, 8))
    states[:, 4] = speeds
    found = on_equilibrium(model, states, np.tile(model.vector, (5, 1)))[:, 2]
    assert found == pytest.approx([model.equilibrium_heave(v) for v in speeds], rel=1e-12, abs=1e-15)
    assert states[:, 2].tolist() == [0.0] * 5  # what was given stays as it was


def test_no_equilibrium_is_no_run_and_the_others_are_flown():
    """Without a track to lie on nothing carries a slow cradle."""
    found = sweep(plan(Model.default().with_changes({"contact_stiffness": 0.0}), ["surge_rate=5,20"], {}, duration=0.2))
    assert np.isnan([found.values[n][0] for n in NAMES]).all() and found.unflown == 1
    assert found.values["stable"][1] == 1.0


def test_the_hover_gap_is_that_of_the_papers_equations():
    """Heave alone, at a held speed: (6), (36) and m g give the gap in closed form, for the sides' arrays pull down what
    they lift the top's."""
    model = Model.create({"contact_stiffness": 0.0, "contact_damping": 0.0}, dof=1)
    found = sweep(plan(model, ["surge_rate=12:40:15"], {}, duration=0.5))
    p, k = model.parameters, 2 * np.pi / model.parameters["wavelength"]
    for speed, gap in zip(found.plan.axes[0].values, found.values["hover_gap"], strict=True):
        x = k * speed * p["inductance"] / p["resistance"]
        per_overlap = (
            p["coils_per_wavelength"]
            * p["peak_field"]
            * p["eta"]
            * p["peak_field"]
            / k
            / p["inductance"]
            * x**2
            / (1 + x**2)
        )
        heave = gap - p["nominal_gap"]
        top = p["width_top"] * np.exp(-k * gap)
        side = p["width_side"] * np.exp(-k * (p["nominal_gap"] - np.sqrt(0.5) * heave))
        lift = per_overlap * (top + 2 * side) * (top - 2 * np.sqrt(0.5) * side)
        assert lift == pytest.approx(p["mass"] * p["gravity"], rel=1e-9)


def test_drag_takes_its_speed_by_the_textbooks_law():
    """No magnets, nothing but air: v = v0 / (1 + v0 ρ A t / 2m)."""
    model = Model.create({"peak_field": 0.0, "gravity": 0.0}, dof=2)
    found = sweep(
        plan(model, ["aerodynamic_drag.drag_area=0.1:0.4:4"], {"surge_rate": 30.0, "heave": 0.0}, duration=2.0)
    )
    p = model.parameters
    rate = 30.0 * p["air_density"] * found.plan.axes[0].values / (2 * p["mass"])
    assert found.values["final_speed"] == pytest.approx(30.0 / (1 + 2.0 * rate), rel=1e-7)
    assert found.values["travel"] == pytest.approx(30.0 / rate * np.log1p(2.0 * rate), rel=1e-7)


# ---------------------------------------------------------------- draws


def known(**std):
    names = tuple(std)
    size = np.array(list(std.values()))
    correlation = np.full((len(names),) * 2, 0.6) + 0.4 * np.eye(len(names))
    return Uncertainty(names, correlation * np.outer(size, size))


def test_the_spread_is_the_covariances_linear_prediction():
    model, small = Model.default(), known(eta=2e-4, mass=3e-3)
    moved, axes = read_axes(["surge_rate=18,26"], model)
    p = Plan(moved, axes, {}, 0.5, 200.0, draw(small, moved, ["surge_rate"], 400, 1))
    found = sweep(p)
    for name in ("hover_gap", "travel", "final_speed"):
        slopes = []
        for parameter, std in small.std.items():
            ends = [
                sweep(
                    Plan(moved.with_changes({parameter: moved.parameters[parameter] + s * std}), axes, {}, 0.5, 200.0)
                ).values[name]
                for s in (1, -1)
            ]
            slopes.append((ends[0] - ends[1]) / (2 * std))
        by_rule = np.sqrt(np.einsum("pi,pq,qi->i", slopes, small.covariance, slopes))
        by_draws = np.sqrt(np.einsum("pi,pq,qi->i", slopes, np.cov(p.draws.values.T), slopes))
        assert found.spread.std[name] == pytest.approx(by_draws, rel=0.02), name  # these very draws
        assert by_draws == pytest.approx(by_rule, rel=0.15)  # 400 of them: 3.5 % a standard deviation
        assert (found.spread.low[name] < found.values[name]).all() and (
            found.values[name] < found.spread.high[name]
        ).all()


def test_draws_have_the_covariance_and_stay_in_range():
    wide = known(eta=0.05, contact_damping=4000.0)
    d = draw(wide, Model.default(), [], 20000, 3)
    assert d.names == ("eta", "contact_damping") and d.values[:, 1].min() >= 0.0 and 0.05 < d.again < 0.15
    d = draw(known(eta=0.01, gamma=0.1), Model.default(), [], 20000, 3)
    assert np.cov(d.values.T) == pytest.approx(known(eta=0.01, gamma=0.1).covariance, rel=0.05)
    assert np.array_equal(d.values, draw(known(eta=0.01, gamma=0.1), Model.default(), [], 20000, 3).values)
    assert draw(known(eta=0.01, gamma=0.1), Model.default(), ["gamma"], 5, 3).names == ("eta",)


def test_parts_of_the_draws_that_touch_lie_between_none_and_all_at_the_edge():
    model, axes = read_axes(["surge_rate=14,16.2,30"], Model.default())
    found = sweep(Plan(model, axes, {}, 1.5, 200.0, draw(known(gamma=0.3), model, [], 40, 0)))
    touching = found.spread.touching
    assert touching[0] == 1.0 and touching[2] == 0.0 and 0.0 <= touching[1] <= 1.0
    assert found.spread.stable[2] == 1.0 and found.spread.stable[0] == 0.0


# ---------------------------------------------------------------- NetCDF


def test_the_numbers_come_back_from_the_file(tmp_path):
    xarray = pytest.importorskip("xarray")
    model, axes = read_axes(["viscous_drag.coefficient=0,1", "surge_rate=14:30:5"], Model.default())
    found = sweep(Plan(model, axes, {"sway": 0.001}, 0.5, 100.0, draw(known(eta=1e-3), model, [], 3, 0)))
    write(found, (), tmp_path / "sweep.nc")
    with xarray.open_dataset(tmp_path / "sweep.nc") as back:
        for q in QUANTITIES:
            assert np.array_equal(back[q.name].values, found.values[q.name], equal_nan=True)
            assert back[q.name].attrs["units"] == (q.unit or "1")
            assert np.array_equal(back[f"{q.name}_p95"].values, found.spread.high[q.name], equal_nan=True)
        assert back.smallest_gap.dims == ("viscous_drag.coefficient", "surge_rate")
        assert np.array_equal(back["surge_rate"].values, axes[1].values)
        assert json.loads(back.attrs["model"])["effects"] == ["viscous_drag"]
        assert back.identical(dataset(found)) or set(back.variables) == set(dataset(found).variables)
