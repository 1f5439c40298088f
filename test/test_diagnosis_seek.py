"""Idea: the order in which sets of effects are tried, on practice campaigns and small ones of the independent simulator, with known answers."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from independent import simulator
from test_diagnosis_input import CHANNELS, NOISE

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.data.campaign import Campaign
from inductrack_ros.data.measurement import Run
from inductrack_ros.diagnosis import seek, unknown
from inductrack_ros.diagnosis.deterministic import base_fit
from inductrack_ros.diagnosis.race import Trial
from inductrack_ros.diagnosis.search import Search
from inductrack_ros.diagnosis.seek import (
    QUICK_FIRST,
    _first_effects,
    _force_of_any_shape,
    _grown,
    _one_more_explains,
    _passing,
    _two_explain,
    _varied,
    find,
)
from inductrack_ros.diagnosis.signatures import VARIABLES
from inductrack_ros.diagnosis.unknown import localised, penalised, stand_ins
from inductrack_ros.estimation.fit import fit, fit_from_scratch

PRACTICE = Path(__file__).parent / "data" / "practice"

TWO = {"track_slope__angle": 0.02, "skin_friction_drag__wetted_area": 5.0}
THREE = {"finite_pulse_width__on": 1.0, "sliding_friction__coefficient": 0.05, "skin_friction_drag__wetted_area": 5.0}


@cache
def begun(name: str) -> Search:
    return Search(*base_fit(load_campaign(PRACTICE / name), Model.default())[:2])


@cache
def grown(name: str) -> tuple[Trial, ...]:
    search = begun(name)
    return tuple(search.grow(root(search), QUICK_FIRST))


def root(search: Search) -> Trial:
    return search.trials[frozenset()]


def measured(speeds, current=0.0, **hidden) -> tuple[Run, ...]:
    """Runs of a rig with ``hidden`` fields, by the simulator that the library does not share."""
    rng, rig, times = np.random.default_rng(0), simulator.rig(**hidden), np.arange(0, 0.8, 1 / 250)
    runs = []
    for speed in speeds:
        start = np.array([0, 0, simulator.equilibrium_heave(speed, simulator.rig()), 0, speed, 0, 0, 0])
        start[1:4] += rng.uniform(-1, 1, 3) * (2e-3, 5e-4, 2e-3)
        values, _ = simulator.measure(times, start, current, rig, CHANNELS)
        values += rng.standard_normal(values.shape) * [NOISE[c] for c in CHANNELS]
        runs.append(Run(f"{speed}_{current}", Path("run.csv"), CHANNELS, times, values, times, current))
    return tuple(runs)


def searched(runs: tuple[Run, ...]) -> Search:
    return Search(*base_fit(Campaign("small", Path("small"), runs, NOISE), Model.default())[:2])


def test_what_was_found_under_more_noise_is_not_sought_again():
    """Under too large a noise the delay is found; under the true one it is refitted and passes, and nothing else is tried."""
    whole = begun("p7_sensor")
    half = whole.problem.subset(range(6))
    truly = Search(half, fit(half, whole.base.structure, whole.base.states[:6], whole.base.theta))
    blunt = half.with_sigma(half.sigma * np.array([1.1, 1.3, 1.2, 1.15]))
    search = Search(blunt, fit(blunt, truly.base.structure, truly.base.states, truly.base.theta))
    first = search.finish(search.grow(root(search), QUICK_FIRST)[0])
    assert first.names[0] in ("sensor_delay:heave", "sensor_lag:heave")  # half of the runs do not tell them apart
    said: list[str] = []
    search.tell = said.append
    again = search.under(truly.problem, truly.base)
    answer, gate = find(again, root(again), [], again.trials[frozenset(first.names)])
    assert answer.names == first.names and gate.adequate and answer.full and not said
    assert answer.fit.reduced_chi2 == pytest.approx(1.0, abs=0.05)


def test_a_point_weighted_anew_is_the_point_under_the_other_noise():
    search = begun("p7_sensor")
    other = search.problem.with_sigma(search.problem.sigma * np.array([0.5, 2.0, 0.9, 1.3]))
    weighted = search.base.weighted(other, search.problem.sigma)
    fresh = fit(other, search.base.structure, search.base.states, search.base.theta, iterations=0)
    assert weighted.chi2 == pytest.approx(fresh.chi2, rel=1e-9)
    assert weighted.covariance == pytest.approx(fresh.covariance, rel=1e-6)


def test_an_answer_that_ran_out_of_steps_is_fitted_on():
    search = Search(begun("p7_sensor").problem, begun("p7_sensor").base)
    best = search.finish(grown("p7_sensor")[0])
    away = fit(search.problem, best.fit.structure, best.fit.states, best.fit.theta + 0.5 * np.sqrt(np.diag(best.fit.covariance)), iterations=0)
    assert not away.converged and away.leaves_noise and away.chi2 > best.chi2 + 0.1
    short = Trial(away, best.names, True)
    judged, gate = search.judged(short)
    assert judged.fit.converged and gate.adequate and judged.chi2 < best.chi2 + 0.1
    assert search.trials[frozenset(best.names)].chi2 <= judged.chi2 and search.converged(judged) is judged


def test_a_set_far_behind_the_best_is_neither_refitted_nor_followed():
    search = begun("p7_sensor")
    best, *_, last = grown("p7_sensor")
    assert best.names == ("sensor_delay:heave",) and last.chi2 > 1.5 * best.chi2 and not last.full
    ranked = [best, last]
    assert _passing(search, ranked)
    assert ranked[0].full and ranked[1] is last
    assert [t.names for t in _varied(ranked)] == [best.names]


def test_one_more_known_effect_is_told_from_a_force_of_any_shape():
    """Beside one of two effects the other promises all that is left; of a patch that pulls no known effect explains nearly all."""
    two, odd = begun("p5_two"), begun("p6_odd")
    first = two.finish(grown("p5_two")[0])
    assert first.label in ("roll_damping", "track_slope") and not two.gate(first).adequate
    assert _one_more_explains(two, first)
    assert not _one_more_explains(odd, root(odd))


def test_two_known_effects_are_told_from_a_force_of_any_shape():
    """A slope and a drag are one smooth force of the speed, a patch is one of the place: known physics is asked first where two promise all of it."""
    two, odd = searched(measured([14, 28], **TWO)), begun("p6_odd")
    assert _two_explain(two, root(two))
    assert not _two_explain(odd, root(odd))


def test_an_exact_twin_is_reached_though_the_runs_touch_down():
    """More inductance is less resistance and another η: far apart, with impacts on the way that throw a refit off at once."""
    search = searched(measured([8, 14, 22], track_inductance__relative_change=0.34))
    found = Trial(fit_from_scratch(search.problem, search.base.structure.plus("track_inductance")), ("track_inductance",), True)
    assert found.fit.leaves_noise
    (twin, *_) = search.recognise(found, "track_inductance")
    assert twin.names == ("track_resistance",)
    assert twin.chi2 == pytest.approx(found.chi2, abs=1.0)
    assert twin.fit.values["track_resistance.relative_change"] == pytest.approx(1 / 1.34 - 1, abs=0.01)
    assert twin.fit.values["eta"] == pytest.approx(found.fit.values["eta"] / 1.34, rel=0.01)


def test_an_effect_at_a_share_of_its_size():
    search = begun("p7_sensor")
    structure = search.base.structure.plus("cg_offset", {"offset": 0.002}).plus("track_inductance", {"relative_change": 0.4})
    at = fit(search.problem, structure, search.base.states, iterations=0)
    half = structure.decode(at.weakened("track_inductance", 0.5))
    assert half == pytest.approx(at.values | {"track_inductance.relative_change": 0.2})
    assert np.array_equal(at.weakened("track_inductance", 1.0), at.theta)


@pytest.mark.parametrize("hidden", [TWO, THREE])
def test_known_effects_are_recognised_in_a_force_of_any_shape(hidden):
    """Drags, a slope and a weaker drive are one smooth force, to within little: what it does to the measurements says which they are."""
    search = searched(measured([14, 28], **hidden) + measured([10, 20], 3000.0, **hidden))
    force = next(t for t in stand_ins(search, root(search)) if t.names == ("stand_in_surge",))
    found = search.recognise_together(force, "stand_in_surge", len(hidden))
    known = min(found, key=lambda t: penalised(search, t))
    assert set(known.names) == {field.partition("__")[0] for field in hidden}
    assert known.chi2 < force.chi2 + 25 and penalised(search, known) < penalised(search, force)
    assert known.fit.values["skin_friction_drag.wetted_area"] == pytest.approx(5.0, abs=0.5)
    if hidden is TWO:
        assert known.fit.values["track_slope.angle"] == pytest.approx(0.02, abs=0.002)


@pytest.mark.parametrize("wind", [0.0, 0.05])
def test_a_force_at_one_place_is_none_elsewhere_and_what_is_everywhere_is_known(wind):
    """A rail bent at 9 m, with a wind or without: the table says nothing but the bend, and the wind is named."""
    runs = measured([12, 20, 30], crosswind__force=wind, sway_patch__force=0.2, sway_patch__place=9.0, sway_patch__width=0.3)
    search = searched(runs)
    force = stand_ins(search, root(search))[0]
    assert force.names == ("stand_in_sway",) and ("stand_in_sway" in force.fit.structure.local) == (not wind)
    local = localised(search, force, beside=True) if wind else force
    assert local.names == (("crosswind", "stand_in_sway") if wind else ("stand_in_sway",)) and search.gate(local).adequate
    found = local.fit.model.effects["stand_in_sway"]
    assert found["values"][0] == pytest.approx(0.0, abs=1e-3) == found["values"][int(found["knots"]) - 1]
    assert penalised(search, local) <= penalised(search, force)
    if wind:
        assert local.fit.values["crosswind.force"] == pytest.approx(wind, abs=4 * local.fit.deviations["crosswind.force"])


def test_a_force_at_one_place_found_late_is_told_from_one_everywhere(monkeypatch):
    """Found beside another effect it was laid over the whole track: what is chosen is the simplest, and known to the search under another noise."""
    search = searched(measured([12, 20, 30], sway_patch__force=0.2, sway_patch__place=9.0, sway_patch__width=0.3))
    with monkeypatch.context() as patch:
        patch.setattr(unknown, "localised", lambda *_: None)
        wide = stand_ins(search, root(search))[0]
    assert search.gate(wide).adequate and not wide.fit.structure.local
    chosen, gate = find(search, root(search), [], wide)
    assert chosen.names == ("stand_in_sway",) and chosen.fit.structure.local == {"stand_in_sway"} and gate.adequate
    again = search.under(search.problem.with_sigma(0.9 * search.problem.sigma), search.base)
    assert again.trials[frozenset(chosen.names)].fit.structure == chosen.fit.structure


def test_what_comes_late_does_not_hide_a_known_effect(monkeypatch):
    """A drag acts from the start, a stretch that brakes only at 9 m, but far more: over whole runs nothing looks like the drag any more."""
    hidden = {"skin_friction_drag__wetted_area": 2.0, "surge_patch__force": 20.0, "surge_patch__place": 9.0, "surge_patch__width": 0.6}
    search = searched(measured([14, 24], **hidden) + measured([20], 3000.0, **hidden))
    singles = _grown(search, root(search), QUICK_FIRST)
    first = _first_effects(search, root(search), singles)
    assert not {"skin_friction_drag", "aerodynamic_drag"} & set(singles[0].names)
    assert first[0] is singles[0] and {"skin_friction_drag", "aerodynamic_drag"} & set(first[1].names)
    monkeypatch.setattr(seek, "stand_ins", lambda search, trial: stand_ins(search, trial) if trial is first[1] else [])
    tried: list[Trial] = []
    found, gate = _force_of_any_shape(search, root(search), first, tried)
    assert gate.adequate and not tried and found.names == (*first[1].names, "stand_in_surge")
    assert VARIABLES[int(found.fit.model.effects["stand_in_surge"]["variable"])] == "surge"


def test_a_known_effect_is_looked_for_beside_a_force_that_takes_off_nearly_all():
    """However far from noise what it leaves is: what a strong shaking hides, a drive that is too weak, is by itself far above it."""
    hidden = {"heave_shake__force": 10.0, "heave_shake__frequency": 8.0, "finite_pulse_width__on": 1.0}
    search = searched(measured([18], **hidden) + measured([16, 22], 7000.0, **hidden))
    tried: list[Trial] = []
    found, gate = _force_of_any_shape(search, root(search), [], tried)
    assert gate.adequate and set(found.names) == {"stand_in_heave", "finite_pulse_width"}
    assert [t.names for t in tried] == [("stand_in_heave",)] and tried[0].chi2 > 10 * tried[0].fit.samples
