# SPDX-License-Identifier: Apache-2.0
"""Idea: a fit names one of the parameter sets that do the same, and it does do the same."""

import numpy as np
import pytest

from inductrack_ros.core.model import Model
from inductrack_ros.estimation.structure import Structure


def test_a_wave_is_named_by_a_positive_amplitude():
    model = Model.create(effects={"guideway_waviness": {"amplitude": 1e-4, "wavelength": 0.7, "phase": 0.3}})
    structure = Structure(model, tuple(f"guideway_waviness.{p}" for p in ("amplitude", "wavelength", "phase")))
    theta = structure.encode([-2e-4, 0.7, 4.0])
    values = structure.decode(theta)
    assert values["guideway_waviness.amplitude"] == pytest.approx(2e-4)
    assert values["guideway_waviness.phase"] == pytest.approx(4.0 - np.pi)
    times = np.linspace(0, 0.3, 50)
    named = structure.with_theta(theta)
    meant = model.with_changes(effects={"guideway_waviness": {"amplitude": -2e-4, "wavelength": 0.7, "phase": 4.0}})
    start = model.initial_state(surge_rate=17.0)
    assert named.simulate(times, start)["heave"] == pytest.approx(meant.simulate(times, start)["heave"], abs=1e-12)
