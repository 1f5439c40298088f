# SPDX-License-Identifier: Apache-2.0
"""What README.md and docs/ say is true: tables are the code's, commands exist, links lead somewhere."""

from __future__ import annotations

import ast
import os
import re
import shlex
import textwrap
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest
import yaml

from inductrack_ros import cli
from inductrack_ros.core.effects import catalogue, load_effects
from inductrack_ros.core.model import Model
from inductrack_ros.core.parameters import PARAMETERS as MODEL
from inductrack_ros.data import load_campaign
from inductrack_ros.diagnosis.diagnose import base_fit
from inductrack_ros.diagnosis.moves import State, Task, screened
from inductrack_ros.nodes import interface_tables, monitor, play, record
from inductrack_ros.nodes.launching import ARGUMENTS
from inductrack_ros.nodes.parameters import MODEL_OPTIONS
from inductrack_ros.nodes.sim import OWN
from inductrack_ros.nodes.track_controller import DECLARED

ROOT = Path(__file__).parents[1]
README, USAGE, INSTALLATION, INTERFACES = (
    (ROOT / name).read_text(encoding="utf-8")
    for name in ("README.md", "docs/usage.md", "docs/installation.md", "docs/interfaces.md")
)
BLOCKS = re.findall(r"```(\w*)\n(.*?)```", README + USAGE + INSTALLATION, re.DOTALL)
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
#: Programs that are not ours and take nothing of ours.
FOREIGN = {"sudo", "pip", "mkdir", "source", "export", "rosdep"}
PARAMETERS = {
    "sim": {**OWN, **MODEL_OPTIONS, **MODEL},
    "track_controller": DECLARED,
    "monitor": {**monitor.OWN, **MODEL_OPTIONS, **MODEL},
}


def commands() -> list[list[str]]:
    """Every command of the shell blocks as words, without remarks, each once."""
    lines = "\n".join(text for kind, text in BLOCKS if kind == "sh").splitlines()
    parts = [re.split(r"\s+&&\s+", line) for line in lines]
    found = [shlex.split(one, comments=True) for part in parts for one in part]
    return [list(words) for words in dict.fromkeys(map(tuple, found)) if words]


@pytest.fixture(scope="module")
def tables() -> str:
    return interface_tables.text()  # conftest.py has claimed a ROS domain


