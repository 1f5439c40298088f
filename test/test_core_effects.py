# SPDX-License-Identifier: Apache-2.0
"""Every effect of the catalogue, under its contracted name: formula, direction, energy, and nothing at its default.

Idea: `reference` below is the model written once more, plainly and without the package, with a place for each effect's
formula. The package's total force must equal it at random states, so a wrong sign or factor in an effect, or in where
the kernel puts it, shows. Energy and direction are then asked for separately, since a formula copied wrongly twice
would still agree with itself.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from inductrack_ros.core.effects import catalogue
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model

K = 2 * math.pi / 0.1
C = math.sqrt(0.5)
ARMS = ((0.0, 0.040), (-0.105, -0.035), (0.105, -0.035))
NORMALS = ((0.0, 1.0), (-C, -C), (C, -C))
WEIGHT = 9.3 * 9.81

#: The contract: names and parameters that outside checks rely on.
CONTRACT = {
    "aerodynamic_drag": ["drag_area"],
    "skin_friction_drag": ["wetted_area"],
    "aerodynamic_lift": ["lift_area"],
    "viscous_drag": ["coefficient"],
    "sliding_friction": ["coefficient"],
    "heave_damping": ["coefficient"],
    "sway_damping": ["coefficient"],
    "roll_damping": ["coefficient"],
    "coil_current_dynamics": [],
    "skin_effect": ["corner_frequency"],
    "track_resistance": ["relative_change"],
    "track_inductance": ["relative_change"],
    "magnet_warming": ["rate"],
    "finite_pulse_width": [],
    "firing_delay": ["delay"],
    "drive_back_emf": ["cutoff_speed"],
    "drive_droop": ["fraction_per_pulse"],
    "track_slope": ["angle"],
    "guideway_waviness": ["amplitude", "wavelength", "phase"],
    "array_asymmetry": ["relative_difference"],
    "cg_offset": ["offset"],
    "crosswind": ["force"],
    "beam_attraction": ["force"],
    "halbach_fifth_harmonic": ["relative_amplitude"],
    "sensor_bias": ["bias"],
    "sensor_scale": ["scale"],
    "sensor_delay": ["delay"],
    "flexible_mode": ["frequency", "damping_ratio", "mass_ratio"],
    "dead_coils": ["place", "fraction"],
    "joint_step": ["height", "place"],
    "auxiliary_wheels": ["height", "stiffness", "damping", "rolling_resistance"],
    "bungee_launcher": ["stiffness", "stroke"],
    "track_temperature": ["coefficient"],
    "magnet_temperature": ["coefficient"],
    "sensor_lag": ["time_constant"],
    "sensor_drift": ["rate"],
    "sensor_clock": ["rate"],
    "sensor_saturation": ["limit"],
    "sensor_misalignment": ["angle"],
}


def gaps_of(x, height=0.0, height_rate=0.0):
    """Gaps and their rates, (29)–(34), of the arrays 1, 2, 3 (top, right, left)."""
    _, sway, heave, roll, _, sway_rate, heave_rate, roll_rate = x
    turn = np.array([[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]])
    turning = roll_rate * np.array([[-math.sin(roll), -math.cos(roll)], [math.cos(roll), -math.sin(roll)]])
    place, speed = np.array([sway, heave - height]), np.array([sway_rate, heave_rate - height_rate])
    gap = [0.01 + (place + turn @ r - r) @ n for r, n in zip(np.array(ARMS), np.array(NORMALS), strict=True)]
    rate = [(speed + turning @ r) @ n for r, n in zip(np.array(ARMS), np.array(NORMALS), strict=True)]
    return np.array(gap), np.array(rate), turn


def reference(
    x,
    R=1.5e-3,
    L=1.8e-6,
    B0=0.52,
    widths=(0.12, 0.08, 0.08),
    thrust_factor=1.0,
    harmonic=0.0,
    height=0.0,
    height_rate=0.0,
    added=(0.0, 0.0, 0.0, 0.0),
    friction=0.0,
    coils=1.0,
):
    """Total force (surge, sway, heave) and roll moment at state ``x``, 7000 A, equations (29)–(40)."""
    gap, rate, turn = gaps_of(x, height, height_rate)
    v = max(x[4], 0.0)
    e = np.array(widths) * np.exp(-K * gap) * (1 + harmonic * np.exp(-4 * K * gap))
    flux = 0.7295 * B0 / K * e.sum()
    rho_inverse = K * v * L / R
    strength = coils * 13 * B0 * flux / L
    lift = strength * rho_inverse**2 / (1 + rho_inverse**2)
    drag = strength * rho_inverse / (1 + rho_inverse**2) * e.sum()
    thrust = 3.9298 * 2 * e.sum() * (2 * v / 0.1) * (600e-6 / math.pi) * 7000.0 * B0 * thrust_factor
    contact = np.where(gap < 0, np.minimum(9.1e6 * gap + 5e3 * rate, 0.0), 0.0)
    push = e * lift - contact
    total = np.array([thrust - drag, 0.0, -WEIGHT, 0.0]) + np.array(added)
    total[0] += -friction * -contact.sum() * np.sign(x[4])
    for force, r, n in zip(push, np.array(ARMS), np.array(NORMALS), strict=True):
        arm = turn @ r
        total[1:3] += force * n
        total[3] += (arm[0] * n[1] - arm[1] * n[0]) * force
    return total


def air(v):
    return 0.5 * 1.29 * v * abs(v)


def skin_friction(v):
    reynolds = 1.29 * abs(v) * 0.65 / 1.862e-5
    return 0.455 / math.log10(reynolds) ** 2.58 * air(v) if reynolds > 10 else 0.0


def pulse_width(v):
    omega_tau = K * v * 600e-6
    return math.cos(omega_tau / 2) / (1 - (omega_tau / math.pi) ** 2)


def alive(z):
    """What dead_coils at 8 m with a fraction of 0.4 leaves of lift and drag."""
    away = abs(z - 8.0)
    return 1 - 0.4 * math.cos(math.pi * away / 0.65) ** 2 if away < 0.325 else 1.0


def wheels(x):
    """Forces of wheels that reach 4 mm down: surge, sway, heave, roll."""
    gap, rate, turn = gaps_of(x)
    load = max(2e4 * (4e-3 - gap[0]) - 300.0 * rate[0], 0.0) if gap[0] < 4e-3 else 0.0
    return (-0.05 * load * np.sign(x[4]), 0.0, load, load * (turn @ np.array(ARMS[0]))[0])


TABLE = {"variable": 0.0, "start": 1.0, "step": 3.0, "knots": 5.0, "values": (0.1, -0.4, 0.3, 0.7, -0.2)}


def table(surge):
    """Cubic B-splines, constant beyond the table's ends."""
    u = min(max((surge - 1.0) / 3.0, 0.0), 4.0)
    spline = BSpline.basis_element(range(-2, 3), extrapolate=False)
    return float(np.nan_to_num(spline(u - np.arange(5))) @ TABLE["values"])


