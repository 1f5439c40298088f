"""The report of `inductrack diagnose`: which effect is missing, how sure that is, what would settle what is open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..comparison.result import rms
from ..core.effects import split_name
from ..core.parameters import PARAMETERS, Parameter
from ..core.state import CHANNELS
from ..diagnosis.result import OF_THRUST, Diagnosis, Limit, Rival, Step, Unknown
from .explorer import RunTraces, Trace, explorer
from .page import Figure, Page, bullets, folded, joined, markup, packed, table
from .words import counted, effect_name, in_channel, listed, number, ratio, sized, title

TONES = {"adequate": "good", "missing_effect": "bad", "unknown_effect": "warn"}
_FORCE = {
    "surge": "a force along the track",
    "sway": "a lateral force",
    "heave": "a vertical force",
    "roll": "a roll moment",
}
_DEPENDS = {
    "surge": ("the place along the track", "place along the track, m"),
    "sway": ("sway", "sway, m"),
    "heave": ("heave (the gap)", "heave, m"),
    "roll": ("roll", "roll, rad"),
    "surge_rate": ("speed", "speed, m/s"),
    "sway_rate": ("the sway rate", "sway rate, m/s"),
    "heave_rate": ("the heave rate", "heave rate, m/s"),
    "roll_rate": ("the roll rate", "roll rate, rad/s"),
    "time": ("time", "time since the run's start, s"),
    "drive": ("the drive current", "drive current, A"),
}
#: Rivals shown of each round; the rest is folded away.
SHOWN = 8


def diagnosis_report(result: Diagnosis, sentence: str = "", notes: Sequence[str] = ()) -> str:
    """The whole page, under another ``sentence`` than the verdict's where one is given; ``notes`` are the campaign's."""
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
    if result.indistinguishable or result.next_experiment:
        page.section("Still open", _open(result))
    if result.limits and result.verdict == "adequate":
        page.section("What would have shown", _limits(result))
    if result.traces:
        page.section("Try it" if len(_variants(result)) > 1 else "Traces", _try_it(page, result))
    if result.unknown is not None and len(result.steps) > 1:
        page.section("Step by step", page.figure(_steps_figure(result)))
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


def verdict(result: Diagnosis) -> str:
    """The answer in one sentence."""
    if result.verdict == "adequate":
        return "Nothing detectable is missing: what the model leaves is the sensors' noise."
    found = [_with_rivals(result, e) for e in result.effects if not _is_stand_in(e)]
    if result.interrupted:
        return f"Interrupted while searching. Best found until then: {listed(found) or 'nothing yet'}."
    if result.verdict == "missing_effect":
        return f"Missing: {listed(found)}. With {'it' if len(found) == 1 else 'them'}, what is left is noise."
    missing = f"Missing: {listed(found)}. "
    if result.unknown is None:
        return f"{missing if found else ''}Something {'more ' if found else ''}is missing that no known effect explains."
    what, _, on = _law(result.unknown)
    depends = listed([_DEPENDS[d][0] for d in on])
    force = f"{what}{f' that depends on {depends}' if depends else ''}{_peak(result.unknown)}"
    return f"{missing}Besides, {force}, which no known effect explains." if found else f"No known effect explains {force}."


def _law(unknown: Unknown) -> tuple[str, tuple[float, str], tuple[str, ...]]:
    """An unknown force in words, with the factor and unit it is shown in, and what it depends on besides the thrust it may change."""
    if unknown.unit == OF_THRUST:
        return "a change of the thrust", (100.0, "%"), unknown.depends_on[:1]
    return _FORCE[unknown.channel], (1.0, unknown.unit), unknown.depends_on


def _peak(unknown: Unknown) -> str:
    """`` (−12 N at 8 m)``; nothing where the curve is not known."""
    if not _finite(unknown.peak):
        return ""
    _, (factor, unit), on = _law(unknown)
    return f" ({number(factor * unknown.peak, 2)} {unit} at {number(unknown.place, 2)} {_DEPENDS[on[0]][1].rpartition(', ')[2]})"


def addition(result: Diagnosis) -> str:
    """What adding one effect by hand gained, in one sentence."""
    (rival,) = result.rivals
    name = effect_name(rival.name)
    if not rival.chosen:
        return f"Adding {name} gains no more than chance would."
    before, after = (ratio(math.sqrt(s.reduced_chi2)) for s in (result.steps[0], result.steps[-1]))
    left = "more than noise is left" if result.verdict == "unknown_effect" else "what is left is noise"
    return f"Adding {name} lowers the error from {before} to {after} times the noise; {left}."


def _with_rivals(result: Diagnosis, effect: str) -> str:
    rivals = result.indistinguishable.get(effect, ())
    if len(result.effects) > 1 and rivals:  # brackets, or "a or b and c" would be read in two ways
        return f"{effect_name(effect)} (or {listed([effect_name(r) for r in rivals], 'or')})"
    return listed([effect_name(e) for e in (effect, *rivals)], "or")


def _lead(result: Diagnosis) -> str:
    points = []
    first, last = result.steps[0], result.steps[-1]
    if len(result.steps) > 1:
        fall = f"{ratio(math.sqrt(first.reduced_chi2))} to {ratio(math.sqrt(last.reduced_chi2))}"
        held = f", on runs left out of the fit from {ratio(first.heldout_nrmse)} to {ratio(last.heldout_nrmse)}"
        points.append(
            f"Error over noise falls from {fall}{held if _finite(last.heldout_nrmse) else ''}{_most(first, last)}."
        )
    else:
        held = f"; on runs left out of the fit it is {ratio(first.heldout_nrmse)}"
        after = f"Error over noise is {ratio(math.sqrt(first.reduced_chi2))} after the fit"
        points.append(f"{after}{held if _finite(first.heldout_nrmse) else ''}.")
    sizes = [
        markup("{} <strong class='num'>{}</strong>", _full_symbol(n), _size(result, n))
        for n in _shown_parameters(result)
        if "." in n
    ]
    if sizes:
        points += [markup("{}{}.", size[:1].upper(), size[1:]) for size in sizes]
    if result.unknown is not None:
        points += [other] if (other := _not_on(result)) else []
    for effect, rivals in result.indistinguishable.items():
        others = listed([effect_name(r) for r in rivals], "or")
        points.append(f"These data cannot tell {effect_name(effect)} from {others}.")
    points += [f"Note: {note}." for note in result.notes]
    return bullets(points)


def _most(first: Step, last: Step) -> str:
    """The channel whose error falls most, where the sum over all channels hides it."""
    falls = {c: e / last.errors[c] for c, e in first.errors.items() if last.errors.get(c) and _finite(e)}
    if len(falls) < 2:
        return ""
    channel = max(falls, key=lambda c: falls[c])
    return f"; most in {title(channel).lower()}, from {ratio(first.errors[channel])} to {ratio(last.errors[channel])}"


def _not_on(result: Diagnosis) -> str:
    rivals = [_DEPENDS[r][0] if r in _DEPENDS else r for r in result.unknown.rivals]
    return f"Nearly as well the data would fit one that depends on {listed(rivals, 'or')}." if rivals else ""


# ---------------------------------------------------------------- pictures


def _picture(page: Page, result: Diagnosis) -> str:
    if result.unknown is not None and len(result.unknown.at):
        return page.figure(_unknown_figure(result), "The missing force, as the data show it, with its 95 % band.")
    if len(result.steps) > 1:
        return page.figure(_steps_figure(result), "Each step adds one effect and refits everything. 1 is noise alone.")
    if result.limits:
        caption = "The smallest size of each effect these data would have shown, over a size at which it matters."
        return page.figure(_limits_figure(result), caption)
    return ""


def _steps_figure(result: Diagnosis) -> Figure:
    names = [_step_name(s, before) for s, before in zip(result.steps, [None, *result.steps], strict=False)]
    fitted = [math.sqrt(s.reduced_chi2) for s in result.steps]
    held = [s.heldout_nrmse for s in result.steps]
    above = [_finite(h) and h > f for f, h in zip(fitted, held, strict=True)]  # the label that is not between the lines

    def line(values: Sequence[float], name: str, colour: str, top: Sequence[bool], dash: str) -> dict[str, Any]:
        return {
            "type": "scatter",
            "mode": "lines+markers+text",
            "name": name,
            "x": names,
            "y": [v if _finite(v) else None for v in values],
            "text": [ratio(v) for v in values],
            "textposition": ["top center" if t else "bottom center" for t in top],
            "textfont": {"color": colour},
            "cliponaxis": False,
            "line": {"color": colour, "width": 2.5, "dash": dash},
            "marker": {"size": 9, "color": colour},
            "hovertemplate": "%{x}: %{text} × noise",
        }

    data = [line(fitted, "runs in the fit", "@after", [not a for a in above], "solid")]
    if any(_finite(h) for h in held):
        data.append(line(held, "runs left out", "@before", above, "dot"))
    values = [v for v in [*fitted, *held] if _finite(v) and v > 0]
    least, most = min([*values, 1.0]), max(values)
    if most > 3.0:
        scale = {"type": "log", "range": [math.log10(least * 0.6), math.log10(most * 1.9)], "dtick": 1}
    else:
        pad = 0.25 * max(most - least, 0.1)
        scale = {"range": [least - pad, most + pad]}
    layout = {
        "xaxis": {"type": "category", "range": [-0.35, len(names) - 0.65], "ticks": ""},
        "yaxis": {"title": "error / noise", **scale},
        "shapes": [_line_at_one("y")],
    }
    return Figure(
        data, layout, "Error over noise as effects are added, in the fit and on runs left out", 330, fixed=True
    )


def _step_name(step: Step, before: Step | None) -> str:
    new = [e for e in step.effects if before is None or e not in before.effects]
    if before is None:
        return "the model, refitted" if not new else listed([effect_name(e) for e in new])
    return "+ " + listed([effect_name(e) for e in new])


def _line_at_one(axis: str) -> dict[str, Any]:
    along, across = ("x", "y") if axis == "y" else ("y", "x")
    line = {"color": "@good", "width": 1.5, "dash": "dash"}
    return {
        "type": "line",
        f"{along}ref": "paper",
        f"{along}0": 0,
        f"{along}1": 1,
        f"{across}0": 1,
        f"{across}1": 1,
        "line": line,
    }


def _unknown_figure(result: Diagnosis) -> Figure:
    unknown = result.unknown
    named, (factor, unit), _ = _law(unknown)
    at, force, half = np.asarray(unknown.at, float), factor * np.asarray(unknown.force, float), factor * np.asarray(unknown.band, float)
    quiet = {"type": "scatter", "mode": "lines", "showlegend": False}
    band = quiet | {
        "x": packed(np.concatenate([at, at[::-1]])),
        "y": packed(np.concatenate([force + half, (force - half)[::-1]])),
        "fill": "toself",
        "fillcolor": "@shade",
        "line": {"width": 0},
        "hoverinfo": "skip",
    }
    line = quiet | {
        "x": packed(at),
        "y": packed(force),
        "line": {"color": "@before", "width": 2.5},
        "hovertemplate": f"%{{x:.4g}}: %{{y:.3g}} {unit}<extra></extra>",
    }
    on = _DEPENDS[unknown.depends_on[0]][1] if unknown.depends_on else ""
    what = named.split(" ", 1)[1]
    layout = {
        "xaxis": {"title": on},
        "yaxis": {"title": f"{what}, {unit}", "zeroline": True, "zerolinecolor": "@soft"},
        "margin": {"l": 8, "r": 8, "t": 10, "b": 8},
    }
    return Figure([band, line], layout, f"The {what} that no effect explains over {on}", 330)


def _limits_figure(result: Diagnosis) -> Figure:
    shares = {
        x.name: _share(result, x) for x in result.limits if not _of_sensor(result, x.name)
    }  # a sensor's faults are in the table
    rows = sorted((x for x in result.limits if _finite(shares.get(x.name))), key=lambda x: -shares[x.name])
    data = {
        "type": "bar",
        "orientation": "h",
        "y": [effect_name(x.name) for x in rows],
        "x": [shares[x.name] for x in rows],
        "marker": {"color": "@after"},
        "text": [_limit_size(result, x) for x in rows],
        "textposition": "outside",
        "cliponaxis": False,
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }
    layout = {
        "xaxis": {"type": "log", "title": "smallest size that would have shown / size that matters", "dtick": 1},
        "yaxis": {"ticks": "", "tickfont": {"size": 11}, "dtick": 1},
        "margin": {"l": 8, "r": 110, "t": 8, "b": 8},
        "shapes": [_line_at_one("x")],
    }
    label = "Smallest size of each effect that would have shown; the table below has the numbers"
    return Figure([data], layout, label, 70 + 17 * len(rows), fixed=True)


def _share(result: Diagnosis, limit: Limit) -> float:
    """A limit over the size that matters; where a smaller value is the larger effect, the other way round."""
    typical, _ = _matters(result, limit)
    declared = _declared(result, _full(limit.name, limit.parameter))
    grows = declared.fit_as in ("x", "x^2")
    share = limit.size / typical if grows else typical / limit.size if limit.size else math.nan
    return share if share > 0 else math.nan


def _matters(result: Diagnosis, limit: Limit) -> tuple[float, str]:
    """A size at which an effect matters, with its unit; an error in a channel's unit matters from ten times its noise."""
    channel = limit.name.partition(":")[2]
    declared = _declared(result, _full(limit.name, limit.parameter))
    if declared.per_channel == "size" and channel in result.noise:
        return 10 * result.noise[channel], declared.unit
    return abs(declared.typical or declared.default) or math.nan, declared.unit


