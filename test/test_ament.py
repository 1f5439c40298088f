# SPDX-License-Identifier: Apache-2.0
"""The linters of ROS 2, each where it is installed: on a distribution all, with the wheels flake8 and pep257."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ["inductrack_ros", "launch", "setup.py"]
REST = ["test", "benchmarks", "examples", "docs"]  # a colcon workspace need not have them
#: How our docstrings differ from the convention `ament`: the first sentence may take two lines and need not command.
OTHERWISE = ["D205", "D208", "D209", "D213", "D400", "D401", "D402", "D403", "D415"]


@pytest.fixture(autouse=True)
def at_the_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def test_flake8():
    linter = pytest.importorskip("ament_flake8.main")
    status, errors = linter.main_with_errors(argv=["--config", "setup.cfg", *PACKAGE])
    assert status == 0, "\n".join(errors)


def test_pep257(capfd):
    linter = pytest.importorskip("ament_pep257.main")
    assert linter.main(argv=["--add-ignore", *OTHERWISE, "--", *PACKAGE]) == 0, capfd.readouterr().err


def test_copyright(capfd):
    """`ament_copyright` knows whole licence headers and no SPDX lines, so it looks at LICENSE alone; see below."""
    linter = pytest.importorskip("ament_copyright.main")
    assert linter.main(argv=["LICENSE"]) == 0, capfd.readouterr().err


def test_xmllint(capfd):
    linter = pytest.importorskip("ament_xmllint.main")
    if shutil.which("xmllint") is None:
        pytest.skip("xmllint is not installed")
    status, said = linter.main(argv=["package.xml"]), capfd.readouterr().err
    if "failed to load external entity" in said:
        pytest.skip("the schema on download.ros.org cannot be reached")
    assert status == 0, said


def test_every_source_file_says_its_licence():
    files = [Path("setup.py"), *(f for folder in (*PACKAGE, *REST) for f in sorted(Path(folder).rglob("*.py")))]
    assert len(files) > 200
    without = [str(f) for f in files if "SPDX-License-Identifier: Apache-2.0" not in f.read_text("utf-8")[:100]]
    assert not without


def test_sphinx_can_read_every_docstring():
    """`make docs` and rosdoc2 make pages of them; a fold in an item of a list was an error there."""
    publish_doctree = pytest.importorskip("docutils.core").publish_doctree  # comes with colcon
    documented = ast.Module, ast.ClassDef, ast.FunctionDef
    wrong, read = [], 0
    for path in sorted(Path("inductrack_ros").rglob("*.py")):
        nodes = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, documented)]
        for text in filter(None, map(ast.get_docstring, nodes)):
            read += 1
            tree = publish_doctree(text, settings_overrides={"report_level": 5, "halt_level": 5})
            wrong += [
                f"{path}: {said.astext()} {text[:60]!r}"
                for said in tree.findall(lambda node: node.tagname == "system_message" and node["level"] > 1)
            ]
    assert read > 1000 and not wrong, "\n".join(wrong)