#: name -> parameters and what effects.md says they do to `reference`, given state x and time t.
FORMULAS = {
    "aerodynamic_drag": ({"drag_area": 0.3}, lambda x, t: {"added": (-0.3 * air(x[4]), 0, 0, 0)}),
    "skin_friction_drag": ({"wetted_area": 2.0}, lambda x, t: {"added": (-2.0 * skin_friction(x[4]), 0, 0, 0)}),
    "aerodynamic_lift": ({"lift_area": -0.2}, lambda x, t: {"added": (0, 0, -0.2 * air(abs(x[4])), 0)}),
    "viscous_drag": ({"coefficient": 3.0}, lambda x, t: {"added": (-3.0 * x[4], 0, 0, 0)}),
    "sliding_friction": ({"coefficient": 0.25}, lambda x, t: {"friction": 0.25}),
    "heave_damping": ({"coefficient": 7.0}, lambda x, t: {"added": (0, 0, -7.0 * x[6], 0)}),
    "sway_damping": ({"coefficient": 6.0}, lambda x, t: {"added": (0, -6.0 * x[5], 0, 0)}),
    "roll_damping": ({"coefficient": 0.4}, lambda x, t: {"added": (0, 0, 0, -0.4 * x[7])}),
    "skin_effect": (
        {"corner_frequency": 400.0},
        lambda x, t: {"R": 1.5e-3 * (1 + (K * x[4] / 2 / math.pi / 400.0) ** 2)},
    ),
    "track_resistance": ({"relative_change": 0.1}, lambda x, t: {"R": 1.5e-3 * 1.1}),
    "track_inductance": ({"relative_change": -0.2}, lambda x, t: {"L": 1.8e-6 * 0.8}),
    "magnet_warming": ({"rate": 0.05}, lambda x, t: {"B0": 0.52 * (1 - 0.05 * t)}),
    "finite_pulse_width": ({}, lambda x, t: {"thrust_factor": pulse_width(max(x[4], 0.0))}),
    "firing_delay": ({"delay": 4e-4}, lambda x, t: {"thrust_factor": math.cos(K * x[4] * 4e-4)}),
    "drive_back_emf": ({"cutoff_speed": 35.0}, lambda x, t: {"thrust_factor": max(1 - x[4] / 35.0, 0.0)}),
    "drive_droop": ({"fraction_per_pulse": 0.01}, lambda x, t: {"thrust_factor": 0.99 ** (2 * x[0] / 0.1)}),
    "track_slope": (
        {"angle": 0.1},
        lambda x, t: {"added": (-WEIGHT * math.sin(0.1), 0, WEIGHT - WEIGHT * math.cos(0.1), 0)},
    ),
    "guideway_waviness": (
        {"amplitude": 1e-3, "wavelength": 0.7, "phase": 0.4},
        lambda x, t: {
            "height": 1e-3 * math.sin(2 * math.pi * x[0] / 0.7 + 0.4),
            "height_rate": 1e-3 * 2 * math.pi / 0.7 * math.cos(2 * math.pi * x[0] / 0.7 + 0.4) * x[4],
        },
    ),
    "array_asymmetry": ({"relative_difference": 0.15}, lambda x, t: {"widths": (0.12, 0.08 * 0.85, 0.08 * 1.15)}),
    "cg_offset": ({"offset": 0.01}, lambda x, t: {"added": (0, 0, 0, -WEIGHT * 0.01 * math.cos(x[3]))}),
    "crosswind": ({"force": -4.0}, lambda x, t: {"added": (0, -4.0, 0, 0)}),
    "beam_attraction": (
        {"force": 30.0},
        lambda x, t: {"added": (0, 0, -30.0 * math.exp(-2 * K * gaps_of(x)[0][0]), 0)},
    ),
    "halbach_fifth_harmonic": ({"relative_amplitude": 0.2}, lambda x, t: {"harmonic": 0.2}),
    "dead_coils": ({"place": 8.0, "fraction": 0.4}, lambda x, t: {"coils": alive(x[0])}),
    "joint_step": (
        {"height": -1e-3, "place": 8.0},
        lambda x, t: {
            "height": -1e-3 / (1 + math.exp(-2 * (x[0] - 8.0) / 0.05)),
            "height_rate": -1e-3 * 0.5 / 0.05 / math.cosh(min(abs(x[0] - 8.0) / 0.05, 300.0)) ** 2 * x[4],
        },
    ),
    "auxiliary_wheels": (
        {"height": 4e-3, "stiffness": 2e4, "damping": 300.0, "rolling_resistance": 0.05},
        lambda x, t: {"added": wheels(x)},
    ),
    "bungee_launcher": (
        {"stiffness": 40.0, "stroke": 12.0},
        lambda x, t: {"added": (40.0 * max(12.0 - x[0], 0.0), 0, 0, 0)},
    ),
    "track_temperature": ({"coefficient": 4e-3}, lambda x, t: {"R": 1.5e-3 * (1 + 4e-3 * 15.0)}),
    "magnet_temperature": ({"coefficient": -1.1e-3}, lambda x, t: {"B0": 0.52 * (1 - 1.1e-3 * 40.0)}),
}
#: The conditions under which the formulas hold.
CONDITIONS = {"track_temperature": 35.0, "magnet_temperature": 60.0}
#: The same of smooth forces in place of what is not known.
STAND_INS = {
    "stand_in_heave": (TABLE, lambda x, t: {"added": (0, 0, table(x[0]), 0)}),
    "stand_in_thrust": (TABLE, lambda x, t: {"thrust_factor": 1 + table(x[0])}),
}

