# SPDX-License-Identifier: Apache-2.0
"""Layouts of PlotJuggler and Foxglove: ``python -m inductrack_ros.nodes.layouts FOLDER`` writes both from one table.

The files in `layouts/` are what this writes; a test holds them to it, and every curve to a topic and field that exist.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from ..core.plain_json import file_text
from ..core.state import CHANNEL, FURTHER
from .runtime import NAMESPACE

_FORCES = {"surge": "force.x", "sway": "force.y", "heave": "force.z", "roll": "torque.x"}

#: Tab → plot → curves, as topic and field.
TABS: dict[str, dict[str, list[tuple[str, str]]]] = {
    "Motion": {
        "Speed, m/s": [("twist", "twist.linear.x"), ("measured/twist", "twist.linear.x")],
        "Heave, m": [("pose", "pose.position.z"), ("measured/pose", "pose.position.z")],
        "Sway, m": [("pose", "pose.position.y"), ("measured/pose", "pose.position.y")],
        "Gaps, m": [("gap_top", "range"), ("gap_right", "range"), ("gap_left", "range")],
    },
    "Forces": {
        "Surge, N": [(f"wrench/{part}", "wrench.force.x") for part in ("thrust", "drag", "total")],
        "Heave, N": [(f"wrench/{part}", "wrench.force.z") for part in ("lift", "weight", "contact", "total")],
        "Sway, N": [(f"wrench/{part}", "wrench.force.y") for part in ("slip", "total")],
        "Roll, N·m": [("wrench/total", "wrench.torque.x")],
    },
    "Drive": {
        "Pulses fired, A": [("fired_pulses", "point.y"), ("drive_pulses", "point.y")],
        "Thrust, N": [("wrench/thrust", "wrench.force.x")],
        "Speed, m/s": [("twist", "twist.linear.x")],
    },
    "Monitor": (
        {
            f"Missing in {c}, {'N·m' if c == 'roll' else 'N'}": [
                (t, f"wrench.{f}") for t in ("missing_force", "missing_force_sigma")
            ]
            for c, f in _FORCES.items()
        }
        | {
            "Residual of heave, m": [("residual/pose", "pose.position.z")],
            "Residual of speed, m/s": [("residual/twist", "twist.linear.x")],
        }
    ),
}
if FURTHER:
    TABS["Other sensors"] = {
        f"{CHANNEL[c].title}, {CHANNEL[c].unit}".rstrip(", "): [(f"measured/{CHANNEL[c].sensor}", CHANNEL[c].field)]
        for c in FURTHER
    }
_COLOURS = ("#1f77b4", "#d62728", "#1ac938", "#ff7f0e")


def plotjuggler() -> str:
    """A layout for PlotJuggler: a tab to each group, its plots one under the other.

    Version 3 knows a curve by its name. Version 4 knows it by topic and field, and says so at the root."""
    root = ElementTree.Element("root", format="PlotJuggler", pj4_version="4", binding="generic")
    tabs = ElementTree.SubElement(root, "tabbed_widget", name="Main Window", parent="main_window")
    for name, plots in TABS.items():
        tab = ElementTree.SubElement(tabs, "Tab", tab_name=name, containers="1")
        sizes = ";".join([f"{1 / len(plots):.6f}"] * len(plots))
        column = ElementTree.SubElement(
            ElementTree.SubElement(tab, "Container"),
            "DockSplitter",
            orientation="-",
            count=str(len(plots)),
            sizes=sizes,
        )
        for title, curves in plots.items():
            area = ElementTree.SubElement(column, "DockArea", name=title)
            plot = ElementTree.SubElement(
                area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false"
            )
            ElementTree.SubElement(plot, "range", left="0", right="1", bottom="0", top="1")
            ElementTree.SubElement(plot, "limitY")
            for (topic, field), colour in zip(curves, _COLOURS, strict=False):
                topic, field = f"/{NAMESPACE}/{topic}", field.replace(".", "/")
                ElementTree.SubElement(plot, "curve", name=f"{topic}/{field}", topic=topic, field=field, color=colour)
    ElementTree.SubElement(tabs, "currentTabIndex", index="0")
    ElementTree.SubElement(root, "use_relative_time_offset", enabled="1")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def foxglove() -> str:
    """A layout for Foxglove: a 3D view and the diagnostics beside tabs of plots."""
    panels: dict[str, object] = {
        "3D!rig": {
            "followTf": "cradle",
            "topics": {f"/{NAMESPACE}/{t}": {"visible": True} for t in ("forces", "scene")},
        },
        "DiagnosticSummary!all": {
            "topicToRender": "/diagnostics",
            "minLevel": 0,
            "hardwareIdFilter": "",
            "sortByLevel": True,
        },
    }
    tabs = []
    for tab, plots in TABS.items():
        names = []
        for title, curves in plots.items():
            names.append(f"Plot!{tab}-{len(names)}".lower().replace("plot!", "Plot!"))
            panels[names[-1]] = {
                "title": title,
                "paths": [
                    {"value": f"/{NAMESPACE}/{topic}.{field}", "enabled": True, "timestampMethod": "headerStamp"}
                    for topic, field in curves
                ],
                "showLegend": True,
                "isSynced": True,
                "xAxisVal": "timestamp",
            }
        tabs.append({"title": tab, "layout": _stacked(names)})
    panels["Tab!plots"] = {"activeTabIdx": 0, "tabs": tabs}
    left = {"first": "3D!rig", "second": "DiagnosticSummary!all", "direction": "column", "splitPercentage": 65}
    layout = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"first": left, "second": "Tab!plots", "direction": "row", "splitPercentage": 40},
    }
    return file_text(layout)


def _stacked(names: list[str]) -> object:
    """Panels one under the other, of one height."""
    if len(names) == 1:
        return names[0]
    share = 100 / len(names)
    return {"first": names[0], "second": _stacked(names[1:]), "direction": "column", "splitPercentage": round(share, 2)}


def main(folder: str) -> None:
    for name, text in (("plotjuggler.xml", plotjuggler()), ("foxglove.json", foxglove())):
        Path(folder, name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
