"""The report of `inductrack diagnose`: which effect is missing, how sure that is, and what would settle what is open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.effects import split_name
from ..core.parameters import PARAMETERS
from ..core.state import CHANNELS
from .explorer import RunTraces, Trace, explorer
from .page import Figure, Page, folded, packed, table, text
from .words import effect_name, in_channel, listed, number, ratio, sized, title

if TYPE_CHECKING:
    from ..diagnosis.result import Diagnosis

TONES = {"adequate": "good", "missing_effect": "bad", "unknown_effect": "warn"}
_FORCE = {
    "surge": "a force along the track",
    "sway": "a lateral force",
    "heave": "a vertical force",
    "roll": "a roll moment",
}
_FORCE_UNIT = {"roll": "N·m"}
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


def diagnosis_report(result: Diagnosis) -> str:
    """The whole page."""
    page = Page(
        title=result.campaign.name,
        kind="What the model misses",
        verdict=verdict(result),
        tone=TONES[result.verdict],
        lead=_lead(result),
    )
    page.picture(_picture(page, result))
    if len(result.predictions) > 1:
        page.section("Try it", _try_it(page, result))
    if result.unknown is not None:
        page.section("What is unexplained", _unexplained(result))
    if result.indistinguishable or result.next_experiment:
        page.section("Still open", _open(result))
    page.section("Rivals", _rivals(result))
    if result.evidence:
        page.section("Where it was decided", _where(page, result))
    page.section("Before and after", _before_and_after(page, result))
    if result.detectable:
        page.section("What would have shown", _detectable(result))
    page.section("The model", _model(result))
    return page.render()


# ---------------------------------------------------------------- the answer in words


def verdict(result: Diagnosis) -> str:
    """The answer in one sentence."""
    if result.verdict == "adequate":
        return "Nothing detectable is missing: what the model leaves is the sensors' noise."
    found = [_with_rivals(result, e) for e in result.effects]
    if result.verdict == "missing_effect":
        names = listed(found)
        return f"{names[0].upper()}{names[1:]} {'is' if len(found) == 1 else 'are'} missing; with {'it' if len(found) == 1 else 'them'}, what is left is noise."
    beyond = f" beyond {listed(found)}" if found else ""
    if result.unknown is None:
        return f"Something is missing{beyond} that no known effect explains."
    depends = listed([_DEPENDS[d][0] for d in result.unknown.depends_on])
    on = f" that depends on {depends}" if depends else ""
    return f"No known effect explains {_FORCE[result.unknown.channel]}{on}{beyond}."


def _with_rivals(result: Diagnosis, effect: str) -> str:
    rivals = result.indistinguishable.get(effect, ())
    return listed([effect_name(effect), *(effect_name(r) for r in rivals)], "or") if rivals else effect_name(effect)


def _lead(result: Diagnosis) -> str:
    points = []
    first, last = result.steps[0], result.steps[-1]
    if len(result.steps) > 1:
        fall = f"Error over noise falls from {ratio(math.sqrt(first.reduced_chi2))} to {ratio(math.sqrt(last.reduced_chi2))}"
        held = (
            f", on runs left out of the fit from {ratio(first.heldout_nrmse)} to {ratio(last.heldout_nrmse)}"
            if _finite(last.heldout_nrmse)
            else ""
        )
        points.append(f"{fall}{held}.")
    else:
        held = (
            f"; on runs left out of the fit it is {ratio(first.heldout_nrmse)}" if _finite(first.heldout_nrmse) else ""
        )
        points.append(f"Error over noise is {ratio(math.sqrt(first.reduced_chi2))} after the fit{held}.")
    sizes = [
        f"{text(_full_symbol(n))} <strong>{text(_size(result, n))}</strong>" for n in result.parameters if "." in n
    ]
    if sizes:
        points.append("Fitted: " + ", ".join(sizes) + ".")
    if result.unknown is not None:
        points.append(text(result.unknown.sentence))
    for effect, rivals in result.indistinguishable.items():
        points.append(
            f"These data cannot tell {text(effect_name(effect))} from {text(listed([effect_name(r) for r in rivals], 'or'))}."
        )
    if result.next_experiment:
        points.append(f"Next: {text(result.next_experiment)}")
    return "<ul>" + "".join(f"<li>{p}</li>" for p in points) + "</ul>"


# ---------------------------------------------------------------- pictures


def _picture(page: Page, result: Diagnosis) -> str:
    if result.unknown is not None and len(result.unknown.at):
        return page.figure(
            _unknown_figure(result),
            "The force that is missing, as the data show it; the band is ±2 standard deviations.",
        )
    if len(result.steps) > 1:
        return page.figure(_steps_figure(result), "Each step adds one effect and refits everything. 1 is noise alone.")
    if result.detectable:
        return page.figure(
            _detectable_figure(result),
            "The smallest size of each effect that these data would have shown, over the size at which it matters.",
        )
    return ""


def _steps_figure(result: Diagnosis) -> Figure:
    names = ["the model as given"] + [f"+ {effect_name(s.effects[-1])}" if s.effects else "" for s in result.steps[1:]]
    fitted = [math.sqrt(s.reduced_chi2) for s in result.steps]
    held = [s.heldout_nrmse for s in result.steps]

    above = [_finite(h) and h > f for f, h in zip(fitted, held, strict=True)]  # the label that is not between the lines

    def line(values: Sequence[float], name: str, colour: str, top: Sequence[bool], dash: str) -> dict[str, Any]:
        return {
            "type": "scatter", "mode": "lines+markers+text", "x": names, "y": [v if _finite(v) else None for v in values], "name": name,
            "text": [ratio(v) for v in values], "textposition": ["top center" if t else "bottom center" for t in top], "cliponaxis": False, "textfont": {"color": colour},
            "line": {"color": colour, "width": 2.5, "dash": dash}, "marker": {"size": 9, "color": colour},
            "hovertemplate": "%{x}: %{text} × noise",
        }  # fmt: skip

    data = [line(fitted, "runs in the fit", "@after", [not a for a in above], "solid")]
    if any(_finite(h) for h in held):
        data.append(line(held, "runs left out", "@before", above, "dot"))
    values = [v for v in [*fitted, *held] if _finite(v) and v > 0]
    layout = {
        "xaxis": {"type": "category", "range": [-0.35, len(names) - 0.65], "ticks": ""},
        "yaxis": {
            "title": "error / noise",
            "type": "log",
            "range": [math.log10(min([*values, 0.8]) * 0.6), math.log10(max(values) * 1.9)],
            "dtick": 1,
        },
        "shapes": [_noise_line()],
    }
    return Figure(
        data, layout, "Error over noise falling as effects are added, in the fit and on runs left out", 330, fixed=True
    )


def _noise_line() -> dict[str, Any]:
    line = {"color": "@good", "width": 1.5, "dash": "dash"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1, "line": line}


def _unknown_figure(result: Diagnosis) -> Figure:
    unknown = result.unknown
    unit = _FORCE_UNIT.get(unknown.channel, "N")
    at, force, std = (np.asarray(a, float) for a in (unknown.at, unknown.force, unknown.std))
    band = {
        "x": packed(np.concatenate([at, at[::-1]])),
        "y": packed(np.concatenate([force + 2 * std, (force - 2 * std)[::-1]])),
        "type": "scatter", "mode": "lines", "fill": "toself", "fillcolor": "@shade", "line": {"width": 0}, "hoverinfo": "skip", "showlegend": False,
    }  # fmt: skip
    line = {
        "x": packed(at), "y": packed(force), "type": "scatter", "mode": "lines", "line": {"color": "@before", "width": 2.5},
        "showlegend": False, "hovertemplate": "%{x:.4g}: %{y:.3g} " + unit + "<extra></extra>",
    }  # fmt: skip
    on = _DEPENDS[unknown.depends_on[0]][1] if unknown.depends_on else ""
    layout = {
        "xaxis": {"title": on},
        "yaxis": {
            "title": f"{_FORCE[unknown.channel].split(' ', 1)[1]}, {unit}",
            "zeroline": True,
            "zerolinecolor": "@soft",
        },
        "margin": {"l": 8, "r": 8, "t": 10, "b": 8},
    }
    return Figure([band, line], layout, f"The force that no effect explains over {on}", 330)


def _detectable_figure(result: Diagnosis) -> Figure:
    rows = [d for d in sorted(result.detectable, key=lambda d: -d.size / d.typical) if _finite(d.size / d.typical)]
    shares = [d.size / d.typical for d in rows]
    data = {
        "type": "bar", "orientation": "h", "y": [effect_name(d.name) for d in rows], "x": shares, "marker": {"color": "@after"},
        "text": [f"{number(d.size, 2)} {d.unit}".strip() for d in rows], "textposition": "outside", "cliponaxis": False,
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }  # fmt: skip
    layout = {
        "xaxis": {"type": "log", "title": "smallest size that would have shown / size that matters", "dtick": 1},
        "yaxis": {"ticks": "", "tickfont": {"size": 11}},
        "margin": {"l": 8, "r": 70, "t": 8, "b": 8},
        "shapes": [
            {
                "type": "line",
                "x0": 1,
                "x1": 1,
                "yref": "paper",
                "y0": 0,
                "y1": 1,
                "line": {"color": "@good", "width": 1.5, "dash": "dash"},
            }
        ],
    }
    return Figure(
        [data],
        layout,
        "Smallest detectable size of each effect; the table below has the numbers",
        60 + 20 * len(rows),
        fixed=True,
    )


# ---------------------------------------------------------------- the evidence


def _try_it(page: Page, result: Diagnosis) -> str:
    variants = list(result.predictions)
    runs = []
    for i, run in enumerate(result.campaign.runs):
        traces = {}
        for j, channel in enumerate(run.channels):
            rows = run.measured[:, j]
            if rows.any():
                predicted = [result.predictions[v][i][rows, j] for v in variants]
                errors = [result.errors[v][i].get(channel, math.nan) for v in variants]
                traces[channel] = Trace(run.times[rows], run.values[rows, j], predicted, errors)
        runs.append(RunTraces(run.name, _about(run), traces))
    none, whole = variants[0], tuple(result.effects)
    worst = max(
        ((r.name, c) for r, run in zip(runs, result.campaign.runs, strict=True) for c in r.traces if c in run.channels),
        key=lambda rc: _gain(result, none, whole, rc),
    )
    return (
        "<p>Switch an effect off and see which measurements need it. Every combination was fitted beforehand: "
        "its parameters, η and γ and the initial states are the best it can do.</p>"
        + explorer(
            page, runs, result.noise, result.effects, variants, worst, ("without any effect", "with the effects chosen")
        )
    )


def _gain(result: Diagnosis, none: tuple, whole: tuple, where: tuple[str, str]) -> float:
    name, channel = where
    i = next(k for k, run in enumerate(result.campaign.runs) if run.name == name)
    before, after = (result.errors[v][i].get(channel, math.nan) for v in (none, whole))
    return before / after if _finite(before) and _finite(after) and after > 0 else -1.0


def _about(run: Any) -> str:
    if run.pulses is not None:
        return "pulses"
    return f"{number(run.drive_current, 4)} A" if run.drive_current else "coasting"


def _open(result: Diagnosis) -> str:
    parts = []
    for effect, rivals in result.indistinguishable.items():
        names = listed([f"<strong>{text(effect_name(r))}</strong>" for r in rivals], "or")
        parts.append(
            f"<p>Instead of <strong>{text(effect_name(effect))}</strong> it could be {names}: after refitting, these data fit both.</p>"
        )
    if result.next_experiment:
        parts.append(f'<div class="box"><strong>Next experiment.</strong> {text(result.next_experiment)}</div>')
    return "".join(parts)


def _unexplained(result: Diagnosis) -> str:
    return (
        f"<p>{text(result.unknown.sentence)}</p><p class='soft'>The curve is what the data demand once everything else is fitted. As a stand-in it can be added to the "
        "model, so that predictions improve while the physics is sought; it is a description, not an explanation.</p>"
    )


def _rivals(result: Diagnosis) -> str:
    rows = []
    for c in result.candidates:
        sizes = (
            "<br>".join(f"{text(_symbol(n))} = {text(sized(v, s, _unit(result, n)))}" for n, (v, s) in c.sizes.items())
            or "–"
        )
        style = (
            "good-word"
            if c.name in result.effects
            else "warn-word"
            if any(c.name in r for r in result.indistinguishable.values())
            else ""
        )
        judged = f'<span class="{style}">{text(c.words)}</span>' if style else text(c.words)
        rows.append(
            [
                f"{text(effect_name(c.name))}<br><span class='soft'>{text(_summary(result, c.name))}</span>",
                judged,
                number(c.delta_chi2, 4),
                ratio(c.heldout_nrmse),
                sizes,
            ]
        )
    header = ["Effect", "Verdict", "Fall in χ²", "Error, runs left out", "Fitted size"]
    caption = (
        "Each rival was added in place of what was found and everything was refitted. A fall in χ² of 10 is strong evidence, if few were tried; "
        "a size within two of its standard deviations of nothing is no evidence."
    )
    return table(header, rows, caption, words=2, last_words=True)


def _where(page: Page, result: Diagnosis) -> str:
    figures = []
    for by in dict.fromkeys(e.by for e in result.evidence):
        rows = [e for e in result.evidence if e.by == by]
        if len(rows) < 2:
            continue
        data = {
            "type": "bar", "x": [e.label for e in rows], "y": [e.delta_chi2 for e in rows], "marker": {"color": "@after"},
            "hovertemplate": "%{x}: %{y:.4g}<extra></extra>",
        }  # fmt: skip
        layout = {
            "xaxis": {"type": "category", "title": by},
            "yaxis": {"title": "fall in χ²"},
            "margin": {"l": 8, "r": 8, "t": 10, "b": 8},
        }
        figures.append(page.figure(Figure([data], layout, f"Fall in chi squared by {by}", 250)))
    return (
        "<p>By how much the misfit falls where: an effect that only one run or one stretch asks for is less certain than one all ask for.</p>"
        f'<div class="two">{"".join(figures)}</div>'
    )


def _before_and_after(page: Page, result: Diagnosis) -> str:
    variants = list(result.predictions)
    before, after = variants[0], tuple(result.effects)
    channels = result.campaign.channels
    rows = []
    for i, run in enumerate(result.campaign.runs):
        cells = []
        for c in channels:
            b = result.errors[before][i].get(c)
            a = result.errors[after][i].get(c)
            cells.append(
                "–" if b is None else ratio(b) if before == after else f"{ratio(b)} → <strong>{ratio(a)}</strong>"
            )
        rows.append([text(run.name), text(_about(run)), *cells])
    caption = (
        "Error over noise per run and channel, refitted without and with what was found."
        if before != after
        else "Error over noise per run and channel."
    )
    return table(["Run", "Drive", *(text(title(c)) for c in channels)], rows, caption, words=2)


def _detectable(result: Diagnosis) -> str:
    rows = [
        [
            f"{text(effect_name(d.name))}<br><span class='soft'>{text(_summary(result, d.name))}</span>",
            text(d.parameter),
            f"{number(d.size, 3)} {text(d.unit)}",
            f"{number(d.typical, 3)} {text(d.unit)}",
        ]
        for d in sorted(result.detectable, key=lambda d: d.size / d.typical if d.typical else math.inf)
    ]
    return (
        "<p>Had one of these been there at this size, these data would have shown it (nineteen times in twenty). What is smaller may be there unseen.</p>"
        + table(["Effect", "Parameter", "Would have shown", "A size that matters"], rows, words=2)
    )


def _model(result: Diagnosis) -> str:
    rows = [[f"<code>{text(n)}</code>", text(_size(result, n)), text(_meaning(result, n))] for n in result.parameters]
    noise = ", ".join(f"{text(title(c)).lower()} {text(in_channel(c, s))}" for c, s in result.noise.items())
    tests = table(
        ["Test of what is left", "Statistic", "Degrees of freedom", "p"],
        [[text(t.name), number(t.statistic, 4), str(t.dof), number(t.p_value, 2)] for t in result.tests],
    )
    return (
        table(["Parameter", "Value ± standard deviation", "Meaning"], rows, last_words=True)
        + "<p>The improved model is in <code>model.yaml</code>: <code>inductrack compare --model model.yaml</code> reads it, and the simulator node with "
        f"<code>--params-file model.yaml</code>.</p><p class='soft'>Noise: {noise}.</p>"
        + folded("Tests of what is left", tests)
    )


# ---------------------------------------------------------------- names


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _declared(result: Diagnosis, name: str) -> Any:
    effect, _, parameter = name.rpartition(".")
    if not effect:
        return PARAMETERS[name]
    return split_name(effect, result.model.known_effects, CHANNELS)[0].parameters[parameter]


def _unit(result: Diagnosis, name: str) -> str:
    return _declared(result, name).unit


def _meaning(result: Diagnosis, name: str) -> str:
    return _declared(result, name).meaning


def _symbol(name: str) -> str:
    return name.rpartition(".")[2].replace("_", " ")


def _full_symbol(name: str) -> str:
    return f"{effect_name(name.rpartition('.')[0])} {_symbol(name)}"


def _size(result: Diagnosis, name: str) -> str:
    value, std = result.parameters[name]
    return sized(value, std, _unit(result, name))


def _summary(result: Diagnosis, name: str) -> str:
    return split_name(name, result.model.known_effects, CHANNELS)[0].summary
