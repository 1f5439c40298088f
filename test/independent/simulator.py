# SPDX-License-Identifier: Apache-2.0
"""A second, independent implementation of the 4-DOF cradle, to test the package on data it did not make.

Why: a diagnosis that is only tested on its own simulator cannot notice that simulator's mistakes. Nothing of
`inductrack_ros` is imported here.

Source: N. H. Kim and L. Ge, J. Vibration and Control 2012, doi 10.1177/1077546312438601; equation numbers are the
paper's, as corrected in model.md.
Units: SI, radians. Axes: x lateral (left), y up, z forward, roll about z.
State (12): 0 surge, 1 sway, 2 heave, 3 roll, 4..7 their rates, 8 and 9 the coil's lag current (real and imaginary, J
= L I - flux, Wb), 10 and 11 how much higher the magnets' frame stands over the body than at rest, and its rate.

The rig is one numpy record (see FIELDS): every effect is always in the formulas and is off at the value given in
FIELDS.
"""

import math

import numpy as np
from numba import njit

from independent.laws import value as law_value

C = math.sqrt(0.5)
STATES = 12

# name -> value that leaves the model as published. A double underscore separates effect and parameter.
FIELDS = {
    # --- Table 1 and the assumptions of model.md
    "B0": 0.52,
    "wavelength": 0.1,
    "L": 1.8e-6,
    "R": 1.5e-3,
    "mass": 9.3,
    "roll_inertia": 0.091,
    "tau": 600e-6,
    "coils": 13.0,
    "g0": 0.010,
    "w_top": 0.12,
    "w_side": 0.08,
    "eta": 0.7295,
    "gamma": 3.9298,
    "gravity": 9.81,
    "contact_stiffness": 9.1e6,
    "contact_damping": 5e3,
    "air_density": 1.29,
    # --- the catalogue (effects.md); the sensors' faults are in measure()
    "aerodynamic_drag__drag_area": 0.0,
    "skin_friction_drag__wetted_area": 0.0,
    "aerodynamic_lift__lift_area": 0.0,
    "viscous_drag__coefficient": 0.0,
    "sliding_friction__coefficient": 0.0,
    "heave_damping__coefficient": 0.0,
    "sway_damping__coefficient": 0.0,
    "roll_damping__coefficient": 0.0,
    "coil_current_dynamics__on": 0.0,
    "skin_effect__corner_frequency": math.inf,
    "track_resistance__relative_change": 0.0,
    "track_inductance__relative_change": 0.0,
    "magnet_warming__rate": 0.0,
    "finite_pulse_width__on": 0.0,
    "firing_delay__delay": 0.0,
    "drive_back_emf__cutoff_speed": math.inf,
    "drive_droop__fraction_per_pulse": 0.0,
    "track_slope__angle": 0.0,
    "guideway_waviness__amplitude": 0.0,
    "guideway_waviness__wavelength": 1.0,
    "guideway_waviness__phase": 0.0,
    "array_asymmetry__relative_difference": 0.0,
    "cg_offset__offset": 0.0,
    "crosswind__force": 0.0,
    "beam_attraction__force": 0.0,
    "halbach_fifth_harmonic__relative_amplitude": 0.0,
    # --- those added in November 2026
    "flexible_mode__frequency": math.inf,
    "flexible_mode__damping_ratio": 0.03,
    "flexible_mode__mass_ratio": 0.3,
    "dead_coils__place": 0.0,
    "dead_coils__fraction": 0.0,
    "joint_step__height": 0.0,
    "joint_step__place": 0.0,
    "auxiliary_wheels__height": 0.0,
    "auxiliary_wheels__stiffness": 0.0,
    "auxiliary_wheels__damping": 0.0,
    "auxiliary_wheels__rolling_resistance": 0.0,
    "bungee_launcher__stiffness": 0.0,
    "bungee_launcher__stroke": 1.0,
    "track_temperature__coefficient": 0.0,
    "magnet_temperature__coefficient": 0.0,
    "track_celsius": 20.0,  # conditions of a run
    "magnet_celsius": 20.0,
    # --- outside the catalogue: what an "unknown" campaign hides
    "heave_patch__force": 0.0,  # F_y -= F exp(-((z - place)/width)^2): a magnetised patch
    "heave_patch__place": 0.0,
    "heave_patch__width": 1.0,
    "sway_patch__force": 0.0,  # F_x += the same: a bent rail
    "sway_patch__place": 0.0,
    "sway_patch__width": 1.0,
    "surge_patch__force": 0.0,  # F_z -= the same: a short-circuited stretch brakes
    "surge_patch__place": 0.0,
    "surge_patch__width": 1.0,
    "roll_patch__moment": 0.0,  # M_z += the same: a twisted rail
    "roll_patch__place": 0.0,
    "roll_patch__width": 1.0,
    "heave_cubic_spring__stiffness": 0.0,  # F_y -= K (y - centre)^3, N/m^3
    "heave_cubic_spring__centre": 0.0,
    "sway_cubic_spring__stiffness": 0.0,  # F_x -= K x^3
    "lift_above_speed__slope": 0.0,  # F_y += s max(v - threshold, 0), N s/m
    "lift_above_speed__threshold": 0.0,
    "thrust_ripple__relative_amplitude": 0.0,  # F_drive (1 + a sin(2 pi z/wavelength))
    "thrust_ripple__wavelength": 1.0,
    "roll_from_sway_cubed__coefficient": 0.0,  # M_z += c x^3, N/m^2
    "heave_from_sway_squared__coefficient": 0.0,  # F_y -= c x^2, N/m^2
    "drag_from_time__force": 0.0,  # F_z -= F once t > start (smoothed over 5 ms)
    "drag_from_time__start": 0.0,
    "heave_shake__force": 0.0,  # F_y += F sin(2 pi f t)
    "heave_shake__frequency": 1.0,
    "sway_from_speed__coefficient": 0.0,  # F_x += c v^2, N s^2/m^2
    "law__size": 0.0,  # any law of `laws`: coordinate += size form(u; a, b) (w / scale)^power
    "law__coordinate": 0.0,
    "law__form": 0.0,
    "law__variable": 0.0,
    "law__a": 0.0,
    "law__b": 1.0,
    "law__second": 8.0,
    "law__scale": 1.0,
    "law__power": 0.0,
}
RIG_TYPE = np.dtype([(name, np.float64) for name in FIELDS])

