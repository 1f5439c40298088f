# SPDX-License-Identifier: Apache-2.0
"""What the sensors make of a run, sample by sample: the loops that `sensor_kernel` compiles with the effects' calls.

A channel's reading at the time t is found in four steps. The effects that change the time say when what is read was
true. What was true then is interpolated from the run. The effects of several channels mix them. The effects of the
channel itself change the reading, one after the other. ``plan`` lists them, a row (kind, effect, where its
parameters begin in p, where its states begin in x) for each.

States follow the exponential scheme of `follow`. It is exact where their rates are linear in them and their input is a
parabola between two points of the grid. So a time constant of nanoseconds takes no more steps than one of seconds.
"""

# ruff: noqa: F821
# pyright: reportUndefinedVariable=false
import math

import numpy as np

SHIFT, MIX, ALTER = 0, 1, 2
TERMS = 18  # of the exponential's series, for matrices of norm below a half


def interval(s, grid):
    """Index k of the interval of the grid in which s lies, the first or the last where it lies outside."""
    low, high = 0, grid.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if grid[middle] <= s:
            low = middle
        else:
            high = middle
    return low


def true_value(s, k, grid, run, c):
    """Column c of a run (n, w) at s in interval k: cubic where its slope is simulated, a parabola for gaps, else
    linear."""
    if grid.size == 1 or s == grid[k]:
        return run[k, c]
    h = grid[k + 1] - grid[k]
    x = (s - grid[k]) / h
    if x == 1.0:
        return run[k + 1, c]
    a, b = run[k, c], run[k + 1, c]
    if c < 8:
        slope = 4 + c if c < 4 else 7 + c
        da, db = run[k, slope] * h, run[k + 1, slope] * h
        return a + x * (da + x * (3.0 * (b - a) - 2.0 * da - db + x * (2.0 * (a - b) + da + db)))
    line = a + x * (b - a)
    if c < 11 and k > 0:
        before = grid[k] - grid[k - 1]
        bend = ((b - a) / h - (a - run[k - 1, c]) / before) / (h + before)
        line += bend * (s - grid[k]) * (s - grid[k + 1])
    return line


def reading(t, x, dx, fresh, rig, run, p, P, row, seen):
    """The reading at time t with states x, whose rates go to dx; ``fresh`` sets the states where they start.

    Before the run began, what is read stood as it began. Not a number where nobody knows the truth: before the run
    unless ``held``, and after it.
    """
    plan, columns, column, grid, margin, held = rig
    s = t
    for j in range(plan.shape[0]):
        if plan[j, 0] == SHIFT:
            s = shifted(plan[j, 1], p, plan[j, 2], s, t, P)
    unknown = s > grid[grid.size - 1] + margin
    if s < grid[0] - margin:
        unknown = not held
        s = grid[0]
    k = interval(s, grid)
    for j in range(columns.size):
        row[columns[j]] = seen[columns[j]] = true_value(s, k, grid, run, columns[j])
    for j in range(plan.shape[0]):
        if plan[j, 0] == MIX:
            mixed(plan[j, 1], p, plan[j, 2], s, row, seen, P)
    measured = seen[column]
    for j in range(plan.shape[0]):
        if plan[j, 0] == ALTER:
            if fresh:
                started(plan[j, 1], x, plan[j, 3], measured, row)
            measured = altered(plan[j, 1], p, plan[j, 2], x, plan[j, 3], t, measured, row, P, dx)
    return math.nan if unknown else measured


def phi(z):
    """φ_1, φ_2, φ_3 of a number: φ_1 = (e^z − 1)/z, φ_{k+1} = (φ_k − 1/k!)/z."""
    if abs(z) > 0.5:
        one = math.expm1(z) / z
        two = (one - 1.0) / z
        return one, two, (two - 0.5) / z
    three = 0.0
    for j in range(12, -1, -1):
        three = three * z / (j + 4.0) + 1.0
    three /= 6.0
    two = 0.5 + z * three
    return 1.0 + z * two, two, three


