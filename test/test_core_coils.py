# SPDX-License-Identifier: Apache-2.0
"""``track: coils``: forces from the currents of single coils.

Idea: nothing here is compared with the time stepping itself. Averages must be (36), (38), the paper's (6), (7) times
the number of coils, where arrays are long and coils many; those of short arrays a sum over their spectrum; energy must
balance; forces must be derivatives of the flux; a row of coupled coils must be one of another inductance.
"""

import time

import numpy as np
import pytest
import yaml

from inductrack_ros.core.coils.averages import heave_motion
from inductrack_ros.core.coils.field import field_table, flux_per_width
from inductrack_ros.core.coils.track import Coils
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.options import COIL_OPTIONS
from inductrack_ros.paper.stability import corner_speed, modes

BEHIND = -50.0  # m: no coil there has a number, so none is damaged
LONG = {"array_wavelengths": 40.0, "array_spacing": 4.0}  # front and rear set abut: 80 wavelengths without an end
FORCES = ("repulsion_top", "repulsion_right", "repulsion_left", "magnetic_drag")
C = np.sqrt(0.5)


def made(parameters=None, effects=(), **coil_options):
    return Model.create(parameters, effects, track="coils", coil_options=coil_options)


def quantities(model, speed, heave):
    """The kernel's quantities of level flight."""
    x = np.zeros(len(model._kernel.states))
    x[2], x[4] = heave, speed
    return model._evaluate(0.0, x, model.vector, model.switches)[1]


def mean_forces(model, speed, heave, surge=BEHIND):
    return model.coils.mean_forces(surge, speed, quantities(model, speed, heave))


def averaged_forces(speed, heave, parameters=None):
    q = Model.create(parameters).quantities(np.array([0, 0, heave, 0, speed, 0, 0, 0.0]))
    return np.array([q[name] for name in FORCES])


# -- limits -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [5.0, 13.0, 20.0, 40.0])
def test_many_coils_under_long_arrays_give_the_averaged_law(speed):
    coils = {"coils_per_wavelength": 26.0}
    ratio = mean_forces(made(coils, **LONG), speed, -0.0045) / averaged_forces(speed, -0.0045, coils) / 40.0
    assert ratio == pytest.approx(1.0, abs=0.01)


def test_what_is_left_to_the_averaged_law_is_the_ends():
    """Twice as long an array is half as far off."""
    off = [
        mean_forces(made(array_wavelengths=n, array_spacing=0.1 * n), 20.0, -0.0045)
        / averaged_forces(20.0, -0.0045)
        / n
        - 1.0
        for n in (10.0, 20.0)
    ]
    assert off[1] == pytest.approx(off[0] / 2.0, rel=0.05)


@pytest.mark.parametrize("speed", [6.0, 15.5, 40.0])
def test_short_arrays_give_the_sum_over_their_spectrum(speed):
    """Each wave number of the field has its own frequency κv and its own current: (6), (7) for each, added up."""
    model, heave = made(array_spacing=3.0), -0.0045
    p, places = model.parameters, np.arange(-8000, 8000) * 2.5e-4
    q = quantities(model, speed, heave)
    flux = np.stack(
        [
            np.sqrt(p["eta"])
            * p["peak_field"]
            * w
            * flux_per_width(places, q[[i]], 0.1, 1.0, model.coils.settings.pitch)
            for i, w in enumerate((p["width_top"], p["width_side"], p["width_side"]))
        ]
    )[:, :, 0]
    spectrum = np.fft.rfft(flux, axis=1) * 2.5e-4
    kappa = 2.0 * np.pi * np.fft.rfftfreq(places.size, 2.5e-4)
    total, omega, dk = spectrum.sum(axis=0), kappa * speed, kappa[1]
    response = 1j * omega / (p["resistance"] + 1j * omega * p["inductance"])  # −I over the flux, as the coil sees it
    weight = dk / np.pi / model.coils.settings.pitch  # Parseval, over one side of the spectrum
    lift = [np.sum((np.conj(s) * response * total).real * kappa) * weight for s in spectrum]
    drag = np.sum((np.abs(total) ** 2 * response.imag) * kappa) * weight
    expected = 2.0 * np.array([*lift, drag])  # front and rear, so far apart that one does not feel the other
    assert mean_forces(model, speed, heave) == pytest.approx(expected, rel=2e-3)


