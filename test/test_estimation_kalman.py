# SPDX-License-Identifier: Apache-2.0
"""The linear filter and smoother against the same system written out as one dense Gaussian."""

from dataclasses import replace

import numpy as np
import pytest

from inductrack_ros.estimation.kalman import LinearRun, log_determinant, run_filter, run_smoother

NODES, STATES, PER_NODE, PARAMETERS = 7, 8, 3, 2


@pytest.fixture
def run() -> LinearRun:
    rng = np.random.default_rng(0)
    m = NODES * PER_NODE
    return LinearRun(
        first=np.arange(0, m + 1, PER_NODE),
        sensitivity=rng.standard_normal((m, STATES)),
        data=rng.standard_normal((m, 1 + PARAMETERS)),
        variance=rng.uniform(0.5, 2.0, m),
        transitions=np.eye(STATES) + 0.1 * rng.standard_normal((NODES, STATES, STATES)),
        inputs=rng.standard_normal((NODES, STATES, 1 + PARAMETERS)),
        spacing=rng.uniform(0.5, 1.0, NODES),
        start_root=np.diag(rng.uniform(1.0, 2.0, STATES)),
        start_mean=rng.standard_normal((STATES, 1 + PARAMETERS)),
        kicks=rng.uniform(0.1, 0.3, (NODES, STATES)) * (np.arange(STATES) >= 6),
        touching=np.zeros(NODES, bool),
        late=np.zeros((m, 4)),
        struck=np.ones(m, bool),
    )


def white_acceleration(power: np.ndarray, T: float) -> np.ndarray:
    """Covariance (8, 8) of what white accelerations do in T seconds."""
    Q = np.zeros((8, 8))
    for c, q in enumerate(power):
        Q[np.ix_([c, 4 + c], [c, 4 + c])] = q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    return Q


def of_one_channel(linear: LinearRun) -> np.ndarray:
    return np.zeros(len(linear.variance), int)


def dense(run: LinearRun, power: np.ndarray):
    """Covariance (m, m) of the readings, their means' columns (m, c), and of each node: mean (8, c) and covariance with
    the readings (8, m); ``power`` is (4,), or (NODES, 4) where it differs from node to node."""
    powers = np.broadcast_to(power, (NODES, 4))
    means, roots = [run.start_mean], [np.hstack([run.start_root, np.zeros((8, 8 * (NODES - 1)))])]
    for k in range(NODES - 1):
        values, vectors = np.linalg.eigh(white_acceleration(powers[k], run.spacing[k]) + np.diag(run.kicks[k]))
        root = run.transitions[k] @ roots[-1]
        root[:, 8 * (k + 1) : 8 * (k + 2)] += vectors * np.sqrt(np.maximum(values, 0.0))
        means.append(run.transitions[k] @ means[-1] + run.inputs[k])
        roots.append(root)
    rows = [slice(run.first[k], run.first[k + 1]) for k in range(NODES)]
    H = np.vstack([run.sensitivity[r] @ root for r, root in zip(rows, roots, strict=True)])
    left = np.vstack([run.data[r] - run.sensitivity[r] @ mean for r, mean in zip(rows, means, strict=True)])
    return H @ H.T + np.diag(run.variance), left, means, [root @ H.T for root in roots]


@pytest.mark.parametrize("power", [[0.1, 0.2, 0.0, 0.4], [0.0] * 4], ids=["shaken", "deterministic"])
def test_innovations_whiten_every_column(run, power):
    power = np.array(power)
    covariance, left, _, _ = dense(run, power)
    filtered = run_filter(run, power)
    whitened, determinant = filtered.scored(run), log_determinant(filtered.tally(run, of_one_channel(run), 1))
    assert whitened.T @ whitened == pytest.approx(left.T @ np.linalg.solve(covariance, left), rel=1e-9)
    assert determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-9)


@pytest.mark.parametrize("power", [[0.1, 0.2, 0.0, 0.4], [0.0] * 4], ids=["shaken", "deterministic"])
def test_the_smoother_is_the_conditional_mean(run, power):
    power, theta = np.array(power), np.array([0.3, -0.2])
    covariance, left, means, cross = dense(run, power)
    weights = np.array([1.0, *theta])
    told = np.linalg.solve(covariance, left @ weights)
    smoothed = run_smoother(run, run_filter(run, power), theta)
    for k in range(NODES):
        assert smoothed.deviations[k] == pytest.approx(means[k] @ weights + cross[k] @ told, abs=1e-9)


