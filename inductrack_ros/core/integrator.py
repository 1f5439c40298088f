# SPDX-License-Identifier: Apache-2.0
"""Classical Runge–Kutta in which no kink falls inside a step.

`kernel` puts this file's text behind the right-hand side it generates and compiles both as one module; the names it
does not define (``derivative``, ``N_STATES``, …) come from there.

Outside contact the forces are smooth and slow, so a step of two milliseconds is exact to a tenth of a micrometre.
Shorter steps are taken in contact until its vibration has died away, while a pulse lasts, and wherever the embedded
third-order result disagrees (a wavy track, a strong field, a user's effect). A step ends where a pulse begins or ends,
where an array touches or leaves the track, and where the travel turns. A cradle that friction holds at a standstill is
held. It does not rattle about zero speed.

``rig`` below is what does not change during a step: (P, on, groups, free, touching, origin, averaged, pt, pp, pc).
``groups`` has a bit for each group of effects of which any is on. ``free`` are the coordinates that move now. pt, pp
and pc are the pulses' times, places and currents.

All but the three entry points are compiled without numba's reference counting, which took half the time: they own no
array, so work space comes from the entry point. ``PADDED`` is N_STATES rounded up to whole vector registers.
"""

# ruff: noqa: F821
# pyright: reportUndefinedVariable=false
import math

import numpy as np

MAX_CONTACT_SWITCHES = 100_000  # a run that rattles more often than this is not one we can integrate
BOUNDS = 1e9  # m, and rad; what has gone further left all bounds
# Over the error of the third-order result in one step.
PER_TOLERANCE = np.array([1e8, 1e8, 1e8, 1e7, 1e5, 1e5, 1e5, 1e4])
# The same of an effect's state: to the largest it has been, and at the least in its unit.
CARRIED_TOLERANCE = 1e-5
CARRIED_LEAST = 1e-12
GROW, SHRINK = 0.03, 1.0  # errors over tolerance at which steps grow back to normal, and below normal shrink
CONTACT_GROW, CONTACT_SHRINK = 0.002, 0.05  # the same where they are longer than normal, stricter: a step that comes
CONTACT_GROWTH = 8.0  # and goes would show in differences of runs. Times a normal contact step, the longest one
SHORTEST_STEP = 1e-7  # s; a motion that needs shorter ones, a grain's under a clamp's stiffness, would never end
FINEST = 2.0**-10  # steps are not refined further than this: a force that jumps all the time would stop the run
CREEP = 1e-9  # m/s, the speed at which we ask which way friction pushes


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
            total += (
                pulse_currents[i] * math.sin(math.pi * age / tau) * math.cos(2.0 * math.pi / P[WAVELENGTH] * offset)
            )
    return total


def current(t, surge, P, averaged, pulse_times, pulse_places, pulse_currents, first):
    """What `equations` calls ``pulse_current`` (A): the sum of the pulses. Averaged, it is what flows beyond the drive
    current: straight lines through ``pulse_currents`` at ``pulse_times``, where a run has any."""
    n = pulse_times.size
    if not averaged:
        return pulse_sum(t, surge, P, pulse_times, pulse_places, pulse_currents, first)
    if n == 0:
        return 0.0
    low, high = 0, n - 1
    if t <= pulse_times[0] or t >= pulse_times[high]:
        return pulse_currents[0] if t <= pulse_times[0] else pulse_currents[high]
    while high - low > 1:
        middle = (low + high) // 2
        if pulse_times[middle] <= t:
            low = middle
        else:
            high = middle
    part = (t - pulse_times[low]) / (pulse_times[high] - pulse_times[low])
    return pulse_currents[low] + part * (pulse_currents[high] - pulse_currents[low])


def until_pulse_edge(t, tau, pulse_times, first):
    """Time to the next beginning or end of a pulse (s), and whether one burns now."""
    wait, burns = math.inf, False
    for i in range(first, pulse_times.size):
        if pulse_times[i] > t:
            return min(wait, pulse_times[i] - t), burns
        if pulse_times[i] + tau > t:
            wait, burns = min(wait, pulse_times[i] + tau - t), True
    return wait, burns


def first_unburnt(t, tau, pulse_times):
    """Index of the first pulse that has not burnt out by time t."""
    low, high = 0, pulse_times.size
    while low < high:
        middle = (low + high) // 2
        if pulse_times[middle] + tau <= t:
            low = middle + 1
        else:
            high = middle
    return low


