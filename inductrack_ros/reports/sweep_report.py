# SPDX-License-Identifier: Apache-2.0
"""The page of `inductrack sweep`: where the cradle flies, what the runs come to, and the planned runs among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from ..core.parameters import PARAMETERS
from ..sweep.axes import Axis
from ..sweep.planned import Placed
from ..sweep.quantities import GROWTH, QUANTITIES, QUANTITY
from ..sweep.sweep import Sweep
from . import sweep_figures as figures
from .page import Page, bullets, joined, markup, table
from .words import listed, number, sized

#: Quantities with a map of their own besides the first.
MAPPED = ("hover_gap", "travel", "final_speed", "peak_roll", "peak_sway", "swing_growth")

#: A quantity that differs by less than so much of the unit in which it is shown has no map.
SAME = 1e-6


@dataclass(frozen=True)
class SweepReport:
    """One finished sweep and the planned runs on it; ``notes`` are what was said while the campaign was read."""

    sweep: Sweep
    placed: Sequence[Placed] = ()
    campaign: str = ""
    notes: tuple[str, ...] = ()


def verdict(report: SweepReport) -> str:
    """The answer in one sentence or two, as the command prints it."""
    sweep = report.sweep
    flown = np.isfinite(sweep.values["stable"])
    touching = np.isfinite(sweep.values["first_contact"])
    clear = flown & ~touching & np.isfinite(sweep.values["travel"])
    count, seconds = int(flown.sum()), f"{sweep.plan.duration:g} s"
    part = f"all {count}" if clear.sum() == count else "none" if not clear.any() else f"{int(clear.sum())} of {count}"
    said = (
        f"Over {seconds} {part} runs fly clear of the track"
        if part != "none"
        else f"Over {seconds} every one of {count} runs touches the track"
    )
    return said + "." + _idle_words(sweep) + _edge_words(sweep)


def render(report: SweepReport) -> str:
    """The whole page."""
    sweep = report.sweep
    clear = np.isnan(sweep.values["first_contact"])
    first, *rest = verdict(report).split(". ")
    page = Page(
        title=" over ".join(a.name.replace("_", " ") for a in reversed(sweep.plan.axes)),
        kind="Sweep",
        verdict=first.rstrip(".") + ".",
        tone="good" if clear.all() else "neutral",
        lead=joined([bullets([r.rstrip(".") + "." for r in rest] + _points(report))]),
        notes=report.notes,
    )
    page.picture(page.figure(figures.outcome(sweep, report.placed), _caption(report)))
    if report.placed:
        page.section("Planned runs", _planned(report), "planned")
    page.section("Maps" if len(sweep.plan.axes) > 1 else "Curves", _maps(page, report), "maps")
    if sweep.spread is not None:
        page.section("Uncertainty", _uncertainty(page, report), "uncertainty")
    page.section("The numbers", _numbers(report), "numbers")
    return page.render()


# ---------------------------------------------------------------- the first screen


def _points(report: SweepReport) -> list[str]:
    plan = report.sweep.plan
    start = listed([f"{n.replace('_', ' ')} {number(v, 4)}" for n, v in plan.initial.items()]) if plan.initial else ""
    effects = listed([e.replace("_", " ") for e in plan.model.effects]) or "no effect besides the paper's model"
    current = (
        ""
        if any(a.name == "drive_current" for a in plan.axes)
        else f", {number(plan.model.parameters['drive_current'], 4)} A"
    )
    points = [
        (
            f"Every run starts {'at ' + start + ' (SI), ' if start else ''}on its equilibrium heave"
            if "heave" not in plan.initial and not any(a.name == "heave" for a in plan.axes)
            else f"Every run starts at {start} (SI)"
        )
    ]
    points[0] += f"{current}; {effects}."
    clear = np.isnan(report.sweep.values["first_contact"]) & np.isfinite(report.sweep.values["travel"])
    if growing := int((clear & (report.sweep.values["stable"] == 0.0)).sum()):
        points.append(
            f"In {growing} of the runs that fly a swing grows more than {GROWTH:g} times: they are not stable."
        )
    if report.placed:
        points.append(_placed_words(report.placed))
    if report.sweep.spread is not None:
        open_ = int(((report.sweep.spread.touching > 0) & (report.sweep.spread.touching < 1)).sum())
        points.append(
            f"Over {plan.samples} draws of {listed(list(plan.draws.names))} the outcome changes at {open_} of"
            f" {plan.points} points."
        )
    if report.sweep.unflown:
        points.append(
            f"{report.sweep.unflown} points have no run: no heave balances the weight there. They stay white."
        )
    if report.sweep.lost:
        points.append(f"{report.sweep.lost} runs left all bounds.")
    return points


def _placed_words(placed: Sequence[Placed]) -> str:
    flown = [p for p in placed if np.isfinite(p.values["travel"])]
    touching = [p for p in flown if np.isfinite(p.values["first_contact"])]
    names = listed([f"{p.run.name} after {p.values['first_contact']:.2f} s" for p in touching])
    said = f"Of {len(placed)} planned runs {len(touching)} touch{'es' if len(touching) == 1 else ''} the track" + (
        f": {names}." if 0 < len(touching) <= 4 else "."
    )
    missing = [p.run.name for p in placed if p not in flown or not p.on_the_map]
    few = listed(missing) if len(missing) <= 3 else f"{len(missing)} of them"
    return said + (f" Too little is known of {few} to draw." if missing else "")


def _idle_words(sweep: Sweep) -> str:
    """Axes along which nothing changes at all."""
    idle = [a.name for k, a in enumerate(sweep.plan.axes) if all(_same_along(v, k) for v in sweep.values.values())]
    return f" Nothing changes along {listed(idle)}: the model's other values leave it without effect." if idle else ""


def _same_along(values: np.ndarray, axis: int) -> bool:
    first = np.take(values, [0], axis)
    return bool(np.isclose(values, first, rtol=1e-7, atol=1e-9, equal_nan=True).all())


def _edge_words(sweep: Sweep) -> str:
    """Between which values of the first axis the outcome changes, at the value of the second that is nearest the
    model's own."""
    axis, *others = sweep.plan.axes
    touching = np.isfinite(sweep.values["first_contact"])
    at = ""
    if others:
        k = _nearest(others[0], sweep)
        touching = touching[:, k]
        at = f"At {others[0].name.replace('_', ' ')} {number(others[0].values[k], 4)}{_unit(others[0])} "
    changes = np.flatnonzero(np.diff(touching.astype(int)))
    if changes.size != 1:
        return ""
    low, high = (f"{number(axis.values[changes[0] + i], 4)}" for i in (0, 1))
    name = axis.name.replace("_", " ")
    flies = "from" if touching[changes[0]] else "up to"
    said = (
        f"{at}it flies {flies} {name} {high if touching[changes[0]] else low}{_unit(axis)} and touches at"
        f" {low if touching[changes[0]] else high}"
    )
    return f" {said[0].upper()}{said[1:]}."