def test_coupled_coils_are_coils_of_another_inductance():
    """Under a long array neighbours' currents differ by the phase k p: L + 2 M₁ cos kp + 2 M₂ cos 2kp."""
    mutual, kp = [4e-7, -1e-7], 2.0 * np.pi / 13.0
    together = 1.8e-6 + 2.0 * mutual[0] * np.cos(kp) + 2.0 * mutual[1] * np.cos(2.0 * kp)
    coupled = mean_forces(made(mutual_inductance=mutual, **LONG), 20.0, -0.0045)
    single = mean_forces(made({"inductance": together}, **LONG), 20.0, -0.0045)
    assert coupled == pytest.approx(single, rel=2e-3)
    assert abs(coupled[0] / mean_forces(made(**LONG), 20.0, -0.0045)[0] - 1.0) > 0.1


# -- field and forces -------------------------------------------------------------------------------------------------


def test_the_table_is_the_field():
    pitch = 0.1 / 13.0
    table, places, gaps = field_table(0.1, 1.0, pitch), np.linspace(-0.09, 0.09, 37), np.array([0.0, 0.0043, 0.0128])
    direct = flux_per_width(places, gaps, 0.1, 1.0, pitch)

    def spline(u):
        d = np.abs(u)
        return np.where(d < 1.0, 2.0 / 3.0 - d * d + 0.5 * d**3, np.where(d < 2.0, (2.0 - d) ** 3 / 6.0, 0.0))

    rows, columns = (np.arange(n) for n in table.coefficients.shape)
    along = spline((places[:, None] - table.first_place) / table.place_step - columns + 1.0)
    across = spline((gaps[:, None] - table.first_gap) / table.gap_step - rows + 1.0)
    assert along @ table.coefficients.T @ across.T == pytest.approx(direct, abs=2e-5 * np.abs(direct).max())


def test_the_field_obeys_maxwell():
    """A'' along and A'' across add up to nothing."""
    places, h = np.linspace(-0.1, 0.1, 21), 1e-4

    def flux(z, g, power=0):
        return flux_per_width(z, np.array([g]), 0.1, 1.0, 0.1 / 13.0, power)[:, 0]

    along = (flux(places + h, 0.006) - 2.0 * flux(places, 0.006) + flux(places - h, 0.006)) / h**2
    assert along == pytest.approx(-flux(places, 0.006, 2), abs=1e-3 * np.abs(along).max())


def test_forces_are_derivatives_of_the_flux():
    """F = I ∂Φ/∂q, the flux taken from the integral and not from the table, its derivative by differences."""
    model = made()
    x = model.simulate(np.array([0.0, 0.0137]), np.array([0.2, 1e-3, -0.0045, 0.02, 17.0, 0.0, 0.05, 0.0])).final
    q, s, p = model.quantities(x), model.coils.settings, model.parameters
    tail, n = x[len(model._kernel.states) :], model.coils.count
    numbers, currents = tail[0] + np.arange(n), tail[1:]
    gaps = np.array([q["gap_top"], q["gap_right"], q["gap_left"]])
    widths = np.array([p["width_top"], p["width_side"], p["width_side"]])

    def energy(gaps, surge):
        away = numbers * s.pitch - surge
        sets = sum(flux_per_width(away - side * s.spacing / 2, gaps, 0.1, 1.0, s.pitch) for side in (-1, 1))
        return np.sqrt(p["eta"]) * p["peak_field"] * np.sum(currents[:, None] * sets * widths)

    h, ups = 1e-6, np.eye(3) * 1e-6
    found = [(energy(gaps + up, x[0]) - energy(gaps - up, x[0])) / (2 * h) for up in ups]
    found.append(-(energy(gaps, x[0] + h) - energy(gaps, x[0] - h)) / (2 * h))
    assert np.abs(currents).max() > 100.0
    assert [q[name] for name in FORCES] == pytest.approx(found, rel=0.01)


