# SPDX-License-Identifier: Apache-2.0
"""The paper's figures and those of the tests beside them, drawn from finished numbers; the unit of each axis is the
paper's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..reports.drawing import BLUE, GREEN, ORANGE, PURPLE, at, axes, dots, line
from ..reports.page import Figure, packed
from ..reports.words import number
from .claims import AGREES, CLOSE, Claims, Row
from .drive import closed_formula, mean_ratio, thrust_in_time
from .identification import Answer
from .runs import SPEED_4, Runs, first_zero
from .stability import Modes

COLOUR = {AGREES: "@good", CLOSE: "@warn"}
FAR = 3e-4  # how far left the picture's axis goes
PULSE_LENGTHS = (300e-6, 600e-6, 1200e-6)
DELAY_SPEEDS = (15.5, 20.0, 40.0)


# ---------------------------------------------------------------- the first screen


def picture(rows: Sequence[Row]) -> Figure:
    """Model over paper for every claim with a number: one glance says which hold."""
    shown = [r for r in rows if r.claim.value]
    shown.sort(key=lambda r: (r.verdict != AGREES, r.verdict != CLOSE, abs(np.log(abs(r.found / r.claim.value)))))
    ratio = np.array([r.found / r.claim.value for r in shown])
    hover = [
        f"<b>{r.claim.name}</b>, {r.claim.place}<br>paper {number(r.claim.value, 4)} {r.claim.unit}, model"
        f" {number(r.found, 4)}<br>{r.verdict}"
        for r in shown
    ]
    words = ["opposite sign" if q < 0 else "" if 0.97 < q < 1.03 else f"{number(q, 2)} ×" for q in ratio]
    data = [
        {
            "type": "scatter",
            "mode": "markers+text",
            "x": np.maximum(np.abs(ratio), FAR).tolist(),
            "y": [r.claim.name for r in shown],
            "text": words,
            "textposition": ["middle right" if abs(q) < 0.1 else "middle left" for q in ratio],
            "hovertext": hover,
            "hoverinfo": "text",
            "marker": {
                "color": [COLOUR.get(r.verdict, "@before") for r in shown],
                "size": 11,
                "symbol": ["x" if q < 0 else "circle" for q in ratio],
            },
            "showlegend": False,
            "cliponaxis": False,
        }
    ]
    layout = {
        "xaxis": {
            "title": "model ÷ paper",
            "type": "log",
            "range": [np.log10(FAR), np.log10(6)],
            "tickvals": [1e-3, 1e-2, 0.1, 1],
            "ticktext": ["1/1000", "1/100", "1/10", "1"],
        },
        "yaxis": {"type": "category", "autorange": True},
        "shapes": [
            {
                "type": "line",
                "x0": 1,
                "x1": 1,
                "yref": "paper",
                "y0": 0,
                "y1": 1,
                "line": {"color": "@soft", "width": 1},
            }
        ],
        "margin": {"l": 8, "r": 20, "t": 8, "b": 8},
    }
    return Figure(
        data,
        layout,
        "What the model gives over what the paper prints, for each number of the paper",
        30 * len(shown) + 60,
    )


# ---------------------------------------------------------------- the paper's figures


def figure_2(runs: Runs) -> Figure:
    """Lift and drag over ωL/R."""
    f = runs.figure_2
    x, y = f["peak"]
    data = [
        line(f["ratio"], f["lift"], "lift", BLUE),
        line(f["ratio"], f["drag"], "drag", ORANGE),
        dots([x], [y], "largest drag", ORANGE, showlegend=False),
    ]
    note = {"x": x, "y": y, "text": f"½ at ωL/R = {x:.2f}", "ax": 80, "ay": -14, "arrowcolor": "@soft"}
    layout = axes("ωL/R", "force over largest lift", xaxis={"range": [0, 10]}, yaxis={"range": [0, 1.02]})
    return Figure(data, layout | {"annotations": [note]}, "Lift and drag over ωL/R")


def figure_4(runs: Runs) -> Figure:
    """The orbit of the 1-DOF model."""
    orbit = runs.figure_4
    gap = 100 * orbit.gaps
    turn = slice(0, 201)
    data = [
        line(gap, orbit.run["heave_rate"], "20 swings", BLUE, width=1),
        line(gap[turn], orbit.run["heave_rate"][turn], "the first", ORANGE, width=2, dash="dash"),
    ]
    return Figure(
        data,
        axes("gap under the top array (cm)", "vertical speed (m/s)"),
        f"Closed orbit of heave at a held speed of {SPEED_4:g} m/s",
    )


def figure_5(runs: Runs) -> Figure:
    """Lift at 10 mm and equilibrium gap over speed."""
    f = runs.figure_5
    data = [
        line(f["speed"], f["lift"], "lift at 10 mm (N)", BLUE),
        line(f["speed"], 1e3 * f["gap"], "gap (mm)", ORANGE, yaxis="y2"),
    ]
    mark = at(runs.lowest_speed, f"carries the weight<br>from {runs.lowest_speed:.2f} m/s on", side="right")
    layout = axes("speed (m/s)", "net lift with all gaps at 10 mm (N)", [mark], yaxis={"rangemode": "tozero"})
    layout["yaxis2"] = {
        "title": {"text": "gap that carries (mm)"},
        "overlaying": "y",
        "tickmode": "auto",
        "side": "right",
        "range": [0, 8],
        "showgrid": False,
    }
    return Figure(data, layout, "Lift and equilibrium gap over speed")


def figure_6(runs: Runs) -> Figure:
    """Travel in 2 s over the initial speed."""
    f = runs.figure_6
    data = [
        line(f["speed"], f["travel"], "travel in 2 s", BLUE),
        line(f["speed"], 2 * f["speed"], "at constant speed", "@soft", width=1, dash="dash"),
    ]
    critical = runs.critical_speed
    marks = [
        at(critical, f"equations {critical:.2f}", BLUE, up=0.98, side="right"),
        at(16.2, "text 16.2", ORANGE, up=0.88),
        at(18.5, "caption 18.5", ORANGE, up=0.98, side="right"),
    ]
    return Figure(
        data,
        axes("initial speed (m/s)", "travel in 2 s (m)", marks, yaxis={"rangemode": "tozero"}),
        "Travel in 2 s over initial speed",
    )


def figure_7(runs: Runs) -> tuple[Figure, Figure, Figure]:
    """Heave, travel and forces of the 2-DOF run."""
    run, thin = runs.figure_7, slice(None, None, 4)
    t, touch = run.times[thin], runs.first_touch
    mark = at(touch, f"touches at {touch:.2f} s")
    a = Figure(
        [line(t, 1e3 * run["gap_top"][thin], "gap", BLUE)],
        axes("time (s)", "gap under the top array (mm)", [at(touch, f"touches at {touch:.4f} s")], showlegend=False),
        "Figure 7a: gap over time, touching at 1.19 s",
    )
    b_layout = axes("time (s)", "travel (m)", [mark], yaxis={"rangemode": "tozero"})
    b_layout["yaxis2"] = {
        "title": {"text": "speed (m/s)"},
        "overlaying": "y",
        "tickmode": "auto",
        "side": "right",
        "rangemode": "tozero",
        "showgrid": False,
    }
    b = Figure(
        [
            line(t, run["surge"][thin], "travel (m)", BLUE),
            line(t, run["surge_rate"][thin], "speed (m/s)", ORANGE, yaxis="y2"),
        ],
        b_layout,
        "Figure 7b: travel and speed over time",
    )
    f = runs.figure_7_forces
    c = Figure(
        [
            line(f["times"], f["drag"], "drag", ORANGE),
            line(f["times"], f["thrust"], "thrust", GREEN),
            line(f["times"], f["lift"], "magnetic lift", BLUE),
            line(f["times"], f["contact"], "contact", "@soft", width=1),
        ],
        axes("time (s)", "force (N)", [mark], yaxis={"range": [0, 420]}),
        "Figure 7c: drag, thrust, lift and contact force over time",
    )
    return a, b, c


def figure_10(runs: Runs) -> tuple[Figure, Figure, Figure]:
    """Slip, roll moment and roll of the 4-DOF run."""
    run, thin = runs.figure_10, slice(None, None, 4)
    t = run.times[thin]
    first, second = first_zero(run.times, run["gap_top"]), runs.second_touch
    marks = [
        at(first, f"top touches, {first:.2f} s"),
        at(second, f"side, {second:.2f} s", side="right"),
        at(2.5, "paper: 2.5 s", ORANGE, up=0.12, side="right"),
    ]
    f = runs.figure_10_moment
    a = Figure(
        [line(t, 1e3 * run["sway"][thin], "slip", BLUE)],
        axes("time (s)", "slip (mm, left)", marks, showlegend=False),
        "Figure 10a: slip over time",
    )
    b = Figure(
        [line(f["times"], f["moment"], "moment", BLUE)],
        axes("time (s)", "roll moment (N·m)", marks, showlegend=False),
        "Figure 10b: roll moment over time",
    )
    c = Figure(
        [line(t, np.degrees(run["roll"][thin]), "roll", BLUE)],
        axes("time (s)", "roll (°)", marks, showlegend=False),
        "Figure 10c: roll over time",
    )
    return a, b, c


# ---------------------------------------------------------------- claims as numbers


def damping(claims: Claims, found: Sequence[Modes]) -> Figure:
    """Damping in heave over speed, by what causes it."""
    speed = [m.speed for m in found]
    data = [
        line(speed, [m.held_damping for m in found], "the paper's: speed held", "@soft", dash="dash"),
        line(speed, [m.coupling_damping for m in found], "speed free: surge–heave coupling", BLUE),
        line(speed, [m.current_damping for m in found], "unsteady coil current, speed held", ORANGE),
        line(speed, [m.both_damping for m in found], "both", GREEN, width=3),
    ]
    corner, end = claims.beyond["current_sign_change"], claims.beyond["both_sign_change"]
    marks = [at(corner, f"R/kL, {corner:.1f} m/s", ORANGE), at(end, f"unstable above {end:.1f} m/s", GREEN, up=0.4)]
    layout = axes(
        "speed (m/s)", "damping in heave (N·s/m)", marks, yaxis={"range": [-0.6, 3]}, xaxis={"range": [8, 60]}
    )
    layout["legend"] = {
        "orientation": "v",
        "x": 0.99,
        "xanchor": "right",
        "y": 0.99,
        "yanchor": "top",
        "bgcolor": "@page",
    }
    return Figure(data, layout, "Damping in heave over speed, by cause", 360)


def frequencies(found: Sequence[Modes]) -> Figure:
    """Natural frequencies over speed."""
    speed = [m.speed for m in found]
    data = [
        line(speed, [m.heave_frequency for m in found], "heave", BLUE),
        line(speed, [m.lateral_frequencies[1] for m in found], "roll with sway", PURPLE),
        line(speed, [m.lateral_frequencies[0] for m in found], "sway with roll", GREEN),
    ]
    return Figure(
        data,
        axes("speed (m/s)", "natural frequency (Hz)", yaxis={"rangemode": "tozero"}),
        "Natural frequencies over speed",
    )


def stiffness(found: Sequence[Modes]) -> Figure:
    """Stiffness in heave, sway and roll over speed."""
    speed = [m.speed for m in found]
    data = [
        line(speed, [1e-3 * m.heave_stiffness for m in found], "heave (N/mm)", BLUE),
        line(speed, [1e-3 * m.sway_stiffness for m in found], "sway (N/mm)", GREEN),
        line(speed, [m.roll_stiffness for m in found], "roll (N·m/rad)", PURPLE, yaxis="y2"),
    ]
    layout = axes("speed (m/s)", "stiffness (N/mm)", yaxis={"range": [0, 30]})
    layout["yaxis2"] = {
        "title": {"text": "roll (N·m/rad)"},
        "overlaying": "y",
        "tickmode": "auto",
        "side": "right",
        "range": [0, 90],
        "showgrid": False,
    }
    return Figure(data, layout, "Stiffness in heave, sway and roll over speed")


def growth(found: Sequence[Modes], critical: float) -> Figure:
    """How fast an error of the speed grows, in steady flight at each speed."""
    speed = [m.speed for m in found]
    data = [line(speed, [m.growth for m in found], "growth", ORANGE)]
    layout = axes(
        "speed (m/s)",
        "growth of a speed error (1/s)",
        [at(critical, f"critical speed, {critical:.2f} m/s")],
        showlegend=False,
        yaxis={"rangemode": "tozero"},
    )
    return Figure(data, layout, "Growth rate of a speed error over speed: positive everywhere")


def eigenvalues(found: Sequence[Modes]) -> Figure:
    """All eigenvalues of the 4-DOF model in the complex plane, the speed as colour."""
    real = np.concatenate([m.eigenvalues.real for m in found])
    imaginary = np.concatenate([m.eigenvalues.imag for m in found])
    speed = np.concatenate([np.full(len(m.eigenvalues), m.speed) for m in found])
    upper = imaginary >= 0
    marker = {
        "color": speed[upper].tolist(),
        "colorscale": "Viridis",
        "size": 6,
        "colorbar": {"title": {"text": "speed<br>(m/s)"}, "thickness": 12},
    }
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": packed(real[upper]),
            "y": packed(imaginary[upper]),
            "marker": marker,
            "showlegend": False,
        }
    ]
    notes = [
        {"x": -0.4, "y": 43, "text": "heave", "showarrow": False, "xanchor": "right"},
        {"x": 0.1, "y": 31, "text": "roll with sway", "showarrow": False, "xanchor": "left"},
        {"x": 0.1, "y": 13, "text": "sway with roll", "showarrow": False, "xanchor": "left"},
        {"x": 2.0, "y": 3, "text": "speed", "showarrow": False},
    ]
    layout = axes("real part (1/s): right of 0 grows", "imaginary part (rad/s)", xaxis={"range": [-1.2, 3.5]})
    return Figure(data, layout | {"annotations": notes}, "Eigenvalues of the linearised 4-DOF model over speed", 360)


# ---------------------------------------------------------------- drive


def drive(model) -> Figure:
    """Thrust in time, mean thrust over speed and pulse length, mean thrust over firing delay."""
    return Figure(
        [*_thrust_in_time(model), *_thrust_over_speed(model), *_thrust_over_delay(model)],
        _drive_layout(),
        "Drive pulse by pulse against the averaged law, over time, speed, pulse length and firing delay",
        430,
    )


def _thrust_in_time(model) -> list[dict]:
    time, thrust = thrust_in_time(model, 15.5, periods=2.0, points=601)
    mean = model.quantities(model.initial_state(surge_rate=15.5))["thrust"]
    return [
        line(1e3 * time, 1e-3 * thrust, "pulse by pulse", BLUE, legendgroup="p"),
        line(1e3 * time[[0, -1]], 1e-3 * np.array([mean, mean]), "averaged (39)", ORANGE, width=2),
    ]


def _thrust_over_speed(model) -> list[dict]:
    """Mean thrust for each pulse length: points of the simulation, lines of the closed formula."""
    second = {"xaxis": "x2", "yaxis": "y2"}
    speeds, fine = np.concatenate([np.linspace(2, 10, 3), np.linspace(15, 100, 18)]), np.linspace(1, 100, 200)
    data = []
    for tau, colour in zip(PULSE_LENGTHS, (GREEN, BLUE, PURPLE), strict=True):
        of = model.with_changes({"pulse_length": tau})
        low = [v for v in speeds if 2 * v * tau < 1.6 * of.parameters["wavelength"]]
        name = f"τ = {1e6 * tau:.0f} µs"
        data.append(dots(low, [mean_ratio(of, v) for v in low], name, colour, **second, size=6))
        data.append(line(fine, closed_formula(of, fine), name, colour, **second, showlegend=False, width=1.5))
    return data


def _thrust_over_delay(model) -> list[dict]:
    """Mean thrust for each speed: points of the simulation, lines of the closed formula."""
    third = {"xaxis": "x3", "yaxis": "y3"}
    delays, fine = np.linspace(0, 1.2e-3, 13), np.linspace(0, 1.2e-3, 200)
    looks = zip(DELAY_SPEEDS, (GREEN, BLUE, PURPLE), ("square", "diamond", "triangle-up"), strict=True)
    data = []
    for speed, colour, shape in looks:
        name, ratios = f"{speed:g} m/s", [mean_ratio(model, speed, d) for d in delays]
        law = closed_formula(model, speed, fine)
        data.append(dots(1e3 * delays, ratios, name, colour, **third, size=7, symbol=shape))
        data.append(line(1e3 * fine, law, name, colour, **third, showlegend=False, width=1.5))
    return data


def _drive_layout() -> dict:
    """Three plots side by side, with a band of 1 % about the averaged law in the last two."""
    titles = ("one pulse every λ/2, at 15.5 m/s", "speed and pulse length, fired in time", "fired late, τ = 600 µs")
    at = {"x": 0, "y": 1.08, "showarrow": False, "xanchor": "left"}
    notes = [
        {"xref": f"x{n} domain", "yref": f"y{n} domain", "text": f"<b>{words}</b>", **at}
        for n, words in zip(("", "2", "3"), titles, strict=True)
    ]
    band = {"type": "rect", "x0": 0, "x1": 1, "y0": 0.99, "y1": 1.01, "fillcolor": "@band", "line": {"width": 0}}
    return {
        "xaxis": {"title": "time (ms)", "domain": [0, 0.27]},
        "yaxis": {"title": "thrust (kN)"},
        "xaxis2": {"title": "speed (m/s)", "domain": [0.36, 0.63], "anchor": "y2", "range": [0, 102]},
        "yaxis2": {"title": "mean thrust ÷ averaged law", "anchor": "x2", "range": [-0.15, 1.1]},
        "xaxis3": {"title": "delay (ms)", "domain": [0.73, 1], "anchor": "y3"},
        "yaxis3": {"title": "mean thrust ÷ averaged law", "anchor": "x3", "range": [-1.1, 1.1]},
        "annotations": notes,
        "shapes": [{**band, "xref": f"x{n} domain", "yref": f"y{n}", "layer": "below"} for n in ("2", "3")],
        "legend": {"orientation": "h", "x": 0, "y": -0.2, "yanchor": "top"},
        "margin": {"l": 8, "r": 8, "t": 40, "b": 8},
    }


# ---------------------------------------------------------------- identification


def answers(found: np.ndarray, truth: Sequence[float], one: Answer) -> Figure:
    """All answers of the simulated identifications, and the ellipse that one of them states."""
    turn = np.linspace(0, 2 * np.pi, 121)
    root = np.linalg.cholesky(one.fit.covariance) * np.sqrt(5.991)
    ellipse = np.array(truth)[:, None] + root @ np.array([np.cos(turn), np.sin(turn)])
    data = [
        dots(found[:, 0], found[:, 1], "answers", BLUE, size=6),
        line(*ellipse, "95 % ellipse as stated", "@soft", width=1),
        dots([truth[0]], [truth[1]], "true", ORANGE, size=12, symbol="cross"),
    ]
    return Figure(data, axes("η", "γ", xaxis={"nticks": 5}), f"Answers of {len(found)} simulated identifications", 320)