# local magnet points r'_i (m) and track normals n_i, i = top, right, left
PX = (0.0, -0.105, 0.105)
PY = (0.040, -0.035, -0.035)
NX = (0.0, -C, C)
NY = (1.0, -C, -C)


def rig(**changes):
    """A rig: the published one with `changes`, e.g. rig(eta=0.72, aerodynamic_drag__drag_area=0.02). One-element
    array of RIG_TYPE.
    """
    unknown = set(changes) - set(FIELDS)
    if unknown:
        raise KeyError(f"no such field of the rig: {sorted(unknown)}")
    values = {**FIELDS, **changes}
    return np.array([tuple(values[name] for name in FIELDS)], dtype=RIG_TYPE)


@njit(cache=True)
def track_height(z, p):
    """Height of the track's zero pose and its slope along the travel (guideway_waviness, joint_step)."""
    q = 2 * math.pi / p.guideway_waviness__wavelength
    angle = q * z + p.guideway_waviness__phase
    height = p.guideway_waviness__amplitude * math.sin(angle)
    slope = p.guideway_waviness__amplitude * q * math.cos(angle)
    if p.joint_step__height != 0:
        # (1 + tanh u)/2 = 1/(1 + e^-2u)
        fall = math.exp(-2 * min(max((z - p.joint_step__place) / 0.05, -300.0), 300.0))
        height += p.joint_step__height / (1 + fall)
        slope += p.joint_step__height * 2 * fall / (1 + fall) ** 2 / 0.05
    return height, slope


@njit(cache=True)
def gap(i, s, p):
    """Gap of array i and its rate, (29)-(34); also the arm of its magnet point."""
    height, slope = track_height(s[0], p)
    cos, sin = math.cos(s[3]), math.sin(s[3])
    ax = cos * PX[i] - sin * PY[i]
    ay = sin * PX[i] + cos * PY[i]
    g = p.g0 + (s[1] + ax - PX[i]) * NX[i] + (s[2] + s[10] - height + ay - PY[i]) * NY[i]
    rate = (s[5] - s[7] * ay) * NX[i] + (s[6] + s[11] - slope * s[4] + s[7] * ax) * NY[i]
    return g, rate, ax, ay