# -- energy -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options", [{}, {"mutual_inductance": [5e-7, 1e-7], "failed_coils": [70], "damaged_coils": [90]}]
)
def test_energy_balances(options):
    """What the cradle does on the coils is their heat and what they store: exactly, and by the forces as well."""
    model = made(**options)
    q = quantities(model, 18.0, -0.0045)
    times = np.arange(20001) * 2e-6
    heave = 2e-4 * np.sin(2.0 * np.pi * 40.0 * times)
    surges, gaps = 0.5 + 18.0 * times, q[:3] + np.outer(heave, [1.0, -C, -C])
    path = model.coils.follow(times, surges, gaps, q, model.coils.steady(0.5, 18.0, q).tail)
    lost = path.work - path.heat - (path.stored - path.stored[0])
    assert path.heat[-1] > 1.0
    assert np.abs(lost).max() < 2e-3 * path.heat[-1]  # what the coils that are left behind still hold
    push = path.forces[:, :3] @ [1.0, -C, -C]
    power = path.forces[:, 3] * 18.0 - push * np.gradient(heave, times)
    by_forces = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(times))
    assert by_forces == pytest.approx(path.work[-1], rel=1e-4)


def test_the_cradle_loses_what_the_coils_gain():
    """A free run that coasts: its path is flown again by the coils alone, which tell their heat."""
    model = made()
    times = np.arange(10001) * 2e-5
    x = model._whole_state(model.initial_state(surge_rate=25.0, sway=1e-3), 0.0, 0.0, None)
    run, p = model.simulate(times, x, 0.0), model.parameters
    motion = 0.5 * run.states[:, 4:8] ** 2 @ [p["mass"], p["mass"], p["mass"], p["roll_inertia"]]
    motion += p["mass"] * p["gravity"] * run["heave"]
    gaps = run.outputs[:, 8:11]
    path = model.coils.follow(
        times, run["surge"], gaps, quantities(model, 25.0, -0.0045), x[len(model._kernel.states) :]
    )
    gained = path.heat[-1] + path.stored[-1] - path.stored[0]
    assert gained > 100.0
    assert motion[0] - motion[-1] == pytest.approx(gained, rel=2e-3)


# -- single coils -----------------------------------------------------------------------------------------------------


def lift_over_track(model, speed=20.0, length=3.0):
    q = quantities(model, speed, -0.0045)
    path = model.coils.steady(length, speed, q, length)
    return np.linspace(0.0, length, len(path.times)), path.forces


def test_a_failed_coil_takes_its_share_where_it_stands():
    model = made(failed_coils=[200])
    where, forces = lift_over_track(model)
    share = 1.0 - forces[:, 0] / mean_forces(model, 20.0, -0.0045)[0]
    place = 200 * 0.1 / 13.0
    passes = [abs(where[np.argmax(share * (abs(where - c) < 0.1))] - c) for c in (place - 0.275, place + 0.275)]
    assert max(passes) < 0.06  # once under the front set, once under the rear
    assert 0.03 < share.max() < 0.2
    assert np.abs(share[abs(where - place) > 0.5]).max() < 2e-3
    _, damaged = lift_over_track(made(damaged_coils=[200], damage_factor=1e6))
    assert damaged == pytest.approx(forces, abs=0.01)
    _, whole = lift_over_track(made(damaged_coils=[200], damage_factor=1.0))
    assert whole == pytest.approx(lift_over_track(made())[1], abs=1e-9)


def test_all_coils_damaged_are_coils_of_another_resistance():
    numbers = list(range(600))
    damaged = made(damaged_coils=numbers, damage_factor=1.5)
    other = made({"resistance": 1.5 * 1.5e-3})
    assert mean_forces(damaged, 15.0, -0.0045, 2.0) == pytest.approx(mean_forces(other, 15.0, -0.0045, 2.0), rel=1e-3)


# -- heave damping, pace ----------------------------------------------------------------------------------------------


def test_heave_damping_changes_its_sign_where_post_and_ryutov_say():
    """Long arrays damp heave below R/kL and drive it above, as the effect `coil_current_dynamics` does."""
    model, law = made({"mass": 9.3 * 20.0}, array_wavelengths=20.0, array_spacing=2.0), Model.default()
    corner = corner_speed(law)
    assert heave_motion(model, corner - 1.0).damping > 0.0 > heave_motion(model, corner + 1.0).damping
    for speed in (11.0, 20.0):
        damping = heave_motion(model, speed).damping / 20.0
        assert damping == pytest.approx(modes(law, speed).current_damping, rel=0.1, abs=0.02)