def groups_on(on):
    """A bit for each group of neighbours in the right-hand side of which any is on: most are off, and asking each took
    a tenth."""
    bits = 0
    for i in range(GROUPS.size):
        if on[i]:
            bits |= GROUPS[i]
    return bits


def touches(i, P, q):
    """Whether array i is in contact: g < 0 and its force would push. ``q`` holds gaps and their rates."""
    return P[CONTACT_STIFFNESS] * q[i] + P[CONTACT_DAMPING] * max(q[3 + i], 0.0) < 0.0


def switches_contact(P, q, touching):
    """Whether any array's contact differs from ``touching``."""
    for i in range(3):
        if touches(i, P, q) != touching[i]:
            return True
    return False


def lowest_moment(h, P, touching, q, q_new):
    """Where within a step of size h a gap grazes zero on its way down and up again (s); h where none does."""
    for i in range(3):
        down, up = q[3 + i], q_new[3 + i]
        if down < 0.0 < up and not touching[i] and not touches(i, P, q_new):
            moment = h * down / (down - up)
            if q[i] + 0.5 * down * moment < 1e-7 and 1e-6 < moment < h - 1e-6:
                return moment
    return h


def step_sizes(P, on, longest):
    """Longest free step and longest step in contact (s), from the stiffness of field and contact; longest travel
    (m)."""
    arm = P[MAGNET_SIDE_OFFSET] ** 2 + max(P[MAGNET_SIDE_HEIGHT] ** 2, P[MAGNET_TOP_HEIGHT] ** 2)
    inverse_mass = 1.0 / P[MASS] + arm / P[ROLL_INERTIA]
    field_rate = math.sqrt(2.0 * 2.0 * math.pi / P[WAVELENGTH] * P[GRAVITY] * P[MASS] * inverse_mass)
    contact_rate = math.sqrt(P[CONTACT_STIFFNESS] * inverse_mass) + 0.5 * P[CONTACT_DAMPING] * inverse_mass
    free = min(longest, FREE_STEP / max(field_rate, 1e-3))
    travel = math.inf
    for i in range(MAX_STEPS.size):
        if on[i]:
            free = min(free, MAX_STEPS[i])
            if MAX_TRAVELS[i] >= 0:  # the place in P of the length over which the effect repeats
                travel = min(travel, 0.1 * P[MAX_TRAVELS[i]])
    return free, min(free, CONTACT_STEP / contact_rate), travel


def slope(t, x, rig, first, dx, q):
    """Derivative dx of the state x, and the gaps and their rates in q."""
    P, on, groups, free, touching, origin, averaged, pt, pp, pc = rig
    pulse = current(t, x[0], P, averaged, pt, pp, pc, first)
    derivative(t, x, P, on, groups, free, touching, origin, averaged, pulse, dx, q, False)


def observe(t, x, P, on, groups, moving, touching, origin, averaged, pulse, dx, q, detail):
    """`derivative`, with the named quantities in q where ``detail``: called where one copy of it is enough."""
    derivative(t, x, P, on, groups, moving, touching, origin, averaged, pulse, dx, q, detail)


def see_further(t, x, rig, first, dx, q, row):
    """What the channels beside the motion see, behind the motion in ``row``. ``dx`` and ``q`` are work space."""
    P, on, groups, free, touching, origin, averaged, pt, pp, pc = rig
    pulse = current(t, x[0], P, averaged, pt, pp, pc, first)
    observe(t, x, P, on, groups, free, touching, origin, averaged, pulse, dx[:N_STATES], q, True)
    for i in range(row.size - MOTION):
        row[MOTION + i] = q[FURTHER + i]


