# SPDX-License-Identifier: Apache-2.0
"""``inductrack fit``: parameters from travel distances, from time series, or from both."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from .core.errors import InputError
from .core.named_values import named_values
from .core.output_folder import output_folder

if TYPE_CHECKING:
    from .core.model import Model
    from .data import Campaign

EPILOG = """examples:
  inductrack fit travels.csv --std 0.05 --output fit
  inductrack fit my_campaign --output fit
  inductrack fit travels.csv my_campaign --std 0.05 --free eta,gamma,mass --output fit

A CSV of distances has the header initial_speed,travel (m/s, m) and, if wanted, the columns duration (s), drive_current (A) and std (m).
Writes report.html, fit.json and model.yaml, the model with the fitted values."""  # noqa: E501


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "data",
        metavar="DATA",
        nargs="+",
        help="a CSV of travel distances, or a campaign's folder; one of each may be given",
    )
    parser.add_argument(
        "--model", metavar="MODEL.yaml", help="the model to start from (default: the campaign's own, else the paper's)"
    )
    parser.add_argument(
        "--free",
        metavar="NAME,…",
        help="parameters to fit, e.g. eta,gamma,aerodynamic_drag.drag_area (default: the campaign's, else eta,gamma)",
    )
    parser.add_argument(
        "--start",
        metavar="NAME=VALUE,…",
        default="",
        help="values to start from, e.g. eta=1,gamma=3 (default: the model's)",
    )
    parser.add_argument(
        "--duration",
        metavar="S",
        type=float,
        help="time the distances were covered in, where the CSV does not say (default: 2)",
    )
    parser.add_argument(
        "--std",
        metavar="M",
        type=float,
        help="standard deviation of a distance, where the CSV does not say (default: estimated)",
    )
    parser.add_argument(
        "--effects",
        metavar="MY_EFFECTS.py",
        action="append",
        default=[],
        help="a file with effects of your own (it is run)",
    )
    parser.add_argument("--output", metavar="DIR", required=True, help="folder for the results; made if need be")
    parser.epilog = EPILOG


def run(arguments: argparse.Namespace) -> None:
    """Fit; writes ``report.html``, ``fit.json`` and ``model.yaml``."""
    from .checks import admit
    from .core.plain_json import file_text
    from .core.uncertainty import Uncertainty
    from .data import load_campaign
    from .estimation.identify import Identification, verdict
    from .estimation.misfits import DURATION, JointMisfit, SeriesMisfit, TravelMisfit, read_travels
    from .progress import progress, say_findings, say_notes
    from .reports.fit_report import FitReport, render, results

    table, folder = _data(arguments)
    travels = read_travels(table, arguments.duration or DURATION, arguments.std or math.nan) if table else None
    campaign = load_campaign(folder) if folder else None
    with output_folder(arguments.output, campaign and campaign.folder) as written:
        free, model = _model(arguments, campaign)
        campaign, findings = admit(campaign.against(model), model) if campaign else (None, ())
        notes = (*(travels.notes if travels else ()), *(campaign.notes if campaign else ()))
        say_notes(notes)
        say_findings(findings)
        travel = TravelMisfit(model, free, travels) if travels is not None else None
        series = SeriesMisfit(campaign, model, free) if campaign is not None else None
        parts = [p for p in (travel, series) if p is not None]
        start = series.start if series is not None else [_value(model, n) for n in free]
        question = Identification(parts[0] if len(parts) == 1 else JointMisfit(parts), start)
        with progress() as tell:
            tell("least squares, then Nelder–Mead from the same start")
            fit = question.fit()
            profiles = []
            for name in free:
                tell(f"profile likelihood of {name}")
                profiles.append(question.profile(fit, name))
        name = campaign.name if campaign else ""
        report = FitReport(fit, profiles, verdict(fit, profiles), travels, name, travel, series, notes, findings)
        fitted = with_values(model, dict(zip(free, fit.values.tolist(), strict=True)))
        (written / "report.html").write_text(render(report), encoding="utf-8")
        (written / "fit.json").write_text(file_text(results(report)), encoding="utf-8")
        fitted.save(
            written / "model.yaml", f"Fitted by inductrack fit: {', '.join(free)}", Uncertainty(free, fit.covariance)
        )
    print(report.words)
    print(Path(arguments.output) / "report.html")


def _data(arguments: argparse.Namespace) -> tuple[str | None, str | None]:
    """The table of distances and the campaign's folder that were given."""
    for name in ("duration", "std"):
        value = getattr(arguments, name)
        if value is not None and not (math.isfinite(value) and value > 0):
            raise InputError(f"--{name} {value:g}: must be above 0")
    tables = [d for d in arguments.data if Path(d).suffix.lower() == ".csv"]
    folders = [d for d in arguments.data if d not in tables]
    if len(tables) > 1 or len(folders) > 1:
        raise InputError(f"{arguments.data[-1]}: give at most one CSV of distances and one campaign")
    return next(iter(tables), None), next(iter(folders), None)


def _model(arguments: argparse.Namespace, campaign: Campaign | None) -> tuple[tuple[str, ...], Model]:
    """Names of the parameters to fit, and the model that the fit starts from."""
    from .core.model import Model

    if campaign is not None:
        model = campaign.load_model(arguments.model, arguments.effects)
    elif arguments.model:
        model = Model.load(arguments.model, arguments.effects)
    else:
        model = Model.create(effect_files=arguments.effects)
    if arguments.free:
        free = tuple(n.strip() for n in arguments.free.split(","))
    else:
        free = campaign.free if campaign else ("eta", "gamma")
    start = named_values(arguments.start, "--start", "eta=1")
    for name in start:
        if name not in free:
            raise InputError(f"--start: '{name}' is not among the free parameters {', '.join(free)}; add it to --free")
    return free, with_values(model, start)


def with_values(model: Model, values: Mapping[str, float]) -> Model:
    """``model`` with parameters set by full name."""
    base = {n: v for n, v in values.items() if "." not in n}
    effects = {e: dict(p) for e, p in model.effects.items()}
    for name, value in values.items():
        effect, dot, parameter = name.rpartition(".")
        if dot:
            effects.setdefault(effect, {})[parameter] = value
    return model.with_changes(base, effects)


def _value(model: Model, name: str) -> float:
    """The model's value of a parameter by full name."""
    from .estimation.misfits import declarations

    declarations(model, [name])
    effect, dot, parameter = name.rpartition(".")
    return model.effects[effect][parameter] if dot else model.parameters[name]