@njit(cache=True)
def overlap(i, g, p):
    """e_i = w_i exp(-k g), with array_asymmetry and halbach_fifth_harmonic (m)."""
    k = 2 * math.pi / p.wavelength
    eps = p.array_asymmetry__relative_difference
    if i == 0:
        w = p.w_top
    elif i == 1:
        w = p.w_side * (1 - eps)
    else:
        w = p.w_side * (1 + eps)
    return w * math.exp(-k * g) * (1 + p.halbach_fifth_harmonic__relative_amplitude * math.exp(-4 * k * g))


@njit(cache=True)
def circuit(t, v, p):
    """Field B0 (T), angular frequency omega (1/s), resistance and inductance now, with warming, skin effect and wrong
    constants.
    """
    k = 2 * math.pi / p.wavelength
    f = k * abs(v) / (2 * math.pi)
    field = p.B0 * (1 - p.magnet_warming__rate * t)
    field *= 1 + p.magnet_temperature__coefficient * (p.magnet_celsius - 20)
    resistance = p.R * (1 + p.track_resistance__relative_change) * (1 + (f / p.skin_effect__corner_frequency) ** 2)
    resistance *= 1 + p.track_temperature__coefficient * (p.track_celsius - 20)
    inductance = p.L * (1 + p.track_inductance__relative_change)
    return field, k * max(v, 0.0), resistance, inductance


@njit(cache=True)
def thrust(t, s, total, field, drive_current, p):
    """(39) times what the drive's effects leave of it (N)."""
    v = s[4]
    if v <= 0 or drive_current == 0:
        return 0.0
    omega = 2 * math.pi / p.wavelength * v
    force = p.gamma * 2 * total * (2 * v / p.wavelength) * (p.tau / math.pi) * drive_current * field
    if p.finite_pulse_width__on > 0:
        u = omega * p.tau / math.pi
        if abs(u - 1) < 1e-6:
            force *= math.pi / 4  # the limit of the next line
        else:
            force *= math.cos(math.pi * u / 2) / (1 - u * u)
    force *= math.cos(omega * p.firing_delay__delay)
    force *= max(1 - v / p.drive_back_emf__cutoff_speed, 0.0)
    force *= (1 - p.drive_droop__fraction_per_pulse) ** (2 * s[0] / p.wavelength)
    force *= 1 + p.thrust_ripple__relative_amplitude * math.sin(2 * math.pi * s[0] / p.thrust_ripple__wavelength)
    return force


@njit(cache=True)
def bump(z, place, width):
    return math.exp(-(((z - place) / width) ** 2))


@njit(cache=True)
def law(t, s, p):
    """The force of an unknown law (`laws`)."""
    u = t if p.law__variable == 8 else s[int(p.law__variable)]
    force = p.law__size * law_value(int(p.law__form), u, p.law__a, p.law__b)
    if p.law__power != 0:
        force *= ((t if p.law__second == 8 else s[int(p.law__second)]) / p.law__scale) ** p.law__power
    return force


