# SPDX-License-Identifier: Apache-2.0
"""The report of `inductrack diagnose`: which effect is missing, how sure that is, what would settle what is open."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..comparison.result import rms
from ..diagnosis.result import Diagnosis, Limit, Rival
from .diagnosis_figures import limit_size, limits_figure, matters, share, step_name, steps_figure
from .diagnosis_words import (
    declared,
    finite,
    full,
    full_symbol,
    is_stand_in,
    most,
    not_on,
    of_sensor,
    shown_parameters,
    size,
    summary,
    symbol,
    verdict,
)
from .explorer import Opening, RunTraces, Trace, explorer
from .law_section import law_section
from .page import Figure, Page, bullets, folded, joined, markup, table
from .unknown_figures import surface_figure, unknown_figure, usually
from .words import counted, effect_name, in_channel, listed, number, ratio, sized, title

TONES = {"adequate": "good", "missing_effect": "bad", "unknown_effect": "warn"}
LAWS_DRAWN = ", and the laws nearest to it refitted in its place"
TICKS = "Ticks at the bottom: where runs have been."
SURFACE = (
    "The table times its factor over both variables. Dots are where runs have been; elsewhere the surface is a guess."
)
#: Rivals shown of each round; the rest is folded away.
SHOWN = 8


def diagnosis_report(result: Diagnosis, sentence: str = "", notes: Sequence[str] = ()) -> str:
    """The whole page, under another ``sentence`` than the verdict's where one is given; ``notes`` are the
    campaign's."""
    page = Page(
        title=result.campaign,
        kind="What the model misses",
        verdict=sentence or verdict(result),
        tone=TONES[result.verdict],
        lead=_lead(result),
        notes=notes,
        findings=result.findings,
    )
    page.picture(_picture(page, result))
    if result.laws is not None:
        page.section("A law for it" if result.laws.proposed else "No law for it", law_section(result))
    if result.unknown is not None and result.unknown.factor is not None and len(result.unknown.at):
        page.section("Over both variables", page.figure(surface_figure(result.unknown), SURFACE))
    if result.indistinguishable or result.next_experiment:
        page.section("Still open", _open(result))
    if result.limits and result.verdict == "adequate":
        page.section("What would have shown", _limits(result))
    if result.traces:
        page.section("Try it" if len(_variants(result)) > 1 else "Traces", _try_it(page, result))
    if result.unknown is not None and len(result.steps) > 1:
        page.section("Step by step", page.figure(steps_figure(result)))
    if result.rivals:
        page.section("Rivals", _rivals(result))
    if chosen := [r for r in result.rivals if r.chosen and r.where]:
        page.section("Where it was decided", joined(_where(page, r) for r in chosen))
    page.section("Before and after" if len(result.steps) > 1 else "Error by channel", _before_and_after(result))
    if result.limits and result.verdict != "adequate":
        page.section("What would have shown", _limits(result))
    page.section("The model", _model(result))
    return page.render()


# ---------------------------------------------------------------- the answer in words


def _lead(result: Diagnosis) -> str:
    points = []
    first, last = result.steps[0], result.steps[-1]
    if len(result.steps) > 1:
        fall = f"{ratio(math.sqrt(first.reduced_chi2))} to {ratio(math.sqrt(last.reduced_chi2))}"
        held = f", on runs left out of the fit from {ratio(first.heldout_nrmse)} to {ratio(last.heldout_nrmse)}"
        points.append(
            f"Error over noise falls from {fall}{held if finite(last.heldout_nrmse) else ''}{most(first, last)}."
        )
    else:
        held = f"; on runs left out of the fit it is {ratio(first.heldout_nrmse)}"
        after = f"Error over noise is {ratio(math.sqrt(first.reduced_chi2))} after the fit"
        points.append(f"{after}{held if finite(first.heldout_nrmse) else ''}.")
    sizes = [
        markup("{} <strong class='num'>{}</strong>", full_symbol(n), size(result, n))
        for n in shown_parameters(result)
        if "." in n
    ]
    if sizes:
        points += [markup("{}{}.", words[:1].upper(), words[1:]) for words in sizes]
    if result.unknown is not None:
        points += [other] if (other := not_on(result)) else []
    for effect, rivals in result.indistinguishable.items():
        others = listed([effect_name(r) for r in rivals], "or")
        points.append(f"These data cannot tell {effect_name(effect)} from {others}.")
    points += [f"Note: {note}." for note in result.notes]
    return bullets(points)


# ---------------------------------------------------------------- pictures


def _picture(page: Page, result: Diagnosis) -> str:
    if result.unknown is not None and len(result.unknown.at):
        return page.figure(
            unknown_figure(result),
            f"The missing force{usually(result.unknown)}, as the data show it, with its 95 % band"
            f"{LAWS_DRAWN if result.laws else ''}. {TICKS if len(result.unknown.seen) else ''}",
        )
    if len(result.steps) > 1:
        return page.figure(steps_figure(result), "Each step adds one effect and refits everything. 1 is noise alone.")
    if result.limits:
        caption = "The smallest size of each effect these data would have shown, over a size at which it matters."
        return page.figure(limits_figure(result), caption)
    return ""


