# SPDX-License-Identifier: Apache-2.0
"""The page of `inductrack paper`: the paper's tables, figures and claims beside what the model gives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from ..core.parameters import PARAMETERS
from ..reports.fit_figures import profiles
from ..reports.fit_report import raised
from ..reports.page import Page, bullets, joined, markup, parts, table
from ..reports.words import SYMBOL, number, sized
from . import figures
from .claims import AGREES, CLOSE, DISAGREES, Row
from .identification import FLAT_SPEEDS, FLAT_STD, FREE, SPEEDS, STD, Precision, truth
from .reproduction import Reproduction, verdict

KINDS = {
    "typo": "a typo",
    "contradiction": "the paper contradicts itself",
    "assumption": "depends on what the paper does not print",
}


def render(work: Reproduction) -> str:
    """The whole page."""
    rows = work.claims.rows
    facts = work.facts
    page = Page(
        title=f"{facts.authors}, {facts.title} (2012)",
        kind="The paper, reproduced",
        verdict=verdict(rows),
        tone="good" if all(r.verdict != DISAGREES or r.claim.kind for r in rows) else "bad",
        lead=_lead(work),
        foot=markup(
            '<p>The paper: {}, <em>{}</em>, Journal of Vibration and Control, 2012, <a href="https://doi.org/{}">doi'
            " {}</a>. Its curves were not digitised: lay the paper beside this page.</p>",
            facts.authors,
            facts.title,
            facts.doi,
            facts.doi,
        ),
    )
    page.picture(
        page.figure(
            figures.picture(rows),
            "What the model gives over what the paper prints. Green: agrees; amber: close; orange: does not.",
        )
    )
    page.section("Every claim", _claims_table(rows), "claims")
    page.section("Tables 1 and 2", _tables(work), "tables")
    page.section("Figures", _figures(page, work), "figures")
    page.section("Stability in numbers", _stability(page, work), "stability")
    page.section("Identification", _identification(page, work), "identification")
    page.section("Air", _air(work), "air")
    page.section("Drive by pulses", _drive(page, work), "drive")
    return page.render()


def _lead(work: Reproduction) -> str:
    c = work.claims
    found = {r.claim.id: r.found for r in c.rows}
    points = [
        (
            f"The run of Figure 7 is reproduced: touchdown after {found['first_touch']:.2f} s, {found['sink']:.2f} mm"
            " into the contact, at rest by 3 s."
        ),
        (
            f"The critical speed is {found['critical_speed']:.2f} m/s; the paper prints 16.2 and 18.5. The speed is"
            f" unstable there: an error doubles in {c.numbers['doubling']:.2f} s."
        ),
        (
            "Heave is undamped only while the speed is held. Free, it is damped up to"
            f" {c.beyond['both_sign_change']:.1f} m/s, and unstable above once the coil current lags."
        ),
        f"Four distances can fix η and γ, if well chosen: {_choice_words(work)}.",
    ]
    return bullets(points)


def _choice_words(work: Reproduction) -> str:
    flat = next(p for p in work.choices if p.speeds == FLAT_SPEEDS)
    good = work.choices[-1]
    return (
        f"starts that all touch down tell η {flat.relative_std[0] / good.relative_std[0]:.0f} times worse than starts"
        f" from {good.speeds[0]:g} to {good.speeds[-1]:g} m/s"
    )


# ---------------------------------------------------------------- claims


#: Columns of the claims' table: title, width in rem. The third and the fourth hold numbers.
_COLUMNS = (("Where", 5.5), ("The paper says", 15), ("Paper", 8), ("Model", 8), ("Verdict", 9), ("Why", 28.5))


def _claims_table(rows: Sequence[Row]) -> Markup:
    caption = 'In the order of the paper. "Close" is within a few per cent but outside the printed digits.'
    header, widths = zip(*_COLUMNS, strict=True)
    cells = [{"id": f"claim-{r.claim.id}", "cells": _claim_cells(r)} for r in rows]
    return parts.table(header, cells, caption, {0, 1, 4, 5}, "table-layout:fixed;width:74rem", widths)


def _claim_cells(row: Row) -> list[str]:
    c = row.claim
    word, tone = {AGREES: ("agrees", "good"), CLOSE: ("close", "warn"), DISAGREES: ("does not", "bad")}[row.verdict]
    kind = markup("<br><span class='soft'>{}</span>", KINDS[c.kind]) if row.verdict != AGREES and c.kind else ""
    unit = f" {c.unit}" if c.unit else ""
    paper = "no number" if c.value is None else f"{number(c.value, 4)}{unit}"
    model = _found(row) + (unit if c.value is None else "")
    return [c.place, c.says, paper, model, markup('<span class="{}-word">{}</span>{}', tone, word, kind), row.why]


def _found(row: Row) -> str:
    """As many digits as it takes to compare with the paper's."""
    if row.claim.value == 0 and abs(row.found) <= row.claim.within:
        return "0" if abs(row.found) < 1e-12 else number(row.found, 2)
    return number(row.found, 4)