#: States near the track: in flight, touching, rolling either way (surge, sway, heave, roll, then their rates); not at a
#: gap of exactly zero, where rounding decides whether a closing contact pushes.
STATES = st.tuples(
    st.floats(0, 50) | st.floats(7.6, 8.4),
    st.floats(-3e-3, 3e-3),
    st.floats(-0.0101, -0.01001) | st.floats(-0.00999, 4e-3),
    st.floats(-0.01, 0.01),
    st.floats(-5, 60),
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
    st.floats(-2, 2),
).map(list)
TIMES = st.floats(0, 5)
QUICK = settings(max_examples=60, deadline=None, derandomize=True)


def simulate(effects=(), seconds=0.2, dof=4, current=7000.0, times=None, **start):
    """A run from the plain model's equilibrium heave, so that two runs differ by the effect alone."""
    model = Model.create(effects=effects, dof=dof, conditions=CONDITIONS)
    x = Model.default().initial_state(**start)
    return model.simulate(np.linspace(0.0, seconds, 51) if times is None else times, x[:8], current)


# -- formulas -------------------------------------------------------------------------------------------------------


def test_the_contract_is_kept():
    shipped = catalogue()
    assert {name: list(item.parameters) for name, item in shipped.items() if name in CONTRACT} == CONTRACT
    assert {n for n in CONTRACT if shipped[n].of_sensor} == {n for n in CONTRACT if n.startswith("sensor_")}
    cradle = {n for n in CONTRACT if not shipped[n].of_sensor}
    assert cradle == {*FORMULAS, "coil_current_dynamics", "flexible_mode"}