def _limit_size(result: Diagnosis, limit: Limit) -> str:
    shrinks = _declared(result, _full(limit.name, limit.parameter)).fit_as not in ("x", "x^2")
    return f"{'under ' if shrinks else ''}{number(limit.size, 2)} {_matters(result, limit)[1]}".strip()


# ---------------------------------------------------------------- the evidence


def _open(result: Diagnosis) -> str:
    parts = []
    for effect, rivals in result.indistinguishable.items():
        names = joined([markup("<strong>{}</strong>", effect_name(r)) for r in rivals], " or ")
        parts.append(
            markup("<p>Instead of <strong>{}</strong> it could be {}: these data fit both.</p>", effect_name(effect), names)
        )
    if result.next_experiment:
        apart = [f"{effect_name(n)}: {number(s, 2)} standard deviations" for n, s in (result.proposal.sigmas.items() if result.proposal else ())]
        tail = markup("<br>Expected difference from {}.", '; from '.join(apart)) if apart else ""
        parts.append(markup('<div class="box"><strong>Next experiment.</strong> {}{}</div>', result.next_experiment, tail))
    return joined(parts)


def _variants(result: Diagnosis) -> list[tuple[str, ...]]:
    """Sets of effects that were predicted for every run, none first."""
    sets = [set(t.predicted) for t in result.traces]
    return sorted(set.intersection(*sets), key=lambda v: (len(v), v)) if sets else []