# ---------------------------------------------------------------- the evidence


def _open(result: Diagnosis) -> str:
    parts = []
    for effect, rivals in result.indistinguishable.items():
        names = joined([markup("<strong>{}</strong>", effect_name(r)) for r in rivals], " or ")
        parts.append(
            markup(
                "<p>Instead of <strong>{}</strong> it could be {}: these data fit both.</p>", effect_name(effect), names
            )
        )
    if result.next_experiment:
        apart = [
            f"{effect_name(n)}: {number(s, 2)} standard deviations"
            for n, s in (result.proposal.sigmas.items() if result.proposal else ())
        ]
        tail = markup("<br>Expected difference from {}.", "; from ".join(apart)) if apart else ""
        parts.append(
            markup('<div class="box"><strong>Next experiment.</strong> {}{}</div>', result.next_experiment, tail)
        )
    return joined(parts)


def _variants(result: Diagnosis) -> list[tuple[str, ...]]:
    """Sets of effects that were predicted for every run, none first."""
    sets = [set(t.predicted) for t in result.traces]
    return sorted(set.intersection(*sets), key=lambda v: (len(v), v)) if sets else []


def _switches(result: Diagnosis) -> list[str]:
    """Effects that the variants switch, in the order they were found."""
    named = {e for v in _variants(result) for e in v}
    return [e for e in result.effects if e in named] + sorted(named - set(result.effects))


def _either(result: Diagnosis) -> tuple[tuple[str, str], ...]:
    """The best law and the table that it stands in the place of."""
    table = next((n for n in _switches(result) if is_stand_in(n)), None)
    law = next((n for n in _switches(result) if n.startswith("proposed_") and n not in result.effects), None)
    return ((law, table),) if law and table else ()


def _error(result: Diagnosis, measured: np.ndarray, predicted: np.ndarray, channel: str) -> float:
    """What the bars beside a trace show: its RMS error over noise."""
    return rms((np.asarray(measured) - predicted) / result.noise[channel])


def _try_it(page: Page, result: Diagnosis) -> str:
    variants = _variants(result)
    runs, gain = [], {}
    for run in result.traces:
        traces = {}
        for channel, measured in run.measured.items():
            seen = ~np.isnan(measured)
            if seen.any():
                predicted = [run.predicted[v][channel][seen] for v in variants]
                errors = [_error(result, measured[seen], p, channel) for p in predicted]
                traces[channel] = Trace(run.times[seen], measured[seen], predicted, errors)
                gain[run.name, channel] = errors[0] / errors[-1] if finite(errors[0]) and errors[-1] > 0 else 0.0
        runs.append(RunTraces(run.name, run.driven, traces))
    start = max(gain, key=lambda k: gain[k]) if gain else None
    words = ("without any effect", "with the effects chosen") if len(variants) > 1 else ("by this model", "")
    well = result.verdict == "adequate" and len(variants) == 1
    html = explorer(page, runs, result.noise, _switches(result), variants, Opening(start, words, well, _either(result)))
    if len(variants) == 1:
        return html
    return markup(
        "<p>Switch an effect off and see which measurements need it. Each combination was fitted beforehand: its"
        " parameters and initial states are the best it can do.</p>{}",
        html,
    )


def _rivals(result: Diagnosis) -> str:
    parts = []
    for beside in dict.fromkeys(r.beside for r in result.rivals):
        round_ = sorted(
            (r for r in result.rivals if r.beside == beside), key=lambda r: (not r.chosen, not r.refitted, -r.chi2_fall)
        )
        if beside:
            parts.append(markup("<h3>With {} in the model</h3>", listed([effect_name(b) for b in beside])))
        parts.append(_rival_table(result, round_[:SHOWN]))
        if len(round_) > SHOWN:
            parts.append(folded(f"{len(round_) - SHOWN} more that do worse", _rival_table(result, round_[SHOWN:])))
    return markup(
        "<p>Each of the promising ones was added and everything refitted; the others stand below with what they promise"
        " to first order. The evidence is the fall in χ² beyond what chance alone gives to the best of so many"
        " tried.</p>"
    ) + joined(parts)


def _rival_table(result: Diagnosis, rivals: Sequence[Rival]) -> str:
    rows = []
    confused = {r for others in result.indistinguishable.values() for r in others}
    for r in rivals:
        style = "good-word" if r.chosen else "warn-word" if r.name in confused else ""
        words = r.words or ("chosen" if r.chosen else "")
        sizes = markup("<br>").join(
            markup(
                "<span class='num'>{} {}</span>",
                symbol(p),
                sized(v, r.std.get(p), declared(result, full(r.name, p)).unit),
            )
            for p, v in r.size.items()
            if "[" not in p
        )
        rows.append(
            [
                markup("{}<br><span class='soft'>{}</span>", effect_name(r.name), summary(result, r.name)),
                markup('<span class="{}">{}</span>', style, words) if style else words,
                counted(r.chi2_fall),
                counted(r.threshold),
                sizes or "–",
            ]
        )
    header = ["Effect", "For and against", "Fall in χ²", "By chance", "Fitted size"]
    return table(header, rows, words=2, last_words=True)