def step(t, h, x, k1, rig, first, x_new, k_new, q_new, k, stage):
    """One step from x, whose derivative k1 is known, to x_new with derivative k_new, gaps q_new.

    Returns how far the embedded third-order result (weights ⅙ ⅓ ⅓ 0 and ⅙ on k_new) is off, over the tolerance.
    """
    P, on, groups, free, touching, origin, averaged, pt, pp, pc = rig
    for i in range(PADDED):
        x_new[i] = x[i] + h / 6.0 * k1[i]
        stage[i] = x[i] + 0.5 * h * k1[i]
    for s in range(4):  # the fourth is the slope at the end; one loop, so that `derivative` is compiled into it once
        ts = t + (h if s >= 2 else 0.5 * h)
        pulse = current(ts, stage[0], P, averaged, pt, pp, pc, first)
        derivative(ts, stage, P, on, groups, free, touching, origin, averaged, pulse, k_new, q_new, False)
        if s == 3:
            break
        weight = h / 6.0 if s == 2 else h / 3.0
        ahead = h if s == 1 else 0.5 * h
        for i in range(PADDED):
            x_new[i] += weight * k_new[i]
            k[i] = k_new[i]
            stage[i] = x_new[i] if s == 2 else x[i] + ahead * k_new[i]
    error = 0.0
    for i in range(8):
        error = max(error, h / 6.0 * abs(k[i] - k_new[i]) * PER_TOLERANCE[i])
    return error


def carried_error(h, x_new, k, k_new, largest):
    """How far the third-order result of `step` is off in the effects' states, over the tolerance; ``largest`` is the
    size of each so far."""
    error = 0.0
    for i in range(8, N_STATES):
        size = max(largest[i], abs(x_new[i]))
        error = max(error, h / 6.0 * abs(k[i] - k_new[i]) / (CARRIED_TOLERANCE * size + CARRIED_LEAST))
    return error


def sticks(t, x, rig, first, k, q):
    """Whether a cradle that stands is held: creeping forth the force pushes it back, and creeping back, forth."""
    free, speed = rig[3], x[4]
    was, free[0] = free[0], 1.0
    x[4] = CREEP
    slope(t, x, rig, first, k, q)
    forth = k[4]
    x[4] = -CREEP
    slope(t, x, rig, first, k, q)
    back = k[4]
    x[4], free[0] = speed, was
    return forth < 0.0 < back


def integrate(times, t, state, P, on, moving, origin, averaged, pt, pp, pc, longest, work, touching, out):
    """Carry ``state`` from time t through ``times`` and write the `state.MOTION` at each into ``out`` (n, 15), or with
    room for them all `state.OUTPUTS`.

    ``state`` is changed in place and ends as that at the last of ``times``. Rows after a state that is no longer finite
    are NaN. ``work`` (10, PADDED or N_QUANTITIES) and ``touching`` (3,) are work space.
    """
    free_step, contact_step, travel_step = step_sizes(P, on, longest)
    x_new, k1, k_new, k, stage = work[0], work[1], work[2], work[3], work[4]
    q, q_new, free, x, largest = work[5], work[6], work[7], work[8], work[9]
    for i in range(PADDED):
        x[i] = state[i] if i < N_STATES else 0.0
        k1[i] = k_new[i] = 0.0
        largest[i] = abs(x[i])
    for i in range(3):
        touching[i] = False
    for i in range(4):
        free[i] = moving[i]
    groups = groups_on(on)
    rig = (P, on, groups, free, touching, origin, averaged, pt, pp, pc)
    first, switches, refine = 0 if averaged else first_unburnt(t, P[PULSE_LENGTH], pt), 0, 1.0

    slope(t, x, rig, first, k1, q)
    for i in range(3):
        touching[i] = touches(i, P, q)
    if x[4] == 0.0 and free[0] > 0.0 and sticks(t, x, rig, first, k, q_new):
        free[0] = 0.0
    if touching[0] or touching[1] or touching[2] or free[0] != moving[0]:
        slope(t, x, rig, first, k1, q)

    for row in range(times.size):
        target = times[row]
        while t < target:
            in_contact = touching[0] or touching[1] or touching[2]
            limit = contact_step if in_contact else free_step
            if travel_step < limit * abs(x[4]):
                limit = travel_step / abs(x[4])
            if limit < SHORTEST_STEP:
                x[0] = np.nan  # ends as what left all bounds
            remaining = target - t
            if not averaged:
                while first < pt.size and pt[first] + P[PULSE_LENGTH] <= t:
                    first += 1
                wait, burns = until_pulse_edge(t, P[PULSE_LENGTH], pt, first)
                remaining = min(remaining, wait)
                if burns:
                    limit = min(limit, 0.1 * P[PULSE_LENGTH])
            h = remaining / max(math.ceil(remaining / min(limit * refine, free_step) - 1e-9), 1)

            error = step(t, h, x, k1, rig, first, x_new, k_new, q_new, k, stage)
            error = max(error, carried_error(h, x_new, k, k_new, largest))
            if error > (CONTACT_SHRINK if refine > 1.0 else SHRINK) and refine > FINEST and h > SHORTEST_STEP:
                refine *= 0.5
                continue
            if error < (GROW if refine < 1.0 else CONTACT_GROW) and refine < (CONTACT_GROWTH if in_contact else 1.0):
                refine *= 2.0

            bottom = lowest_moment(h, P, touching, q, q_new)
            if bottom < h:
                h = bottom
                step(t, h, x, k1, rig, first, x_new, k_new, q_new, k, stage)

            turns = x[4] * x_new[4] < 0.0
            if turns or switches_contact(P, q_new, touching):
                # Bisect on the step: low ends before the event, high just after it.
                low, high = 0.0, h
                while high - low > max(1e-9, 1e-6 * h):
                    middle = 0.5 * (low + high)
                    step(t, middle, x, k1, rig, first, x_new, k_new, q_new, k, stage)
                    if x[4] * x_new[4] < 0.0 or switches_contact(P, q_new, touching):
                        high = middle
                    else:
                        low = middle
                h = high
                step(t, h, x, k1, rig, first, x_new, k_new, q_new, k, stage)
                for i in range(3):
                    touching[i] = touches(i, P, q_new)
                if x[4] * x_new[4] < 0.0 and sticks(t + h, x_new, rig, first, k, q_new):
                    x_new[4] = free[0] = 0.0
                slope(t + h, x_new, rig, first, k_new, q_new)
                switches += 1
                refine = min(refine, 1.0)
                if switches > MAX_CONTACT_SWITCHES:
                    x_new[0] = np.nan
            elif moving[0] > 0.0 and free[0] == 0.0 and not sticks(t + h, x_new, rig, first, k, q_new):
                free[0] = 1.0
                slope(t + h, x_new, rig, first, k_new, q_new)

            t = target if h == target - t else t + h
            for i in range(PADDED):
                x[i], k1[i] = x_new[i], k_new[i]
                largest[i] = max(largest[i], abs(x[i]))
            for i in range(6):
                q[i] = q_new[i]
            if not abs(x[0]) + abs(x[1]) + abs(x[2]) + abs(x[3]) < BOUNDS:
                for later in range(row, times.size):
                    for i in range(out.shape[1]):
                        out[later, i] = np.nan
                state[:] = np.nan
                return
        for i in range(8):
            out[row, i] = x[i]
        for i in range(3):
            out[row, 8 + i] = q[i]
        for i in range(4):
            out[row, 11 + i] = k1[4 + i]
        if out.shape[1] > MOTION:
            see_further(t, x, rig, first, k, q_new, out[row])
    for i in range(N_STATES):
        state[i] = x[i]