@pytest.mark.parametrize("contact", [[], [2, 3]], ids=["free", "touching"])
def test_found_less_expected_is_the_slope_of_the_likelihood(run, contact):
    """By the power without a contact, but for surge, which goes on in one."""
    power, theta = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.3, -0.2])
    weights = np.array([1.0, *theta])
    run = replace(run, touching=np.isin(np.arange(NODES), contact))
    told = ~run.touching[:, None] | (np.arange(4) == 0)

    def twice_log_likelihood(q: np.ndarray) -> float:
        covariance, left, _, _ = dense(run, q)
        r = left @ weights
        return -np.linalg.slogdet(covariance)[1] - r @ np.linalg.solve(covariance, r)

    smoothed = run_smoother(run, run_filter(run, power), theta)
    h = 1e-5
    steps = [h * told * e for e in np.eye(4)]
    slopes = [(twice_log_likelihood(power + e) - twice_log_likelihood(power - e)) / (2 * h) for e in steps]
    assert smoothed.of_power[0] - smoothed.of_power[1] == pytest.approx(slopes, rel=1e-5)


def test_the_slopes_by_kicks_starts_and_readings(run):
    power, theta, h = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.3, -0.2]), 1e-5
    weights = np.array([1.0, *theta])

    def twice_log_likelihood(changed: LinearRun) -> float:
        covariance, left, _, _ = dense(changed, power)
        r = left @ weights
        return -np.linalg.slogdet(covariance)[1] - r @ np.linalg.solve(covariance, r)

    def larger_state(a: int, by: float) -> LinearRun:
        factor = np.where(np.arange(STATES) == a, by, 1.0)
        return replace(run, kicks=run.kicks * factor, start_root=run.start_root * np.sqrt(factor)[:, None])

    def larger_reading(j: int, by: float) -> LinearRun:
        return replace(run, variance=run.variance * np.where(np.arange(len(run.variance)) == j, by, 1.0))

    smoothed = run_smoother(run, run_filter(run, power), theta)
    for larger, told in ((larger_state, smoothed.of_states), (larger_reading, smoothed.of_readings)):
        for k in range(told.shape[1]):
            slope = (twice_log_likelihood(larger(k, 1 + h)) - twice_log_likelihood(larger(k, 1 - h))) / (2 * h)
            assert told[0, k] - told[1, k] == pytest.approx(slope, rel=1e-5, abs=1e-7)


def test_of_a_run_kept_in_step_variances_are_charged_as_if_its_pulses_came_with_the_cradle(run):
    """What is left is as it was; the determinant is that of a run in which surge changes nothing else. What is found
    less what is expected is the slope of both, by the power and by the readings' variances."""
    power, theta, h = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.3, -0.2]), 1e-5
    weights, transitions = np.array([1.0, *theta]), run.transitions.copy()
    transitions[:, :, 0] = np.eye(STATES)[0]
    paced = replace(run, paced=True)
    filtered = run_filter(paced, power)
    assert np.array_equal(filtered.whitened, run_filter(run, power).whitened)
    charged = np.linalg.slogdet(dense(replace(run, transitions=transitions), power)[0])[1]
    assert charged != pytest.approx(np.linalg.slogdet(dense(run, power)[0])[1], abs=0.01)
    assert log_determinant(filtered.tally(paced, of_one_channel(run), 1)) == pytest.approx(charged, rel=1e-9)

    def less_deviance(q: np.ndarray, variance: np.ndarray) -> float:
        covariance, left, _, _ = dense(replace(run, variance=variance), q)
        in_step = dense(replace(run, variance=variance, transitions=transitions), q)[0]
        r = left @ weights
        return -np.linalg.slogdet(in_step)[1] - r @ np.linalg.solve(covariance, r)

    smoothed = run_smoother(paced, filtered, theta)
    found, V = smoothed.of_power[0] - smoothed.of_power[1], run.variance
    for c, step in enumerate(h * np.eye(4)):
        slope = (less_deviance(power + step, V) - less_deviance(power - step, V)) / (2 * h)
        assert found[c] == pytest.approx(slope, rel=1e-5)
    for j in range(len(V)):
        step = h * V * (np.arange(len(V)) == j)
        slope = (less_deviance(power, V + step) - less_deviance(power, V - step)) / (2 * h)
        assert smoothed.of_readings[0, j] - smoothed.of_readings[1, j] == pytest.approx(slope, rel=1e-5, abs=1e-7)