def _switches(result: Diagnosis) -> list[str]:
    """Effects that the variants switch, in the order they were found."""
    named = {e for v in _variants(result) for e in v}
    return [e for e in result.effects if e in named] + sorted(named - set(result.effects))


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
                gain[run.name, channel] = errors[0] / errors[-1] if _finite(errors[0]) and errors[-1] > 0 else 0.0
        runs.append(RunTraces(run.name, run.driven, traces))
    start = max(gain, key=lambda k: gain[k]) if gain else None
    words = ("without any effect", "with the effects chosen") if len(variants) > 1 else ("by this model", "")
    well = result.verdict == "adequate" and len(variants) == 1
    html = explorer(page, runs, result.noise, _switches(result), variants, start, words, well)
    if len(variants) == 1:
        return html
    return (
        markup("<p>Switch an effect off and see which measurements need it. Each combination was fitted beforehand: its parameters and initial states are the best it can do.</p>{}", html)
    )


def _rivals(result: Diagnosis) -> str:
    parts = []
    for beside in dict.fromkeys(r.beside for r in result.rivals):
        round_ = sorted((r for r in result.rivals if r.beside == beside), key=lambda r: (not r.chosen, not r.refitted, -r.chi2_fall))
        if beside:
            parts.append(markup("<h3>With {} in the model</h3>", listed([effect_name(b) for b in beside])))
        parts.append(_rival_table(result, round_[:SHOWN]))
        if len(round_) > SHOWN:
            parts.append(folded(f"{len(round_) - SHOWN} more that do worse", _rival_table(result, round_[SHOWN:])))
    return (
        markup("<p>Each of the promising ones was added and everything refitted; the others stand below with what they promise to first order. The evidence is the fall in χ² beyond what chance alone gives to the best of so many tried.</p>") + joined(parts)
    )


