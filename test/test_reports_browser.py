# SPDX-License-Identifier: Apache-2.0
"""Reports in a real browser: no script error, plots drawn, choices followed. Skipped where there is no browser."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from conftest import LONG
from test_checks import changed, measured, put
from test_checks_kinds import held
from test_compare import make_campaign

from inductrack_ros.checks.check import check
from inductrack_ros.compare import compare
from inductrack_ros.core.model import Model
from inductrack_ros.core.state import CHANNELS
from inductrack_ros.data import load_campaign
from inductrack_ros.reports.check_report import check_report
from inductrack_ros.reports.compare_report import compare_report
from inductrack_ros.reports.explorer import Opening, RunTraces, Trace, explorer
from inductrack_ros.reports.page import Page

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome in PATH: the reports are not opened")

# What a reader would see is written into the title, which the browser prints with the page.
PROBE = """<script>addEventListener("load", () => setTimeout(async () => {
  const seen = {};
  const pause = () => new Promise((done) => setTimeout(done, 50));
  try { %s } catch (error) { seen.error = String(error); }
  document.title = "PROBE" + JSON.stringify(seen) + "END";
}, 100));</script></body>"""


def open_page(html: str, folder: Path, probe: str, *options: str) -> dict:
    """Open a report without network and return what the probe saw; any message on the console fails the test."""
    file = folder / "report.html"
    head, body = html.rsplit("</body>", 1)
    file.write_text(head + PROBE % probe + body, encoding="utf-8")
    command = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-sync",
    ]
    command += [
        "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={folder / 'profile'}",
        "--virtual-time-budget=20000",
    ]
    command += ["--window-size=1280,900", "--enable-logging=stderr", *options, "--dump-dom", file.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG, check=False)
    complaints = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not complaints, complaints
    title = re.search(r"<title>PROBE(.*?)END</title>", done.stdout, re.S)
    assert title, done.stdout[-2000:] + done.stderr[-2000:]
    seen = json.loads(unescape(title.group(1)))
    assert "error" not in seen, seen
    return seen


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> str:
    model = Model.create(effects={"aerodynamic_drag": {"drag_area": 0.05}})
    folder = make_campaign(tmp_path_factory.mktemp("browser") / "campaign", model)
    return compare_report(compare(load_campaign(folder), Model.default()))


def test_every_plot_is_drawn_and_follows_the_choice(report, tmp_path):
    seen = open_page(
        report,
        tmp_path,
        """
        seen.plots = document.querySelectorAll(".plot").length;
        seen.drawn = document.querySelectorAll(".plot > .plot-container .main-svg").length;
        const plot = document.getElementById("explorer-traces"), run = document.getElementById("explorer-run");
        const channel = document.getElementById("explorer-channel");
        const sentence = document.getElementById("explorer-sentence");
        const chosen = () => [sentence.textContent, plot.layout.yaxis.title.text];
        seen.first = chosen();
        run.value = "1"; channel.value = "heave";
        channel.dispatchEvent(new Event("change", { bubbles: true }));
        await pause();
        seen.second = chosen();
        """,
    )
    assert seen["drawn"] >= seen["plots"] >= 6
    assert "Travel (surge) of run_" in seen["first"][0]
    assert seen["second"] == [seen["second"][0], "Heave, mm"] and "Heave of run_1" in seen["second"][0]


def test_plots_zoom_by_keyboard(report, tmp_path):
    seen = open_page(
        report,
        tmp_path,
        """
        const plot = document.getElementById("explorer-traces");
        plot.focus();
        const press = async (key) => {
          plot.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
          await pause();
        };
        const range = () => [...plot._fullLayout.xaxis.range];
        seen.all = range();
        await press("+"); seen.near = range();
        await press("ArrowRight"); seen.right = range();
        await press("0"); seen.again = range();
        seen.focused = document.activeElement === plot;
        """,
    )
    width = [seen[k][1] - seen[k][0] for k in ("all", "near", "right", "again")]
    assert width[1] == pytest.approx(0.7 * width[0]) and width[2] == pytest.approx(width[1])
    assert seen["right"][0] > seen["near"][0]
    assert seen["again"] == pytest.approx(seen["all"])
    assert seen["focused"]


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_plots_take_the_theme_and_print_on_white(report, tmp_path, theme):
    seen = open_page(
        report,
        tmp_path,
        """
        const ink = () => document.getElementById("explorer-traces")._fullLayout.font.color;
        const page = () => getComputedStyle(document.body).backgroundColor;
        seen.screen = [page(), ink()];
        dispatchEvent(new Event("beforeprint")); await pause();
        seen.paper = [page(), ink()];
        seen.folded = document.querySelectorAll("details:not([open])").length;
        dispatchEvent(new Event("afterprint")); await pause();
        seen.after = [page(), ink()];
        """,
        *(["--force-dark-mode"] if theme == "dark" else []),
    )
    white = ["rgb(255, 255, 255)", "#1b1f24"]
    assert seen["paper"] == white and seen["folded"] == 0
    assert seen["screen"] == seen["after"] == (white if theme == "light" else ["rgb(20, 23, 27)", "#e8eaed"])


def test_it_prints_to_paper(report, tmp_path):
    file, paper = tmp_path / "report.html", tmp_path / "report.pdf"
    file.write_text(report, encoding="utf-8")
    command = [
        BROWSER,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--no-first-run",
        f"--user-data-dir={tmp_path / 'profile'}",
    ]
    command += ["--virtual-time-budget=20000", "--no-pdf-header-footer", f"--print-to-pdf={paper}", file.as_uri()]
    subprocess.run(command, capture_output=True, timeout=LONG, check=True)
    pages = len(re.findall(rb"/Type\s*/Page\b", paper.read_bytes()))
    assert 2 <= pages <= 8


@pytest.mark.parametrize("width", [1280, 420])
def test_nothing_sticks_out_at_either_width(report, tmp_path, width):
    """Tables scroll inside themselves; plots and words fit; numbers that would run into each other are left out."""
    seen = open_page(
        report.replace("<body>", f'<body style="width:{width}px">'),
        tmp_path,
        """
        document.querySelectorAll("details").forEach((d) => (d.open = true)); await pause();
        const limit = document.body.getBoundingClientRect().right + 1;
        const inside = (e) => e.closest(".scroll, nav, .js-plotly-plot, .skip") && !e.matches(".scroll, nav, .plot");
        seen.out = [...document.body.querySelectorAll("*")].filter((e) => !inside(e) && e.getBoundingClientRect().right > limit)
          .map((e) => e.outerHTML.slice(0, 120));
        const plots = [...document.querySelectorAll(".plot")];
        seen.wide = plots.filter((p) => p.querySelector(".main-svg").getBoundingClientRect().width > p.clientWidth + 1).length;
        seen.plots = plots.length;
        const runs = [...Array(14).keys()].map(String), map = plots[0];
        await page.draw(map, { data: [{ type: "heatmap", x: runs, y: ["a"], z: [runs.map(Number)], texttemplate: "%{z}" }] });
        seen.numbers = map.querySelectorAll(".heatmap-label").length;
        """,  # noqa: E501
        f"--window-size={max(width, 500)},800",
    )
    assert seen["plots"] >= 6 and not seen["out"] and not seen["wide"], seen
    assert seen["numbers"] == (14 if width == 1280 else 0)


def test_all_channels_leave_the_verdict_on_the_first_screen_and_nothing_alarms(tmp_path):
    """Where the model predicts all, no plot has the colour of an error; a wrong model's plots have it."""
    model = Model.create(effects={"aerodynamic_drag": {"drag_area": 0.05}})
    noise = dict.fromkeys(CHANNELS, 1e-3)
    folder = make_campaign(tmp_path / "campaign", model, duration=0.4, channels=CHANNELS, noise_std=noise)
    campaign = load_campaign(folder)
    look = """
        seen.verdict = document.querySelector("h1").getBoundingClientRect().bottom;
        seen.picture = document.querySelector(".picture").getBoundingClientRect().bottom;
        const alarm = getComputedStyle(document.documentElement).getPropertyValue("--before").trim();
        const shade = (plot) => JSON.stringify(plot.data.map((d) => [d.marker && d.marker.color, d.line && d.line.color]));
        seen.alarms = [...document.querySelectorAll(".plot")].filter((plot) => plot.data && shade(plot).includes(alarm)).length;
        seen.cells = [...document.querySelectorAll(".plot")][0].data[0].z.flat().length;
    """  # noqa: E501
    seen = {}
    for name, right in (("right", model), ("wrong", Model.default())):
        page = compare_report(compare(campaign, right))
        seen[name] = open_page(page, tmp_path, look, "--window-size=1280,800")
    assert all(s["cells"] == 2 * len(CHANNELS) for s in seen.values()), seen
    assert all(s["verdict"] < 400 and s["picture"] < 700 for s in seen.values()), seen
    assert seen["right"]["alarms"] == 0 and seen["wrong"]["alarms"] > 3