# ---------------------------------------------------------------- tables


def _tables(work: Reproduction) -> str:
    p, facts = work.model.parameters, work.facts
    rows = [
        [
            r["symbol"],
            r["meaning"],
            number(r["value"], 5),
            number(p[r["parameter"]], 5),
            r["unit"],
            markup("<code>{}</code>", r["parameter"]),
        ]
        for r in [*facts.table_1, *facts.elsewhere]
    ]
    printed = table(
        ["Symbol", "Meaning", "Paper", "Used", "Unit", "Parameter"],
        rows,
        "Table 1, and three values the paper prints elsewhere",
        words=2,
    )
    rows = [
        [
            r["symbol"],
            PARAMETERS[r["parameter"]].meaning,
            r["why"],
            number(p[r["parameter"]], 5),
            PARAMETERS[r["parameter"]].unit,
            markup("<code>{}</code>", r["parameter"]),
        ]
        for r in facts.assumed
    ]
    assumed = table(
        ["Symbol", "Meaning", "Why", "Used", "Unit", "Parameter"], rows, "Assumed: not in the paper", words=3
    )
    rows = []
    for r in facts.table_2:
        i = FREE.index(r["parameter"])
        fit = work.identified.fit
        rows.append(
            [
                r["symbol"],
                r["meaning"],
                number(r["before"], 5),
                number(r["after"], 5),
                sized(float(fit.values[i]), float(fit.std[i])),
                number(float(fit.nelder_mead[i]), 6),
            ]
        )
    second = table(
        ["Symbol", "Meaning", "Before", "After", "Found again", "by Nelder–Mead"],
        rows,
        "Table 2, and what the fit finds from the paper's starting values, given four distances simulated at the"
        f" published ones (± {100 * STD:g} cm)",
        words=2,
    )
    return markup(
        '{}{}{}<p class="soft">The four distances the paper fitted are not available here.</p>',
        printed,
        assumed,
        second,
    )


# ---------------------------------------------------------------- figures


