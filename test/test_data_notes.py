# SPDX-License-Identifier: Apache-2.0
"""What was converted or left out while reading reaches the terminal, the results and the head of the page."""

from dataclasses import replace
from html import unescape

from test_compare import make_campaign

from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.reports.page import Page


def test_a_note_that_runs_share_is_one_line(tmp_path):
    campaign = load_campaign(make_campaign(tmp_path / "rig", Model.default(), duration=0.1))
    assert campaign.notes == ()
    runs = [replace(campaign.runs[0], name=f"run_{i}", notes=("heave is in mm", "x")[: 1 + (i == 4)]) for i in range(5)]
    notes = replace(campaign, runs=tuple(runs)).notes
    assert notes == ("run_0, run_1, run_2 and 2 more: heave is in mm", "run_4: x")


def test_notes_stand_in_the_head_of_a_page():
    page = Page("rig", "Kind", "Verdict.", notes=("run: column '<b>' is left out",)).render()
    head = page[page.index("<header") : page.index("</header>")]
    assert "run: column '<b>' is left out" in unescape(head) and "<b>" not in head and "<details" not in head
    many = Page("rig", "Kind", "Verdict.", notes=("a", "b", "c", "d")).render()
    assert "4 remarks</summary>" in many[: many.index("</header>")]
    assert 'class="notes"' not in Page("rig", "Kind", "Verdict.").render()


def test_what_a_campaign_gives_and_no_run_asks_for(tmp_path):
    for name in ("a.csv", "b.csv", "c.csv"):
        (tmp_path / name).write_text(f"time,heave\n0,1\n1,{3 if name == 'b.csv' else 2}\n")
    (tmp_path / "campaign.yaml").write_text(
        "noise_std: {heave: 1.0e-5, gap_top: 1.0e-5}\n"
        "topics: {pose: /rig/pose}\n"
        "inputs: {wind: '/bus:point.x'}\n"
        "runs: [{file: a.csv, drive_current: 0}, {file: b.csv, drive_current: 0}, {file: c.csv, drive_current: 0}]\n"
    )
    assert load_campaign(tmp_path).notes == (
        "noise_std of gap_top is not used: no run has that channel",
        "topics: is not used: no run is a bag",
        "input 'wind' is in no run",
    )