def phi_sum(J, h, b1, b2, b3, out, A, B, C):
    """``out`` = φ_1(hJ) b1 + φ_2(hJ) b2 + φ_3(hJ) b3, from one exponential of a matrix (Al-Mohy and Higham 2011,
    theorem 2.1)."""
    n = b1.size
    if n == 1:
        one, two, three = phi(h * J[0, 0])
        out[0] = one * b1[0] + two * b2[0] + three * b3[0]
        return
    size, norm = n + 3, 0.0
    for i in range(size):
        total = 0.0
        for j in range(size):
            A[i, j] = 0.0
            if i < n and j < n:
                A[i, j] = h * J[i, j]
                total += abs(A[i, j])
        norm = max(norm, total)
    for i in range(n):
        A[i, n], A[i, n + 1], A[i, n + 2] = b3[i], b2[i], b1[i]
    A[n, n + 1] = A[n + 1, n + 2] = 1.0
    halvings = 1 if norm < 1.0 else 2 + int(math.ceil(np.log2(norm)))
    part = 0.5**halvings
    for i in range(size):
        for j in range(size):
            B[i, j] = 1.0 if i == j else 0.0
    for term in range(TERMS, 0, -1):  # Horner: B = 1 + A B / term
        multiply(A, B, C, size, part / term)
        for i in range(size):
            for j in range(size):
                B[i, j] = C[i, j] + (1.0 if i == j else 0.0)
    for _ in range(halvings):
        multiply(B, B, C, size, 1.0)
        for i in range(size):
            for j in range(size):
                B[i, j] = C[i, j]
    for i in range(n):
        out[i] = B[i, n + 2]


def multiply(A, B, C, size, factor):
    """C = factor · A B."""
    for i in range(size):
        for j in range(size):
            total = 0.0
            for k in range(size):
                total += A[i, k] * B[k, j]
            C[i, j] = factor * total


def follow(t, h, x, rig, run, p, P, work, matrices, row, seen):
    """Carry the states x from t to t + h.

    J is the rates' derivative by x at t, and g = rates − J x, which depends on time alone where the rates are linear.
    The parabola through g at the beginning, the middle and the end is integrated exactly:

        x(t + h) = x + h (φ_1(hJ) f_0 + φ_2(hJ) (−3 g_0 + 4 g_m − g_1) + φ_3(hJ) 4 (g_0 − 2 g_m + g_1))

    Where the rates are not linear, g_m and g_1 are taken at states that a step of the first order predicts.
    """
    f0, rates, moved, b2, b3, none = work[0], work[1], work[2], work[3], work[4], work[5]
    J, A, B, C = matrices[0], matrices[1], matrices[2], matrices[3]
    n = x.size
    for i in range(n):
        none[i] = b2[i] = b3[i] = 0.0
    for stage in range(n + 3):  # at x, at x with each state moved in turn, in the middle, at the end
        ahead = 0.0 if stage <= n else 0.5 * h if stage == n + 1 else h
        if stage > n:
            phi_sum(J, ahead, f0, none, none, moved, A, B, C)
        for i in range(n):
            moved[i] = x[i] + (ahead * moved[i] if stage > n else 0.0)
        nudge = 0.0
        if 0 < stage <= n:
            nudge = max(1e-6 * abs(x[stage - 1]), 1e-9)
            moved[stage - 1] += nudge
        reading(t + ahead, moved, f0 if stage == 0 else rates, h < 0.0, rig, run, p, P, row, seen)
        for i in range(n):
            if 0 < stage <= n:
                J[i, stage - 1] = (rates[i] - f0[i]) / nudge
            elif stage > n:
                for j in range(n):  # J x is taken from f_0 too, for only differences count
                    rates[i] -= J[i, j] * (moved[j] - x[j])
                b2[i] += (4.0 if stage == n + 1 else -1.0) * (rates[i] - f0[i])
                b3[i] += (-8.0 if stage == n + 1 else 4.0) * (rates[i] - f0[i])
    phi_sum(J, h, f0, b2, b3, moved, A, B, C)
    for i in range(n):
        x[i] += h * moved[i]


def read(at, grid, runs, which, p, P, plan, columns, column, begin, x, margin, held, out):
    """One channel's readings ``out`` (j, m) at the times ``at`` (m,), rising, for each job.

    ``runs`` (u, n, w) are true at ``grid`` (n,); job j reads run ``which[j]`` with its own rows of p and P. The states
    x (j, s) are those at ``begin``, or start afresh at the grid's beginning where that is not a number; they end as
    those at the last of ``at``."""
    n = x.shape[1]
    row, seen, dx = np.zeros(runs.shape[2]), np.zeros(runs.shape[2]), np.zeros(max(n, 1))
    work, matrices = np.zeros((6, n)), np.zeros((4, n + 3, n + 3))
    rig = (plan, columns, column, grid, margin, held)
    for job in range(which.size):
        run, state = runs[which[job]], x[job]
        fresh = n > 0 and math.isnan(begin)
        t, k = grid[0] if fresh else begin, 0
        if fresh:
            reading(t, state, dx, fresh, rig, run, p[job], P[job], row, seen)
            fresh = False
        for m in range(at.size):
            while n > 0 and t < at[m]:
                while k < grid.size and grid[k] <= t:
                    k += 1
                until = min(grid[k], at[m]) if k < grid.size else at[m]
                follow(t, until - t, state, rig, run, p[job], P[job], work, matrices, row, seen)
                t = until
            out[job, m] = reading(at[m], state, dx, fresh, rig, run, p[job], P[job], row, seen)
