# SPDX-License-Identifier: Apache-2.0
"""Idea: the peers of the laws' benchmarks are given a fair chance: each finds a plain cubic in a table; the judge knows
a form from another; the tables print what was judged."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import laws as benchmark
from blind import law_table
from peers import law_judge, law_versus, laws

from inductrack_ros.diagnosis.laws.forms import FORMS, Range

BUILT_ON = {"law_sindy": "pysindy", "law_expressions": "pyoperon"}
RANGE = Range(-3e-3, 3e-3)
FORM = {f.name: f for f in FORMS}


def cubic(u):
    """A hardening spring in sway (N)."""
    return 2e8 * u**3


@pytest.fixture(scope="module")
def statement():
    """What three thousand samples say of it, a tenth of it in noise."""
    rng = np.random.default_rng(3)
    u = benchmark.samples_of(rng, "sway", RANGE, 3000)
    return benchmark.told(rng, "sway", RANGE, u, cubic(u), 0.1 * float(np.std(cubic(u))))[0]


@pytest.mark.parametrize("name", laws.LAW_PEERS)
def test_finds_a_plain_cubic(statement, name):
    pytest.importorskip(BUILT_ON[name])
    formula = laws.ask(name, statement)
    assert law_judge.of_form(formula, FORM["cubic"], "sway", RANGE), formula.text
    assert law_judge.nearness(formula, cubic, "sway", RANGE)[0] < 0.02, formula.text


def test_an_expression_is_read_as_the_search_means_it():
    pytest.importorskip("pyoperon")
    from peers.law_expressions import Expression

    text = "((-0.5) + (2.0 * (exp(((-3.0) * X1)) - ((1.5 * X1) ^ 2))))"
    read = Expression.of(text, 0.1, 4.0)
    u = np.linspace(-0.1, 0.1, 9)
    x = u / 0.1
    wanted = 4.0 * (-0.5 + 2.0 * (np.exp(-3.0 * x) - (1.5 * x) ** 2))
    assert read.with_constants(np.array(read.constants))(u) == pytest.approx(wanted)
    bare = read.without_offset
    assert bare.with_constants(np.array(bare.constants))(u) == pytest.approx(wanted + 2.0)


def test_a_force_is_of_a_form_if_the_rest_of_it_is_negligible():
    near = law_judge.of_form(lambda u: cubic(u) + 0.05, FORM["cubic"], "sway", RANGE)
    far = law_judge.of_form(lambda u: cubic(u) + 2.0, FORM["cubic"], "sway", RANGE)
    assert near and not far
    assert not law_judge.of_form(lambda u: 0.0 * u, FORM["cubic"], "sway", RANGE)
    assert not law_judge.of_form(lambda u: np.tanh(u / 1e-3), FORM["cubic"], "sway", RANGE)
    off, beyond = law_judge.nearness(lambda u: 1.1 * cubic(u), cubic, "sway", RANGE)
    assert off == pytest.approx(0.1) and beyond > off


def test_tables_have_a_line_for_the_package_and_each_peer():
    good = law_versus.Answer(cubic, 1, "a u³", 0.1)
    bad = law_versus.Answer(lambda u: 5.0 + 0.0 * u, 2, "5", 3.0)
    answers = {law_versus.MINE: good, "PySINDy": bad, "expression search": None}
    row = law_versus.judged(answers, cubic, FORM["cubic"], "sway", RANGE)
    _, _, mine, sindy, search = law_versus.table([row, row], "laws")
    assert mine == "| this package | 2 of 2 | 2 of 2 | 0 % | 0 % | 1 | 0.1 / 0.1 |"
    assert sindy.startswith("| PySINDy | 2 of 2 | 0 of 2 |") and search.startswith("| expression search | 0 of 2 |")
    assert "right form" in law_versus.line(row) and "no formula" in law_versus.line(row)
    assert law_versus.table([], "laws") == []

    told = {"error": 1.2, "right": True, "terms": 2, "cpu": 1.0, "refit": 4.0, "text": ""}
    crashed = {"error": None, "right": False, "text": "crash"}
    answers = {"this package": told, "PySINDy": told | {"error": 2.0, "right": False}, "expression search": crashed}
    campaign = {"error": 1.0, "law": {"sort": "inside", "errors": [1.0, 0.9]}, "law_peers": answers}
    _, _, mine, sindy, search = law_table.versus([campaign])
    assert mine.startswith("| this package | 1 of 1 | 1 of 1 | 0.90 | 1 of 1 |")
    assert sindy.startswith("| PySINDy | 1 of 1 | 0 of 1 | 2.00 | 0 of 1 |")
    assert search.startswith("| expression search | 0 of 1 | 0 of 1 |  | 0 of 0 |")
    assert law_table.versus([]) == []
