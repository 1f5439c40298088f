# SPDX-License-Identifier: Apache-2.0
"""The scores of a table beside something known, against the least squares that they stand for."""

import numpy as np
import pytest

from inductrack_ros.estimation.scores import WIDE, Background, Level, Scores


def test_a_table_beside_a_known_effect_is_the_joint_least_squares():
    rng = np.random.default_rng(7)
    nuisance, known, table = (rng.standard_normal((80, k)) for k in (2, 1, 5))
    residual = rng.standard_normal(80) + known[:, 0] * 0.4 + table @ np.linspace(-0.3, 0.3, 5)
    w = np.column_stack([residual, nuisance, known, table])
    power = np.zeros(4)
    level = Level(power, Background(power, (), 2.0), w.T @ w, 11.0)
    places = {"drag": np.array([0]), "table": np.arange(1, 6)}
    anywhere = np.tile([-np.inf, np.inf], (6, 1))
    found = Scores(2, np.eye(2) * 1e-6, np.zeros(2), places, (level,), anywhere).beside(level, "drag", "table")
    free = np.column_stack([nuisance, known])
    prior = np.diag([1e-3, 1e-3, 1 / WIDE])
    alone = np.linalg.lstsq(np.vstack([free, prior]), np.r_[-residual, np.zeros(3)], rcond=None)
    assert found.deviance == pytest.approx(alone[1][0] + 11.0 + 2.0)
    assert found.size == pytest.approx(alone[0][2:])
    wide = np.block([[free, table], [prior, np.zeros((3, 5))]])
    both, left, *_ = np.linalg.lstsq(wide, np.r_[-residual, np.zeros(3)], rcond=None)
    values = np.linalg.solve(found.gram, found.score)
    assert values == pytest.approx(both[3:])
    assert found.size - found.moves @ values == pytest.approx(both[2:3])
    assert found.deviance - found.score @ values == pytest.approx(left[0] + 13.0)