def simulate_batch(times, t0, x, P, on, moving, origin, averaged, pt, pp, pc, longest, out):
    """`integrate` for each row of x (jobs, N_STATES) with its own row of P, on and origin; ``out`` is (jobs, n, 15) or
    wider."""
    work, touching = np.empty((10, max(PADDED, N_QUANTITIES))), np.zeros(3, np.bool_)
    for job in range(x.shape[0]):
        integrate(
            times, t0, x[job], P[job], on[job], moving, origin[job], averaged, pt, pp, pc, longest, work, touching,
            out[job],
        )  # fmt: skip


def simulate_pieces(times, x, offsets, P, on, moving, origin, averaged, pt, pp, pc, longest, out):
    """States at the end of each interval between ``times`` (n,) from the one in x (n−1, N_STATES) at its beginning,
    moved by each row of ``offsets`` (jobs, N_STATES): ``out`` is (n−1, jobs, 8)."""
    work, touching = np.empty((10, max(PADDED, N_QUANTITIES))), np.zeros(3, np.bool_)
    state, row = np.empty(N_STATES), np.empty((1, MOTION))
    for k in range(x.shape[0]):
        for job in range(offsets.shape[0]):
            for i in range(N_STATES):
                state[i] = x[k, i] + offsets[job, i]
            integrate(
                times[k + 1 : k + 2], times[k], state, P, on, moving, origin, averaged, pt, pp, pc, longest, work,
                touching, row,
            )  # fmt: skip
            for i in range(8):
                out[k, job, i] = row[0, i]


