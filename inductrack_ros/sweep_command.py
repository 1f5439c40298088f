# SPDX-License-Identifier: Apache-2.0
"""``inductrack sweep``: maps for planning runs."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from .core.errors import InputError
from .core.named_values import named_values
from .core.options import SIM
from .core.output_folder import output_folder

if TYPE_CHECKING:
    from .core.model import Model
    from .data.planned import PlannedCampaign
    from .sweep.draws import Draws
    from .sweep.sweep import Plan

#: Where runs start unless told otherwise, as the node's does: the paper's launch.
LAUNCH = SIM["initial_state"].default
#: Samples of a run at most: what one task holds grows with them.
MOST_SAMPLES = 20_000
EPILOG = """examples:
  inductrack sweep --over surge_rate=10:40:61 --over drive_current=0:7000:57 --output maps
  inductrack sweep --over aerodynamic_drag.drag_area=0:0.2:21 --initial surge_rate=25 --output drag
  inductrack sweep --over surge_rate=10:40:31 --model fit/model.yaml --samples 100 --campaign my_campaign --output maps

An axis is NAME=FROM:TO:COUNT, NAME=FROM:TO:COUNT:log or NAME=a,b,c. NAME is a state at the start, a parameter of the model, an effect's
(mass, viscous_drag.coefficient: the effect is then on), drive_current, or a condition that an effect asks for.
With --samples every point is flown again under parameters drawn from the covariance that fit and diagnose write into model.yaml.
Writes report.html and sweep.nc, the numbers (NetCDF; xarray.open_dataset reads it)."""  # noqa: E501


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "--over", metavar="NAME=FROM:TO:COUNT", action="append", required=True, help="an axis; give it once or twice"
    )
    parser.add_argument(
        "--model",
        metavar="MODEL.yaml",
        help="the model, a ROS 2 parameter file (default: the campaign's own, else the paper's)",
    )
    parser.add_argument(
        "--initial",
        metavar="NAME=VALUE,…",
        help=(
            "initial state besides the axes, SI, and conditions; heave: the equilibrium unless given (default:"
            f" {LAUNCH})"
        ),
    )
    parser.add_argument(
        "--drive-current", metavar="A", type=float, help="drive current, 0 to coast (default: the model's, 7000)"
    )
    parser.add_argument("--duration", metavar="S", type=float, default=3.0, help="seconds of a run (default: 3)")
    parser.add_argument(
        "--rate",
        metavar="HZ",
        type=float,
        default=500.0,
        help="samples a second that a run is judged by (default: 500)",
    )
    parser.add_argument(
        "--samples", metavar="N", type=int, help="draws of the parameters at each point (default: none)"
    )
    parser.add_argument("--seed", metavar="SEED", type=int, default=0, help="seed of the draws (default: 0)")
    parser.add_argument(
        "--campaign",
        metavar="DIR",
        help="draw the runs of this campaign.yaml on the maps; they need not have been measured",
    )
    parser.add_argument(
        "--effects",
        metavar="MY_EFFECTS.py",
        action="append",
        default=[],
        help="a file with effects of your own (it is run)",
    )
    parser.add_argument(
        "--scheduler", metavar="tcp://…", help="fly on the workers of this dask scheduler (default: here)"
    )
    parser.add_argument("--output", metavar="DIR", required=True, help="folder for the results; made if need be")
    parser.epilog = EPILOG


def run(arguments: argparse.Namespace) -> None:
    """Sweep; writes ``report.html`` and ``sweep.nc``."""
    _check(arguments)
    from .progress import progress, say_notes
    from .workers import workers

    _needs_xarray()
    planned = _planned(arguments.campaign)
    with output_folder(arguments.output, planned and planned.folder) as folder:
        plan = _plan(arguments, planned)
        from .reports.sweep_report import SweepReport, render, verdict
        from .sweep.netcdf import write
        from .sweep.planned import place
        from .sweep.sweep import sweep

        say_notes(planned.notes if planned else ())
        placed = place(plan, planned.runs) if planned else ()
        with progress() as tell, workers(arguments.scheduler) as hands:
            found = sweep(plan, hands, tell)
        report = SweepReport(found, placed, planned.name if planned else "", planned.notes if planned else ())
        write(found, placed, folder / "sweep.nc")
        (folder / "report.html").write_text(render(report), encoding="utf-8")
    print(verdict(report))
    print(Path(arguments.output) / "report.html")


def _check(arguments: argparse.Namespace) -> None:
    for name, unit in (("duration", "s"), ("rate", "Hz")):
        value = getattr(arguments, name)
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"--{name} {value:g}: must be above 0 {unit}")
    samples = round(arguments.duration * arguments.rate)
    if not 6 <= samples <= MOST_SAMPLES:
        raise InputError(f"--duration × --rate is {samples} samples a run; give 6 to {MOST_SAMPLES}")
    if arguments.samples is not None and arguments.samples < 1:
        raise InputError(
            f"--samples {arguments.samples}: give 1 or more, or leave it out for the model's own parameters alone"
        )
    if not 0 <= arguments.seed < 2**31:
        raise InputError(f"--seed {arguments.seed}: must lie in [0, {2**31 - 1}]")


def _needs_xarray() -> None:
    """Raise `InputError` before any work where the numbers could not be written."""
    from importlib.util import find_spec

    if find_spec("xarray") is None:
        raise InputError("sweep needs xarray: pip install xarray, or apt install python3-xarray")


def _planned(folder: str | None) -> PlannedCampaign | None:
    if folder is None:
        return None
    from .data.planned import planned_runs

    return planned_runs(folder)


def _plan(arguments: argparse.Namespace, planned: PlannedCampaign | None) -> Plan:
    """What is to be flown, all of it checked."""
    from .core.parameters import PARAMETERS
    from .core.state import STATES
    from .sweep.axes import read_axes
    from .sweep.sweep import Plan

    model, file = _model(arguments, planned)
    model, axes = read_axes(arguments.over, model)
    swept = [a.name for a in axes]
    if arguments.drive_current is not None:
        if "drive_current" in swept:
            raise InputError("--drive-current and --over drive_current: give one of them")
        model = model.with_changes(
            {"drive_current": PARAMETERS["drive_current"].check("--drive-current", arguments.drive_current)}
        )
    given = named_values("" if "surge_rate" in swept else LAUNCH, "--initial", LAUNCH)
    given |= named_values(arguments.initial or "", "--initial", LAUNCH)
    if twice := [n for n in given if n in swept]:
        raise InputError(f"--initial: {twice[0]} is an axis of the sweep already; leave it out of one of them")
    conditions = {n: v for n, v in given.items() if any(n in item.conditions for item in model.known_effects.values())}
    model = model.with_changes(conditions={**model.conditions, **conditions})
    initial = {n: v for n, v in given.items() if n not in conditions}
    model.initial_state(**{"heave": 0.0} | initial)  # complains of unknown names
    initial = {n: initial[n] for n in STATES if n in initial}
    draws = _draws(arguments, model, file, swept)
    return (
        Plan(model, axes, initial, arguments.duration, arguments.rate, draws)
        if draws
        else Plan(model, axes, initial, arguments.duration, arguments.rate)
    )


def _model(arguments: argparse.Namespace, planned: PlannedCampaign | None) -> tuple[Model, str | Path | None]:
    """The model, and the file that it comes from."""
    from .core.model import Model

    file = arguments.model or (planned.model if planned else None)
    model = (
        Model.load(file, arguments.effects, trusted=bool(arguments.model))
        if file
        else Model.create(effect_files=arguments.effects)
    )
    if model.drive == "pulses":
        raise InputError(f"{file}: drive: pulses needs the controller node, which fires them; set drive: averaged here")
    return model, file


def _draws(arguments: argparse.Namespace, model: Model, file: str | Path | None, swept: list[str]) -> Draws | None:
    if arguments.samples is None:
        return None
    from .core.uncertainty import Uncertainty
    from .sweep.draws import draw
    from .sweep.sweep import MOST_RUNS

    if arguments.samples > MOST_RUNS:
        raise InputError(f"--samples {arguments.samples}: at most {MOST_RUNS} runs are flown in all")
    known = Uncertainty.load(file) if file else None
    if known is None:
        raise InputError(
            f"--samples: {file or 'the paper’s model'} carries no covariance; give --model a model.yaml that inductrack"
            " fit or diagnose wrote"
        )
    fixed = [*swept, *(["drive_current"] if arguments.drive_current is not None else [])]
    return draw(known, model, fixed, arguments.samples, arguments.seed)
