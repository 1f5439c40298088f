# SPDX-License-Identifier: Apache-2.0
"""The bands that `compare` draws: how far predictions are open by what is known of the parameters."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from test_compare import NOISE, make_campaign

from inductrack_ros import cli
from inductrack_ros.compare import compare
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import STATES
from inductrack_ros.core.uncertainty import Uncertainty
from inductrack_ros.data import load_campaign

TRUE = Model.default()
VALUES = np.array([TRUE.parameters["eta"], TRUE.parameters["gamma"]])
STD = np.array([0.01, 0.01]) * VALUES
COVARIANCE = np.outer(STD, STD) * np.array([[1.0, -0.6], [-0.6, 1.0]])


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return load_campaign(make_campaign(tmp_path_factory.mktemp("bands") / "rig", TRUE, duration=0.5, step=0.004))


def test_with_exact_starts_a_band_is_the_derivative_times_what_is_known(campaign):
    known = Uncertainty(("gamma",), np.array([[STD[1] ** 2]]))
    starts = [TRUE.initial_state(surge_rate=v, sway=s) for v, s in ((15.5, 0.002), (22.0, -0.003))]
    exact = tuple(
        replace(run, initial_state=dict(zip(STATES, start[:8].tolist(), strict=True)))
        for run, start in zip(campaign.runs, starts, strict=True)
    )
    result = compare(replace(campaign, runs=exact), TRUE, known=known)
    for r, start in zip(result.runs, starts, strict=True):
        above, below = (
            TRUE.with_changes({"gamma": VALUES[1] + side * STD[1] / 10}).simulate(
                r.run.times, start, r.run.drive_current
            )
            for side in (1.0, -1.0)
        )
        for i, c in enumerate(r.run.channels):
            expected = np.abs(above[c] - below[c]) * 5.0
            assert r.band[:, i] * NOISE[c] == pytest.approx(expected, rel=0.02, abs=1e-3 * NOISE[c])
    assert result.known == ("gamma",) and result.runs[0].band[-1, 0] > 3.0
    assert not result.runs[1].band.any()  # it coasts


def test_bands_hold_the_error_that_their_parameters_make(campaign):
    """Parameters drawn from what is known of them are wrong by many noises, and by as much as the bands say."""
    rng, squares, bare = np.random.default_rng(2), [], []
    for eta, gamma in VALUES + rng.standard_normal((8, 2)) @ np.linalg.cholesky(COVARIANCE).T:
        result = compare(
            campaign, TRUE.with_changes({"eta": eta, "gamma": gamma}), known=Uncertainty(("eta", "gamma"), COVARIANCE)
        )
        squares.append(result.beyond_bands**2)
        bare.append(result.error)
    assert np.median(bare) > 4.0
    assert 0.4 < np.sqrt(np.mean(squares)) < 1.5


def test_without_a_covariance_there_are_no_bands(campaign):
    for known in (None, Uncertainty(("aerodynamic_drag.drag_area",), np.eye(1))):
        result = compare(campaign, TRUE, known=known)
        assert all(r.band is None and r.beyond_band == {} for r in result.runs) and result.known == ()
    badly = compare(campaign, TRUE, known=Uncertainty(("gamma",), np.array([[4.0]])))
    assert badly.hardly_known == ("gamma",) and badly.runs[0].band is None


def test_the_page_and_the_json_show_the_bands_of_the_models_file(campaign, tmp_path):
    model = tmp_path / "model.yaml"
    off = TRUE.with_changes({"gamma": VALUES[1] + STD[1]})
    off.save(model, uncertainty=Uncertainty(("eta", "gamma"), COVARIANCE))
    output = tmp_path / "compare"
    assert cli.main(["compare", str(campaign.folder), "--model", str(model), "--output", str(output)]) == 0
    result = json.loads((output / "comparison.json").read_text())
    assert result["model"]["uncertain"] == ["eta", "gamma"]
    run = result["runs"][0]
    assert run["band"]["surge"] > 5 * NOISE["surge"] and run["beyond_band"]["surge"] < 3.0 < run["channels"]["surge"]
    page = (output / "report.html").read_text()
    assert "What is known of eta and gamma leaves the predictions open" in page and "that explains the error" in page