@QUICK
@given(x=STATES)
def test_the_reference_is_the_model(x):
    total = Model.default().wrenches(x)["total"]
    assert total == pytest.approx(reference(x), rel=1e-9, abs=1e-7)


@pytest.mark.parametrize("name", [*FORMULAS, *STAND_INS])
def test_formula(name):
    parameters, formula = (FORMULAS | STAND_INS)[name]
    model = Model.create(effects={name: parameters}, conditions=CONDITIONS)
    pulsed = None if catalogue()[name].only else model.with_changes(drive="pulses")

    @QUICK
    @given(x=STATES, t=TIMES)
    def check(x, t):
        if pulsed:  # between two pulses nothing drives
            assert pulsed.wrenches(x, t)["total"] == pytest.approx(
                reference(x, **(formula(x, t) | {"thrust_factor": 0.0})), rel=1e-9, abs=1e-7
            )
        parts = model.wrenches(x, t)
        expected = reference(x, **formula(x, t))
        assert parts["total"] == pytest.approx(expected, rel=1e-9, abs=1e-7)
        assert parts[name] == pytest.approx(expected - reference(x), rel=1e-6, abs=1e-5)

    check()


def test_pulse_width_at_its_removable_singularity():
    """At ωτ = π numerator and denominator vanish together; the limit is π/4."""
    speed = math.pi / (K * 600e-6)
    model = Model.create(effects=["finite_pulse_width"])
    thrust = [model.quantities([0, 0, 0, 0, v, 0, 0, 0])["thrust"] / v for v in (speed * 0.999, speed, speed * 1.001)]
    plain = Model.default().quantities([0, 0, 0, 0, speed, 0, 0, 0])["thrust"] / speed
    assert thrust[1] == pytest.approx(plain * math.pi / 4, rel=1e-5)
    assert thrust[0] > thrust[1] > thrust[2] > 0


def test_droop_counts_from_where_the_run_begins():
    model = Model.create(effects={"drive_droop": {"fraction_per_pulse": 0.01}})
    x = [30.0, 0, -0.005, 0, 20.0, 0, 0, 0]
    later = model.quantities([33.0, *x[1:]], origin=3.0)["thrust"]
    assert model.quantities(x)["thrust"] == pytest.approx(later)
    far = model.simulate([0.0, 0.1], x).states[-1] - [30.0, *[0] * 7]
    near = model.simulate([0.0, 0.1], [0.0, *x[1:]]).states[-1]
    assert far == pytest.approx(near, rel=1e-9, abs=1e-12)