@njit(cache=True)
def derivative(t, s, drive_current, p, ds):
    """Right-hand side of (40) with all effects; writes ds, returns the smallest gap (m)."""
    k = 2 * math.pi / p.wavelength
    z, x, y, roll, v, vx, vy, w = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
    field, omega, resistance, inductance = circuit(t, v, p)

    # gaps, overlaps, and the current: I = flux/L * j/(rho + j) when steady
    g0, rate0, ax0, ay0 = gap(0, s, p)
    g1, rate1, ax1, ay1 = gap(1, s, p)
    g2, rate2, ax2, ay2 = gap(2, s, p)
    e0, e1, e2 = overlap(0, g0, p), overlap(1, g1, p), overlap(2, g2, p)
    total = e0 + e1 + e2
    flux = p.eta * (field / k) * total  # (35)
    if p.coil_current_dynamics__on > 0:
        # L dI/dt + (R + j w L) I = dflux/dt + j w flux; with J = L I - flux it needs no flux rate: dJ/dt = -R I - j w J
        current_re = (s[8] + flux) / inductance
        current_im = s[9] / inductance
        ds[8] = -resistance * current_re + omega * s[9]
        ds[9] = -resistance * current_im - omega * s[8]
    else:
        q = omega * inductance / resistance  # 1/rho
        current_re = flux / inductance * q * q / (1 + q * q)
        current_im = flux / inductance * q / (1 + q * q)
        ds[8] = 0.0
        ds[9] = 0.0
    lift_factor = 2 * p.coils * field * current_re / 2 if omega > 0 else 0.0  # (36) without e_i
    drag = total * 2 * p.coils * field * current_im / 2 if omega > 0 else 0.0  # (38)
    off = abs(z - p.dead_coils__place)
    if off < 0.65 / 2:
        alive = 1 - p.dead_coils__fraction * math.cos(math.pi * off / 0.65) ** 2
        lift_factor *= alive
        drag *= alive

    # contact (25): positive is what the track presses on the array; it acts with the repulsion against the normal
    c0 = -min(p.contact_stiffness * g0 + p.contact_damping * rate0, 0.0) if g0 < 0 else 0.0
    c1 = -min(p.contact_stiffness * g1 + p.contact_damping * rate1, 0.0) if g1 < 0 else 0.0
    c2 = -min(p.contact_stiffness * g2 + p.contact_damping * rate2, 0.0) if g2 < 0 else 0.0
    f0, f1, f2 = e0 * lift_factor + c0, e1 * lift_factor + c1, e2 * lift_factor + c2
    fx = f0 * NX[0] + f1 * NX[1] + f2 * NX[2]
    fy = f0 * NY[0] + f1 * NY[1] + f2 * NY[2]
    moment = (
        f0 * (ax0 * NY[0] - ay0 * NX[0])
        + f1 * (ax1 * NY[1] - ay1 * NX[1])
        + f2 * (ax2 * NY[2] - ay2 * NX[2])
    )  # fmt: skip
    fz = thrust(t, s, total, field, drive_current, p) - drag

    # weight, on a slope
    fz -= p.mass * p.gravity * math.sin(p.track_slope__angle)
    fy -= p.mass * p.gravity * math.cos(p.track_slope__angle)
    moment -= p.mass * p.gravity * p.cg_offset__offset * math.cos(roll)

    # air
    fz -= 0.5 * p.air_density * p.aerodynamic_drag__drag_area * v * abs(v)
    fy += 0.5 * p.air_density * p.aerodynamic_lift__lift_area * v * v
    if p.skin_friction_drag__wetted_area != 0:
        reynolds = p.air_density * abs(v) * 0.65 / 1.862e-5
        if reynolds > 10:
            friction = 0.455 / math.log10(reynolds) ** 2.58
            fz -= friction * 0.5 * p.air_density * v * abs(v) * p.skin_friction_drag__wetted_area

    # friction and damping
    fz -= p.viscous_drag__coefficient * v
    if v != 0:
        fz -= p.sliding_friction__coefficient * (c0 + c1 + c2) * math.copysign(1.0, v)
    fy -= p.heave_damping__coefficient * vy
    fx -= p.sway_damping__coefficient * vx
    moment -= p.roll_damping__coefficient * w

    # launcher and landing wheels
    fz += p.bungee_launcher__stiffness * max(p.bungee_launcher__stroke - z, 0.0)
    if g0 < p.auxiliary_wheels__height:
        load = p.auxiliary_wheels__stiffness * (p.auxiliary_wheels__height - g0) - p.auxiliary_wheels__damping * rate0
        if load > 0:
            fy += load
            moment += load * ax0
            if v != 0:
                fz -= p.auxiliary_wheels__rolling_resistance * load * math.copysign(1.0, v)

    # other catalogue forces
    fx += p.crosswind__force
    fy -= p.beam_attraction__force * math.exp(-2 * k * g0)

    # outside the catalogue
    fy -= p.heave_patch__force * bump(z, p.heave_patch__place, p.heave_patch__width)
    fx += p.sway_patch__force * bump(z, p.sway_patch__place, p.sway_patch__width)
    fz -= p.surge_patch__force * bump(z, p.surge_patch__place, p.surge_patch__width)
    moment += p.roll_patch__moment * bump(z, p.roll_patch__place, p.roll_patch__width)
    fy -= p.heave_cubic_spring__stiffness * (y - p.heave_cubic_spring__centre) ** 3
    fx -= p.sway_cubic_spring__stiffness * x**3
    fy += p.lift_above_speed__slope * max(v - p.lift_above_speed__threshold, 0.0)
    moment += p.roll_from_sway_cubed__coefficient * x**3
    fy -= p.heave_from_sway_squared__coefficient * x * x
    if p.drag_from_time__force != 0:
        fz -= p.drag_from_time__force * 0.5 * (1 + math.tanh((t - p.drag_from_time__start) / 0.005))
    fy += p.heave_shake__force * math.sin(2 * math.pi * p.heave_shake__frequency * t)
    fx += p.sway_from_speed__coefficient * v * v
    if p.law__size != 0:
        force = law(t, s, p)
        to = int(p.law__coordinate)
        if to == 0:
            fz += force
        elif to == 1:
            fx += force
        elif to == 2:
            fy += force
        else:
            moment += force

    # an elastic frame of mass mu m takes all of it and passes on what its spring does
    up = fy / p.mass
    ds[10] = ds[11] = 0.0
    if p.flexible_mode__frequency < math.inf:
        own = 2 * math.pi * p.flexible_mode__frequency
        spring = own * own * s[10] + 2 * p.flexible_mode__damping_ratio * own * s[11]
        ds[10] = s[11]
        ds[11] = up / p.flexible_mode__mass_ratio - spring
        up = p.flexible_mode__mass_ratio * spring

    ds[0], ds[1], ds[2], ds[3] = v, vx, vy, w
    ds[4] = fz / p.mass
    ds[5] = fx / p.mass
    ds[6] = up
    ds[7] = moment / p.roll_inertia
    return min(g0, min(g1, g2))


