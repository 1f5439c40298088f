# SPDX-License-Identifier: Apache-2.0
"""The blind benchmark's own parts: its loop campaigns fly as the nodes do, its judge knows what a finding is about."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from blind import law_table, loop
from blind.ask import Asked, draw
from blind.judge import judge_findings
from blind.judge_law import NOTHING, judge_law
from blind.last_bits import CHANGE, changed
from independent.campaigns import write_campaign

from inductrack_ros.checks import IMPOSSIBLE, NOTE, Finding, look
from inductrack_ros.core.effects.stand_in import parameters
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.laws.code import Written
from inductrack_ros.diagnosis.laws.forms import FORMS, Range
from inductrack_ros.diagnosis.laws.result import Laws, ProposedLaw
from inductrack_ros.diagnosis.result import Unknown


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A loop campaign and its truth."""
    folder = tmp_path_factory.mktemp("loop") / "rig"
    truth = loop.write_campaign(folder, 33003, "loop_complete")
    return load_campaign(folder), truth


def test_loop_campaign_is_flown_by_pulses_and_measured_with_the_noise_that_is_said(flown):
    campaign, truth = flown
    rig = loop.model_of(truth["parameters"]["eta"], truth["parameters"]["gamma"], [])
    for run, told in zip(campaign.runs, truth["runs"], strict=True):
        coils = run["surge"][-1] / (0.5 * rig.parameters["wavelength"])
        assert run.pulses is not None and abs(len(run.pulses.times) - coils) < 6  # every coil but the first few
        start = rig.initial_state(**told["initial"])
        true = rig.simulate(run.times, start, pulses=run.pulses)
        for channel, sigma in truth["plan"]["noise"].items():
            off = (run[channel] - true[channel]) / sigma
            assert abs(np.nanstd(off) - 1) < 5 / np.sqrt(2 * np.isfinite(off).sum()), channel


def test_a_finding_is_known_by_its_kind_and_what_it_is_about():
    truth = {
        "dirt": [{"name": "current_differs"}, {"name": "spikes"}],
        "findings": [
            {"kind": "run_to_run", "parameter": ["gamma", "drive_current"]},
            {"kind": "outliers", "channel": "sway"},
        ],
    }
    said = [
        Finding("run_to_run", NOTE, "", size={"parameter": "gamma", "relative_std": 0.01}),
        Finding("outliers", NOTE, "", channel="heave"),
        Finding("shaken", NOTE, "", size={"coordinate": "sway"}),
    ]
    told = judge_findings(truth, said)
    assert (told["expected"], told["told"], told["not_there"]) == (2, 1, ["shaken"])
    assert [w["channel"] for w in told["lost"]] == ["sway"]


def test_other_last_bits_are_other_and_no_more(flown):
    campaign, _ = flown
    one, other = campaign.runs[0].values, changed(campaign, 1).runs[0].values
    assert 0 < np.nanmax(np.abs(other / one - 1)) < 10 * CHANGE


BUMP = next(f for f in FORMS if f.name == "bump")


def found_with(values, true):
    """What a diagnosis says that proposes a bump in heave on surge."""
    law = Written(BUMP, "heave", "surge", values, Range(0.0, 20.0))
    sizes = {n: (v, 0.05, "") for n, v in values.items()}
    model = Model.create(parameters={n: true[n] for n in ("eta", "gamma")})
    table = {**parameters("surge", 0.0, 1.0), "knots": 21.0, "values": (0.0,) * 21}
    laws = Laws(1, (ProposedLaw(law.name, "", "", sizes, "", 5.0, 0.5, np.zeros(1)),), model=model)
    return SimpleNamespace(
        unknown=Unknown.of("heave", "surge"), laws=laws, model=model.with_changes(effects={"stand_in_heave": table})
    )


def test_a_law_is_judged_by_its_form_its_variables_and_its_parameters(tmp_path):
    """The law that is hidden, flown, predicts the unseen runs; one that is off does not."""
    truth = write_campaign(tmp_path / "rig", 5, kind="law", names=[("law_heave_bump_surge", None)], design="coasting")
    hidden, heldout = truth["unknown"][0]["law"]["parameters"], tmp_path / "rig.heldout"
    found = found_with(hidden, truth["parameters"])
    told = judge_law(truth, found, heldout, 3.0)
    assert told["in_set"] and not told["false"] and told["variables"] and told["errors"][1] == pytest.approx(1, abs=0.1)
    off = {**hidden, "place": hidden["place"] + 3.0}
    wrong = judge_law(truth, found_with(off, truth["parameters"]), heldout, 3.0)
    assert wrong["off"] == pytest.approx({"force": 0, "place": 60, "width": 0})
    assert wrong["errors"][1] > told["errors"][1] + 0.1
    sine = {
        **truth,
        "unknown": [{**truth["unknown"][0], "law": {"sort": "inside", "form": "sine", "power": 0.0, "parameters": {}}}],
    }
    assert judge_law(sine, found, heldout, 3.0)["false"]
    assert not judge_law(sine, SimpleNamespace(unknown=found.unknown, laws=None), heldout, 3.0)["false"]
    crashed = judge_law(truth, NOTHING, heldout, 3.0)
    assert not (crashed["coordinate"] or crashed["in_set"] or crashed["false"] or crashed["errors"])
    head, _, line, *_ = law_table.laws([{"verdict": "unknown_effect", "law": t} for t in (told, wrong)], [])
    assert "2 of 2" in line.split(" | ")[-1] and head.count("|") == line.count("|")


@pytest.mark.parametrize(("kind", "seed"), [("loop_complete", 36061), ("dirty", 34065)])
def test_the_look_refuses_no_campaign_that_is_only_dirty(kind, seed, tmp_path):
    """An accelerometer that samples pulses ten milliseconds apart, and a rig with six tenths of the model's thrust in
    coloured noise, are no wrong units."""
    draw(tmp_path / "rig", seed, Asked(kind))
    campaign = load_campaign(tmp_path / "rig")
    model = Model.load(campaign.model) if campaign.model else Model.default()
    assert [f.line for f in look(campaign, model) if f.severity == IMPOSSIBLE] == []