def test_two_effects_add_up_and_compose():
    """Forces add; changes of one quantity compose, whatever the order they are named in."""
    x, t = [3.0, 1e-3, -0.005, 2e-3, 25.0, 0.1, -0.05, 0.3], 2.0
    both = {
        "track_resistance": {"relative_change": 0.1},
        "skin_effect": {"corner_frequency": 400.0},
        "crosswind": {"force": 2.0},
    }
    expected = reference(x, R=1.5e-3 * 1.1 * (1 + (250.0 / 400.0) ** 2), added=(0, 2.0, 0, 0))
    for effects in (both, dict(reversed(both.items()))):
        assert Model.create(effects=effects).wrenches(x, t)["total"] == pytest.approx(expected, rel=1e-9)


# -- at its default an effect is nothing ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", [n for n, (parameters, _) in (FORMULAS | STAND_INS).items() if parameters])
def test_vanishes_at_its_default(name):
    plain, idle = Model.default(), Model.create(effects=[name])

    @QUICK
    @given(x=STATES, t=TIMES)
    def check(x, t):
        assert np.array_equal(idle.wrenches(x, t)["total"], plain.wrenches(x, t)["total"])

    check()


# -- energy ---------------------------------------------------------------------------------------------------------

DISSIPATES = [
    "aerodynamic_drag",
    "skin_friction_drag",
    "viscous_drag",
    "sliding_friction",
    "heave_damping",
    "sway_damping",
    "roll_damping",
]


@pytest.mark.parametrize("name", DISSIPATES)
def test_what_dissipates_takes_power(name):
    """Force times velocity is never positive, also when rolling backwards, and somewhere it is negative."""
    declared = next(iter(catalogue()[name].parameters.values()))
    least = [0.0]

    @QUICK
    @given(x=STATES, size=st.floats(0, 1))
    def check(x, size):
        own = next(iter(catalogue()[name].parameters))
        model = Model.create(effects={name: {own: size * min(declared.high, 10.0)}})
        power = model.wrenches(x)[name] @ np.array(x[4:])
        scale = np.abs(model.wrenches(x)["total"] * x[4:]).sum()
        assert power <= 1e-12 * scale
        least[0] = min(least[0], power)

    check()
    assert least[0] < 0


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("firing_delay", {"delay": 2e-4}),
        ("drive_back_emf", {"cutoff_speed": 50.0}),
        ("drive_droop", {"fraction_per_pulse": 0.01}),
    ]
    + [("finite_pulse_width", {})],
)
def test_what_weakens_the_drive_adds_no_power(name, parameters):
    model = Model.create(effects={name: parameters})

    @QUICK
    @given(x=STATES)
    def check(x):
        assert model.wrenches(x)[name] @ np.array(x[4:]) <= 1e-9

    check()


@QUICK
@given(x=STATES)
def test_the_eddy_currents_take_power(x):
    """Drag brakes and contact dampers never push back more than the spring gives: the paper's own dissipation."""
    parts = Model.default().wrenches(x)
    assert parts["drag"] @ np.array(x[4:]) <= 0
    stiff = Model.create({"contact_damping": 0.0}).wrenches(x)["contact"]
    assert (parts["contact"] - stiff) @ np.array(x[4:]) <= 1e-9


def test_friction_holds_a_cradle_that_stands():
    """At a standstill friction is what is needed, no more: the cradle stays on a slight slope, slides on a steep
    one."""

    def slide(angle):
        effects = {"sliding_friction": {"coefficient": 0.2}, "track_slope": {"angle": angle}}
        run = Model.create(effects=effects).simulate(
            np.linspace(0, 3, 301), Model.default().initial_state(surge_rate=2.0), 0.0
        )
        return run["surge"][200:], run["surge_rate"][200:], run["surge_acceleration"][200:]

    surge, rate, acceleration = slide(0.1)
    assert np.ptp(surge) == 0.0
    assert np.all(rate == 0.0)  # it does not rattle
    assert np.all(acceleration == 0.0)
    _, rate, acceleration = slide(0.3)
    assert rate[-1] < -0.5
    drag = 0.2 * 9.81 * math.cos(0.3) - 9.81 * math.sin(0.3)
    assert acceleration[-1] == pytest.approx(drag, rel=1e-3)