@njit(cache=True)
def step(t, s, h, drive_current, p, k1, k2, k3, k4, trial):
    """One classical Runge-Kutta step of h (s), in place; k1 must hold the derivative at (t, s)."""
    for i in range(STATES):
        trial[i] = s[i] + 0.5 * h * k1[i]
    derivative(t + 0.5 * h, trial, drive_current, p, k2)
    for i in range(STATES):
        trial[i] = s[i] + 0.5 * h * k2[i]
    derivative(t + 0.5 * h, trial, drive_current, p, k3)
    for i in range(STATES):
        trial[i] = s[i] + h * k3[i]
    derivative(t + h, trial, drive_current, p, k4)
    for i in range(STATES):
        s[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i])


@njit(cache=True)
def integrate(times, s0, drive_current, rigs, far_step, near_step, stop_at_contact, kick_times, kicks, states):
    """Fill states (n, STATES) at `times` (ascending; those before 0 are integrated backwards). Returns the time of
    first contact (inf if none).

    The state jumps by kicks[j] (m, 8) at kick_times[j] (m,), which ascend; those before 0 are passed over.

    `far_step` is used while every gap is above 0.3 mm, `near_step` otherwise, so the kink of the contact force is met
    with short steps. With stop_at_contact the rows after the first contact are NaN.
    """
    p = rigs[0]
    k1, k2, k3, k4, trial = np.empty(STATES), np.empty(STATES), np.empty(STATES), np.empty(STATES), np.empty(STATES)
    n = len(times)
    contact = math.inf

    first = 0  # the first sample at or after the start
    while first < n and times[first] < 0:
        first += 1
    s = s0.copy()
    t = 0.0
    for row in range(first - 1, -1, -1):
        while t > times[row] + 1e-12:
            h = max(-far_step, times[row] - t)
            derivative(t, s, drive_current, p, k1)
            step(t, s, h, drive_current, p, k1, k2, k3, k4, trial)
            t += h
        states[row] = s

    s = s0.copy()
    t = 0.0
    kick = 0
    while kick < len(kick_times) and kick_times[kick] <= 0:
        kick += 1
    for row in range(first, n):
        begin = t
        done = 0.0
        while t < times[row] - 1e-12:
            smallest = derivative(t, s, drive_current, p, k1)
            if smallest < 0 and contact == math.inf:
                contact = t
                if stop_at_contact:
                    states[row:] = math.nan
                    return contact
            h = far_step if smallest > 3e-4 else near_step
            h = min(h, times[row] - t)
            if kick < len(kick_times):
                h = min(h, kick_times[kick] - t)
            step(t, s, h, drive_current, p, k1, k2, k3, k4, trial)
            done += h
            t = begin + done
            while kick < len(kick_times) and kick_times[kick] <= t + 1e-12:
                s[:8] += kicks[kick]
                kick += 1
        t = times[row]
        states[row] = s
    return contact


