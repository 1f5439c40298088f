# SPDX-License-Identifier: Apache-2.0
"""Runs side by side, each in a lane of the processor's vector registers, for as long as they fly.

`lane_kernel` puts this file's text behind a right-hand side in which every quantity is a row of LANES numbers in one
array ``work``: `slopes`, which takes STAGE and WHEN to SLOPE and GAPS. These rows' names come from there. Constant
places in one array, no branch and no call are what the compiler needs to do all lanes at once; so exp, sin and cos are
arithmetic here. ``own`` (LANES, parameters) are the parameters of each lane, for tables. Method and steps are those of
`integrator`, with a step and its refinement for each lane.

A run that comes near the track, stands or turns is given back as it was at the last row with steps of normal length,
where `integrate` begins: so the result is the same."""

# ruff: noqa: F821
# pyright: reportUndefinedVariable=false
import math

import numpy as np

#: A register of 512 bits holds 8 numbers, one of 256 half of them.
LANES = 8
#: Rows of ``work`` for each state; each step's size stands there as often, once to a state.
STATE_ROWS = ("STAGE", "SLOPE", "STATE", "FIRST", "NEXT", "THIRD", "SIZE", "ERROR", "LARGEST")
#: Its other rows, one each: the time of a state, of the stage, and where its run began; the longest step and travel.
ROWS = ("TIME", "WHEN", "BEGAN", "REFINE", "LONGEST", "TRAVEL", "FLIES")
CLEAR, FAR = 5e-4, 1.0  # m, of gaps (and rad, of roll): nearer is too near to the track, further is out of range
ROUND = 1.5 * 2.0**52  # a number to which this is added has its integer part in its last bits