def _where(page: Page, rival: Rival) -> str:
    figures = []
    for by, parts in rival.where.items():
        if len(parts) < 2:
            continue
        data = {
            "type": "bar",
            "x": list(parts),
            "y": [100 * p for p in parts.values()],
            "marker": {"color": "@after"},
            "hovertemplate": "%{x}: %{y:.3g} %<extra></extra>",
        }
        layout = {
            "xaxis": {"type": "category", "title": by},
            "yaxis": {"title": "share, %"},
            "margin": {"l": 8, "r": 8, "t": 10, "b": 8},
        }
        label = f"Part of the evidence for {effect_name(rival.name)} by {by}"
        figures.append(page.figure(Figure([data], layout, label, 240, fixed=True)))
    return markup(
        "<h3>{}</h3><p>Which data ask for it, as shares of the fall in χ²: what only one run asks for is less certain"
        ' than what all do.</p><div class="two">{}</div>',
        effect_name(rival.name)[:1].upper() + effect_name(rival.name)[1:],
        joined(figures),
    )


def _before_and_after(result: Diagnosis) -> str:
    channels = [c for c in result.noise if any(c in s.errors for s in result.steps)]
    names = [step_name(s, b) for s, b in zip(result.steps, [None, *result.steps], strict=False)]
    whole = [
        c
        for s in result.steps
        for c in (
            markup("<strong>{}</strong>", ratio(math.sqrt(s.reduced_chi2))),
            markup("<strong>{}</strong>", ratio(s.heldout_nrmse)),
        )
    ]
    each = [
        [title(c), *(x for s in result.steps for x in (ratio(s.errors.get(c)), ratio(s.heldout_errors.get(c))))]
        for c in channels
    ]
    channel_table = table(
        ["", *(h for n in names for h in (n, "left out"))],
        [["All channels", *whole], *each],
        "Error over noise on the runs of the fit, and on runs left out of it.",
    )
    first, last = result.steps[0], result.steps[-1]
    both = [n for n in first.by_run if n in last.by_run]
    run_table = table(
        ["Run", "Before", "After"],
        [[n, ratio(first.by_run[n]), markup("<strong>{}</strong>", ratio(last.by_run[n]))] for n in both],
        "Error over noise of each run, all channels, fitted on all runs.",
    )
    return channel_table + (run_table if both and len(result.steps) > 1 else "")


def _limits(result: Diagnosis) -> str:
    def rows(limits: Sequence[Limit]) -> list[list[str]]:
        ordered = sorted(limits, key=lambda x: (not finite(share(result, x)), share(result, x)))
        return [
            [
                markup("{}<br><span class='soft'>{}</span>", effect_name(x.name), summary(result, x.name)),
                symbol(x.parameter),
                limit_size(result, x),
                " ".join((number(matters(result, x)[0], 2), matters(result, x)[1])),
            ]
            for x in ordered
        ]

    header = ["Effect", "Parameter", "Would have shown", "A size that matters"]
    cradle = [x for x in result.limits if not of_sensor(result, x.name)]
    sensors = [x for x in result.limits if of_sensor(result, x.name)]
    beside = "" if result.verdict == "adequate" else "beside what was found "
    return (
        markup(
            "<p>Had one of these been there {}at this size, these data would have shown it. What is smaller may be"
            " there unseen.</p>",
            beside,
        )
        + (table(header, rows(cradle), words=2) if cradle else "")
        + (folded("Faults of sensors", table(header, rows(sensors), words=2)) if sensors else "")
    )


def _model(result: Diagnosis) -> str:
    rows = [
        [markup("<code>{}</code>", n), size(result, n), declared(result, n).meaning] for n in shown_parameters(result)
    ]
    noise = table(
        ["Channel", "Noise (standard deviation)", ""],
        [
            [title(c), in_channel(c, s), "given" if c in result.noise_given else "estimated"]
            for c, s in result.noise.items()
        ],
    )
    tests = table(
        ["Test of what is left", "Statistic", "Degrees of freedom", "p of this test alone"],
        [[t.name, number(t.statistic, 4), str(t.dof), number(t.p_value, 2)] for t in result.tests],
    )
    return (
        table(["Parameter", "Value ± standard deviation", "Meaning"], rows, last_words=True)
        + markup(
            "<p>The improved model is <code>model.yaml</code>: <code>inductrack compare --model model.yaml</code> reads"
            " it, "
        )
        + markup("and the simulator node with <code>--params-file model.yaml</code>.</p>")
        + folded("Noise", noise)
        + (folded(f"Tests of what is left: together p = {number(result.p_value, 2)}", tests) if result.tests else "")
        + (
            folded(
                "How the search went", markup("<ol>{}</ol>", joined(markup("<li>{}</li>", line) for line in result.log))
            )
            if result.log
            else ""
        )
    )


# ---------------------------------------------------------------- names