def _figures(page: Page, work: Reproduction) -> str:
    r = work.runs
    orbit = r.figure_4
    seven, ten = figures.figure_7(r), figures.figure_10(r)
    blocks = [
        (figures.figure_2(r), markup("<b>Figure 2.</b> Lift and drag of a track circuit over ωL/R.")),
        (
            figures.figure_4(r),
            markup(
                "<b>Figure 4.</b> 1-DOF at 20 m/s, η = 1, let go at 10 mm: closed. Period {:.4f} s, {:.3f}–{:.3f} cm,"
                " ±{:.4f} m/s; 20 swings lose {:.2g} nm.",
                orbit.period,
                100 * orbit.low,
                100 * orbit.high,
                orbit.fastest,
                abs(1000000000.0 * orbit.lost),
            ),
        ),
        (
            figures.figure_5(r),
            markup(
                "<b>Figure 5.</b> Net lift with all gaps at 10 mm, where it never carries the weight of {:.1f} N, and"
                " the gap on which it does.",
                r.weight,
            ),
        ),
        (
            figures.figure_6(r),
            markup(
                "<b>Figure 6.</b> Travel in 2 s. Below the critical speed the cradle stops, above it it runs away: the"
                " averaged thrust grows with the speed."
            ),
        ),
        (seven[0], markup("<b>Figure 7a.</b> 2-DOF from 15.5 m/s: heave.")),
        (seven[1], markup("<b>Figure 7b.</b> Travel and speed.")),
        (
            seven[2],
            markup(
                "<b>Figure 7c.</b> Forces; drag is three times the lift. The contact carries the weight at the end."
            ),
        ),
        (ten[0], markup("<b>Figure 10a.</b> 4-DOF, 4 mm off the centre at −0.1 m/s: slip.")),
        (ten[1], markup("<b>Figure 10b.</b> Roll moment of the magnets.")),
        (ten[2], markup("<b>Figure 10c.</b> Roll.")),
    ]
    return markup('<div class="two">') + joined(page.figure(f, caption) for f, caption in blocks) + markup("</div>")


# ---------------------------------------------------------------- stability


#: Columns of the table of stability, and what stands in each.
_OF_STABILITY = {
    "Speed<br>m/s": lambda q: f"{q.speed:g}",
    "Gap<br>mm": lambda q: f"{1e3 * q.gap:.3f}",
    "Trim<br>A": lambda q: f"{q.drive_current:,.0f}",
    "Heave<br>N/m": lambda q: f"{q.heave_stiffness:,.0f}",
    "Sway<br>N/m": lambda q: f"{q.sway_stiffness:,.0f}",
    "Roll<br>N·m/rad": lambda q: f"{q.roll_stiffness:.1f}",
    "Heave<br>Hz": lambda q: f"{q.heave_frequency:.2f}",
    "Roll<br>Hz": lambda q: f"{q.lateral_frequencies[1]:.2f}",
    "Sway<br>Hz": lambda q: f"{q.lateral_frequencies[0]:.2f}",
    "Coupling<br>N·s/m": lambda q: _signed(q.coupling_damping),
    "Current<br>N·s/m": lambda q: _signed(q.current_damping),
    "Both<br>N·s/m": lambda q: _signed(q.both_damping),
    "Growth<br>1/s": lambda q: _signed(q.growth),
}


def _stability(page: Page, work: Reproduction) -> str:
    c = work.claims
    rows = [[say(q) for say in _OF_STABILITY.values()] for q in work.modes_shown]
    numbers = table(
        [markup(title) for title in _OF_STABILITY],
        rows,
        "Stiffness, natural frequencies, damping in heave by cause, growth of a speed error",
    )
    plots = [
        (figures.damping(c, work.modes), "Damping in heave. Below zero a swing grows."),
        (figures.eigenvalues(work.modes), "Eigenvalues of the 4-DOF model (steady coil current) over speed."),
        (figures.frequencies(work.modes), "Natural frequencies."),
        (figures.stiffness(work.modes), "Stiffness of the centred, level cradle."),
        (
            figures.growth(work.modes, work.runs.critical_speed),
            "An error of the speed grows at every speed: steady flight needs a controller.",
        ),
    ]
    shown = joined(page.figure(f, t) for f, t in plots)
    return _on_stability(work) + numbers + markup('<div class="two">') + shown + markup("</div>")