def lane_exp(x):
    """e^x within two units in the last place, by its series about the nearest multiple of ln 2; x is cut off at
    ±700."""
    x = min(max(x, -700.0), 700.0)
    shifted = x * 1.4426950408889634 + ROUND
    n = shifted - ROUND
    r = (x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10  # ln 2 in two parts
    total = 1.0 / 6227020800.0
    total = total * r + 1.0 / 479001600.0
    total = total * r + 1.0 / 39916800.0
    total = total * r + 1.0 / 3628800.0
    total = total * r + 1.0 / 362880.0
    total = total * r + 1.0 / 40320.0
    total = total * r + 1.0 / 5040.0
    total = total * r + 1.0 / 720.0
    total = total * r + 1.0 / 120.0
    total = total * r + 1.0 / 24.0
    total = total * r + 1.0 / 6.0
    total = total * r + 0.5
    total = total * r * r + r + 1.0
    return total * np.int64((np.float64(shifted).view(np.int64) + 1023) << 52).view(np.float64)


def lane_sine(x, quarters):
    """sin(x + quarters·π/2) to within 2.3e-16 for abs(x) up to 1000; constants of fdlibm, which the C libraries use."""
    shifted = x * (2.0 / math.pi) + ROUND
    n = shifted - ROUND
    quadrant = np.float64(shifted).view(np.int64) + quarters
    r = ((x - n * 1.57079632673412561417) - n * 6.07710050630396597660e-11) - n * 2.02226624879595063154e-21
    z = r * r
    odd = (
        (
            ((1.58969099521155010221e-10 * z - 2.50507602534068634195e-08) * z + 2.75573137070700676789e-06) * z
            - 1.98412698298579493134e-04
        )
        * z
        + 8.33333333332248946124e-03
    ) * z - 1.66666666666666324348e-01
    even = (
        (
            ((-1.13596475577881948265e-11 * z + 2.08757232129817482790e-09) * z - 2.75573143513906633035e-07) * z
            + 2.48015872894767294178e-05
        )
        * z
        - 1.38888888888741095749e-03
    ) * z + 4.16666666666666019037e-02
    value = 1.0 - 0.5 * z + z * z * even if quadrant & 1 else r + r * z * odd
    return -value if quadrant & 2 else value


def lane_sin(x):
    return lane_sine(x, 0)


def lane_cos(x):
    return lane_sine(x, 1)


def lane_steps(work, own, moving):
    """`integrator.step` in every lane: from STATE, whose slope is FIRST, by SIZE to NEXT with SLOPE and GAPS; its
    ERROR."""
    for i in range(N_STATES * LANES):
        h, x, k = work[SIZE + i], work[STATE + i], work[FIRST + i]
        work[NEXT + i] = x + h / 6.0 * k
        work[STAGE + i] = x + 0.5 * h * k
    for s in range(4):
        for lane in range(LANES):
            work[WHEN + lane] = work[TIME + lane] + (1.0 if s >= 2 else 0.5) * work[SIZE + lane]
        slopes(work, own, moving)
        if s == 3:
            break
        part = 6.0 if s == 2 else 3.0
        ahead = 1.0 if s == 1 else 0.5
        for i in range(N_STATES * LANES):
            h, k = work[SIZE + i], work[SLOPE + i]
            x_new = work[NEXT + i] + h / part * k
            work[NEXT + i] = x_new
            work[THIRD + i] = k
            work[STAGE + i] = x_new if s == 2 else work[STATE + i] + ahead * h * k
    for i in range(N_STATES * LANES):
        work[ERROR + i] = work[SIZE + i] / 6.0 * abs(work[THIRD + i] - work[SLOPE + i])


def leaves(work, lane):
    """Whether a lane's step is one for `integrate`. Said so that what is not a number leaves too."""
    for i in range(3):
        if not CLEAR < work[GAPS + i * LANES + lane] < FAR:
            return True
    surge, roll, speed = NEXT + lane, NEXT + 3 * LANES + lane, 4 * LANES + lane
    return not (abs(work[surge]) < BOUNDS and abs(work[roll]) < FAR and work[STATE + speed] * work[NEXT + speed] > 0.0)


def fly(times, began, x, P, moving, out, done):
    """Carry runs x (jobs, N_STATES) with parameters P from time ``began`` through ``times``; outputs as `integrate`'s
    in ``out``.

    Gives back in ``done`` (jobs,) how many rows stand for each, and in ``x`` the state at the last of them.
    """
    work, own, on = np.zeros(WORK), np.empty((LANES, P.shape[1])), np.ones(MAX_STEPS.size, np.bool_)
    for first in range(0, x.shape[0], LANES):
        jobs = min(LANES, x.shape[0] - first)
        for lane in range(LANES):  # the last group is filled up with copies that do not fly
            job = first + min(lane, jobs - 1)
            own[lane] = P[job]
            for i in range(GAPS // LANES):
                work[i * LANES + lane] = P[job, i]
            for i in range(N_STATES):
                at = i * LANES + lane
                work[STATE + at] = work[NEXT + at] = work[STAGE + at] = x[job, i]
                work[LARGEST + at] = abs(x[job, i])
            work[TIME + lane] = work[WHEN + lane] = began
            work[BEGAN + lane], work[REFINE + lane], work[FLIES + lane] = x[job, 0], 1.0, 0.0
            work[LONGEST + lane], _, work[TRAVEL + lane] = step_sizes(P[job], on, 1.0)
        slopes(work, own, moving)
        for i in range(N_STATES * LANES):
            work[FIRST + i] = work[SLOPE + i]
        flying = 0
        for lane in range(jobs):
            done[first + lane] = 0
            if not leaves(work, lane):
                work[FLIES + lane] = 1.0
                flying += 1

        for row in range(times.size):
            target = times[row]
            while flying:
                waits = False
                for lane in range(LANES):
                    remaining = (target - work[TIME + lane]) * work[FLIES + lane]
                    limit = min(
                        work[LONGEST + lane], work[TRAVEL + lane] / max(abs(work[STATE + 4 * LANES + lane]), 1e-9)
                    )
                    limit = min(limit * work[REFINE + lane], work[LONGEST + lane])
                    h = remaining / max(math.ceil(remaining / limit - 1e-9), 1)
                    waits = waits or h > 0.0
                    for i in range(0, N_STATES * LANES, LANES):
                        work[SIZE + i + lane] = h
                if not waits:
                    break
                lane_steps(work, own, moving)
                for lane in range(jobs):
                    h, t, refine, error = work[SIZE + lane], work[TIME + lane], work[REFINE + lane], 0.0
                    if h == 0.0:
                        continue
                    for i in range(8):
                        error = max(error, work[ERROR + i * LANES + lane] * PER_TOLERANCE[i])
                    for i in range(8, N_STATES):  # as in `carried_error`
                        at = i * LANES + lane
                        size = max(work[LARGEST + at], abs(work[NEXT + at]))
                        error = max(error, work[ERROR + at] / (CARRIED_TOLERANCE * size + CARRIED_LEAST))
                    if leaves(work, lane):
                        work[FLIES + lane] = 0.0
                        flying -= 1
                    elif error > SHRINK and refine > FINEST and h > SHORTEST_STEP:
                        work[REFINE + lane] = 0.5 * refine
                        for i in range(lane, N_STATES * LANES, LANES):
                            work[NEXT + i], work[SLOPE + i] = work[STATE + i], work[FIRST + i]
                    else:
                        work[TIME + lane] = target if h == target - t else t + h
                        if error < GROW and refine < 1.0:
                            work[REFINE + lane] = 2.0 * refine
                for i in range(N_STATES * LANES):
                    work[STATE + i], work[FIRST + i] = work[NEXT + i], work[SLOPE + i]
                    work[LARGEST + i] = max(work[LARGEST + i], abs(work[STATE + i]))
            for lane in range(jobs):
                if work[FLIES + lane] > 0.0:
                    for i in range(8):
                        out[first + lane, row, i] = work[STATE + i * LANES + lane]
                    for i in range(3):
                        out[first + lane, row, 8 + i] = work[GAPS + i * LANES + lane]
                    for i in range(4):
                        out[first + lane, row, 11 + i] = work[FIRST + (4 + i) * LANES + lane]
                    if work[REFINE + lane] == 1.0 or row == times.size - 1:
                        done[first + lane] = row + 1
                        for i in range(N_STATES):
                            x[first + lane, i] = work[STATE + i * LANES + lane]