def test_a_bungee_gives_what_it_holds():
    """½ k stroke², all of it, and nothing behind its stroke."""
    model = Model.create(
        {"gamma": 0.0, "peak_field": 0.0}, {"bungee_launcher": {"stiffness": 200.0, "stroke": 2.0}}, dof=["surge"]
    )
    run = model.simulate(np.linspace(0, 2, 201), np.zeros(8))
    assert 0.5 * 9.3 * run["surge_rate"][-1] ** 2 == pytest.approx(0.5 * 200.0 * 2.0**2, rel=1e-6)
    assert run["surge_acceleration"][-1] == 0.0


def test_wheels_give_back_what_their_spring_holds_and_no_more():
    """A cradle dropped on wheels without damping comes back as high as it was; with damping it comes to rest at k(h −
    g) = m a_g."""
    times = np.linspace(0, 3, 3001)

    def drop(damping):
        effects = {"auxiliary_wheels": {"height": 3e-3, "stiffness": 2e5, "damping": damping}}
        model = Model.create({"peak_field": 0.0}, effects, dof=["heave"])
        return model.simulate(times, model.initial_state(heave=-0.005))["heave"]

    free = drop(0.0)
    # 40 bounces, a tenth of a micrometre each where the wheels begin within a step.
    assert free.max() == pytest.approx(-0.005, abs=5e-6)
    assert free[1500:].max() > -0.005 - 1e-5
    damped = drop(400.0)
    assert damped.max() == -0.005
    assert damped[-1] == pytest.approx(3e-3 - 0.01 - WEIGHT / 2e5, abs=1e-9)


def test_wheels_hold_a_cradle_that_stands():
    """Rolling resistance is what is needed, no more, as friction is."""
    effects = {
        "auxiliary_wheels": {"height": 3e-3, "stiffness": 1e5, "damping": 400.0, "rolling_resistance": 0.02},
        "track_slope": {"angle": 0.01},
    }
    model = Model.create(effects=effects)
    run = model.simulate(np.linspace(0, 3, 301), model.initial_state(surge_rate=0.3), 0.0)
    assert run["surge_rate"][-1] == 0.0 and np.ptp(run["surge"][-50:]) == 0.0
    steep = model.with_changes(effects={**effects, "track_slope": {"angle": 0.03}})
    assert steep.simulate(np.linspace(0, 3, 301), model.initial_state(), 0.0)["surge_rate"][-1] < -0.1


def test_dead_coils_take_lift_and_drag_alike():
    """No power comes of coils that are not there: where they lift less they brake less."""
    x = [8.0, 0, -0.005, 0, 20.0, 0, 0, 0]
    dead, whole = (Model.create(effects={"dead_coils": {"place": 8.0, "fraction": f}}).wrenches(x) for f in (1.0, 0.0))
    assert dead["lift"] == pytest.approx(np.zeros(4)) and dead["drag"] == pytest.approx(np.zeros(4))
    assert dead["thrust"] == pytest.approx(whole["thrust"])


# -- direction ------------------------------------------------------------------------------------------------------

