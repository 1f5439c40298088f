# SPDX-License-Identifier: Apache-2.0
"""The page of `inductrack fit`: what the measurements fix, and how well."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from ..checks import Finding
from ..estimation.identify import Fit, Profile, valley
from ..estimation.misfits import SeriesMisfit, TravelMisfit, Travels
from .fit_figures import distances, profiles
from .page import Page, joined, markup, table
from .words import SYMBOL, number, sized


@dataclass(frozen=True)
class FitReport:
    """One identification, ready to be shown."""

    fit: Fit
    profiles: Sequence[Profile]
    words: str
    travels: Travels | None
    campaign: str
    travel: TravelMisfit | None
    series: SeriesMisfit | None
    notes: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()


def results(report: FitReport) -> dict[str, Any]:
    """The fit for programs; a number that is not finite (an interval without an end) is null in the file."""
    fit = report.fit
    along = valley(fit)
    return {
        "verdict": report.words,
        "findings": [f.to_json() for f in report.findings],
        "parameters": {
            n: {
                "value": v,
                "std": s,
                "interval": [p.low, p.high],
                "flat": p.flat,
                "nelder_mead": nm,
                "profile": {"value": p.values.tolist(), "rise": p.rise.tolist(), "threshold": p.threshold},
            }
            for n, v, s, nm, p in zip(
                fit.free, fit.values.tolist(), fit.std.tolist(), _simplex(fit), report.profiles, strict=True
            )
        },
        "correlation": fit.correlation.tolist(),
        "misfit": fit.misfit,
        "degrees_of_freedom": fit.degrees,
        "noise_known": fit.noise_known,
        "noise": None if fit.noise_known else fit.noise,
        "chance": fit.chance,
        "fixed_best": (
            None
            if along is None
            else {
                "exponents": dict(zip(fit.free, along.best_exponents.tolist(), strict=True)),
                "relative_std": along.best_std,
            }
        ),
    }


def _simplex(fit: Fit) -> list[float]:
    return [math.nan] * len(fit.free) if fit.nelder_mead is None else fit.nelder_mead.tolist()


def render(report: FitReport) -> str:
    """The whole page."""
    fit = report.fit
    flat = any(p.flat for p in report.profiles)
    about = " and ".join(
        part
        for part in (
            f"{len(report.travels.travel)} travel distances" if report.travels is not None else "",
            report.campaign and f"campaign {report.campaign}",
        )
        if part
    )
    first, *rest = report.words.split(". ")
    page = Page(
        title=about,
        kind="Identification",
        verdict=first.rstrip(".").replace("^-", "^−") + ".",
        tone="warn" if flat or fit.chance < 1e-4 else "good",
        lead=joined(markup("<p>{}.</p>", raised(s.rstrip("."))) for s in rest),
        notes=report.notes,
        findings=report.findings,
    )
    page.picture(
        page.figure(
            profiles(report.profiles),
            "Profile likelihood: by how much the least misfit rises when one parameter is held. Green: the 95 %"
            " interval.",
        )
    )
    page.section("Values", _values(report), "values")
    if report.travel is not None:
        page.section("Distances", _distances(page, report), "distances")
    if report.series is not None:
        page.section("Time series", _series(report), "series")
    return page.render()


def _values(report: FitReport) -> str:
    fit = report.fit
    rows = []
    for i, p in enumerate(report.profiles):
        declared = (report.travel or report.series).declared[i]
        simplex = _simplex(fit)[i]
        name = SYMBOL.get(p.name, "")
        label = markup("{} <code>{}</code>", name, p.name)
        rows.append(
            [
                label,
                sized(p.best, float(fit.std[i]), declared.unit),
                f"{number(p.low, 5)} – {number(p.high, 5)}",
                number(simplex, 6),
                number(fit.start[i], 5),
            ]
        )
    values = table(["Parameter", "Least squares ± standard error", "95 % interval", "Nelder–Mead", "Start"], rows)
    names = [SYMBOL.get(n, n) for n in fit.free]
    matrix = ""
    if len(names) > 1:
        rows = [
            [n, *(f"{c:.4f}".replace("-", "−") for c in row)] for n, row in zip(names, fit.correlation, strict=True)
        ]
        matrix = table(["Correlation", *names], rows)
    if fit.noise_known:
        noise = (
            f"Misfit {number(fit.misfit, 5)} over {fit.degrees} degrees of freedom, the noise as stated (chance of"
            f" more: {number(fit.chance, 2)})."
        )
    else:
        noise = (
            f"The noise was not stated; the residuals make it {number(fit.noise, 3)} m with {fit.degrees} degrees of"
            " freedom, and the intervals are as much wider (F distribution)."
        )
    counts = ", ".join(f"{name} {n}" for name, n in fit.evaluations.items())
    return values + matrix + markup("<p class='soft'>{} Evaluations: {}.</p>", noise, counts)


def _distances(page: Page, report: FitReport) -> str:
    t, fit = report.travels, report.fit
    predicted = report.travel.predict(fit.values)
    left = t.travel - predicted
    rows = [
        [f"{v:g}", f"{d:g}", f"{z:.3f}", f"{q:.3f}", f"{r:+.3f}".replace("-", "−")]
        for v, d, z, q, r in zip(t.initial_speed, t.duration, t.travel, predicted, left, strict=True)
    ]
    header = ["Initial speed (m/s)", "Time (s)", "Measured (m)", "Fitted (m)", "Difference (m)"]
    std = t.std if np.isfinite(t.std).all() else np.full(len(left), fit.noise)
    return page.figure(distances(t.initial_speed, left, std)) + table(header, rows, words=0)


def _series(report: FitReport) -> str:
    series = report.series
    problem, structure = series.problem, series.structure
    states = [np.array(s) for s in series.found.states]
    rows = []
    for data, r in zip(
        problem.runs, problem.residuals(structure, structure.encode(report.fit.values), states), strict=True
    ):
        rows.append([data.run.name, f"{len(r)}", f"{np.sqrt(np.nanmean(r**2)):.2f}"])
    return table(["Run", "Samples", "Error over noise"], rows) + markup(
        "<p class='soft'>Traces: <code>inductrack compare CAMPAIGN --model model.yaml</code>.</p>"
    )


def raised(sentence: str) -> str:
    """HTML of a sentence with exponents such as ^-0.98."""
    return Markup(re.sub(r"\^(-?[\d.]+\d)", lambda m: f"<sup>{m[1].replace('-', '−')}</sup>", escape(sentence)))
