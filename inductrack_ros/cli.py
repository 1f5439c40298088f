"""The command line: arguments in, files out, exit status 0, 2 for wrong input, 130 when interrupted.

Each command is a pair of functions, one that declares its arguments and one that runs; `COMMANDS` lists them. What
is slow to import is imported by the one that runs, so that `-h` answers at once.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from .core.errors import InputError
from .core.named_values import named_values
from .core.output_folder import output_folder
from .progress import progress, say_findings, say_notes
from .terminal import speak_to_any_terminal

if TYPE_CHECKING:
    from .checks import Finding
    from .core.model import Model
    from .data import Campaign

#: Where `simulate` starts unless told otherwise, as the node does: the paper's launch.
LAUNCH = "surge_rate=15.5"
MOST_SAMPLES = 10_000_000


@dataclass(frozen=True)
class Command:
    """A subcommand: ``arguments`` declares its options on a parser, ``run`` does it."""

    name: str
    summary: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], None]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status."""
    speak_to_any_terminal()
    arguments = _parser().parse_args(argv)
    who = f"inductrack {arguments.command.name}"
    try:
        arguments.command.run(arguments)
        sys.stdout.flush()
    except InputError as error:
        print(f"{who}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # `inductrack … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        print(f"{who}: {place}{error.strerror or error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:  # with what was kept, where anything was
        print(f"{who}: interrupted; {str(error) or 'nothing was written'}", file=sys.stderr)
        return 130
    return 0


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line, like every other."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} -h\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="inductrack",
        description="Simulate the Inductrack maglev cradle of Kim and Ge (2012); find out what a model of it misses.",
        epilog="inductrack COMMAND -h says more about each.",
        allow_abbrev=False,
    )
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for command in COMMANDS:
        sub = commands.add_parser(
            command.name,
            help=command.summary,
            description=command.summary[0].upper() + command.summary[1:] + ".",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        command.arguments(sub)
        sub.set_defaults(command=command)
    return parser


# ---------------------------------------------------------------- what commands share


def _model_argument(parser: argparse.ArgumentParser, otherwise: str) -> None:
    parser.add_argument(
        "--model", metavar="MODEL.yaml", help=f"the model, a ROS 2 parameter file (default: {otherwise})"
    )


def _campaign_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("campaign", metavar="CAMPAIGN", help="a folder with campaign.yaml and the runs it lists")
    _model_argument(parser, "the campaign's own, else the paper's")
    parser.add_argument("--output", metavar="DIR", required=True, help="folder for the results; made if need be")
    parser.add_argument(
        "--effects",
        metavar="MY_EFFECTS.py",
        action="append",
        default=[],
        help="a file with effects of your own (it is run)",
    )


def _read(arguments: argparse.Namespace) -> tuple[Campaign, Model]:
    """The campaign as it is read and the model it is held against."""
    from .data import load_campaign

    campaign = load_campaign(arguments.campaign)
    say_notes(campaign.notes)
    return campaign, campaign.load_model(arguments.model, arguments.effects)


def _load(arguments: argparse.Namespace) -> tuple[Campaign, Model, tuple[Finding, ...]]:
    """The campaign without what a look at its data sets aside, the model, and what the look found, which is said.

    Raises `InputError` where the data cannot be meant as they are written, before any physics is named.
    """
    from .checks import admit

    campaign, model = _read(arguments)
    campaign, findings = admit(campaign, model)
    say_findings(findings)
    return campaign, model, findings


# ---------------------------------------------------------------- simulate


def _simulate_arguments(parser: argparse.ArgumentParser) -> None:
    _model_argument(parser, "the paper's")
    parser.add_argument(
        "--initial",
        metavar="NAME=VALUE,…",
        default=LAUNCH,
        help=f"initial state, SI; heave: the equilibrium at that speed unless given, the rest 0 (default: {LAUNCH})",
    )
    parser.add_argument("--duration", metavar="S", type=float, default=3.0, help="seconds to simulate (default: 3)")
    parser.add_argument("--rate", metavar="HZ", type=float, default=500.0, help="samples a second (default: 500)")
    parser.add_argument(
        "--drive-current", metavar="A", type=float, help="drive current, 0 to coast (default: the model's, 7000)"
    )
    parser.add_argument(
        "--output", metavar="RUN.csv|BAG", required=True, help="a .csv file, or else a rosbag2 folder to be made"
    )
    parser.epilog = (
        "example:\n  inductrack simulate --initial surge_rate=16.1,sway=0.004 --duration 2 --output run.csv\n\n"
        "writes time, surge, sway, heave, roll and their rates; a bag has the topics that the sim node publishes.\n"
        "An existing CSV is replaced, an existing bag is not."
    )


def _simulate(arguments: argparse.Namespace) -> None:
    initial = named_values(arguments.initial, "--initial", LAUNCH)
    if not (math.isfinite(arguments.duration) and arguments.duration > 0):
        raise InputError(f"--duration {arguments.duration:g}: must be above 0 s")
    if not (math.isfinite(arguments.rate) and arguments.rate > 0):
        raise InputError(f"--rate {arguments.rate:g}: must be above 0 Hz")
    samples = arguments.duration * arguments.rate
    if samples > MOST_SAMPLES:
        raise InputError(f"--duration × --rate is {samples:g} samples; at most {MOST_SAMPLES} are written")
    output = Path(arguments.output)
    is_csv = output.suffix.lower() == ".csv"
    if os.path.lexists(output) and (output.is_dir() if is_csv else True):
        raise InputError(f"--output {output}: exists already; choose another name or delete it first")
    if not output.absolute().parent.is_dir():
        raise InputError(f"--output {output}: there is no folder {output.parent}; create it first")

    import numpy as np

    from .core.flight import story, why
    from .core.model import Model
    from .core.parameters import PARAMETERS
    from .core.state import STATES
    from .data import write_bag, write_csv

    model = Model.load(arguments.model) if arguments.model else Model.default()
    if model.drive == "pulses":
        raise InputError(
            f"{arguments.model}: drive: pulses needs the controller node, which fires them; set drive: averaged here"
        )
    if arguments.drive_current is not None:
        PARAMETERS["drive_current"].check("--drive-current", arguments.drive_current)
    times = np.arange(round(arguments.duration * arguments.rate) + 1) / arguments.rate
    start = model.initial_state(drive_current=arguments.drive_current, **initial)
    run = model.simulate(times, start, arguments.drive_current)
    lost = np.flatnonzero(~np.isfinite(run.states).all(axis=1))
    if lost.size:
        raise InputError(
            f"the simulation leaves all bounds at {times[lost[0]]:g} s; look at --initial and the model's parameters"
        )
    columns = {name: run[name] for name in STATES}
    if is_csv:
        write_csv(output, times, columns, overwrite=True)
    else:
        write_bag(output, times, columns)
    print(f"{output}: {times[-1]:g} s, {len(times)} samples; {story(run)}")
    if reason := why(model, run, start, arguments.drive_current):
        print(reason)


# ---------------------------------------------------------------- check


def _check_arguments(parser: argparse.ArgumentParser) -> None:
    _campaign_arguments(parser)
    parser.epilog = (
        "Clocks, single samples, sensors, noise, and whether the channels fit each other and the model's motion. Prints one\n"
        "line for each finding, worst first; what cannot be so stops compare and diagnose, what is left out they leave out.\n"
        "Writes check.json and report.html. The exit status is 0 whatever is found."
    )


def _check(arguments: argparse.Namespace) -> None:
    campaign, model = _read(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .checks.check import check, write_check
        from .reports.check_report import check_report, verdict

        result = check(campaign, model)
        write_check(result, folder)
        (folder / "report.html").write_text(check_report(result), encoding="utf-8")
    print(verdict(result))
    for finding in result.findings:
        print(finding.said)
    print(f"{Path(arguments.output) / 'report.html'}")


# ---------------------------------------------------------------- compare


def _compare_arguments(parser: argparse.ArgumentParser) -> None:
    _campaign_arguments(parser)
    parser.epilog = (
        "Fits nothing but the initial states that campaign.yaml does not give.\n"
        "Writes comparison.json, report.html and, for each run, RUN.predicted.csv."
    )


def _compare(arguments: argparse.Namespace) -> None:
    campaign, model, findings = _load(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .compare import compare
        from .comparison.files import write_results
        from .reports.compare_report import compare_report, verdict

        with progress() as tell:
            tell(f"predicting {len(campaign.runs)} runs from their start, and from anew every 0.2 s")
            result = replace(compare(campaign, model), findings=findings)
        write_results(result, folder)
        (folder / "report.html").write_text(compare_report(result), encoding="utf-8")
    print(verdict(result))
    print(f"{Path(arguments.output) / 'report.html'}")


# ---------------------------------------------------------------- diagnose


def _diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    _campaign_arguments(parser)
    parser.add_argument("--scheduler", metavar="tcp://…", help="do the refits on the workers of this dask scheduler (default: here)")
    parser.epilog = (
        "Fits the free parameters and every run's initial state, decides whether anything is missing, and if so which\n"
        "effect, how large, and what run would settle what these data leave open. A minute for a dozen runs; Ctrl-C\n"
        "while it searches reports what was found until then.\n"
        "Writes report.html, diagnosis.json and model.yaml, the improved model."
    )


def _diagnose(arguments: argparse.Namespace) -> None:
    campaign, model, findings = _load(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .diagnosis.diagnose import diagnose
        from .reports.diagnosis_report import diagnosis_report, verdict
        from .workers import workers

        with progress() as tell, workers(arguments.scheduler) as hands:
            result = replace(diagnose(campaign, model, tell, hands), findings=findings)
        result.write(folder)
        (folder / "report.html").write_text(diagnosis_report(result, notes=campaign.notes), encoding="utf-8")
    print(verdict(result))
    if result.next_experiment and not result.interrupted:
        print(f"Next experiment: {result.next_experiment}")
    print(f"{Path(arguments.output) / 'report.html'}")
    if result.interrupted:
        raise KeyboardInterrupt(f"what was found until then was kept in {arguments.output}")


# ---------------------------------------------------------------- add


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "effect", metavar="EFFECT", help="an effect's name; a sensor's with its channel: sensor_delay:heave"
    )
    _campaign_arguments(parser)
    parser.epilog = (
        "Refits everything with the effect and without it, and shows how far the error falls.\n"
        "Writes report.html, diagnosis.json and model.yaml, the model with the effect."
    )


def _add(arguments: argparse.Namespace) -> None:
    campaign, model, findings = _load(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .diagnosis.add import add_effect
        from .reports.diagnosis_report import addition, diagnosis_report

        with progress() as tell:
            result = replace(add_effect(campaign, model, arguments.effect, tell), findings=findings)
        result.write(folder)
        (folder / "report.html").write_text(diagnosis_report(result, addition(result), campaign.notes), encoding="utf-8")
    print(addition(result))
    print(f"{Path(arguments.output) / 'report.html'}")


# ---------------------------------------------------------------- the table


def _delivered(module: str) -> tuple[Callable[[argparse.ArgumentParser], None], Callable[[argparse.Namespace], None]]:
    """A command that another module of the package delivers as ``add_arguments(parser)`` and ``run(arguments)``."""

    def arguments(parser: argparse.ArgumentParser) -> None:
        import_module(module, __package__).add_arguments(parser)

    def run(given: argparse.Namespace) -> None:
        import_module(module, __package__).run(given)

    return arguments, run


COMMANDS = (
    Command("simulate", "simulate one run into a CSV or a bag, without ROS", _simulate_arguments, _simulate),
    Command("check", "look at a campaign's data before any fit: clocks, units, signs, bad samples, noise", _check_arguments, _check),
    Command("compare", "show where a model fails to predict a campaign's measurements", _compare_arguments, _compare),
    Command("diagnose", "find out which effect a model misses, if any", _diagnose_arguments, _diagnose),
    Command("add", "add one effect by hand, refit, and show how far the error falls", _add_arguments, _add),
    Command(
        "fit",
        "fit parameters to travel distances or campaigns, and say how well they are known",
        *_delivered(".fit_command"),
    ),
    Command("paper", "reproduce Kim and Ge (2012) on one page", *_delivered(".paper.command")),
    Command("watch", "show running nodes live, list topics, print one", *_delivered(".nodes.watch_command")),
)

if __name__ == "__main__":
    sys.exit(main())