DIRECTIONS = {  # parameters, what moves and where to, the start besides 25 m/s (all above R/kL = 13.3 m/s)
    "aerodynamic_drag": ({"drag_area": 0.3}, "surge", -1, {}),
    "skin_friction_drag": ({"wetted_area": 5.0}, "surge", -1, {}),
    "aerodynamic_lift": ({"lift_area": 0.05}, "heave", 1, {}),
    "viscous_drag": ({"coefficient": 2.0}, "surge", -1, {}),
    "sliding_friction": ({"coefficient": 0.3}, "surge", -1, {"surge_rate": 5.0}),
    "heave_damping": ({"coefficient": 5.0}, "heave", -1, {"heave_rate": 0.05}),
    "sway_damping": ({"coefficient": 5.0}, "sway", -1, {"sway_rate": 0.05}),
    "roll_damping": ({"coefficient": 0.05}, "roll", -1, {"roll_rate": 0.3}),
    "skin_effect": ({"corner_frequency": 500.0}, "surge", -1, {}),
    "track_resistance": ({"relative_change": 0.1}, "surge", -1, {}),
    "track_inductance": ({"relative_change": 0.1}, "surge", 1, {}),
    "magnet_warming": ({"rate": 0.1}, "heave", -1, {}),
    "finite_pulse_width": ({}, "surge", -1, {}),
    "firing_delay": ({"delay": 3e-4}, "surge", -1, {}),
    "drive_back_emf": ({"cutoff_speed": 100.0}, "surge", -1, {}),
    "drive_droop": ({"fraction_per_pulse": 0.001}, "surge", -1, {}),
    "track_slope": ({"angle": 0.05}, "surge", -1, {}),
    "guideway_waviness": ({"amplitude": 1e-3, "wavelength": 50.0, "phase": 1.5}, "heave", 1, {}),
    "array_asymmetry": ({"relative_difference": 0.05}, "sway", 1, {}),
    "cg_offset": ({"offset": 0.001}, "roll", -1, {}),
    "crosswind": ({"force": 1.0}, "sway", 1, {}),
    "beam_attraction": ({"force": 20.0}, "heave", -1, {}),
    "halbach_fifth_harmonic": ({"relative_amplitude": 0.1}, "heave", 1, {}),
    "dead_coils": ({"place": 0.5, "fraction": 0.5}, "heave", -1, {}),
    "joint_step": ({"height": 1e-3, "place": 0.0}, "heave", 1, {}),
    "auxiliary_wheels": ({"height": 6e-3, "stiffness": 1e4}, "heave", 1, {}),
    "bungee_launcher": ({"stiffness": 10.0, "stroke": 2.0}, "surge", 1, {}),
    "track_temperature": ({"coefficient": 4e-3}, "surge", -1, {}),
    "magnet_temperature": ({"coefficient": -1e-3}, "heave", -1, {}),
}


@pytest.mark.parametrize("name", DIRECTIONS)
def test_direction_in_a_run(name):
    """The first half swing goes where the effect pushes (30 ms: less than a quarter of any bounce)."""
    parameters, channel, sign, start = DIRECTIONS[name]
    start = {"surge_rate": 25.0, **start}
    moved = simulate({name: parameters}, 0.03, **start)[channel] - simulate((), 0.03, **start)[channel]
    assert sign * moved[-1] > 1e-8
    assert sign * moved.min() > -1e-3 * abs(moved[-1]) if sign > 0 else moved.max() < 1e-3 * abs(moved[-1])


def test_every_cradle_effect_has_a_direction():
    assert set(DIRECTIONS) == set(FORMULAS)


# -- the unsteady coil current --------------------------------------------------------------------------------------


#: Where the current's two states stand.
CURRENT = [
    Model.default().kernel.states.index(f"coil_current_dynamics.current_{part}") for part in ("real", "imaginary")
]


def derivative(model, x):
    """dx of the compiled right-hand side, coil current included."""
    return model._evaluate(0.0, np.asarray(x, float), model.vector, model.switches)[0]


@QUICK
@given(x=STATES)
def test_steady_coil_current_is_the_averaged_law(x):
    """At rest in every rate but the travel, the current that stays is (36) and (38)."""
    model = Model.create(effects=["coil_current_dynamics"])
    x = [*x[:4], abs(x[4]), 0.0, 0.0, 0.0]
    full = model.with_effect_states(x)
    assert model.wrenches(full)["total"] == pytest.approx(Model.default().wrenches(x)["total"], rel=1e-9, abs=1e-7)
    current = full[CURRENT]
    assert np.abs(derivative(model, full)[CURRENT]).max() <= 1e-9 * (1 + np.abs(current).max()) * 6e3


def test_coil_current_settles_from_nothing():
    """Started without current, a cradle too heavy to move finds (36) and (38) with the time constant L/R = 1.2 ms."""
    model = Model.create({"mass": 1e5, "gravity": 0.0}, ["coil_current_dynamics"])
    x = model.with_effect_states([0, 0, -0.005, 0, 20.0, 0, 0, 0])
    steady = x[CURRENT].copy()
    x[CURRENT] = 0.0
    envelope = []
    for step in range(10):
        x = model.advance(x, step * 1e-3, (step + 1) * 1e-3)
        envelope.append(np.hypot(*(x[CURRENT] - steady)))
    decay = np.array(envelope[1:6]) / np.array(envelope[:5])
    assert decay == pytest.approx(np.full(5, math.exp(-1e-3 * 1.5e-3 / 1.8e-6)), rel=1e-3)


