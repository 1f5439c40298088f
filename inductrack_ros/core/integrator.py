"""Classical Runge–Kutta with the contacts' switching moments located, so that a kink never falls inside a step.

`kernel` puts this file's text behind the right-hand side it generates and compiles both as one module; the names it
does not define (``derivative``, ``N_STATES``, …) come from there. Outside contact the forces are smooth and slow, so a step of
half a millisecond is exact to nanometres; in contact, and while a pulse lasts, the steps are shorter.
"""

# ruff: noqa: F821
import math

import numpy as np

MAX_CONTACT_SWITCHES = 100_000  # a run that rattles more often than this is not one we can integrate


def pulse_sum(t, surge, P, pulse_times, pulse_places, pulse_currents, first):
    """Σ I sin(π(t−t0)/τ) cos(k(z−z_n)) over the pulses that burn now (A); ``first`` is the first that may."""
    tau = P[PULSE_LENGTH]
    total = 0.0
    for i in range(first, pulse_times.size):
        age = t - pulse_times[i]
        if age < 0.0:
            break
        offset = surge - pulse_places[i]
        if age < tau and abs(offset) <= 0.5 * P[ARRAY_LENGTH]:
            total += pulse_currents[i] * math.sin(math.pi * age / tau) * math.cos(2.0 * math.pi / P[WAVELENGTH] * offset)
    return total


def touches(i, P, q):
    """Whether array i is in contact: g < 0 and its force would push. ``q`` holds gaps and their rates."""
    return P[CONTACT_STIFFNESS] * q[i] + P[CONTACT_DAMPING] * max(q[3 + i], 0.0) < 0.0


def step_sizes(P, on, longest):
    """Longest free step and longest step in contact (s), from the stiffness of the field and of the contact."""
    arm = P[MAGNET_SIDE_OFFSET] ** 2 + max(P[MAGNET_SIDE_HEIGHT] ** 2, P[MAGNET_TOP_HEIGHT] ** 2)
    inverse_mass = 1.0 / P[MASS] + arm / P[ROLL_INERTIA]
    field_rate = math.sqrt(2.0 * 2.0 * math.pi / P[WAVELENGTH] * P[GRAVITY] * P[MASS] * inverse_mass)
    contact_rate = math.sqrt(P[CONTACT_STIFFNESS] * inverse_mass) + 0.5 * P[CONTACT_DAMPING] * inverse_mass
    free = min(longest, FREE_STEP / max(field_rate, 1e-3))
    for i in range(MAX_STEPS.size):
        if on[i] and free > MAX_STEPS[i]:
            free = MAX_STEPS[i]
    return free, min(free, CONTACT_STEP / contact_rate)


def runge_kutta(t, h, x, k1, x_new, k, stage, q, P, on, moving, touching, origin, averaged, pt, pp, pc, first):
    """One step of size h from x, whose derivative k1 is known; leaves the end in x_new."""
    for i in range(N_STATES):
        x_new[i] = x[i] + h / 6.0 * k1[i]
        stage[i] = x[i] + 0.5 * h * k1[i]
    for s in range(3):
        ts = t + (h if s == 2 else 0.5 * h)
        pulse = 0.0 if averaged else pulse_sum(ts, stage[0], P, pt, pp, pc, first)
        derivative(ts, stage, P, on, moving, touching, origin, averaged, pulse, k, q, False)
        weight = h / 6.0 if s == 2 else h / 3.0
        ahead = h if s == 1 else 0.5 * h
        for i in range(N_STATES):
            x_new[i] += weight * k[i]
            stage[i] = x[i] + ahead * k[i]


