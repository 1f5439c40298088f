# SPDX-License-Identifier: Apache-2.0
"""The page of the paper: complete, self-contained, and saying what the numbers say."""

import json
import os
import re
from html import unescape

import numpy as np
import pytest
from independent import simulator as other
from test_reports_browser import BROWSER, open_page

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.output_folder import output_folder
from inductrack_ros.paper import command, figures, reproduction
from inductrack_ros.paper.facts import AGREES, DISAGREES, load_facts
from inductrack_ros.paper.identification import FREE, SPEEDS, STD, coverage, truth
from inductrack_ros.paper.output import config_file
from inductrack_ros.paper.page import raised, render
from inductrack_ros.paper.reproduction import Reproduction, results, verdict

FIGURES = ["2", "4", "5", "6", "7a", "7b", "7c", "10a", "10b", "10c"]


@pytest.fixture(scope="module")
def work():
    """All of it, but for the hundred identifications (test_identify does them): four."""
    made = Reproduction(Model.load(config_file("paper.yaml")), load_facts())
    made.__dict__["coverage"] = coverage(made.model, replicates=4)
    return made


@pytest.fixture(scope="module")
def html(work):
    return render(work)


def words(html):
    """What a reader sees of some HTML."""
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", html)))


def test_no_tag_is_shown_as_text(html):
    assert not re.search(r"&lt;/?(strong|p|ul|li|code|span|br|b|sup|div|table|td|h3)\b|&amp;lt;", html)


def test_every_claim_has_its_row(work, html):
    for row in work.claims.rows:
        cells = re.search(rf'<tr id="claim-{row.claim.id}">(.*?)</tr>', html, re.S)[1]
        seen = words(cells)
        assert row.claim.place in seen and row.claim.says in seen and row.why in seen, row.claim.id
        assert ("good-word" in cells) == (row.verdict == AGREES) and ("bad-word" in cells) == (
            row.verdict == DISAGREES
        ), row.claim.id


def test_every_figure_and_table_of_the_paper_is_there(html):
    seen = words(html)
    for number in FIGURES:
        assert f"Figure {number}." in seen
    assert "Table 1," in seen and "Table 2," in seen and "Assumed: not in the paper" in seen


def test_the_first_sentence_counts(work, html):
    rows = work.claims.rows
    assert (
        verdict(rows)
        == "Of 23 numbers and claims the paper prints, its own equations give 13, and 2 nearly; 8 do not: a typo and 7"
        " contradictions inside the paper."
    )
    assert f"<h1>{verdict(rows)}</h1>" in html
    assert (
        verdict([r for r in rows if r.verdict == AGREES])
        == "Of 13 numbers and claims the paper prints, its own equations give 13, and 0 nearly."
    )


def test_self_contained(html):
    head = re.sub(r"<script.*?</script>", "", html, flags=re.S)
    assert not re.search(r'(src|href)="(?!#|data:|https://doi.org/)', head)
    assert "NaN" not in head and "nan" not in words(head).split()


def test_figures_show_finite_numbers(work):
    import base64

    runs, claims = work.runs, work.claims
    shown = [
        figures.figure_2(runs),
        figures.figure_4(runs),
        figures.figure_6(runs),
        *figures.figure_7(runs),
        *figures.figure_10(runs),
    ]
    shown += [
        figures.damping(claims, work.modes),
        figures.frequencies(work.modes),
        figures.stiffness(work.modes),
        figures.drive(work.model),
    ]
    for figure in shown:
        assert figure.label and figure.data
        for trace in figure.data:
            for axis in "xy":
                values = np.frombuffer(base64.b64decode(trace[axis]["bdata"]), "<f4")
                assert values.size and np.isfinite(values).all(), (figure.label, trace["name"])
        for name in ("xaxis", "yaxis"):
            assert figure.layout[name]["title"], figure.label


def test_two_methods_one_answer(work):
    """From the paper's start, with noise: least squares, simplex and truth; as in Table 2."""
    answer = work.identified
    assert answer.fit.start.tolist() == [1.0, 3.0]
    assert answer.fit.nelder_mead == pytest.approx(answer.fit.values, rel=1e-5)
    assert (np.abs(answer.fit.values - truth(work.model)) < 3 * answer.fit.std).all()