def _nearest(axis: Axis, sweep: Sweep) -> int:
    own = sweep.plan.model.parameters[axis.name] if axis.name in PARAMETERS else axis.values[len(axis.values) // 2]
    return int(np.argmin(np.abs(axis.values - own)))


def _unit(axis: Axis) -> str:
    return f" {axis.unit}" if axis.unit else ""


def _caption(report: SweepReport) -> str:
    if len(report.sweep.plan.axes) == 1:
        said = (
            "Blue: how close to the track the cradle comes where it flies. Orange: when it first touches where it does"
            " not."
        )
    else:
        said = (
            "Blue: the cradle flies; the darker, the closer to the track, lines in mm. Orange: it touches; the darker,"
            " the sooner."
        )
    return said + (" Dots: planned runs." if report.placed else "")


# ---------------------------------------------------------------- evidence


def _maps(page: Page, report: SweepReport) -> Markup:
    sweep = report.sweep
    differing = [
        name
        for name in MAPPED
        if np.isfinite(sweep.values[name]).any()
        and np.nanmax(sweep.values[name]) - np.nanmin(sweep.values[name]) > SAME / QUANTITY[name].shown[0]
    ]
    drawn = [page.figure(figures.single(sweep, QUANTITY[name], placed=report.placed)) for name in differing]
    thinned = max(figures.strides(sweep)) > 1
    more = (
        markup(
            "<p class='soft'>Drawn with every {} point; sweep.nc has all.</p>",
            " × ".join(f"{s}th" if s > 1 else "" for s in figures.strides(sweep)),
        )
        if thinned
        else ""
    )
    return markup("<div class='two'>{}</div>{}", joined(drawn), more)


def _uncertainty(page: Page, report: SweepReport) -> Markup:
    sweep, spread, draws = report.sweep, report.sweep.spread, report.sweep.plan.draws
    part = QUANTITY["stable"]
    drawn = [page.figure(figures.single(sweep, part, spread.touching, report.placed, "Part of the draws that touch"))]
    for name in ("smallest_gap", "hover_gap", "travel"):
        if np.isfinite(spread.std[name]).any():
            drawn.append(
                page.figure(
                    figures.single(
                        sweep,
                        QUANTITY[name],
                        spread.std[name],
                        report.placed,
                        f"{QUANTITY[name].title}: standard deviation over the draws",
                    )
                )
            )
    own = [sweep.plan.model.vector[sweep.plan.model.kernel.parameters.index(n)] for n in draws.names]
    rows = [
        [markup("<code>{}</code>", n), sized(float(v), float(s))]
        for n, v, s in zip(draws.names, own, draws.std, strict=True)
    ]
    said = (
        f"{sweep.plan.samples} draws, the same at every point, from the covariance in model.yaml. A parameter on an"
        " axis is not drawn."
    )
    if draws.again > 0:
        said += f" {100 * draws.again:.2g} % of the draws fell outside a parameter's range and were drawn again."
    return markup(
        "<p>{}</p>{}<div class='two'>{}</div>",
        said,
        table(["Parameter", "Value ± standard deviation (SI)"], rows),
        joined(drawn),
    )


def _planned(report: SweepReport) -> Markup:
    plan = report.sweep.plan
    shown = [QUANTITY[n] for n in ("first_contact", "smallest_gap", "hover_gap", "travel", "final_speed", "peak_roll")]
    header = [
        "Run",
        *(a.title for a in plan.axes),
        *(f"{q.title} ({q.shown[1]})" for q in shown),
        "Taken from the sweep",
    ]
    rows = []
    for p in report.placed:
        assumed = listed([n.replace("_", " ") for n in p.assumed]) + (
            f"; not used: {listed(list(p.unused))}" if p.unused else ""
        )
        rows.append(
            [
                p.run.name,
                *(number(p.at[a.name], 4) for a in plan.axes),
                *(number(p.values[q.name] * q.shown[0], 4) for q in shown),
                assumed.lstrip("; "),
            ]
        )
    caption = (
        f"The runs of {report.campaign} flown with this model from what campaign.yaml and the data say of their starts."
    )
    return table(header, rows, caption, last_words=True)


def _numbers(report: SweepReport) -> Markup:
    sweep = report.sweep
    rows = []
    for q in QUANTITIES:
        values = sweep.values[q.name][np.isfinite(sweep.values[q.name])] * q.shown[0]
        low, high = (number(float(v), 4) for v in (values.min(), values.max())) if values.size else ("–", "–")
        rows.append([markup("<code>{}</code>", q.name), q.shown[1] or "–", low, high, q.meaning])
    code = markup(
        '<pre><code>import xarray\nmaps = xarray.open_dataset("sweep.nc")\nmaps.smallest_gap.sel({},'
        ' method="nearest")</code></pre>',
        ", ".join(f"{a.name}={a.values[len(a.values) // 2]:g}" for a in sweep.plan.axes if a.name.isidentifier())
        or "{…}",
    )
    return table(["Quantity", "Unit here", "Least", "Most", "Meaning"], rows, last_words=True) + markup(
        "<p>All of it, in SI units, is in <code>sweep.nc</code>:</p>{}", code
    )