@njit(cache=True)
def steady_current(t, s, p):
    """Lag current J = L I - flux (Wb) of the steady state, for starting coil_current_dynamics."""
    k = 2 * math.pi / p.wavelength
    field, omega, resistance, inductance = circuit(t, s[4], p)
    total = 0.0
    for i in range(3):
        total += overlap(i, gap(i, s, p)[0], p)
    flux = p.eta * (field / k) * total
    q = omega * inductance / resistance
    return flux * q * q / (1 + q * q) - flux, flux * q / (1 + q * q)


@njit(cache=True)
def heave_force(heave, v, p):
    """Force up (N) on a centred cradle at rest in heave, averaged law; for the equilibrium."""
    s = np.zeros(STATES)
    s[2], s[4] = heave, v
    ds = np.empty(STATES)
    derivative(0.0, s, 0.0, p, ds)
    return ds[6] * p.mass


def equilibrium_heave(v, rigs):
    """Heave (m) at which the averaged law of the published kind carries the weight at speed v; effects of the rig are
    left out.
    """
    plain = rig(eta=rigs["eta"][0], gamma=rigs["gamma"][0])[0]
    low, high = -0.0099, 0.02
    if heave_force(low, v, plain) < 0:
        return -0.00995  # too slow to be carried: just above the track
    for _ in range(60):
        middle = 0.5 * (low + high)
        if heave_force(middle, v, plain) > 0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


NO_KICKS = np.zeros(0), np.zeros((0, 8))


def simulate(times, start, drive_current, rigs, far_step=1e-4, near_step=1e-5, stop_at_contact=False, kicks=NO_KICKS):
    """Run the rig. times (n,) s; start (8,) SI; kicks: times (m,) s and jumps of the state (m, 8). Returns states (n,
    STATES) and the time of first contact.
    """
    times = np.ascontiguousarray(times, dtype=float)
    s0 = np.zeros(STATES)
    s0[:8] = start
    p = rigs[0]
    if p["coil_current_dynamics__on"] > 0:
        far_step = min(far_step, 5e-5)
        s0[8:10] = steady_current(0.0, s0, p)
    if p["flexible_mode__frequency"] < math.inf:
        far_step = min(far_step, 0.05 / p["flexible_mode__frequency"])
    states = np.empty((len(times), STATES))
    contact = integrate(times, s0, float(drive_current), rigs, far_step, near_step, stop_at_contact, *kicks, states)
    return states, contact


# ---- what sensors see ----------------------------------------------------------------------------

STATE_CHANNELS = ("surge", "sway", "heave", "roll", "surge_rate", "sway_rate", "heave_rate", "roll_rate")
GAP_CHANNELS = ("gap_top", "gap_right", "gap_left")
ACCELERATION_CHANNELS = ("surge_acceleration", "sway_acceleration", "heave_acceleration")


@njit(cache=True)
def derived_channels(times, states, drive_current, rigs, gaps, accelerations):
    p = rigs[0]
    ds = np.empty(STATES)
    for row in range(len(times)):
        for i in range(3):
            gaps[row, i] = gap(i, states[row], p)[0]
        derivative(times[row], states[row], drive_current, p, ds)
        accelerations[row] = ds[4:7]