def _on_stability(work: Reproduction) -> str:
    """What the paper says of stability, and what the model gives."""
    c, m = work.claims, work.claims.at_critical_speed
    return markup(
        "<p>The model made linear about steady flight, the drive current trimmed so that thrust equals drag. <b>“No"
        " inherent damping in lift”</b> is exact while the speed is held. With the speed free, surge–heave coupling"
        " damps heave by {:.2f} N·s/m at the critical speed ({:.2g} % of critical damping). A coil current that takes"
        " its time adds damping below R/kL = {:.2f} m/s and removes it above (it changes sign at {:.2f} m/s here), as"
        " Post and Ryutov found; together they leave heave unstable above {:.1f} m/s.</p><p><b>“Stable in travel”</b>"
        " does not hold at any steady speed: an error grows, at the critical speed by {:.2f} 1/s. <b>“Strong concentric"
        " force”</b>: sway is stiff, {} N/m, a quarter of heave; with it the lateral motions are stable and undamped"
        " too.</p>",
        m.coupling_damping,
        100 * m.coupling_damping / (2 * np.sqrt(m.heave_stiffness * work.model.parameters["mass"])),
        c.beyond["corner_speed"],
        c.beyond["current_sign_change"],
        c.beyond["both_sign_change"],
        m.growth,
        number(m.sway_stiffness, 3),
    )


def _signed(value: float) -> str:
    return _minus(f"{value:+.2f}")


# ---------------------------------------------------------------- identification


def _identification(page: Page, work: Reproduction) -> str:
    held, found = work.coverage
    values, good, flat = truth(work.model), work.identified, work.flat
    rows = []
    for p in work.choices:
        rows.append([
            ", ".join(f"{v:g}" for v in p.speeds), ", ".join(f"{z:.1f}" for z in p.travels),
            f"{100 * p.relative_std[0]:.2g} %", f"{100 * p.relative_std[1]:.2g} %", f"{p.correlation:.4f}",
            markup("{} to {:.1g} %", _combination(p), 100 * p.valley.best_std),
        ])  # fmt: skip
    choices = table(
        ["Initial speeds (m/s)", "Distances in 2 s (m)", "η ±", "γ ±", "Correlation", "Fixed best"], rows,
        f"What four distances, each to ± {100 * STD:g} cm, can tell at best (standard errors)", words=2,
    )  # fmt: skip
    far = np.max(np.abs(good.fit.nelder_mead / good.fit.values - 1))
    words = markup(
        "<p>Distances of 2 s are simulated at the published η and γ, noise is added, and both methods start from the"
        " paper's η = 1, γ = 3. From {} m/s and ± {:g} cm: {} Least squares and Nelder–Mead agree to {} of the values"
        " ({} and {} evaluations).</p><p>In {} such identifications the stated 95 % interval held the true η {} times"
        " and the true γ {} times.</p>",
        _starts(SPEEDS),
        100 * STD,
        raised(good.words),
        number(float(far), 1),
        good.fit.evaluations["least squares"],
        good.fit.evaluations["Nelder–Mead"],
        len(found),
        held["eta"],
        held["gamma"],
    )
    warning = markup(
        '<div class="box"><b>Four distances may also say little.</b> From {} m/s, which all touch down, known to ± {:g}'
        " m: {}</div>",
        _starts(FLAT_SPEEDS),
        FLAT_STD,
        raised(flat.words),
    )
    return (
        words
        + markup('<div class="two">')
        + page.figure(
            profiles(good.profiles, values),
            f"Profile likelihood from {_starts(SPEEDS)} m/s, ± {100 * STD:g} cm; green: the 95 % interval.",
        )
        + page.figure(
            figures.answers(found, values, good),
            f"{len(found)} simulated identifications, and the ellipse that one of them states.",
        )
        + markup("</div>")
        + warning
        + page.figure(
            profiles(flat.profiles, values),
            f"Profile likelihood from {_starts(FLAT_SPEEDS)} m/s, ± {FLAT_STD:g} m: wide, and not a parabola.",
        )
        + choices
        + markup(
            "<p class='soft'>An initial speed that is off by 0.01 m/s moves the distance near the critical speed by "
        )
        + markup("{:.2g} m: there the speeds must be known far better than the distances.</p>", work.speed_error)
    )


def _starts(speeds: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in speeds[:-1]) + f" and {speeds[-1]:g}"


