# SPDX-License-Identifier: Apache-2.0
"""The page on effects says what the code does: its table is the declarations', its example is an effect that works."""

import math
import re
import subprocess
import sys
from pathlib import Path

from inductrack_ros.core import effects_table
from inductrack_ros.core.effects import catalogue, load_effects

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")


def test_the_table_is_what_the_command_prints():
    command = [sys.executable, "-m", "inductrack_ros.core.effects_table"]
    printed = subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=ROOT, encoding="utf-8"
    ).stdout.strip()
    assert printed == effects_table.text()
    assert printed in PAGE, (
        "docs/effects.md is out of date: put in what python -m inductrack_ros.core.effects_table prints"
    )


def test_every_effect_of_the_catalogue_is_on_the_page():
    for item in catalogue().values():
        assert item.name in PAGE or (item.name.startswith("stand_in_") and item.name.removeprefix("stand_in") in PAGE)
        assert item.summary != item.name, f"{item.name} has no docstring"
        assert all(p.meaning for p in item.parameters.values())


def test_the_example_on_the_page_works(tmp_path):
    """The ten lines, copied out, are the file in examples/."""
    code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
    (tmp_path / "copied.py").write_text(code)
    copied = load_effects([tmp_path / "copied.py"])["magnetised_patch"]
    shipped = load_effects([ROOT / "examples" / "my_effect.py"])["magnetised_patch"]
    assert copied.parameters == shipped.parameters
    assert copied.summary == shipped.summary
    for surge in (0.0, 7.5, 8.0, 9.0):
        assert copied.function(surge, 3.0, 8.0) == shipped.function(surge, 3.0, 8.0)
    assert copied.function(8.5, 3.0, 8.0) == -3.0 * math.exp(-1.0)