def test_effects_switch_on_and_off(tmp_path):
    times = np.linspace(0, 1, 50)
    variants = [(), ("aerodynamic_drag",), ("sensor_delay:heave",), ("aerodynamic_drag", "sensor_delay:heave")]
    predicted = [np.full(50, 1e-3 * k) for k in range(4)]
    trace = Trace(times, np.full(50, 3e-3), predicted, [100.0, 66.0, 33.0, 0.0])
    page = Page(title="t", kind="k", verdict="v")
    runs = [RunTraces("<run>", "about", {"heave": trace})]
    words = ("without any", "with those chosen")
    page.section("Try it", explorer(page, runs, {"heave": 3e-5}, variants[-1], variants, Opening(words=words)))
    seen = open_page(
        page.render(),
        tmp_path,
        """
        const boxes = [...document.querySelectorAll("[data-effect]")], plot = document.getElementById("explorer-traces");
        const bars = document.getElementById("explorer-errors"), sentence = document.getElementById("explorer-sentence");
        const look = () => {
          const [line, residual] = plot.data.slice(-2);
          return [sentence.textContent, plot.data.length, line.y[0], Math.round(residual.y[0]), bars.data.length];
        };
        seen.names = boxes.map((box) => box.parentElement.textContent.trim());
        seen.both = look();
        boxes[0].focus(); boxes[0].click(); await pause(); seen.second = look();
        boxes[1].click(); await pause(); seen.none = look();
        boxes[0].click(); await pause(); seen.first = look();
        """,  # noqa: E501
    )
    assert seen["names"] == ["aerodynamic drag", "delay of the heave sensor"]
    assert seen["both"] == ["Heave of <run>: 100 × noise without any, 0.00 × noise with those chosen.", 5, 3, 0, 2]
    assert seen["second"] == ["Heave of <run>: 100 × noise without any, 33.0 × noise with those chosen.", 5, 2, 33, 2]
    assert seen["none"] == ["Heave of <run>: 100 × noise without any.", 3, 0, 100, 1]
    assert seen["first"] == ["Heave of <run>: 100 × noise without any, 66.0 × noise with those chosen.", 5, 1, 67, 2]