def test_it_is_faster_than_real_time():
    """The paper's track at 40 m/s, all four coordinates free, in the time of one processor."""
    model, times = made(), np.arange(126) * 4e-3
    start = model.initial_state(surge_rate=40.0, sway=1e-3)
    took = []
    for _ in range(3):
        begun = time.process_time()
        model.simulate(times, start, 5000.0)
        took.append(time.process_time() - begun)
    assert times[-1] / min(took) > 1.0


# -- a model like others ----------------------------------------------------------------------------------------------


def test_a_run_in_pieces_is_the_run():
    model, times = made(failed_coils=[40]), np.arange(101) * 2e-3
    start = model.initial_state(surge_rate=22.0, sway=2e-3)
    whole, x = model.simulate(times, start), start
    for a, b in zip(times[:-1], times[1:], strict=True):
        x = model.advance(x, a, b)
    assert x[:8] == pytest.approx(whole.final[:8], abs=1e-9)
    assert x[8:] == pytest.approx(whole.final[8:], rel=1e-6, abs=1e-6)  # a step foresees its end to 1e-9 m
    q, truth = (
        model.quantities(x),
        dict(zip(("gap_top", "gap_right", "gap_left"), whole.outputs[-1, 8:11], strict=True)),
    )
    assert {n: q[n] for n in truth} == pytest.approx(truth)
    assert q["heave_acceleration"] == pytest.approx(whole["heave_acceleration"][-1], abs=1e-6)
    parts = model.wrenches(x)
    assert set(parts) == {"lift", "drag", "thrust", "contact", "weight", "total"}
    assert sum(parts[n] for n in parts if n != "total") == pytest.approx(parts["total"], abs=1e-9)


def test_the_equilibrium_is_one():
    """Held in speed, the cradle stays where it starts, but for the ripple of the coils."""
    model = Model.create(dof=1, track="coils")
    run = model.simulate(np.arange(501) * 1e-3, model.initial_state(surge_rate=20.0))
    assert np.ptp(run["heave"]) < 2e-6
    assert np.abs(run["heave_acceleration"]).max() < 0.02


def test_shorter_steps_change_little():
    model, times = made(), np.arange(101) * 2e-3
    start = model.initial_state(surge_rate=40.0)
    usual, fine = model.simulate(times, start, 0.0), model.simulate(times, start, 0.0, longest_step=4e-6)
    assert np.abs(usual["surge"] - fine["surge"]).max() < 2e-4  # of 8 m
    assert np.abs(usual["heave"] - fine["heave"]).max() < 2e-6


def test_effects_act_as_on_the_averaged_track():
    start, times = {"surge_rate": 22.0, "heave": -0.0045}, np.arange(101) * 2e-3

    def run(model):
        return model.simulate(times, model.initial_state(**start)).states

    constant = run(made(effects={"track_resistance": {"relative_change": 0.2}}))
    assert constant == pytest.approx(run(made({"resistance": 1.8e-3})), abs=1e-9)
    wider = run(made(effects={"array_asymmetry": {"relative_difference": 0.1}}))
    assert wider[-1, 1] > 1e-5 and abs(run(made())[-1, 1]) < 1e-9  # pushed to the left
    airy, plain = made(effects={"viscous_drag": {"coefficient": 1.0}}), made()
    x = plain.initial_state(**start)
    slower = [m.quantities(x)["surge_acceleration"] for m in (airy, plain)]
    assert slower[0] - slower[1] == pytest.approx(-22.0 / 9.3)
    assert airy.wrenches(x)["viscous_drag"][0] == pytest.approx(-22.0)


def test_a_landing_ends_on_the_track():
    model = Model.create(dof=2, track="coils")
    run = model.simulate(np.arange(3001) * 1e-3, model.initial_state(surge_rate=13.0))
    assert np.isfinite(run.outputs).all()
    assert run["gap_top"].min() > -1e-4 and run["gap_top"][-1] == pytest.approx(-1e-5, abs=1e-6)
    assert abs(run["surge_rate"][-1]) < 0.1