def heave_damping_of_lag(speed):
    """c of m ÿ + c ẏ + … at held speed: −2 m Re λ of the bounce, linearised with its two current states."""
    model = Model.create(effects=["coil_current_dynamics"], dof=1)
    centre = model.with_effect_states(model.initial_state(surge_rate=speed))
    places = [2, 6, *CURRENT]
    sizes = [1e-7, 1e-5, *(1e-5 * np.abs(centre[CURRENT]).max() * np.ones(2))]
    matrix = np.empty((4, 4))
    for column, (place, size) in enumerate(zip(places, sizes, strict=True)):
        step = np.zeros(len(centre))
        step[place] = size
        matrix[:, column] = (derivative(model, centre + step) - derivative(model, centre - step))[places] / (2 * size)
    values = np.linalg.eigvals(matrix)
    bounce = values[np.argmin(np.where(values.imag > 0, np.abs(values.real), np.inf))]
    assert 20 < bounce.imag < 60  # rad/s: it is the heave mode
    return -2 * 9.3 * bounce.real


@pytest.mark.parametrize(("speed", "damping"), [(10.0, 1.33), (20.0, -0.28), (40.0, -0.12)])
def test_heave_damping_of_the_lag(speed, damping):
    assert heave_damping_of_lag(speed) == pytest.approx(damping, abs=0.005)


def test_heave_damping_of_the_lag_changes_sign_at_the_corner():
    """Post and Ryutov: it damps below R/kL = 13.3 m/s and excites above."""
    corner = 1.5e-3 / (K * 1.8e-6)
    assert corner == pytest.approx(13.3, abs=0.05)
    assert abs(heave_damping_of_lag(corner)) < 0.05
    assert heave_damping_of_lag(corner - 1) > 0 > heave_damping_of_lag(corner + 1)


# -- sensors --------------------------------------------------------------------------------------------------------


def test_sensor_formulas():
    shipped = catalogue()
    assert shipped["sensor_bias"].function(0.3, 0.01) == pytest.approx(0.31)
    assert shipped["sensor_scale"].function(0.3, 1.1) == pytest.approx(0.33)
    assert shipped["sensor_delay"].function(2.0, 0.004) == pytest.approx(1.996)  # measured(t) = true(t − δ)
    for name, vanishing in (("sensor_bias", 0.0), ("sensor_scale", 1.0), ("sensor_delay", 0.0)):
        assert next(iter(shipped[name].parameters.values())).default == vanishing


def test_a_sensor_effect_leaves_the_cradle_alone():
    """It is the sensor, not the cradle: the run itself is the same to the last bit."""
    faults = {
        "sensor_bias:sway": {"bias": 1e-3},
        "sensor_scale:heave": {"scale": 1.2},
        "sensor_delay:surge": {"delay": 2e-3},
    }
    assert np.array_equal(simulate(faults, surge_rate=20.0).outputs, simulate(surge_rate=20.0).outputs)


# -- what belongs together ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["finite_pulse_width", "firing_delay"])
def test_effects_of_the_averaged_law_are_refused_with_pulses(name):
    with pytest.raises(InputError, match=f"{name}.*averaged"):
        Model.create(effects=[name], drive="pulses")


def test_a_wavy_track_is_followed_step_by_step():
    """Waves of 3 cm at 40 m/s, 0.75 ms each, shorter than a free step: the steps follow them all the same."""
    wave = {"guideway_waviness": {"amplitude": 5e-5, "wavelength": 0.03, "phase": 0.0}}
    times = np.linspace(0.0, 0.2, 11)
    start = {"surge_rate": 40.0, "sway": 1e-3}
    model = Model.create(effects=wave)
    x = Model.default().initial_state(**start)
    coarse, fine = model.simulate(times, x, 4000.0), model.simulate(times, x, 4000.0, longest_step=4e-6)
    assert np.abs(coarse.states[:, :4] - fine.states[:, :4]).max() < 1e-9