def channels_of(times, states, drive_current, rigs, names):
    """The true value of the named channels, (n, len(names))."""
    gaps, accelerations = np.empty((len(times), 3)), np.empty((len(times), 3))
    if any(name not in STATE_CHANNELS for name in names):
        derived_channels(np.ascontiguousarray(times), states, float(drive_current), rigs, gaps, accelerations)
    columns = []
    for name in names:
        if name in STATE_CHANNELS:
            columns.append(states[:, STATE_CHANNELS.index(name)])
        elif name in GAP_CHANNELS:
            columns.append(gaps[:, GAP_CHANNELS.index(name)])
        else:
            columns.append(accelerations[:, ACCELERATION_CHANNELS.index(name)])
    return np.stack(columns, axis=1)


def measure(times, start, drive_current, rigs, names, faults=(), **steps):
    """What noiseless sensors would log: simulate, then apply sensor faults.

    faults: dicts {"effect": "sensor_...", "channel": ..., parameter: value}. measured = true + bias; scale * true;
    true(t - delay), where the motion before t = 0 is the one that leads to `start`; true + rate t (drift);
    true((1 + rate) t) (clock); true clipped to +- limit (saturation); the reading that follows with time_constant
    (lag), settled at the start; and, of no channel, sway and heave turned by angle, their rates alike (misalignment).
    Returns values (n, len(names)) and the time of first contact.
    """
    states, contact = simulate(times, start, drive_current, rigs, **steps)
    values = channels_of(times, states, drive_current, rigs, names)

    def seen_at(moments, channel):
        moments = np.ascontiguousarray(moments, dtype=float)
        moved, _ = simulate(moments, start, drive_current, rigs, **steps)
        return channels_of(moments, moved, drive_current, rigs, [channel])[:, 0]

    for fault in faults:
        kind = fault["effect"]
        if kind == "sensor_misalignment":
            turn(values, states, names, fault["angle"])
            continue
        if fault["channel"] not in names:
            continue
        column = list(names).index(fault["channel"])
        if kind == "sensor_bias":
            values[:, column] += fault["bias"]
        elif kind == "sensor_scale":
            values[:, column] *= fault["scale"]
        elif kind == "sensor_drift":
            values[:, column] += fault["rate"] * np.asarray(times)
        elif kind == "sensor_saturation":
            values[:, column] = np.clip(values[:, column], -fault["limit"], fault["limit"])
        elif kind == "sensor_delay":
            values[:, column] = seen_at(np.asarray(times) - fault["delay"], fault["channel"])
        elif kind == "sensor_clock":
            values[:, column] = seen_at((1 + fault["rate"]) * np.asarray(times), fault["channel"])
        elif kind == "sensor_lag":
            values[:, column] = lagged(
                np.asarray(times, dtype=float), lambda t, f=fault: seen_at(t, f["channel"]), fault["time_constant"]
            )
        else:
            raise KeyError(kind)
    return values, contact


def turn(values, states, names, angle):
    """Sway and heave sensors of an instrument that is turned by `angle`, in place; their rates alike."""
    for sway, heave, place in (("sway", "heave", 1), ("sway_rate", "heave_rate", 5)):
        x, y = states[:, place], states[:, place + 1]
        if sway in names:
            values[:, list(names).index(sway)] = x * math.cos(angle) + y * math.sin(angle)
        if heave in names:
            values[:, list(names).index(heave)] = y * math.cos(angle) - x * math.sin(angle)


def lagged(times, truth, time_constant, spacing=2e-4):
    """The reading at `times` of a sensor that follows the truth, linear between points 0.2 ms apart: exact there."""
    fine = np.unique(np.concatenate([times, np.arange(0.0, times[-1], min(spacing, 0.2 * time_constant))]))
    true = truth(fine)
    reading = np.empty(len(fine))
    reading[0] = true[0]
    for k in range(1, len(fine)):
        h = fine[k] - fine[k - 1]
        slope, decay = (true[k] - true[k - 1]) / h, math.exp(-h / time_constant)
        # of r' = (u - r)/tau with u = u0 + slope t: u - tau slope is followed exactly, the rest decays
        steady = true[k] - time_constant * slope
        reading[k] = steady + (reading[k - 1] - (true[k - 1] - time_constant * slope)) * decay
    return reading[np.searchsorted(fine, times)]