def _rival_table(result: Diagnosis, rivals: Sequence[Rival]) -> str:
    rows = []
    held = any(_finite(r.heldout_nrmse) for r in rivals)
    confused = {r for others in result.indistinguishable.values() for r in others}
    for r in rivals:
        style = "good-word" if r.chosen else "warn-word" if r.name in confused else ""
        words = r.words or ("chosen" if r.chosen else "")
        sizes = markup("<br>").join(
            markup("<span class='num'>{} {}</span>", _symbol(p), sized(v, r.std.get(p), _declared(result, _full(r.name, p)).unit))
            for p, v in r.size.items()
            if "[" not in p
        )
        rows.append(
            [
                markup("{}<br><span class='soft'>{}</span>", effect_name(r.name), _summary(result, r.name)),
                markup('<span class="{}">{}</span>', style, words) if style else words,
                counted(r.chi2_fall),
                counted(r.threshold),
                *([ratio(r.heldout_nrmse)] if held else []),
                sizes or "–",
            ]
        )
    header = [
        "Effect",
        "For and against",
        "Fall in χ²",
        "By chance",
        *(["Error, left out"] if held else []),
        "Fitted size",
    ]
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
    return (
        markup('<h3>{}</h3><p>Which data ask for it, as shares of the fall in χ²: what only one run asks for is less certain than what all do.</p><div class="two">{}</div>', effect_name(rival.name)[:1].upper() + effect_name(rival.name)[1:], joined(figures))
    )