def _combination(p: Precision) -> str:
    parts = sorted(zip(FREE, p.valley.best_exponents, strict=True), key=lambda item: -item[1])
    return joined(
        (SYMBOL[n] + ("" if abs(e - 1) < 5e-3 else markup("<sup>{}</sup>", number(e, 2))) for n, e in parts), " · "
    )


# ---------------------------------------------------------------- air and drive


def _air(work: Reproduction) -> str:
    rows = [
        [f"{a.speed:g}", f"{a.friction:.2f}", f"{a.magnetic_drag:.0f}", f"{100 * a.friction / a.magnetic_drag:.2f} %",
         f"{1e3 * a.lost_powered:.0f} mm of {a.powered:.1f} m", f"{1e3 * a.lost_coasting:.0f} mm of {a.coasting:.1f} m"]
        for a in work.claims.air
    ]  # fmt: skip
    at_20, at_40 = work.claims.air[1], work.claims.air[2]
    words = markup(
        "<p>The paper's skin friction (14)–(16), as the effect <code>skin_friction_drag</code>, with 1 m² of wetted"
        " area (the paper prints none; force and effect are proportional to it). <b>Negligible against the magnetic"
        " drag up to 20 m/s</b> ({:.1f} %), less so at 40 m/s ({:.1f} %), where magnetic drag has fallen. Against a"
        " rig's sensors it is not: half a millimetre of travel shows it in any of these runs.</p>",
        100 * at_20.friction / at_20.magnetic_drag,
        100 * at_40.friction / at_40.magnetic_drag,
    )
    header = [
        "Speed (m/s)",
        "Friction (N)",
        "Magnetic drag (N)",
        "Share",
        "Lost in 1 s, powered",
        "Lost in 1 s, coasting",
    ]
    return words + table(header, rows)


def _drive(page: Page, work: Reproduction) -> str:
    test = work.drive
    rows = [
        [
            f"{r.speed:g}",
            f"{r.averaged:.2f}",
            _minus(f"{r.by_pulses - r.averaged:+.2f}"),
            _minus(f"{100 * (r.by_pulses / r.averaged - 1):+.1f} %"),
            _minus(f"{1e3 * (r.by_pulses - r.corrected):+.1f}"),
        ]
        for r in test.runs
    ]
    high = {v: f"{100 * (1 - q):.2g} %" for v, q in test.mean_at.items()}
    words = markup(
        "<p><b>The averaged law (39) is within 1 % of the pulses' mean thrust up to {:.0f} m/s</b> with τ = 600 µs"
        " (half the pulse length: twice the speed). It is {} high at 15.5 m/s, {} at 40 and {} at 80 m/s, because the"
        " field turns while a pulse lasts. Firing late matters more: the factor is cos(kvδ), and later than a quarter"
        " wavelength of travel the drive brakes. The factors cos(ωτ/2)/(1 − (ωτ/π)²) and cos(ωδ) (lines; the effects"
        " <code>finite_pulse_width</code> and <code>firing_delay</code>) give the pulses' mean (dots) to a part in a"
        " thousand: averaging does little harm, leaving those factors out does. Near the critical speed 1 % of thrust"
        " decides between touching down and running away.</p>",
        test.good_to,
        high[15.5],
        high[40.0],
        high[80.0],
    )
    header = [
        "Initial speed (m/s)",
        "Averaged: travel in 1 s (m)",
        "By pulses (m)",
        "",
        markup("By pulses, against averaged<br>with finite pulse width (mm)"),
    ]
    note = (
        "Free runs. Pulse by pulse, the half sine is scaled so that at small kvτ its mean is (39)'s: see the impulse of"
        " a pulse above."
    )
    return (
        words
        + page.figure(figures.drive(work.model), "Lines: formulas. Dots: pulse by pulse. Green band: within 1 %.")
        + table(header, rows, note)
    )


def _minus(number_text: str) -> str:
    return number_text.replace("-", "−")