def test_what_leaves_all_bounds_ends_in_nan():
    model = made({"gravity": 0.0, "drive_current": 1e5, "gamma": 100.0})
    run = model.simulate(np.arange(4) * 1.0, np.array([0, 0, 0.0, 0, 300.0, 0, 0, 0]))
    assert np.isnan(run.states[-1]).all()


# -- files and wrong input --------------------------------------------------------------------------------------------

FILE = """
track: coils
coil_pitch: 0.008
mutual_inductance: [2.0e-7, 1.0e-7]
failed_coils: [12, 40]
damaged_coils: [50, 51]
damage_factor: [3.0, 1.5]
track_length: 30.0
"""
BROKEN = {
    "track: coil\n": "track = 'coil'; it must be 'averaged' or 'coils'",
    "track: coils\nfailed_coils: [99999999]\n": r"coil 99999999 is off the track, whose coils are 0 to 13",
    "track: coils\ntrack_length: 20.0\ndamaged_coils: [2601]\n": "damaged_coils: coil 2601 is off .* 0 to 2600",
    "track: coils\nfailed_coils: [-2]\n": "failed_coils: coil -2 is off the track",
    "track: coils\nfailed_coils: [1.5]\n": r"failed_coils = \[1.5\] must be a list; each entry a whole number",
    "track: coils\nfailed_coils: 3\n": "failed_coils = 3 must be a list; each entry a whole number",
    "track: coils\nfailed_coils: [3]\ndamaged_coils: [3]\n": "coil 3 is in failed_coils and in damaged_coils",
    "track: coils\ndamaged_coils: [3]\ndamage_factor: [2.0, 3.0]\n": "damage_factor holds 2 numbers for 1 damaged",
    "track: coils\nmutual_inductance: 1.0e-6\n": "mutual_inductance = 1e-06 H is too large",
    "track: coils\narray_wavelengths: 8.0\n": "would overlap; give at least 0.8 m",
    "track: coils\ncoil_pitch: -1.0\n": r"coil_pitch = -1 is out of range; it must lie in \[0, 1\] m",
    "track: coils\ncoil_pich: 0.01\n": "unknown parameter 'coil_pich'; did you mean 'coil_pitch'",
    "track: coils\neffects: [coil_current_dynamics]\n": "'coil_current_dynamics' changes current_lift, which only",
    "track: coils\neffects: [dead_coils]\n": "'dead_coils' changes repulsion_top, which only the averaged track has",
}


def test_what_is_saved_is_read(tmp_path):
    (tmp_path / "rig.yaml").write_text(FILE)
    model = Model.load(tmp_path / "rig.yaml")
    model.save(tmp_path / "again.yaml")
    again = Model.load(tmp_path / "again.yaml")
    assert again == model and again.track == "coils"
    s = again.with_changes({"mass": 10.0}).coils.settings
    assert (s.pitch, s.failed, s.damaged, s.factors) == (0.008, (12, 40), (50, 51), (3.0, 1.5))
    assert s.mutual_inductance == (2e-7, 1e-7)


@pytest.mark.parametrize("text", BROKEN)
def test_wrong_input_is_one_line(text, tmp_path):
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(InputError, match=BROKEN[text]) as caught:
        Model.load(tmp_path / "rig.yaml")
    assert str(caught.value).startswith(str(tmp_path)) and "\n" not in str(caught.value)


def test_options_without_their_track_are_said(tmp_path, capsys):
    (tmp_path / "rig.yaml").write_text("failed_coils: [3]\n")
    assert Model.load(tmp_path / "rig.yaml").coils is None
    assert "without track: coils these say nothing: failed_coils" in capsys.readouterr().err
    as_dumped = {n: [one.default] if getattr(one, "count", 1) > 1 else one.default for n, one in COIL_OPTIONS.items()}
    (tmp_path / "dumped.yaml").write_text(yaml.safe_dump(as_dumped))  # `ros2 param dump` writes all that a node has
    assert Model.load(tmp_path / "dumped.yaml").coils is None and not capsys.readouterr().err


def test_the_averaged_kernel_knows_no_coils():
    assert not Model.default().kernel.coils
    assert isinstance(made().coils, Coils)
    with pytest.raises(InputError, match="track: coils can be simulated"):
        _ = made().kernel