def _before_and_after(result: Diagnosis) -> str:
    channels = [c for c in result.noise if any(c in s.errors for s in result.steps)]
    names = [_step_name(s, b) for s, b in zip(result.steps, [None, *result.steps], strict=False)]
    whole = [
        c
        for s in result.steps
        for c in (markup("<strong>{}</strong>", ratio(math.sqrt(s.reduced_chi2))), markup("<strong>{}</strong>", ratio(s.heldout_nrmse)))
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
        ordered = sorted(limits, key=lambda x: (not _finite(_share(result, x)), _share(result, x)))
        return [
            [
                markup("{}<br><span class='soft'>{}</span>", effect_name(x.name), _summary(result, x.name)),
                _symbol(x.parameter),
                _limit_size(result, x),
                " ".join((number(_matters(result, x)[0], 2), _matters(result, x)[1])),
            ]
            for x in ordered
        ]

    header = ["Effect", "Parameter", "Would have shown", "A size that matters"]
    cradle = [x for x in result.limits if not _of_sensor(result, x.name)]
    sensors = [x for x in result.limits if _of_sensor(result, x.name)]
    beside = "" if result.verdict == "adequate" else "beside what was found "
    return (
        markup("<p>Had one of these been there {}at this size, these data would have shown it. What is smaller may be there unseen.</p>", beside)
        + (table(header, rows(cradle), words=2) if cradle else "")
        + (folded("Faults of sensors", table(header, rows(sensors), words=2)) if sensors else "")
    )


def _model(result: Diagnosis) -> str:
    rows = [
        [markup("<code>{}</code>", n), _size(result, n), _declared(result, n).meaning]
        for n in _shown_parameters(result)
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
        + markup("<p>The improved model is <code>model.yaml</code>: <code>inductrack compare --model model.yaml</code> reads it, ")
        + markup("and the simulator node with <code>--params-file model.yaml</code>.</p>")
        + folded("Noise", noise)
        + (folded(f"Tests of what is left: together p = {number(result.p_value, 2)}", tests) if result.tests else "")
    )


# ---------------------------------------------------------------- names


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _is_stand_in(effect: str) -> bool:
    return effect.startswith("stand_in")


def _full(effect: str, parameter: str) -> str:
    return parameter if "." in parameter else f"{effect}.{parameter}"


def _shown_parameters(result: Diagnosis) -> list[str]:
    """Parameters with a meaning of their own: not the entries of a stand-in's table."""
    return [n for n in result.parameters if "[" not in n and not _is_stand_in(n)]


def _declared(result: Diagnosis, name: str) -> Parameter:
    effect, _, parameter = name.rpartition(".")
    if not effect:
        return PARAMETERS[name]
    item, channel = split_name(effect, result.model.known_effects, CHANNELS)
    return item.parameters[parameter].for_channel(channel) if channel else item.parameters[parameter]


def _of_sensor(result: Diagnosis, name: str) -> bool:
    return result.model.known_effects[name.partition(":")[0]].of_sensor


def _symbol(name: str) -> str:
    return name.rpartition(".")[2].replace("_", " ")


def _full_symbol(name: str) -> str:
    return f"{effect_name(name.rpartition('.')[0])}: {_symbol(name)}"


def _size(result: Diagnosis, name: str) -> str:
    value, std = result.parameters[name]
    return sized(value, std, _declared(result, name).unit)


def _summary(result: Diagnosis, name: str) -> str:
    return split_name(name, result.model.known_effects, CHANNELS)[0].summary
