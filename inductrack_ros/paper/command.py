# SPDX-License-Identifier: Apache-2.0
"""``inductrack paper``: Kim and Ge (2012), reproduced on one page."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..core.output_folder import output_folder

#: What takes long, in words, and the part of `Reproduction` that it is.
STEPS = {
    "the paper's runs and claims": "claims",
    "small motions at 90 speeds": "modes",
    "identification from four distances": "identified",
    "a hundred identifications": "coverage",
    "other choices of four speeds": "choices",
    "the drive, pulse by pulse": "drive",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "--model", metavar="MODEL.yaml", help="another rig than the paper's (default: config/paper.yaml)"
    )
    parser.add_argument(
        "--output", metavar="DIR", required=True, help="folder for report.html and paper.json; made if need be"
    )
    parser.epilog = (
        "example:\n  inductrack paper --output paper\n\nTakes half a minute. The page has every table, figure and claim"
        " of the paper beside what the model gives."
    )


def run(arguments: argparse.Namespace) -> None:
    """Reproduce the paper; writes ``report.html`` and ``paper.json``."""
    from ..core.model import Model
    from ..core.plain_json import file_text
    from ..progress import progress
    from .facts import load_facts
    from .output import config_file
    from .page import render
    from .reproduction import Reproduction, results, verdict

    with output_folder(arguments.output) as folder:
        model = Model.load(arguments.model or config_file("paper.yaml"))
        work = Reproduction(model.with_changes(dof=4, drive="averaged"), load_facts())
        with progress() as tell:
            for words, part in STEPS.items():
                tell(words)
                getattr(work, part)
        (folder / "report.html").write_text(render(work), encoding="utf-8")
        (folder / "paper.json").write_text(file_text(results(work)), encoding="utf-8")
    print(verdict(work.claims.rows))
    print(Path(arguments.output) / "report.html")
