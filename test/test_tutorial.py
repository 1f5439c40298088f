# SPDX-License-Identifier: Apache-2.0
"""docs/tutorial.md, as a reader would type it: every `sh` block in order in one shell, each `text` block awaited."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import threading
from pathlib import Path

import pytest
from conftest import BIN, LONG, PATIENCE, wait_until

from inductrack_ros.core.compiled import cache_folder
from inductrack_ros.data import read_bag

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
CHAPTERS = re.split(r"^(?=## )", TEXT, flags=re.MULTILINE)
INSTALL, UNKNOWN = (next(c for c in CHAPTERS if c.startswith(f"## {n}. ")) for n in (1, 8))
#: The installation is that of the tests; what the Makefile would do is looked at only.
PRELUDE = """
make() { command make --dry-run "$@"; }
source() { test "$1" = .venv/bin/activate; }
"""


class Shell:
    """One bash that is fed block by block; what it and its background jobs say is one text."""

    def __init__(self, home: Path) -> None:
        path = f"{BIN}{os.pathsep}{os.environ['PATH']}"
        environment = os.environ | {"HOME": str(home), "INDUCTRACK_CACHE": str(cache_folder()), "PATH": path}
        self._bash = subprocess.Popen(
            ["bash"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=ROOT,
            env=environment,
            start_new_session=True,
        )
        self.said, self._blocks = "", 0
        threading.Thread(target=self._listen, daemon=True).start()
        self._bash.stdin.write(PRELUDE)

    def _listen(self) -> None:
        for line in self._bash.stdout:
            self.said += line

    def run(self, block: str) -> int:
        """Type a block and wait for its end; returns where its words begin. A last command that fails fails the
        test."""
        begin, self._blocks = len(self.said), self._blocks + 1
        end = f"block {self._blocks} ended with"
        self._bash.stdin.write(f"{block}\necho {end} $?\n")
        self._bash.stdin.flush()
        # A whole diagnosis.
        wait_until(lambda: re.search(f"{end} \\d+\n", self.said), f"the end of:\n{block}", patience=LONG)
        status = re.search(f"{end} (\\d+)\n", self.said)[1]
        assert status == "0" or block.startswith("kill"), self.said[begin:]
        return begin

    def close(self) -> None:
        """End it and all that it started, also where a block has not come back."""
        try:
            self._bash.stdin.write("kill $(jobs -p)\nwait\n")
            self._bash.stdin.close()
            self._bash.wait(PATIENCE)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._bash.pid, signal.SIGKILL)
            self._bash.wait()


def typed(home: Path, chapters: list[str]) -> str:
    """Type the chapters into one shell and wait for all that they promise; what it said."""
    blocks = [b for chapter in chapters for b in re.findall(r"```(sh|text)\n(.*?)```", chapter, re.DOTALL)]
    shell, begin = Shell(home), 0
    try:
        for kind, block in blocks:
            if kind == "sh":
                begin = shell.run(block)
            else:
                wait_until(lambda: block.strip() in shell.said[begin:], f"{block!r} in\n{shell.said}")  # noqa: B023
    finally:
        shell.close()
    assert "Traceback" not in shell.said and "command not found" not in shell.said, shell.said
    return shell.said


@pytest.mark.long
def test_every_command_of_the_tutorial_does_what_it_says(tmp_path):
    typed(tmp_path, [c for c in CHAPTERS if c != UNKNOWN])
    bags = list((tmp_path / "tutorial/rig").glob("driven_*"))
    # Simulated, however busy the machine is.
    assert len(bags) == 3 and min(read_bag(bag).times[-1] for bag in bags) > 1.59
    found = json.loads((tmp_path / "tutorial/report/diagnose/diagnosis.json").read_text())
    angle = found["parameters"]["track_slope.angle"]
    hidden = float(re.search(r"angle: ([\d.]+)", TEXT)[1])
    assert found["effects"] == ["track_slope"] and abs(angle["value"] - hidden) < 5 * angle["std"] < 0.2 * hidden
    added = json.loads((tmp_path / "tutorial/report/mine/diagnosis.json").read_text())
    assert [round(s["reduced_chi2"]) for s in added["steps"]][-1] == 1 < added["steps"][0]["reduced_chi2"] / 1.5
    assert {"compare", "diagnose", "after", "mine"} == {
        p.parent.name for p in (tmp_path / "tutorial/report").glob("*/report.html")
    }


@pytest.mark.nightly
def test_an_unknown_force_becomes_a_law_and_the_monitor_goes_quiet(tmp_path):
    """The last chapter, by itself: the law that is proposed is the force that the rig hides."""
    typed(tmp_path, [INSTALL, UNKNOWN])
    report = tmp_path / "tutorial/report"
    found = json.loads((report / "strange/diagnosis.json").read_text())
    assert found["verdict"] == "unknown_effect" and found["unknown"]["channel"] == "heave"
    law = next(x for x in found["laws"] if x["name"] == "proposed_bump_heave_on_surge")["parameters"]
    force, place, width = (
        float(re.search(p, UNKNOWN)[1]) for p in (r"{force: ([\d.]+)}", r"surge - ([\d.]+)", r"/ ([\d.]+)\)")
    )
    for name, true in (("force", -force), ("place", place), ("width", width)):
        assert abs(law[name]["value"] - true) < 5 * law[name]["std"] < 0.5 * abs(true), name
    added = json.loads((report / "law/diagnosis.json").read_text())
    assert added["effects"] == ["proposed_bump_heave_on_surge"] and round(added["steps"][-1]["reduced_chi2"]) == 1


def test_links_lead_to_files():
    for link in re.findall(r"\]\((?!https?:)([^)#]+)", TEXT):
        assert (ROOT / "docs" / link).exists(), link