# ---------------------------------------------------------------- the page of `inductrack check`


def late(y):
    """A channel that comes 200 ms late."""
    return np.concatenate([np.full(100, np.nan), y[:-100]])


SPOILED = {
    "clean": lambda rig: rig,
    "fillers": lambda rig: changed(rig, "heave", put((40, -9999.0), (120, 0.02)), "a"),
    "unit": lambda rig: changed(rig, "heave_rate", lambda y: 1e3 * y),
    "axis": lambda rig: changed(rig, "sway", np.negative),
    "late": lambda rig: changed(changed(rig, "surge_rate", late), "heave_rate", late),
    "dead": lambda rig: changed(rig, "gap_top", lambda y: np.full_like(y, 0.011)),
    "rest": lambda rig: held(rig, 250),
}
SHOWN = {
    "clean": (),
    "fillers": ("left out",),
    "unit": ("derivative of heave",),
    "axis": ("as it may be meant",),
    "late": ("derivative of heave",),
    "dead": (),
    "rest": ("left out",),
}


@pytest.mark.parametrize("name", SPOILED)
def test_the_page_of_a_check_shows_where(name, tmp_path):
    rig = measured(("surge", "sway", "heave", "roll", "surge_rate", "heave_rate", "gap_top"))
    page = check_report(check(SPOILED[name](rig), Model.default()))
    seen = open_page(
        page,
        tmp_path,
        """
        seen.plots = document.querySelectorAll(".plot").length;
        seen.drawn = document.querySelectorAll(".plot > .plot-container .main-svg").length;
        seen.legends = [...document.querySelectorAll(".legendtext")].map((t) => t.textContent);
        """,
    )
    assert seen["drawn"] >= seen["plots"] == 1 + (name != "clean") + (name == "fillers")
    assert all(words in " ".join(seen["legends"]) for words in SHOWN[name])
