# SPDX-License-Identifier: Apache-2.0
"""The command line: arguments in, files out, exit status 0, 2 for wrong input, 130 when interrupted.

Each command is a pair of functions, one that declares its arguments and one that runs; `COMMANDS` lists them. What
is slow to import is imported by the one that runs, so that `-h` answers at once.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from .core.errors import InputError
from .core.memory import room_to_begin, too_little
from .core.output_folder import output_folder
from .progress import progress, say_findings, say_notes
from .terminal import speak_to_any_terminal

if TYPE_CHECKING:
    from .core.model import Model
    from .data import Campaign


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
        return _run(arguments, who)
    except OSError:  # nothing can be said: the disk that standard error goes to is full, or its reader has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
        return 2


def _run(arguments: argparse.Namespace, who: str) -> int:
    """The exit status of a command; one line to standard error where it is not 0."""
    try:
        _stand_somewhere()
        room_to_begin()
        arguments.command.run(arguments)
        sys.stdout.flush()
    except InputError as error:
        print(f"{who}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # `inductrack … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        place = f"{error.filename}: " if error.filename else "standard output: " if _cannot_be_written() else ""
        print(f"{who}: {place}{error.strerror or error}", file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f"{who}: {too_little(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:  # with what was kept, where anything was
        print(f"{who}: interrupted; {str(error) or 'nothing was written'}", file=sys.stderr)
        return 130
    return 0


def _cannot_be_written() -> bool:
    """Whether standard output takes not even the end of a line; what it still holds is thrown away then."""
    try:
        print(flush=True)
        return False
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return True


def _stand_somewhere() -> None:
    """Raise InputError where the current folder is gone, from which every name is taken."""
    try:
        os.getcwd()
    except OSError:
        raise InputError("the current folder is gone; change into one that exists") from None


class _Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line, like every other."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} -h\n")


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        print(f"{parser.prog} {version('inductrack_ros')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="inductrack",
        description="Simulate the Inductrack maglev cradle of Kim and Ge (2012); find out what a model of it misses.",
        epilog="inductrack COMMAND -h says more about each.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version of this package")
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
    model = campaign.load_model(arguments.model, arguments.effects)
    campaign = campaign.against(model)
    say_notes(campaign.notes)
    return campaign, model


# ---------------------------------------------------------------- check


def _check_arguments(parser: argparse.ArgumentParser) -> None:
    _campaign_arguments(parser)
    parser.epilog = (
        "Clocks, single samples, sensors, noise, and whether the channels fit each other and the model's motion. Prints"
        " one\nline for each finding, worst first; what cannot be so stops compare and diagnose, what is left out they"
        " leave out.\nWrites check.json and report.html. The exit status is 0 whatever is found."
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
        "Fits nothing but the initial states that campaign.yaml does not give. Where MODEL.yaml says how well its\n"
        "parameters are known, as fit, diagnose and add write it, the page shows how far the predictions are open.\n"
        "Writes comparison.json, report.html and, for each run, RUN.predicted.csv."
    )


def _compare(arguments: argparse.Namespace) -> None:
    campaign, model = _read(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .compare import compare
        from .comparison.files import write_results
        from .core.uncertainty import Uncertainty
        from .reports.compare_report import compare_report, verdict

        with progress() as tell:
            tell(f"predicting {len(campaign.runs)} runs from their start, and from anew every 0.2 s")
            file = arguments.model or campaign.model
            result = compare(campaign, model, say_findings, Uncertainty.load(file) if file else None)
        write_results(result, folder)
        (folder / "report.html").write_text(compare_report(result), encoding="utf-8")
    print(verdict(result))
    print(f"{Path(arguments.output) / 'report.html'}")


# ---------------------------------------------------------------- diagnose


def _seconds(text: str) -> float:
    """A time that is allowed, s."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not value > 0:
        raise argparse.ArgumentTypeError(f"'{text}' is no time in seconds; give a positive number")
    return value


def _diagnose_arguments(parser: argparse.ArgumentParser) -> None:
    _campaign_arguments(parser)
    parser.add_argument(
        "--scheduler", metavar="tcp://…", help="do the refits on the workers of this dask scheduler (default: here)"
    )
    parser.add_argument(
        "--budget",
        metavar="SECONDS",
        type=_seconds,
        default=float("inf"),
        help="give the best answer found within this time (default: no limit)",
    )
    parser.add_argument("--explain", action="store_true", help="print every step of the search with its reason")
    parser.epilog = (
        "Fits the free parameters and every run's initial state, decides whether anything is missing, and if so"
        " which\neffect, how large, and what run would settle what these data leave open. A minute for a dozen runs;"
        " Ctrl-C\nwhile it searches reports what was found until then.\nWrites report.html, diagnosis.json and"
        " model.yaml, the improved model; for a force that no known effect explains also\nproposed_effects.py and"
        " model_proposed.yaml, where a closed form describes it."
    )


def _diagnose(arguments: argparse.Namespace) -> None:
    campaign, model = _read(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .diagnosis.diagnose import diagnose
        from .reports.diagnosis_report import diagnosis_report
        from .reports.diagnosis_words import verdict
        from .workers import workers

        with progress() as tell, workers(arguments.scheduler) as hands:
            result = diagnose(campaign, model, tell, hands, say_findings, arguments.budget)
        result.write(folder)
        (folder / "report.html").write_text(diagnosis_report(result, notes=campaign.notes), encoding="utf-8")
    if arguments.explain:
        print("\n".join(f"{number}. {line}" for number, line in enumerate(result.log, 1)))
    print(verdict(result))
    if result.next_experiment and not result.unfinished:
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
    campaign, model = _read(arguments)
    with output_folder(arguments.output, campaign.folder) as folder:
        from .diagnosis.add import add_effect
        from .reports.diagnosis_report import diagnosis_report
        from .reports.diagnosis_words import addition

        with progress() as tell:
            result = add_effect(campaign, model, arguments.effect, tell, say_findings)
        result.write(folder)
        (folder / "report.html").write_text(
            diagnosis_report(result, addition(result), campaign.notes), encoding="utf-8"
        )
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
    Command(
        "simulate",
        "simulate a run or a campaign, as it is or as sensors measure it, without ROS",
        *_delivered(".simulate_command"),
    ),
    Command(
        "sweep",
        "map what runs would do over one or two parameters, initial states or currents, to plan with",
        *_delivered(".sweep_command"),
    ),
    Command(
        "check",
        "look at a campaign's data before any fit: clocks, units, signs, bad samples, noise",
        _check_arguments,
        _check,
    ),
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
