# SPDX-License-Identifier: Apache-2.0
"""The report of a diagnosis, for every verdict, from results made by hand."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from test_reports_browser import BROWSER, open_page

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis.factor import Factor
from inductrack_ros.diagnosis.laws.result import Laws, ProposedLaw
from inductrack_ros.diagnosis.result import Diagnosis, Limit, Proposal, Rival, RunTraces, Step, Unknown
from inductrack_ros.diagnosis.result import Test as ScoreTest
from inductrack_ros.reports.diagnosis_report import diagnosis_report
from inductrack_ros.reports.diagnosis_words import verdict

NASTY = "<script>alert(1)</script>"
NOISE = {"surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4}
DRAG, DELAY = "aerodynamic_drag", "sensor_delay:heave"


def made(effects: tuple[str, ...] = (), **others) -> Diagnosis:
    """A diagnosis that found ``effects``, the error falling tenfold with each."""
    model = Model.create(effects=effects)
    times = np.linspace(0, 1, 60)
    subsets = [tuple(e for k, e in enumerate(effects) if mask >> k & 1) for mask in range(1 << len(effects))]
    random = np.random.default_rng(1)
    traces = []
    for name, current in (("run_0", 7000.0), (NASTY, 0.0)):
        measured = {c: np.sin(9 * times) * s * 40 + random.normal(0, s, 60) for c, s in NOISE.items()}
        predicted = {
            v: {c: np.sin(9 * times) * s * (40 - 9 * (len(effects) - len(v))) for c, s in NOISE.items()}
            for v in subsets
        }
        traces.append(RunTraces(name, f"{current:g} A", times, measured, predicted))
    steps = []
    for k in range(len(effects) + 1):
        error = 10.0 ** (len(effects) - k)
        by_channel = dict.fromkeys(NOISE, error)
        by_run = {"run_0": error, NASTY: error}
        steps.append(Step(effects[:k], error**2, 1.1 * error, by_channel, by_channel, by_run))
    parameters = {"eta": (0.73, 1e-4), "gamma": (3.93, 2e-4)}
    parameters |= {
        f"{e}.{p}": (0.0123, 4e-4) for e in effects for p in model.known_effects[e.partition(":")[0]].parameters
    }
    rivals = []
    for k, effect in enumerate(effects):
        name = next(iter(model.known_effects[effect.partition(":")[0]].parameters))
        where = {"run": {"run_0": 0.7, NASTY: 0.3}, "speed": {"0–10 m/s": 0.1, "10–20 m/s": 0.9}}
        best = Rival(effect, effects[:k], 12345.6, 14.0, {name: 0.0123}, {name: 4e-4}, True, "needed", where)
        worse = Rival("skin_friction_drag", effects[:k], 812.0, 14.0, {"wetted_area": 1.2}, {"wetted_area": 0.1})
        rivals += [worse, best]
    if not effects:
        rivals = [Rival("cg_offset", (), 3.0, 14.0, {"offset": 1e-6}, {"offset": 2e-6}, False, "no more than chance")]
    return replace(
        Diagnosis(
            campaign=f"rig {NASTY}",
            verdict="missing_effect" if effects else "adequate",
            effects=effects,
            model=model,
            parameters=parameters,
            indistinguishable={},
            unknown=None,
            next_experiment=None,
            steps=tuple(steps),
            rivals=tuple(rivals),
            noise=NOISE,
            noise_given=("surge",),
            tests=(ScoreTest("whiteness of heave", 12.0, 12, -0.8),),
            p_value=0.4,
            traces=tuple(traces),
        ),
        **others,
    )


def unknown() -> Diagnosis:
    at = np.linspace(0, 20, 80)
    force = -12 * np.exp(-(((at - 8) / 0.6) ** 2))
    found = Unknown("heave", ("surge",), "N", at, force, np.full(80, 0.8), ("time",))
    return made(
        verdict="unknown_effect", unknown=found, next_experiment="Coast over 8 m at 20 m/s.", notes=("A note.",)
    )


def confused() -> Diagnosis:
    return made(
        (DRAG,),
        indistinguishable={DRAG: ("skin_friction_drag",)},
        next_experiment="Coast from 38 m/s for 2 s.",
        proposal=Proposal(38.0, 0.0, (0.0, 0.0, 0.0), 2.0, {"skin_friction_drag": 14.2}),
    )


def adequate() -> Diagnosis:
    return made(limits=(Limit("aerodynamic_drag", "drag_area", "m²", 3e-4), Limit(DELAY, "delay", "s", 2e-5)))


def proposed() -> Diagnosis:
    """An unknown with two laws that the data cannot tell apart."""
    base = unknown()
    law = ProposedLaw(
        "proposed_bump_heave_on_surge", f"a bump {NASTY}", "F exp(−((z − z₀)/w)²)",
        {"force": (-12.0, 0.1, "N"), "place": (8.0, 0.01, "m")}, "a bump in words", 41.0, 0.6, base.unknown.force, 1.0,
        1.01,
    )  # fmt: skip
    return replace(
        base,
        laws=Laws(
            9, (law, replace(law, name="other", title="a raised cosine")), None, "Runs that dwell there would tell."
        ),
    )


def unlawful() -> Diagnosis:
    """An unknown that no form describes."""
    law = proposed().laws.proposed[0]
    return replace(unknown(), laws=Laws(9, nearest=replace(law, p_value=1e-9)))


def paired() -> Diagnosis:
    """An unknown on two variables, with a law that every run was predicted with."""
    base, law = proposed(), "proposed_bump_heave_on_surge"
    seen = np.random.default_rng(2).uniform([0.0, 12.0], [20.0, 30.0], (200, 2))
    traces = tuple(
        replace(t, predicted={**t.predicted, ("stand_in_heave",): t.predicted[()], (law,): t.predicted[()]})
        for t in base.traces
    )
    on_both = replace(base.unknown.times(Factor("surge_rate", 2, 20.0)), seen=seen)
    return replace(base, unknown=on_both, traces=traces)


ALL = {
    "adequate": adequate,
    "one": lambda: made((DRAG,)),
    "two": lambda: made((DRAG, DELAY)),
    "confused": confused,
    "unknown": unknown,
    "an unknown with laws": proposed,
    "an unknown without": unlawful,
    "an unknown on two variables": paired,
    "one and an unknown": lambda: replace(unknown(), effects=(DRAG,)),
}


@pytest.mark.parametrize(
    ("which", "sentence"),
    [
        ("adequate", "Nothing detectable is missing: what the model leaves is the sensors' noise."),
        ("one", "Missing: aerodynamic drag. With it, what is left is noise."),
        ("two", "Missing: aerodynamic drag and delay of the heave sensor. With them, what is left is noise."),
        ("confused", "Missing: aerodynamic drag or skin friction drag. With it, what is left is noise."),
        (
            "unknown",
            "No known effect explains a vertical force that depends on the place along the track (−12 N at 8.1 m).",
        ),
        (
            "one and an unknown",
            (
                "Missing: aerodynamic drag. Besides, a vertical force that depends on the place along the track (−12 N"
                " at 8.1 m), which no known effect explains."
            ),
        ),
    ],
)
def test_the_answer_is_one_sentence(which, sentence):
    assert verdict(ALL[which]()) == sentence


def test_rivals_of_one_of_two_effects_are_unambiguous():
    result = made((DRAG, DELAY), indistinguishable={DRAG: ("skin_friction_drag",)})
    assert verdict(result).startswith(
        "Missing: aerodynamic drag (or skin friction drag) and delay of the heave sensor."
    )


@pytest.mark.parametrize("which", ALL)
def test_what_users_named_is_text(which):
    html = diagnosis_report(ALL[which]())
    assert NASTY not in html
    assert "rig &lt;script&gt;" in html


def test_the_evidence_is_there():
    html = diagnosis_report(made((DRAG,)))
    assert not re.search(r"&lt;/?(strong|p|ul|li|code|span|br|div|table|td|h3)\b", html) and "&amp;lt;" not in html
    for words in (
        "0.0123 ± 0.0004 m²",
        "from 10.0 to 1.00",
        "from 11.0 to 1.10",
        "Part of the evidence",
        "skin friction drag",
    ):
        assert words in html
    assert "14 standard deviations" in diagnosis_report(confused())
    assert "would have shown" in diagnosis_report(adequate())


def test_a_change_of_the_thrust_is_a_share_of_it():
    at = np.linspace(0, 20, 80)
    found = Unknown.of("thrust", "surge", at, 0.3 * np.exp(-((at - 8) ** 2)), np.full(80, 0.02))
    result = made(verdict="unknown_effect", unknown=found)
    assert (
        verdict(result)
        == "No known effect explains a change of the thrust that depends on the place along the track (30 % at 8.1 m)."
    )
    assert result.to_json()["unknown"] == {
        "channel": "surge",
        "depends_on": ["surge", "drive"],
        "peak": found.peak,
        "unit": "of the thrust",
    }
    assert "change of the thrust, %" in diagnosis_report(result)


@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome in PATH: the reports are not opened")
@pytest.mark.parametrize("which", ALL)
def test_it_opens_without_a_complaint(which, tmp_path):
    seen = open_page(
        diagnosis_report(ALL[which]()),
        tmp_path,
        """
        seen.plots = document.querySelectorAll(".plot").length;
        seen.drawn = document.querySelectorAll(".plot > .plot-container").length;
        seen.wide = document.documentElement.scrollWidth - innerWidth;
        """,
    )
    assert seen["plots"] == seen["drawn"] >= 3
    assert seen["wide"] <= 0


def test_a_law_is_proposed_and_none_is_claimed():
    assert "Proposed, not proven" in diagnosis_report(proposed()) and "raised cosine" in verdict(proposed())
    page = diagnosis_report(unlawful())
    assert "None of the 9 forms tried describes it" in page and "proposed_effects.py" not in page
    assert unlawful().to_json()["laws"] == [] and [law["name"] for law in proposed().to_json()["laws"]][1] == "other"


def test_an_unknown_on_two_variables_shows_both():
    """Sentence, curve at the second variable's usual size, surface, JSON."""
    page = diagnosis_report(paired())
    assert "depends on the place along the track and speed" in verdict(paired())
    assert "at speed = 20 m/s" in page and "Over both variables" in page and "elsewhere the surface is a guess" in page
    assert paired().to_json()["unknown"]["factor"] == {"variable": "surge_rate", "power": 2, "scale": 20.0}
    assert "Over both variables" not in diagnosis_report(proposed()) and "factor" not in unknown().to_json()["unknown"]


@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome in PATH: the reports are not opened")
def test_law_and_table_are_switched_against_each_other(tmp_path):
    """The page opens with the law on; the table goes on in its place, never both; the surface has its dots."""
    seen = open_page(
        diagnosis_report(paired()),
        tmp_path,
        """
        const boxes = [...document.querySelectorAll("[data-effect]")];
        const name = (box) => box.parentElement.textContent.trim();
        const look = () => boxes.filter((box) => box.checked).map(name);
        seen.first = look();
        const other = boxes.find((box) => !box.checked);
        other.click(); await pause(); seen.second = look();
        seen.said = document.getElementById("explorer-sentence").textContent;
        other.click(); await pause(); seen.none = look();
        seen.surface = [...document.querySelectorAll(".plot")].filter((p) => p.data && p.data[0].type === "heatmap").map((p) => p.data.length);
        """,  # noqa: E501
    )
    assert seen["first"] == ["proposed bump heave on surge"] and seen["second"] == ["stand-in for the unknown in heave"]
    assert "with the effects chosen" in seen["said"] and seen["none"] == [] and seen["surface"] == [2]