def test_flat_valley_is_said(work, html):
    assert all(p.flat for p in work.flat.profiles)
    assert work.flat.words.startswith("The valley is flat: these data do not determine η and γ.")
    assert "The valley is flat" in words(html)


def test_what_distances_tell_by_the_other_simulator(work):
    """Standard errors of η and γ from derivatives of distances that the package did not compute."""

    def travel(speed, eta, gamma):
        rig = other.rig(eta=eta, gamma=gamma)
        start = [0.0, 0.0, other.equilibrium_heave(speed, rig), 0.0, speed, 0.0, 0.0, 0.0]
        return other.simulate(np.array([0.0, 2.0]), start, 7000.0, rig, far_step=4e-4)[0][-1, 0]

    eta, gamma = truth(work.model)
    h = 1e-4
    J = np.array(
        [
            [
                (travel(v, eta * (1 + h), gamma) - travel(v, eta * (1 - h), gamma)) / (2 * h),
                (travel(v, eta, gamma * (1 + h)) - travel(v, eta, gamma * (1 - h))) / (2 * h),
            ]
            for v in SPEEDS
        ]
    )
    relative = np.sqrt(np.diag(np.linalg.inv(J.T @ J / STD**2)))
    shown = next(p for p in work.choices if p.speeds == SPEEDS)
    assert shown.relative_std == pytest.approx(relative, rel=0.01)


def test_program_readable(work):
    found = json.loads(json.dumps(results(work), allow_nan=False))
    assert [c["id"] for c in found["claims"]] == list(load_facts().claims)
    assert found["beyond_the_paper"]["lowest_speed"] == pytest.approx(8.338, abs=1e-3)
    assert set(found["identification"]) == set(FREE) and found["replicates"] == 4
    assert 0 <= found["identification"]["eta"]["covered"] <= 4


def test_exponents_are_raised():
    assert raised("γ · η^-0.74, to 1 % <b>.") == "γ · η<sup>−0.74</sup>, to 1 % &lt;b&gt;."


@pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome in PATH: the page is not opened")
def test_in_a_browser(html, tmp_path):
    """No script error, and every plot is drawn."""
    probe = """
      await pause();
      const plots = [...document.querySelectorAll(".plot")];
      seen.plots = plots.length;
      seen.drawn = plots.filter((p) => p.querySelector(".main-svg")).length;
    """
    seen = open_page(html, tmp_path, probe)
    assert "error" not in seen
    assert seen["plots"] == seen["drawn"] == 1 + len(FIGURES) + 5 + 3 + 1


# ---------------------------------------------------------------- the command


def test_command_writes_both_files(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("inductrack_ros.paper.page.render", lambda work: "<p>page</p>")
    monkeypatch.setattr("inductrack_ros.paper.reproduction.results", lambda work: {"claims": []})
    out = tmp_path / "a" / "b"
    assert cli.main(["paper", "--output", str(out)]) == 0
    assert (out / "report.html").read_text() == "<p>page</p>" and json.loads((out / "paper.json").read_text()) == {
        "claims": []
    }
    assert "Of 23 numbers" in capsys.readouterr().out
    assert sorted(f.name for f in out.iterdir()) == ["paper.json", "report.html"]


def test_command_refuses_what_cannot_be(tmp_path, capsys):
    (tmp_path / "file").write_text("x")
    for options, place in (
        (["--output", str(tmp_path / "file")], "is a file; give a folder"),
        (["--output", str(tmp_path / "out"), "--model", str(tmp_path / "none.yaml")], "no such file"),
    ):
        assert cli.main(["paper", *options]) == 2
        message = capsys.readouterr().err
        assert place in message and message.count("\n") == 1


def test_old_file_survives_a_failed_write(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.html").write_text("old")

    def full(self, *_args, **_more):
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match="No space left"), output_folder(tmp_path / "out") as folder:
        monkeypatch.setattr("pathlib.Path.write_text", full)
        (folder / "report.html").write_text("new")
    monkeypatch.undo()
    assert (tmp_path / "out" / "report.html").read_text() == "old" and os.listdir(tmp_path) == ["out"]


def test_nothing_here_computes_in_the_renderer():
    """The page is made from finished numbers: its module imports no simulation."""
    import inductrack_ros.paper.page as page

    assert not {"Model", "modes", "coverage", "identify"} & set(vars(page))
    assert command.add_arguments and reproduction.Reproduction