def test_the_tables_are_what_the_command_prints(tables):
    kept = re.search(r"<!-- interface tables: begin -->\n(.*)\n<!-- interface tables: end -->", INTERFACES, re.DOTALL)[
        1
    ]
    wrong = (
        "docs/interfaces.md is out of date: put between its markers what python -m"
        " inductrack_ros.nodes.interface_tables prints"
    )
    assert kept.strip() == tables, wrong
    assert "python -m inductrack_ros.nodes.interface_tables" in INTERFACES


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_every_command_exists(words, tables, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    check(words, tables)
    for word in words:  # files of the repository
        if word.startswith(("examples/", "config/", "docs/", "launch/", "test/", "src/inductrack_ros/")):
            assert (ROOT / word.removeprefix("src/inductrack_ros/")).exists(), word


def check(words: list[str], tables: str) -> None:
    name, *rest = words
    if name == "make":
        assert set(rest) <= set(re.search(r"\.PHONY: (.*)", (ROOT / "Makefile").read_text())[1].split())
    elif name == "python":
        assert (ROOT / rest[0]).is_file()
    elif name == "inductrack":
        if rest != ["-h"]:
            cli._parser().parse_args(rest)  # leaves with an error for what it does not know
            effect = rest[1] if rest[0] == "add" else "track_slope"
            assert effect in catalogue()
    elif name in ("record", "play"):
        {"record": record, "play": play}[name].parse(rest)
    elif name in PARAMETERS:
        check_parameters(name, rest)
    elif name == "ros2":
        check_ros2(rest, tables)
    elif name == "colcon":
        assert rest == ["build", "--packages-select", "inductrack_ros"]
    elif name in ("mv", "echo", "cd", "ln"):
        pass  # what they make is tried below
    else:
        assert name in FOREIGN, f"{name}: not a command that README may name"


def check_parameters(node: str, words: list[str]) -> None:
    assert node in {e.name for e in entry_points(group="console_scripts")}
    assert not words or words[0] == "--ros-args"
    for option, value in zip(words[1::2], words[2::2], strict=True):
        if option == "-p":
            parameter, _, given = value.partition(":=")
            declared = PARAMETERS[node][parameter]
            declared.check(parameter, yaml.safe_load(given))
        else:
            assert option == "--params-file" and value.endswith(".yaml")


def check_ros2(words: list[str], tables: str) -> None:
    if words[0] == "launch":
        assert words[1] == "inductrack_ros" and (ROOT / "launch" / words[2]).is_file()
        for name, _, value in (word.partition(":=") for word in words[3:]):
            assert value in (ARGUMENTS[name].choices or [value])
    elif words[0] == "run":
        assert words[1] == "inductrack_ros"
        check(words[2:], tables)
    elif words[:2] == ["param", "set"]:
        node = words[2].rpartition("/")[2]
        PARAMETERS[node][words[3]].check(words[3], yaml.safe_load(words[4]))
        assert f"`{words[3]}`*" in tables, f"{words[3]} cannot be set while the node runs"
    elif words[:2] == ["service", "call"]:
        assert f"| `{words[2]}` | {words[3].replace('/srv/', '/')} |" in tables
    else:
        assert words[:3] == ["bag", "record", "--regex"] and words[3].startswith("/inductrack/")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_link_leads_to_a_file_and_a_heading(page):
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", page.read_text(encoding="utf-8")):
        file, _, heading = target.partition("#")
        to = (page.parent / file) if file else page
        assert to.exists(), target
        if heading:
            titles = re.findall(r"^#+ (.*)$", to.read_text(encoding="utf-8"), re.MULTILINE)
            anchors = {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}
            assert heading in anchors, target


def test_every_page_is_in_the_contents():
    """Sphinx warns of a page that no table of contents names, and `make docs` fails on a warning."""
    named = re.findall(r"^   ([\w/]+)$", (ROOT / "docs" / "index.rst").read_text(encoding="utf-8"), re.MULTILINE)
    assert {p.stem for p in (ROOT / "docs").glob("*.md")} <= set(named)


def test_the_readme_is_short():
    """A page and a half, with a picture, and every page of docs/ is one of those to read on."""
    assert len(README.splitlines()) <= 90
    (picture,) = re.findall(r"!\[[^]]+\]\(([^)]+)\)", README)
    assert (ROOT / picture).read_bytes().startswith(b"\x89PNG")
    assert {p.name for p in (ROOT / "docs").glob("*.md")} - {"contributing.md"} <= set(
        re.findall(r"\(docs/([\w.]+)\)", README)
    )


def test_the_campaign_that_it_writes_can_be_read(tmp_path):
    """The lines that `echo` writes are those of a campaign and its model."""
    from inductrack_ros.data import load_campaign

    written = {w[3]: w[1] for w in commands() if w[0] == "echo"}
    assert "rig/campaign.yaml" in written
    for file, text in written.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    for run in yaml.safe_load(written["rig/campaign.yaml"])["runs"]:
        bag = tmp_path / "rig" / run["file"]
        cli.main(["simulate", "--duration", "0.1", "--output", str(bag)])
    campaign = load_campaign(tmp_path / "rig")
    assert len(campaign.runs) == 1
    if campaign.model:
        Model.load(campaign.model)


def test_the_effect_on_the_page_works(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(next(text for kind, text in BLOCKS if kind == "python"))
    model = Model.create(effects={"cable_drag": {"force": 5.0}}, effect_files=[file])
    assert load_effects([file])["cable_drag"].summary.startswith("A cable")
    assert model.effects["cable_drag"] == {"force": 5.0}
    assert [load_effects([file])["cable_drag"].function(v, 5.0) for v in (2.0, 0.0, -2.0)] == [-5.0, 0.0, 5.0]


def test_numbers_and_names_of_the_text():
    assert f"says which of {sum(e.screened for e in catalogue().values())} further effects" in " ".join(README.split())
    needed = ast.parse((ROOT / "setup.py").read_text())
    keywords = {k.arg: k.value for n in ast.walk(needed) if isinstance(n, ast.Call) for k in n.keywords}
    rows = INSTALLATION.partition("## What it depends on")[2].partition("\n## ")[0]
    for name in [*ast.literal_eval(keywords["install_requires"]), *ast.literal_eval(keywords["extras_require"])]:
        assert f"`{re.split('[<>=]', name)[0]}`" in rows, name


def test_the_security_note_is_true():
    """The nodes leave DDS to the environment; only the demo and the tests claim a domain, on this machine alone."""
    asked = {
        str(p.relative_to(ROOT))
        for p in (ROOT / "inductrack_ros").rglob("*.py")
        if re.search(r"claim_domain\(|AUTOMATIC_DISCOVERY_RANGE", p.read_text(encoding="utf-8"))
    }
    assert asked == {f"inductrack_ros/{n}" for n in ("demo.py", "nodes/domain.py", "nodes/interface_tables.py")}
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert 40 <= int(os.environ["ROS_DOMAIN_ID"]) <= 99


def test_what_the_recipes_name_exists():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    files = {f for f in re.findall(r"`([\w./]+\.(?:py|md|rst|yaml|xml))`", text) if "/" in f} - {
        "inductrack_ros/core/effects/drive_lag.py",
        "inductrack_ros/core/channels/top_load.py",
    }
    assert len(files) > 20
    for name in files:
        assert (ROOT / name).exists() or (ROOT / "inductrack_ros" / name).exists(), name
    sources = "".join(p.read_text(encoding="utf-8") for p in (ROOT / "inductrack_ros").rglob("*.py"))
    for name in set(re.findall(r"`(_?[A-Z_]{3,}|_\w+)`", text)):
        assert re.search(rf"^(def |\s+def |class )?{name}\b", sources, re.MULTILINE), name
    recipes = re.findall(r"^### (.*)", text, re.MULTILINE)
    assert len(recipes) == 6


def test_the_tests_that_pages_name_exist():
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    named = {n for page in pages for n in re.findall(r"(test_\w+\.py)(?:::(\w+))?", page.read_text(encoding="utf-8"))}
    assert len(named) > 20
    for file, function in named:
        (found,) = (ROOT / "test").rglob(file)
        assert f"def {function}" in found.read_text(encoding="utf-8"), (file, function)


#: Noise of the channels of a small rig.
SIZES = {
    "surge": 5e-4, "sway": 3e-5, "heave": 3e-5, "roll": 1e-4,
    "surge_rate": 0.02, "sway_rate": 2e-3, "heave_rate": 2e-3, "roll_rate": 5e-3,
}  # fmt: skip


def found_by_its_state(model, folder):
    """The first recipe's effect promises most, and about its size, where a rig has it: its state begins on the thrust,
    which a screening has to follow."""
    rig = model.with_changes(effects={"recipe_lag": {"time_constant": 0.02}})
    rng = np.random.default_rng(3)
    folder.mkdir()
    times = np.linspace(0.0, 0.8, 401)
    for i, speed in enumerate((18.0, 22.0)):
        y = rig.simulate(times, rig.initial_state(surge_rate=speed)).outputs[:, :8]
        y = y + rng.standard_normal(y.shape) * list(SIZES.values())
        np.savetxt(
            folder / f"{i}.csv",
            np.column_stack([times, y]),
            delimiter=",",
            header="time," + ",".join(SIZES),
            comments="",
        )
    description = {
        "name": "late",
        "noise_std": SIZES,
        "runs": [{"file": f"{i}.csv", "drive_current": 7000.0} for i in range(2)],
    }
    (folder / "campaign.yaml").write_text(yaml.safe_dump(description))
    problem, base, _ = base_fit(load_campaign(folder), model)
    best = screened(Task(problem, tuple(SIZES)), State(base)).singles[0]
    assert best.labels == ("recipe_lag",)
    typical = model.known_effects["recipe_lag"].parameters["time_constant"].typical
    assert best.sizes["recipe_lag"][0] * typical == pytest.approx(0.02, rel=0.5)


def test_the_effects_of_the_recipes_work(tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.DOTALL)
    sources = [textwrap.dedent(block) for block in blocks if "@effect" in block]
    files = [tmp_path / f"effect_{i}.py" for i in range(len(sources))]
    for file, source in zip(files, sources, strict=True):
        source = source.replace("from . import", "from inductrack_ros.core.effects import")
        file.write_text(source.replace("drive_lag", "recipe_lag"))  # whoever follows the recipe has one of that name
    model = Model.create(
        {"contact_stiffness": 1e3},
        {"recipe_lag": {"time_constant": 0.05}, "hertz_contact": {"stiffness": 1e9}},
        effect_files=files,
    )
    state = model.with_effect_states([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    fallen = model.advance(state, 0.0, 0.5, drive_current=0.0)
    sunk = -fallen[2] - model.parameters["nominal_gap"]
    assert 1e9 * sunk**1.5 + 1e3 * sunk == pytest.approx(
        model.parameters["mass"] * model.parameters["gravity"], rel=1e-3
    )
    found_by_its_state(Model.create(effect_files=files), tmp_path / "late")
    lagging = model.with_effect_states([0.0, 0.0, -0.005, 0.0, 20.0, 0.0, 0.0, 0.0])
    lagging[-1] = 0.0  # no thrust yet
    assert model.quantities(lagging)["thrust"] == 0.0
