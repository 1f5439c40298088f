"""The page of `inductrack paper`: the paper's tables, figures and claims beside what the model gives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.parameters import PARAMETERS
from ..reports.fit_figures import profiles
from ..reports.fit_report import raised
from ..reports.page import Page, table, text
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
        foot=f'<p>The paper: {text(facts.authors)}, <em>{text(facts.title)}</em>, Journal of Vibration and Control, 2012, <a href="https://doi.org/{facts.doi}">doi {facts.doi}</a>. '
        "Its curves were not digitised: lay the paper beside this page.</p>",
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
        f"The run of Figure 7 is reproduced: touchdown after {found['first_touch']:.2f} s, {found['sink']:.2f} mm into the contact, at rest by 3 s.",
        f"The critical speed is {found['critical_speed']:.2f} m/s; the paper prints 16.2 and 18.5. The speed is unstable there: an error doubles in {c.numbers['doubling']:.2f} s.",
        f"Heave is undamped only while the speed is held. Free, it is damped up to {c.beyond['both_sign_change']:.1f} m/s, and unstable above once the coil current lags.",
        f"Four distances can fix η and γ, if well chosen: {_choice_words(work)}.",
    ]
    return "<ul>" + "".join(f"<li>{p}</li>" for p in points) + "</ul>"


def _choice_words(work: Reproduction) -> str:
    flat = next(p for p in work.choices if p.speeds == FLAT_SPEEDS)
    good = work.choices[-1]
    return f"starts that all touch down tell η {flat.relative_std[0] / good.relative_std[0]:.0f} times worse than starts from {good.speeds[0]:g} to {good.speeds[-1]:g} m/s"


# ---------------------------------------------------------------- claims


def _claims_table(rows: Sequence[Row]) -> str:
    widths = (
        ("Where", 5.5, _W),
        ("The paper says", 15, _W),
        ("Paper", 8, ""),
        ("Model", 8, ""),
        ("Verdict", 9, _W),
        ("Why", 28.5, _W),
    )
    head = "".join(f'<th scope="col"{c} style="width:{w}rem">{h}</th>' for h, w, c in widths)
    body = "".join(f'<tr id="claim-{r.claim.id}">{_claim_cells(r)}</tr>' for r in rows)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="table"><table style="table-layout:fixed;width:74rem"><caption>In the order of the paper. "Close" is within a few per cent but '
        f"outside the printed digits.</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


_W = ' class="word"'


def _claim_cells(row: Row) -> str:
    c = row.claim
    word, tone = {AGREES: ("agrees", "good"), CLOSE: ("close", "warn"), DISAGREES: ("does not", "bad")}[row.verdict]
    kind = f"<br><span class='soft'>{KINDS[c.kind]}</span>" if row.verdict != AGREES and c.kind else ""
    unit = f" {c.unit}" if c.unit else ""
    paper = "no number" if c.value is None else f"{number(c.value, 4)}{unit}"
    return (
        f'<th scope="row" class="word">{text(c.place)}</th><td class="word">{text(c.says)}</td>'
        f'<td style="white-space:normal">{text(paper)}</td><td style="white-space:normal">'
        f"{text(_found(row))}{text(unit) if c.value is None else ''}</td>"
        f'<td class="word"><span class="{tone}-word">{word}</span>{kind}</td><td class="word">{text(row.why)}</td>'
    )


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
            text(r["symbol"]),
            text(r["meaning"]),
            number(r["value"], 5),
            number(p[r["parameter"]], 5),
            text(r["unit"]),
            f"<code>{r['parameter']}</code>",
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
            text(r["symbol"]),
            text(PARAMETERS[r["parameter"]].meaning),
            text(r["why"]),
            number(p[r["parameter"]], 5),
            PARAMETERS[r["parameter"]].unit,
            f"<code>{r['parameter']}</code>",
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
                text(r["symbol"]),
                text(r["meaning"]),
                number(r["before"], 5),
                number(r["after"], 5),
                sized(float(fit.values[i]), float(fit.std[i])),
                number(float(fit.nelder_mead[i]), 6),
            ]
        )
    second = table(
        ["Symbol", "Meaning", "Before", "After", "Found again", "by Nelder–Mead"], rows,
        f"Table 2, and what the fit finds from the paper's starting values, given four distances simulated at the published ones (± {100 * STD:g} cm)", words=2,
    )  # fmt: skip
    return f'{printed}{assumed}{second}<p class="soft">The four distances the paper fitted are not available here.</p>'


# ---------------------------------------------------------------- figures


def _figures(page: Page, work: Reproduction) -> str:
    r = work.runs
    orbit = r.figure_4
    seven, ten = figures.figure_7(r), figures.figure_10(r)
    blocks = [
        (figures.figure_2(r), "<b>Figure 2.</b> Lift and drag of a track circuit over ωL/R."),
        (
            figures.figure_4(r),
            f"<b>Figure 4.</b> 1-DOF at 20 m/s, η = 1, let go at 10 mm: closed. Period {orbit.period:.4f} s, {100 * orbit.low:.3f}–{100 * orbit.high:.3f} cm, ±{orbit.fastest:.4f} m/s; "
            f"20 swings lose {abs(1e9 * orbit.lost):.2g} nm.",
        ),
        (
            figures.figure_5(r),
            f"<b>Figure 5.</b> Net lift with all gaps at 10 mm, where it never carries the weight of {r.weight:.1f} N, and the gap on which it does.",
        ),
        (
            figures.figure_6(r),
            "<b>Figure 6.</b> Travel in 2 s. Below the critical speed the cradle stops, above it it runs away: the averaged thrust grows with the speed.",
        ),
        (seven[0], "<b>Figure 7a.</b> 2-DOF from 15.5 m/s: heave."),
        (seven[1], "<b>Figure 7b.</b> Travel and speed."),
        (
            seven[2],
            "<b>Figure 7c.</b> Forces; drag is three times the lift. The contact carries the weight at the end.",
        ),
        (ten[0], "<b>Figure 10a.</b> 4-DOF, 4 mm off the centre at −0.1 m/s: slip."),
        (ten[1], "<b>Figure 10b.</b> Roll moment of the magnets."),
        (ten[2], "<b>Figure 10c.</b> Roll."),
    ]
    return '<div class="two">' + "".join(page.figure(f, caption) for f, caption in blocks) + "</div>"


# ---------------------------------------------------------------- stability


def _stability(page: Page, work: Reproduction) -> str:
    c = work.claims
    m = c.at_critical_speed
    words = (
        f"<p>The model made linear about steady flight, the drive current trimmed so that thrust equals drag. "
        f"<b>“No inherent damping in lift”</b> is exact while the speed is held. With the speed free, surge–heave coupling damps heave by {m.coupling_damping:.2f} N·s/m at the critical speed "
        f"({100 * m.coupling_damping / (2 * np.sqrt(m.heave_stiffness * work.model.parameters['mass'])):.2g} % of critical damping). "
        f"A coil current that takes its time adds damping below R/kL = {c.beyond['corner_speed']:.2f} m/s and removes it above (it changes sign at {c.beyond['current_sign_change']:.2f} m/s here), "
        f"as Post and Ryutov found; together they leave heave unstable above {c.beyond['both_sign_change']:.1f} m/s.</p>"
        f"<p><b>“Stable in travel”</b> does not hold at any steady speed: an error grows, at the critical speed by {m.growth:.2f} 1/s. "
        f"<b>“Strong concentric force”</b>: sway is stiff, {number(m.sway_stiffness, 3)} N/m, a quarter of heave; with it the lateral motions are stable and undamped too.</p>"
    )
    rows = [
        [f"{q.speed:g}", f"{1e3 * q.gap:.3f}", f"{q.drive_current:,.0f}", f"{q.heave_stiffness:,.0f}", f"{q.sway_stiffness:,.0f}", f"{q.roll_stiffness:.1f}",
         f"{q.heave_frequency:.2f}", f"{q.lateral_frequencies[1]:.2f}", f"{q.lateral_frequencies[0]:.2f}",
         _signed(q.coupling_damping), _signed(q.current_damping), _signed(q.both_damping), _signed(q.growth)]
        for q in work.modes_shown
    ]  # fmt: skip
    header = ["Speed<br>m/s", "Gap<br>mm", "Trim<br>A", "Heave<br>N/m", "Sway<br>N/m", "Roll<br>N·m/rad", "Heave<br>Hz", "Roll<br>Hz", "Sway<br>Hz",
              "Coupling<br>N·s/m", "Current<br>N·s/m", "Both<br>N·s/m", "Growth<br>1/s"]  # fmt: skip
    numbers = table(header, rows, "Stiffness, natural frequencies, damping in heave by cause, growth of a speed error")
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
    return words + numbers + '<div class="two">' + "".join(page.figure(f, t) for f, t in plots) + "</div>"


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
            f"{_combination(p)} to {100 * p.valley.best_std:.1g} %",
        ])  # fmt: skip
    choices = table(
        ["Initial speeds (m/s)", "Distances in 2 s (m)", "η ±", "γ ±", "Correlation", "Fixed best"], rows,
        f"What four distances, each to ± {100 * STD:g} cm, can tell at best (standard errors)", words=2,
    )  # fmt: skip
    far = np.max(np.abs(good.fit.nelder_mead / good.fit.values - 1))
    words = (
        f"<p>Distances of 2 s are simulated at the published η and γ, noise is added, and both methods start from the paper's η = 1, γ = 3. "
        f"From {_starts(SPEEDS)} m/s and ± {100 * STD:g} cm: {raised(good.words)} Least squares and Nelder–Mead agree to {number(float(far), 1)} of the values "
        f"({good.fit.evaluations['least squares']} and {good.fit.evaluations['Nelder–Mead']} evaluations).</p>"
        f"<p>In {len(found)} such identifications the stated 95 % interval held the true η {held['eta']} times and the true γ {held['gamma']} times.</p>"
    )
    warning = f'<div class="box"><b>Four distances may also say little.</b> From {_starts(FLAT_SPEEDS)} m/s, which all touch down, known to ± {FLAT_STD:g} m: {raised(flat.words)}</div>'
    return (
        words
        + '<div class="two">'
        + page.figure(
            profiles(good.profiles, values),
            f"Profile likelihood from {_starts(SPEEDS)} m/s, ± {100 * STD:g} cm; green: the 95 % interval.",
        )
        + page.figure(
            figures.answers(found, values, good),
            f"{len(found)} simulated identifications, and the ellipse that one of them states.",
        )
        + "</div>"
        + warning
        + page.figure(
            profiles(flat.profiles, values),
            f"Profile likelihood from {_starts(FLAT_SPEEDS)} m/s, ± {FLAT_STD:g} m: wide, and not a parabola.",
        )
        + choices
        + "<p class='soft'>An initial speed that is off by 0.01 m/s moves the distance near the critical speed by "
        + f"{work.speed_error:.2g} m: there the speeds must be known far better than the distances.</p>"
    )


def _starts(speeds: Sequence[float]) -> str:
    return ", ".join(f"{v:g}" for v in speeds[:-1]) + f" and {speeds[-1]:g}"


def _combination(p: Precision) -> str:
    parts = sorted(zip(FREE, p.valley.best_exponents, strict=True), key=lambda item: -item[1])
    return " · ".join(SYMBOL[n] + ("" if abs(e - 1) < 5e-3 else f"<sup>{number(e, 2)}</sup>") for n, e in parts)


# ---------------------------------------------------------------- air and drive


def _air(work: Reproduction) -> str:
    rows = [
        [f"{a.speed:g}", f"{a.friction:.2f}", f"{a.magnetic_drag:.0f}", f"{100 * a.friction / a.magnetic_drag:.2f} %",
         f"{1e3 * a.lost_powered:.0f} mm of {a.powered:.1f} m", f"{1e3 * a.lost_coasting:.0f} mm of {a.coasting:.1f} m"]
        for a in work.claims.air
    ]  # fmt: skip
    at_20, at_40 = work.claims.air[1], work.claims.air[2]
    words = (
        "<p>The paper's skin friction (14)–(16), as the effect <code>skin_friction_drag</code>, with 1 m² of wetted area (the paper prints none; force and effect are proportional to it). "
        f"<b>Negligible against the magnetic drag up to 20 m/s</b> ({100 * at_20.friction / at_20.magnetic_drag:.1f} %), "
        f"less so at 40 m/s ({100 * at_40.friction / at_40.magnetic_drag:.1f} %), where magnetic drag has fallen. "
        "Against a rig's sensors it is not: half a millimetre of travel shows it in any of these runs.</p>"
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
    words = (
        f"<p><b>The averaged law (39) is within 1 % of the pulses' mean thrust up to {test.good_to:.0f} m/s</b> with τ = 600 µs (half the pulse length: twice the speed). It is {high[15.5]} high at 15.5 m/s, "
        f"{high[40.0]} at 40 and {high[80.0]} at 80 m/s, because the field turns while a pulse lasts. "
        "Firing late matters more: the factor is cos(kvδ), and later than a quarter wavelength of travel the drive brakes. "
        "The factors cos(ωτ/2)/(1 − (ωτ/π)²) and cos(ωδ) (lines; the effects <code>finite_pulse_width</code> and <code>firing_delay</code>) give the pulses' mean (dots) to a part in a thousand: "
        "averaging does little harm, leaving those factors out does. Near the critical speed 1 % of thrust decides between touching down and running away.</p>"
    )
    header = [
        "Initial speed (m/s)",
        "Averaged: travel in 1 s (m)",
        "By pulses (m)",
        "",
        "By pulses, against averaged<br>with finite pulse width (mm)",
    ]
    note = "Free runs. Pulse by pulse, the half sine is scaled so that at small kvτ its mean is (39)'s: see the impulse of a pulse above."
    return (
        words
        + page.figure(figures.drive(work.model), "Lines: formulas. Dots: pulse by pulse. Green band: within 1 %.")
        + table(header, rows, note)
    )


def _minus(number_text: str) -> str:
    return number_text.replace("-", "−")