def linearise_pieces(times, x, offsets, P, on, moving, origin, averaged, pt, pp, pc, longest, outputs, ends):
    """Outputs at each of ``times`` (n,) and the state at the next, from the state in x (n, N_STATES) moved by each row
    of ``offsets`` (jobs, N_STATES) under its row of P: ``outputs`` is (n, jobs, 15) or wider, ``ends`` (n, jobs,
    N_STATES); the last piece has no length."""
    work, touching = np.empty((10, max(PADDED, N_QUANTITIES))), np.zeros(3, np.bool_)
    state, rows, ends_of = np.empty(N_STATES), np.empty((2, outputs.shape[2])), np.empty(2)
    for k in range(x.shape[0]):
        ends_of[0] = times[k]
        ends_of[1] = times[min(k + 1, x.shape[0] - 1)]
        for job in range(offsets.shape[0]):
            for i in range(N_STATES):
                state[i] = x[k, i] + offsets[job, i]
            integrate(
                ends_of, times[k], state, P[job], on, moving, origin, averaged, pt, pp, pc, longest, work, touching,
                rows,
            )  # fmt: skip
            for i in range(outputs.shape[2]):
                outputs[k, job, i] = rows[0, i]
            for i in range(N_STATES):
                ends[k, job, i] = state[i]


def observe_touching(t, x, P, on, groups, moving, touching, origin, averaged, pulse, dx, q):
    """`observe` without details, contact decided from the state itself."""
    touches_now = False
    for i in range(3):
        touching[i] = False
    observe(t, x, P, on, groups, moving, touching, origin, averaged, pulse, dx, q, False)
    for i in range(3):
        touching[i] = touches(i, P, q)
        touches_now = touches_now or touching[i]
    if touches_now:
        observe(t, x, P, on, groups, moving, touching, origin, averaged, pulse, dx, q, False)


def forced_pieces(times, x, P, on, moving, origin, averaged, pulses, pt, pp, pc, outputs, changes):
    """What `linearise_pieces` gives, from the forces at both ends of each piece instead of an integration: for effects
    without states, outside contact.

    ``pulses`` (n,) is the mean of `current` over each piece (A). ``outputs`` (n, jobs, 15 or more) are those at each of
    ``times``; ``changes`` (n, jobs, 8) are what accelerations that change linearly from one end to the other do to
    places and rates until the next; the last piece has no length."""
    touching, groups = np.zeros(3, np.bool_), groups_on(on)
    dx, q = np.empty(max(PADDED, 8)), np.empty(N_QUANTITIES)
    last = x.shape[0] - 1
    for k in range(last + 1):
        span = times[min(k + 1, last)] - times[k]
        pulse = current(times[k], x[k, 0], P[0], averaged, pt, pp, pc, 0)
        for job in range(P.shape[0]):
            row = outputs[k, job]
            observe_touching(times[k], x[k], P[job], on, groups, moving, touching, origin, averaged, pulse, dx, q)
            for i in range(8):
                row[i] = x[k, i]
            for i in range(3):
                row[8 + i] = q[i]
            for i in range(4):
                row[11 + i] = dx[4 + i]
            if outputs.shape[2] > MOTION:
                observe(
                    times[k], x[k], P[job], on, groups, moving, touching, origin, averaged, pulse, dx[:N_STATES], q,
                    True,
                )  # fmt: skip
                for i in range(outputs.shape[2] - MOTION):
                    row[MOTION + i] = q[FURTHER + i]
            for end in range(2):
                at = min(k + end, last)
                if end == 1 or pt.size > 0:
                    observe_touching(
                        times[at], x[at], P[job], on, groups, moving, touching, origin, averaged, pulses[k], dx, q
                    )
                for i in range(4):
                    place, rate = (span * span / 6.0, 0.5 * span) if end == 1 else (span * span / 3.0, 0.5 * span)
                    changes[k, job, i] = place * dx[4 + i] + (changes[k, job, i] if end == 1 else 0.0)
                    changes[k, job, 4 + i] = rate * dx[4 + i] + (changes[k, job, 4 + i] if end == 1 else 0.0)


def evaluate(t, x, P, on, moving, origin, averaged, pt, pp, pc, dx, q):
    """Derivative and all named quantities at one moment, contact decided from the state itself."""
    touching, groups = np.zeros(3, np.bool_), groups_on(on)
    pulse = current(t, x[0], P, averaged, pt, pp, pc, 0)
    for detail in (False, True):
        observe(t, x, P, on, groups, moving, touching, origin, averaged, pulse, dx, q, detail)
        for i in range(3):
            touching[i] = touches(i, P, q)