def test_a_reading_that_does_not_count_costs_what_others_of_its_channel_do(run):
    """Over many data of noise alone the cost is the same on average, whichever nodes touch, however stiff they are."""
    rng, power = np.random.default_rng(5), np.zeros(4)
    one = lambda a: np.tile(a[:1], (NODES, *[1] * (a.ndim - 1)))  # noqa: E731
    still = replace(
        run, first=np.arange(NODES + 1), sensitivity=one(run.sensitivity), variance=one(run.variance),
        transitions=np.tile(0.5 * np.eye(STATES), (NODES, 1, 1)), start_root=np.eye(STATES) / np.sqrt(0.75),
        kicks=np.ones((NODES, STATES)), start_mean=np.zeros_like(run.start_mean), inputs=np.zeros_like(run.inputs),
        struck=np.ones(NODES, bool), late=np.zeros((NODES, 4)),
    )  # fmt: skip
    covariance = dense(replace(still, data=np.zeros((NODES, 1 + PARAMETERS))), power)[0]
    half = replace(still, touching=np.arange(NODES) < NODES // 2)
    stiff = replace(half, transitions=np.where(half.touching[:, None, None], 0.1, 1.0) * half.transitions)
    apart = []
    for _ in range(400):
        data = np.linalg.cholesky(covariance) @ rng.standard_normal((NODES, 1 + PARAMETERS))
        costs = []
        for linear in (still, half, stiff):
            filtered = run_filter(replace(linear, data=data), power)
            rest = log_determinant(filtered.tally(linear, of_one_channel(linear), 1))
            costs.append((filtered.scored(linear) ** 2).sum(axis=0) + rest)
        apart.append([costs[0] - costs[1], costs[0] - costs[2]])
    apart = np.array(apart).transpose(1, 0, 2).reshape(2, -1)
    assert (np.abs(apart.mean(axis=1)) < 4 * apart.std(axis=1) / np.sqrt(apart.shape[1]) + 0.2).all()
    assert (apart.std(axis=1) > 1.0).all()


def test_where_fits_agree_on_a_contact_its_readings_cost_nothing(run):
    """Neither do they tell of the noise, whatever a trajectory says of a contact."""
    contact = np.arange(NODES) < 3
    some = replace(run, contact=contact, touching=~contact)
    filtered = run_filter(some, np.zeros(4))
    counts = some.scored
    assert counts.sum() == (NODES - 3) * PER_NODE
    rest = log_determinant(filtered.tally(some, of_one_channel(some), 1))
    assert rest == pytest.approx(np.log(filtered.variances[counts]).sum())
    assert (run_smoother(some, filtered, np.zeros(PARAMETERS)).counts == counts).all()


def test_a_state_that_is_known_all_but_exactly(run):
    """Squares of what is left of it underflow; it is as one that is known exactly."""
    tiny, exact = run.start_root.copy(), run.start_root.copy()
    tiny[-2:, -2:], exact[-2:, -2:] = [[-2e-155, 0.0], [3e-155, 1e-156]], 0.0
    kicks = np.zeros_like(run.kicks)
    kicks[-2, 0] = 0.1  # so that every node is made triangular, most with nothing new
    still = replace(run, kicks=kicks, transitions=np.tile(np.eye(STATES), (NODES, 1, 1)))
    nearly, wholly = (run_filter(replace(still, start_root=root), np.zeros(4)) for root in (tiny, exact))
    assert np.isfinite(nearly.roots).all()
    np.testing.assert_allclose(nearly.innovations, wholly.innovations, rtol=1e-12)
    np.testing.assert_allclose(nearly.variances, wholly.variances, rtol=1e-12)
