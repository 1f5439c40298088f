# SPDX-License-Identifier: Apache-2.0
"""The page of all reports: what users wrote cannot break out of it, and it needs nothing from outside."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from inductrack_ros.core.plain_json import script_text
from inductrack_ros.reports.page import Figure, Page, bullets, folded, joined, markup, packed, table
from inductrack_ros.reports.words import effect_name, in_channel, listed, number, ratio, shown, sized, title

NASTY = "</script><script>alert('x')</script>\"&<b>"


def test_what_users_wrote_is_text():
    page = Page(title=NASTY, kind="Test", verdict=f"It is {NASTY}.")
    page.picture(page.figure(Figure([{"name": NASTY, "x": [1], "y": [2]}], {"title": NASTY}, NASTY)))
    page.section(NASTY, "<p>fine</p>")
    html = page.render()
    assert "alert('x')" not in html.replace("\\u003c/script>\\u003cscript>alert('x')", "")
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', html, re.S).group(1))
    assert data["figures"][0]["data"][0]["name"] == NASTY


def test_only_markup_is_html():
    """Everywhere: what is not built by `markup` is escaped, once."""
    page = Page(title="t", kind="k", verdict="v", lead=NASTY, notes=[NASTY], foot=NASTY)
    page.picture(page.figure(Figure([], {}, NASTY), NASTY))
    cells = [[NASTY, markup("<b>{}</b>", NASTY)], ["<i>", joined([NASTY, markup("<u>x</u>")], "<br>")]]
    page.section("s", table(["<h>", NASTY], cells, NASTY) + folded(NASTY, NASTY) + bullets([NASTY]) + NASTY)
    html = page.render().partition('<script type="application/json"')[0]
    assert "alert('x')" not in html and "<script>alert" not in html and "&amp;lt;" not in html
    assert html.count("&lt;/script&gt;&lt;script&gt;alert(&#39;x&#39;)") == 14
    assert "<u>x</u>" in html and "&lt;i&gt;<" not in html.replace("&lt;i&gt;</th>", "")


def test_nothing_is_loaded_from_outside():
    html = Page(title="t", kind="k", verdict="v").render()
    assert not re.search(r'<(script|link|img|iframe)[^>]+(src|href)="(?!data:|#)', html)
    assert "@import" not in html and not re.search(r"url\((?!data:)", html.partition("<script>")[0])


def test_json_has_no_word_for_nan():
    assert (
        script_text({"a": [np.nan, np.inf, 1.5], "b": np.array([1.0, np.nan]), "c": np.float32(2), "d": None})
        == '{"a":[null,null,1.5],"b":[1.0,null],"c":2.0,"d":null}'
    )


def test_packed_numbers_are_plotlys_typed_arrays():
    import base64

    values = np.array([0.1, np.nan, -3.0])
    back = np.frombuffer(base64.b64decode(packed(values)["bdata"]), "<f4")
    assert np.allclose(back, values, equal_nan=True)


def test_a_table_names_its_rows_and_columns():
    html = table(["Run", "Error"], [["a", "1"], ["b", "2"]], "All runs")
    assert html.count('scope="row"') == 2 and html.count('scope="col"') == 2 and "<caption>All runs</caption>" in html


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.6, "1235"),
        (0.00012345, "0.000123"),
        (-2.5, "−2.5"),
        (1.8e-6, "1.8·10⁻⁶"),
        (9.1e6, "9.1·10⁶"),
        (np.nan, "–"),
        (np.inf, "∞"),
    ],
)
def test_numbers_read_well(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (0.031234, 0.00042, "0.0312 ± 0.0004 m²"),
        (0.031234, 0.00012, "0.03123 ± 0.00012 m²"),
        (-5.2, 0.3, "−5.2 ± 0.3 m²"),
        (1.8e-6, 2e-8, "(1.800 ± 0.020)·10⁻⁶ m²"),
        (120.4, 33.0, "120 ± 33 m²"),
        (3.0, None, "3 m²"),
        (3.0, np.inf, "3 m²"),
    ],
)
def test_sizes_carry_their_uncertainty(value, std, text):
    assert sized(value, std, "m²") == text


def test_channels_are_shown_in_readable_units():
    assert in_channel("heave", 3e-5) == "0.03 mm"
    assert in_channel("roll", 1e-4) == "0.1 mrad"
    assert in_channel("surge", 5e-4) == "0.0005 m"
    assert shown("surge_acceleration") == (1.0, "m/s²")
    assert title("surge_rate") == "Surge speed" and title("heave_acceleration") == "Heave acceleration"


def test_words():
    assert ratio(1.0) == "1.00" and ratio(1234.0) == "1\u202f234" and ratio(np.inf) == "∞"
    assert listed(["a", "b", "c"]) == "a, b and c" and listed(["a"]) == "a" and listed([]) == ""
    assert effect_name("sensor_delay:gap_top") == "delay of the gap top sensor"
