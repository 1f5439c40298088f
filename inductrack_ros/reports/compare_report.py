# SPDX-License-Identifier: Apache-2.0
"""The report of `inductrack compare`: does this model predict these measurements, and where does it not."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..compare import HOLDS_LIMIT, HOLDS_SAMPLES, WINDOW
from ..comparison.outstanding import Region
from ..comparison.result import Comparison, RunComparison, Stretch
from ..core.errors import InputError
from ..core.flight import AT_REST
from ..core.model import Model
from ..core.state import STATES
from .explorer import Opening, RunTraces, Trace, explorer
from .page import Figure, Page, bullets, folded, joined, markup, table
from .words import effect_name, in_channel, listed, number, ratio, shown, title

#: Up to here the error is the noise's, give or take chance and estimated noise; above the second the model is off.
NOISE_ALONE, PLAINLY = 1.1, 3.0
#: Parameters that are named where a model was refitted; of more only how many.
NAMED = 3
#: Height (px) of a channel's row in the first figure, and of all rows together at most: the page's first screen.
ROW, ROWS = 38, 380

_BY = {
    "speed": ("Speed", "m/s", 1.0),
    "gap": ("Top gap", "mm", 1e3),
    "place": ("Place along the track", "m", 1.0),
    "contact": ("Contact", "", 1.0),
}
#: A region between two limits, above one, below one.
_WHERE = {
    "speed": ("between {} and {} m/s", "above {} m/s", "below {} m/s"),
    "gap": ("at a top gap of {} to {} mm", "at a top gap above {} mm", "at a top gap below {} mm"),
    "place": ("from {} to {} m along the track", "beyond {} m of the track", "before {} m of the track"),
}


def compare_report(result: Comparison) -> str:
    """The whole page."""
    page = Page(
        title=result.campaign.name,
        kind="Model against measurements",
        verdict=verdict(result),
        tone="good" if result.error <= NOISE_ALONE else "warn" if result.error <= PLAINLY else "bad",
        lead=_lead(result),
        notes=result.campaign.notes,
        findings=result.findings,
    )
    page.picture(
        page.figure(_matrix(result), "RMS of measured minus predicted, over the sensor's noise. 1 is a perfect model.")
    )
    worst = result.worst_run
    page.section(
        "Traces",
        explorer(
            page,
            [_traces(r, result.noise) for r in result.runs],
            result.noise,
            opening=Opening(
                (worst.run.name, _worst_channel(worst)), ("by this model", ""), result.error <= NOISE_ALONE
            ),
        ),
    )
    page.section("Where it fails" if result.error > NOISE_ALONE else "By speed, gap and place", _where(page, result))
    page.section("Runs", _runs(result))
    page.section("Assumptions", _basis(result))
    return page.render()


# ---------------------------------------------------------------- the answer in words


def verdict(result: Comparison) -> str:
    """The answer in one sentence."""
    runs = "the one run" if len(result.runs) == 1 else f"all {len(result.runs)} runs"
    if result.error <= NOISE_ALONE:
        return f"The model predicts {runs} to within the sensors' noise."
    if math.isinf(result.error):
        lost = [r.run.name for r in result.runs if math.isinf(r.error)]
        named = listed(lost[:3]) + (" and others" if len(lost) > 3 else "")
        return f"The model loses {named}: the simulation leaves all bounds."
    worst = result.worst_channel
    miss = result.errors[worst]
    size = f"{in_channel(worst, miss * result.noise[worst], 2)}, {ratio(miss)} times the sensor's noise"
    where = f", worst in {result.worst_run.run.name}" if len(result.runs) > 1 else ""
    return f"The model misses {title(worst).lower()} by {size}{where}."


def _lead(result: Comparison) -> str:
    errors = result.errors
    within = [title(c).lower() for c in errors if errors[c] <= NOISE_ALONE]
    points = []
    if within and result.error > NOISE_ALONE:
        points.append(f"Within noise: {listed(within)}.")
    if result.error > NOISE_ALONE:
        times = [r.holds_for for r in result.runs if r.holds_for is not None]
        if times:
            whole = len(result.runs) - len(times)
            tail = f"; {whole} of {len(result.runs)} runs never leave it" if whole else ""
            span = dict.fromkeys((number(min(times), 2), number(max(times), 2)))
            points.append(f"Predictions leave the noise after {'–'.join(span)} s{tail}.")
        if place := _outstanding(result):
            points.append(markup("<strong>{}</strong> (when restarted every {:g} s).", place, WINDOW))
    if result.hardly_known:
        names = listed(result.hardly_known)
        points.append(f"No bands are drawn: {names} {'is' if len(result.hardly_known) == 1 else 'are'} hardly known.")
    if result.known:
        points.append(_openness(result))
    points.append(model_words(result))
    if result.error > NOISE_ALONE:
        points.append(
            markup(
                "<code>inductrack diagnose</code> refits the parameters and says which effect is missing, if one is."
            )
        )
    return bullets(points)


def _openness(result: Comparison) -> str:
    """How much of the error the uncertainty of the parameters explains."""
    names = listed(result.known[:NAMED])
    more = f" and {len(result.known) - NAMED} more" if len(result.known) > NAMED else ""
    left = result.beyond_bands
    said = (
        "explains the error"
        if left <= NOISE_ALONE
        else f"does not explain the error: {ratio(left)} times both are left"
    )
    known = f"What is known of {names}{more} leaves the predictions open by the bands in the traces."
    return known if result.error <= NOISE_ALONE else f"{known} With the noise, that {said}."


def _outstanding(result: Comparison) -> str:
    """Where most goes wrong; regions that the runs cannot tell apart are named together."""
    found = result.outstanding
    if found is None:
        return ""
    where = listed([_region_words(r) for r in found.regions], "or")
    apart = " (these runs cannot tell which)" if len(found.regions) > 1 else ""
    return f"Most goes wrong {where}{apart}, in {title(found.channel).lower()}"


def _region_words(region: Region) -> str:
    if region.by == "contact":
        return "while an array touches"
    between, above, below = _WHERE[region.by]
    factor = _BY[region.by][2]
    low, high = (None if v is None else number(v * factor, 4) for v in (region.low, region.high))
    if low is None or high is None:
        return below.format(high) if low is None else above.format(low)
    return between.format(low, high)


def model_words(result: Comparison) -> str:
    """The model in words: its effects, and the parameters that are not those of the campaign's, or else the paper's,
    model."""
    model, campaign = result.model, result.campaign
    whose, base = "the paper's", Model.default()
    if campaign.model is not None:
        try:
            whose, base = "the campaign's", campaign.load_model(None, model.effect_files)
        except InputError:  # its effect files were not named; the parameters are then held against the paper's
            pass
    changed = [n for n, v in model.parameters.items() if v != base.parameters[n]]
    values = [f"{n} {number(model.parameters[n], 5)} instead of {number(base.parameters[n], 5)}" for n in changed]
    named = ", ".join(values[:NAMED]) + (f" and {len(values) - NAMED} more" if len(values) > NAMED else "")
    added = [effect_name(e) for e in model.effects if e not in base.effects]
    effects = f"{listed(added)} added to {whose} model" if added else f"{whose} model, no effect added"
    return f"Model: {effects}{f', refitted: {named}' if changed else ''}."


def _worst_channel(r: RunComparison) -> str:
    errors = {c: e for c, e in r.errors.items() if not math.isnan(e)}
    return max(errors, key=lambda c: errors[c])


# ---------------------------------------------------------------- the evidence


def _matrix(result: Comparison) -> Figure:
    names = [r.run.name for r in result.runs]
    channels = list(reversed(result.channels))
    errors = [[r.errors.get(c, math.nan) for r in result.runs] for c in channels]
    flat = [e for row in errors for e in row if math.isfinite(e)]
    top = math.log10(max([*flat, 10.0]))
    data = {
        "type": "heatmap",
        "x": names,
        "y": [title(c) for c in channels],
        "z": [[None if math.isnan(e) else min(math.log10(max(e, 1e-3)), top) for e in row] for row in errors],
        "zmin": 0.0,
        "zmax": top,
        "colorscale": [[0, "@low"], [math.log10(NOISE_ALONE) / top, "@low"], [1, "@before"]],
        "text": [["" if math.isnan(e) else ratio(e) for e in row] for row in errors],
        "showscale": False,
        "xgap": 2,
        "ygap": 2,
        "hovertemplate": "%{x}, %{y}: %{text} × noise<extra></extra>",
    }
    if len(names) <= 16:
        data |= {"texttemplate": "%{text}", "textfont": {"size": 12}}
    layout = {
        "xaxis": {"type": "category", "ticks": "", "showgrid": False, "tickangle": -45 if len(names) > 4 else 0},
        "yaxis": {"ticks": "", "showgrid": False},
        "margin": {"l": 8, "r": 8, "t": 8, "b": 8},
    }
    return Figure(
        [data],
        layout,
        "Error over noise of every channel and run; the table of runs has the numbers",
        120 + min(ROW * len(channels), ROWS),
        fixed=True,
    )


def _traces(r: RunComparison, noise: Mapping[str, float]) -> RunTraces:
    traces = {}
    errors = r.errors
    for i, channel in enumerate(r.run.channels):
        rows = r.run.measured[:, i]
        if rows.any():
            band = None if r.band is None else r.band[rows, i] * noise[channel]
            traces[channel] = Trace(
                r.run.times[rows], r.run.values[rows, i], [r.predicted[rows, i]], [errors[channel]], band
            )
    return RunTraces(r.run.name, _about(r), traces)


def _about(r: RunComparison) -> str:
    return f"{number(r.initial_state.get('surge_rate', 0.0), 3)} m/s, {r.run.driven}"


def _where(page: Page, result: Comparison) -> str:
    restarted = any(s.restarted is not None for s in result.stretches)
    figures = joined(
        page.figure(_stretch_figure(of_kind, by, result.error <= NOISE_ALONE))
        for by in _BY
        if len(of_kind := [s for s in result.stretches if s.by == by]) > 1
    )
    meaning = (
        markup(
            "<p><strong>Open loop</strong>, an error stays once it is made. <strong>Restarted</strong> every {:g} s"
            " from a state fitted to that window, only what goes wrong there and then is left: it points at the place,"
            " the speed or the touch where the model fails. An error that is small everywhere and only adds up (a"
            " little drag) shows in the open loop alone.</p>",
            WINDOW,
        )
        if restarted
        else markup("<p>Open loop: an error stays once it is made.</p>")
    )
    channels = result.channels
    rows = [
        [
            _BY[s.by][0],
            _stretch_name(s),
            f"{s.samples}",
            markup("<strong>{}</strong>", ratio(s.error)),
            ratio(s.restarted),
            *(_both(s, c) for c in channels),
        ]
        for s in result.stretches
    ]
    header = ["Stretch", "", "Samples", "All channels", "Restarted", *(title(c) for c in channels)]
    numbers = table(
        header,
        rows,
        "RMS error over noise of all samples in the stretch, all runs together; in brackets restarted.",
        words=2,
    )
    return meaning + markup('<div class="two">{}</div>', figures) + folded("The same as a table, per channel", numbers)


def _both(s: Stretch, channel: str) -> str:
    afresh = s.restarted_errors.get(channel)
    tail = markup(' <span class="soft">({})</span>', ratio(afresh)) if afresh is not None else ""
    return ratio(s.errors.get(channel)) + tail


def _stretch_figure(stretches: list[Stretch], by: str, well: bool) -> Figure:
    name, unit, factor = _BY[by]
    if by == "contact":
        where: list[object] = [_stretch_name(s) for s in stretches]
        width: list[float] | None = None
    else:
        where = [0.5 * (s.low + s.high) * factor for s in stretches]
        width = [(s.high - s.low) * factor * 0.45 for s in stretches]
    shift = 0.225 if width else 0.0

    def bars(values: list[float | None], label: str, colour: str, side: int) -> dict[str, object]:
        bar = {
            "type": "bar",
            "name": label,
            "x": [
                x + side * shift * (s.high - s.low) * factor if width else x
                for x, s in zip(where, stretches, strict=True)
            ],
            "y": [None if v is None or not math.isfinite(v) else v for v in values],
            "customdata": [_stretch_name(s) for s in stretches],
            "marker": {"color": colour},
            "hovertemplate": "%{customdata}: %{y:.3g} × noise",
        }
        return bar | ({"width": width} if width else {})

    data = [bars([s.error for s in stretches], "open loop", "@after" if well else "@before", -1)]
    if any(s.restarted is not None for s in stretches):
        data.append(
            bars(
                [s.restarted for s in stretches], f"restarted every {WINDOW:g} s", "@measured" if well else "@after", 1
            )
        )
    tops = [v for s in stretches for v in (s.error, s.restarted) if v is not None and math.isfinite(v)]
    layout = {
        "barmode": "overlay" if width else "group",
        "xaxis": {"title": f"{name}, {unit}" if unit else name},
        "yaxis": {
            "title": "error / noise",
            "type": "log",
            "range": [math.log10(0.5), math.log10(max([*tops, 3.0]) * 1.3)],
            "dtick": 1,
        },
        "shapes": [_noise_line()],
    }
    return Figure(data, layout, f"Error over noise by {name.lower()}; the table below has the numbers", 260)


def _noise_line() -> dict[str, object]:
    line = {"color": "@good", "width": 1.5, "dash": "dash"}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 1, "y1": 1, "line": line}


def _stretch_name(s: Stretch) -> str:
    if s.by == "contact":
        return "while an array touches" if s.low else "in free flight"
    _, unit, factor = _BY[s.by]
    return f"{number(s.low * factor, 4)}–{number(s.high * factor, 4)} {unit}"


def _runs(result: Comparison) -> str:
    channels = result.channels
    rows = []
    for r in sorted(result.runs, key=lambda r: -r.error):
        holds = "to its end" if r.holds_for is None else f"{number(r.holds_for, 2)} s"
        errors, rmse = r.errors, r.rmse
        cells = [
            (
                markup('{} <span class="soft">({})</span>', ratio(errors[c]), in_channel(c, rmse[c], 2))
                if c in errors
                else "–"
            )
            for c in channels
        ]
        about = _about(r)
        rows.append(
            [
                r.run.name,
                about,
                f"{number(r.run.duration, 3)} s",
                markup("<strong>{}</strong>", ratio(r.error)),
                *cells,
                holds,
            ]
        )
    header = ["Run", "Start, drive", "Length", "All", *(title(c) for c in channels), "Holds for"]
    caption = (
        "RMS error over noise, in brackets in its own unit. A prediction holds until its RMS error over "
        f"{HOLDS_SAMPLES} samples exceeds {HOLDS_LIMIT:g} × noise."
    )
    return table(header, rows, caption, words=2)


def _basis(result: Comparison) -> str:
    noise = table(
        ["Channel", "Noise (standard deviation)", ""],
        [
            [
                title(c),
                in_channel(c, s),
                "given in campaign.yaml" if c in result.noise_given else "estimated from the data",
            ]
            for c, s in result.noise.items()
        ],
    )
    states = table(
        ["Run", *(f"{title(s)}, {shown(s)[1]}" for s in STATES)],
        [
            [
                r.run.name,
                *(number(r.initial_state[s] * shown(s)[0], 4) + ("" if s in r.estimated else " *") for s in STATES),
            ]
            for r in result.runs
        ],
        "* given; the others are fitted to as much of the run's beginning as the model follows; nothing else is.",
    )
    parameters = table(
        ["Parameter", "Value"],
        [[k, number(v, 6)] for k, v in result.model.to_mapping().items() if isinstance(v, float)],
    )
    contact = (
        f"Slower than {AT_REST:g} m/s counts as rest; an array touches where its gap is within two noises of zero."
    )
    return (
        noise
        + markup(
            "<p class='soft'>Speed, gap, place and contact are as measured where they were measured, else as"
            " predicted. "
        )
        + markup("{}</p>", contact)
        + folded("Initial states", states)
        + folded("Parameters of the model", parameters)
    )