def integrate(times, t, x, P, on, moving, origin, averaged, pt, pp, pc, longest, out):
    """Carry the state x from time t through ``times`` and write the `state.OUTPUTS` at each into ``out`` (n, 15).

    x is changed in place and ends as the state at the last of ``times``. Rows after a state that is no longer finite
    are NaN. Returns the number of contact switches.
    """
    free_step, contact_step = step_sizes(P, on, longest)
    pulse_step = 0.1 * P[PULSE_LENGTH]
    k1, k, stage, x_new = np.empty(N_STATES), np.empty(N_STATES), np.empty(N_STATES), np.empty(N_STATES)
    q, q_new = np.empty(N_QUANTITIES), np.empty(N_QUANTITIES)
    touching, flipped = np.zeros(3, np.bool_), np.zeros(3, np.bool_)
    first, switches = 0, 0

    pulse = 0.0 if averaged else pulse_sum(t, x[0], P, pt, pp, pc, first)
    derivative(t, x, P, on, moving, touching, origin, averaged, pulse, k1, q, False)
    for i in range(3):
        touching[i] = touches(i, P, q)
    if touching[0] or touching[1] or touching[2]:
        derivative(t, x, P, on, moving, touching, origin, averaged, pulse, k1, q, False)

    for row in range(times.size):
        target = times[row]
        while t < target:
            remaining = target - t
            limit = contact_step if touching[0] or touching[1] or touching[2] else free_step
            if not averaged:
                while first < pt.size and pt[first] + P[PULSE_LENGTH] <= t:
                    first += 1
                if first < pt.size:  # steps end where a half sine begins or ends
                    if pt[first] > t:
                        remaining = min(remaining, pt[first] - t)
                    else:
                        limit = min(limit, pulse_step)
                        for i in range(first, min(first + 4, pt.size)):
                            if pt[i] > t:
                                remaining = min(remaining, pt[i] - t)
                            elif pt[i] + P[PULSE_LENGTH] > t:
                                remaining = min(remaining, pt[i] + P[PULSE_LENGTH] - t)
            n = math.ceil(remaining / limit - 1e-9)
            last = n <= 1
            h = remaining if last else remaining / n

            runge_kutta(t, h, x, k1, x_new, k, stage, q_new, P, on, moving, touching, origin, averaged, pt, pp, pc, first)
            pulse = 0.0 if averaged else pulse_sum(t + h, x_new[0], P, pt, pp, pc, first)
            derivative(t + h, x_new, P, on, moving, touching, origin, averaged, pulse, k, q_new, False)

            flips = False
            for i in range(3):
                flipped[i] = touches(i, P, q_new) != touching[i]
                flips = flips or flipped[i]
            if flips and h > 1e-9:
                # Bisect on the step: low ends before the switch, high just after it.
                low, high = 0.0, h
                while high - low > 1e-9 and high - low > 1e-6 * h:
                    middle = 0.5 * (low + high)
                    runge_kutta(t, middle, x, k1, x_new, k, stage, q_new, P, on, moving, touching, origin, averaged, pt, pp, pc, first)
                    pulse = 0.0 if averaged else pulse_sum(t + middle, x_new[0], P, pt, pp, pc, first)
                    derivative(t + middle, x_new, P, on, moving, touching, origin, averaged, pulse, k, q_new, False)
                    any_flip = False
                    for i in range(3):
                        any_flip = any_flip or touches(i, P, q_new) != touching[i]
                    if any_flip:
                        high = middle
                    else:
                        low = middle
                if high < h:
                    h = high
                    last = False
                runge_kutta(t, h, x, k1, x_new, k, stage, q_new, P, on, moving, touching, origin, averaged, pt, pp, pc, first)
                pulse = 0.0 if averaged else pulse_sum(t + h, x_new[0], P, pt, pp, pc, first)
                derivative(t + h, x_new, P, on, moving, touching, origin, averaged, pulse, k, q_new, False)
            if flips:
                for i in range(3):
                    touching[i] = touches(i, P, q_new)
                derivative(t + h, x_new, P, on, moving, touching, origin, averaged, pulse, k, q_new, False)
                switches += 1
                if switches > MAX_CONTACT_SWITCHES:
                    x_new[0] = np.nan
            t = target if last and h == target - t else t + h
            x[:] = x_new
            k1[:] = k
            q[:] = q_new
            if not math.isfinite(x[0] + x[1] + x[2] + x[3]):
                out[row:] = np.nan
                return switches
        for i in range(8):
            out[row, i] = x[i]
        for i in range(3):
            out[row, 8 + i] = q[i]
        for i in range(4):
            out[row, 11 + i] = k1[4 + i]
    return switches


def simulate_batch(times, t0, x, P, on, moving, origin, averaged, pt, pp, pc, longest, out):
    """`integrate` for each row of x (jobs, N_STATES) with its own row of P, on and origin; ``out`` is (jobs, n, 15)."""
    for job in range(x.shape[0]):
        integrate(times, t0, x[job], P[job], on[job], moving, origin[job], averaged, pt, pp, pc, longest, out[job])


def evaluate(t, x, P, on, moving, origin, averaged, pt, pp, pc, dx, q):
    """Derivative and all named quantities at one moment, contact decided from the state itself."""
    touching = np.zeros(3, np.bool_)
    pulse = 0.0 if averaged else pulse_sum(t, x[0], P, pt, pp, pc, 0)
    derivative(t, x, P, on, moving, touching, origin, averaged, pulse, dx, q, False)
    for i in range(3):
        touching[i] = touches(i, P, q)
    derivative(t, x, P, on, moving, touching, origin, averaged, pulse, dx, q, True)
